"""The consistency study of a run."""
