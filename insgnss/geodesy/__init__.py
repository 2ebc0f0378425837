"""The Earth's shape, gravity and rotation, and the rotations between frames."""
