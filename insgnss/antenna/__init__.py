"""Antennas on a vehicle: their field of view, the airframe's obstructions, and a receiver's decisions."""
