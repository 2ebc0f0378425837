"""The manoeuvre study, and the covariance on its way through a scenario."""
