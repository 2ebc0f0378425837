"""What the ionosphere's model leaves at the zenith, on L1 [m]."""

from __future__ import annotations

from typing import Final

from insgnss.filter.layout import GaussMarkov, RandomWalk, StateBlock
from insgnss.filter.states.wanted import StatesWanted

IONOSPHERE: Final = "ionosphere"


def ionosphere(wanted: StatesWanted) -> StateBlock | None:
    """Return the block where carriers of one band are used, or lasting range errors are states, and a model is used.

    The codes of two bands differ by the biases of their receiver and satellites as well, metres that such a state
    would take for ionosphere.
    """
    process, sizes = wanted.config.process, wanted.config.slow_errors
    one_band = not any(":" in group for group in wanted.clock_groups)
    modelled = wanted.config.measurements.ionosphere != "ionosphere_free"
    if process.range_bias_states and modelled and sizes.ionosphere_zenith_m > 0.0:
        sigma = wanted.slow_share * sizes.ionosphere_zenith_m
        return StateBlock(
            IONOSPHERE, ("ionosphere_m",), "m", sigma, GaussMarkov(sigma, sizes.correlation_time_s)
        )
    if not (wanted.with_carrier and one_band and modelled and process.ionosphere_sigma_m > 0.0):
        return None
    walk = RandomWalk(process.ionosphere_walk_m_per_sqrt_s)
    return StateBlock(IONOSPHERE, ("ionosphere_m",), "m", process.ionosphere_sigma_m, walk)
