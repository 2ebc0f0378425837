"""Fault identification and recovery, for when the measurements contradict the filter."""
