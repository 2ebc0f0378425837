"""Truth and logs made from it: trajectories, sensors, oscillators, satellites and observations.

Nothing here uses the mechanization, the filter or the engine's orbit code: the truth is made independently of what it
tests.
"""
