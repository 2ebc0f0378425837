"""The single-point solution: least squares, its integrity tests, and a log of such epochs."""
