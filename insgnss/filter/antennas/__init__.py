"""Several antennas in the filter: phase differences as rows, their integers, what the airframe hides."""
