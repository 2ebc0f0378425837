"""What the ionosphere's model leaves at the zenith, on L1 [m]."""

from __future__ import annotations

from typing import Final

from insgnss.filter.layout import RandomWalk, StateBlock
from insgnss.filter.states.wanted import StatesWanted

IONOSPHERE: Final = "ionosphere"


def ionosphere(wanted: StatesWanted) -> StateBlock | None:
    """Return the block where carriers of one band are used and a model leaves something.

    The codes of two bands differ by the biases of their receiver and satellites as well, metres that such a state
    would take for ionosphere.
    """
    process = wanted.config.process
    one_band = not any(":" in group for group in wanted.clock_groups)
    modelled = wanted.config.measurements.ionosphere != "ionosphere_free"
    if not (wanted.with_carrier and one_band and modelled and process.ionosphere_sigma_m > 0.0):
        return None
    walk = RandomWalk(process.ionosphere_walk_m_per_sqrt_s)
    return StateBlock(IONOSPHERE, ("ionosphere_m",), "m", process.ionosphere_sigma_m, walk)
