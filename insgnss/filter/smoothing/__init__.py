"""Estimates from the whole log: the smoother, times between epochs, other points of the body."""
