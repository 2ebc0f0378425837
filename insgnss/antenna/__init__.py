"""Antennas on a vehicle: what they see, what the airframe hides, and what a receiver should do about it."""
