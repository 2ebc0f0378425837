"""Inertial samples on their way into the filter: gaps, bad samples, spikes, sensors that are out."""
