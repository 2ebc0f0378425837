"""The error-state filter: state, prediction, scalar updates, gating, the engine and the compiled loop over a log."""
