"""The outside world's files become tables: inertial and GNSS logs, RINEX, references; and the flight names them."""
