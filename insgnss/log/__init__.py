"""Readers that turn files into tables: inertial and GNSS logs, RINEX, references; and the flight that names them."""
