"""The residual of the ionosphere model at the zenith, on L1 [m]."""

from __future__ import annotations

from typing import Final

from insgnss.filter.layout import GaussMarkov, RandomWalk, StateBlock
from insgnss.filter.states.wanted import StateInputs

IONOSPHERE: Final = "ionosphere"


def ionosphere(wanted: StateInputs) -> StateBlock | None:
    """Return the block where lasting range errors are states, or where carriers of one band are used and a model is.

    The codes of two bands differ by the biases of their receiver and satellites as well, metres that such a state
    would take for ionosphere. Where lasting range errors are states, it is wanted all the same: without it the sigma of
    the height leaves out the largest of them.
    """
    process = wanted.config.process
    one_band = not any(":" in group for group in wanted.clock_groups)
    modelled = wanted.config.measurements.ionosphere != "ionosphere_free"
    sigma, time_s = wanted.slow.ionosphere, wanted.config.slow_errors.air_time_s
    if process.range_bias_states and sigma > 0.0:
        return StateBlock(IONOSPHERE, ("ionosphere_m",), "m", sigma, GaussMarkov(sigma, time_s))
    if not (wanted.with_carrier and one_band and modelled and process.ionosphere_sigma_m > 0.0):
        return None
    walk = RandomWalk(process.ionosphere_walk_m_per_sqrt_s)
    return StateBlock(IONOSPHERE, ("ionosphere_m",), "m", process.ionosphere_sigma_m, walk)
