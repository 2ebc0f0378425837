"""Several antennas in the filter: phase differences as rows, their integers, the airframe's obstructions."""
