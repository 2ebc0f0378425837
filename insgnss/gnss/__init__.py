"""Satellites, signals, atmosphere, range model, noise model and the single-point solution."""
