"""The schemas of the files a user writes: the flight (which logs) and the filter (how they are used)."""
