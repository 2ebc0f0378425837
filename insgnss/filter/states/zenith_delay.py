"""What the troposphere's model leaves of the wet delay at the zenith [m]."""

from __future__ import annotations

from typing import Final

from insgnss.filter.layout import GaussMarkov, RandomWalk, StateBlock
from insgnss.filter.states.wanted import StatesWanted

ZENITH_DELAY: Final = "zenith_delay"


def zenith_delay(wanted: StatesWanted) -> StateBlock | None:
    """Return the block where the settings ask for it."""
    process, sizes = wanted.config.process, wanted.config.slow_errors
    if process.range_bias_states and sizes.troposphere_zenith_m > 0.0:
        sigma = wanted.slow_share * sizes.troposphere_zenith_m
        return StateBlock(
            ZENITH_DELAY, ("zenith_delay_m",), "m", sigma, GaussMarkov(sigma, sizes.correlation_time_s)
        )
    if not wanted.config.measurements.zenith_delay:
        return None
    walk = RandomWalk(process.zenith_delay_walk_m_per_sqrt_s)
    return StateBlock(ZENITH_DELAY, ("zenith_delay_m",), "m", process.zenith_delay_sigma_m, walk)
