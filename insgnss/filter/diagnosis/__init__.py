"""When the measurements contradict the filter: who is to blame, and the way back."""
