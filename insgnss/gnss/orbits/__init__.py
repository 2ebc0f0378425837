"""Orbits and clocks of satellites: broadcast, GLONASS, precise, and which message holds when."""
