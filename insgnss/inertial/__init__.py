"""Strapdown inertial navigation: increments, mechanization, error dynamics, sensor and clock models, alignment."""
