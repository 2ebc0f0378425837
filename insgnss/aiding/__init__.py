"""Loop aiding: predictions for the tracking channels of a receiver, and their uncertainty."""
