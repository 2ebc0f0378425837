"""Inertial and other sensor logs: axes, units, times, faults."""
