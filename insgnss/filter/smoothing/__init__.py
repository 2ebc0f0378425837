"""What the whole log tells of a moment: the smoother, times between epochs, other points of the body."""
