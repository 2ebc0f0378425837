"""The residual wet delay of the troposphere model at the zenith [m]."""

from __future__ import annotations

from typing import Final

from insgnss.filter.layout import GaussMarkov, RandomWalk, StateBlock
from insgnss.filter.states.wanted import StateInputs

ZENITH_DELAY: Final = "zenith_delay"


def zenith_delay(wanted: StateInputs) -> StateBlock | None:
    """Return the block where the settings ask for it."""
    process, sigma = wanted.config.process, wanted.slow.troposphere
    if process.range_bias_states and sigma > 0.0:
        lasting = GaussMarkov(sigma, wanted.config.slow_errors.air_time_s)
        return StateBlock(ZENITH_DELAY, ("zenith_delay_m",), "m", sigma, lasting)
    if not wanted.config.measurements.zenith_delay:
        return None
    walk = RandomWalk(process.zenith_delay_walk_m_per_sqrt_s)
    return StateBlock(ZENITH_DELAY, ("zenith_delay_m",), "m", process.zenith_delay_sigma_m, walk)
