"""The receiver study on samples of the signal."""
