"""The filter's built-in blocks of further states."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from insgnss.filter.layout import Layout, StateBlock
from insgnss.filter.states.glonass_channel_bias import glonass_channel_bias
from insgnss.filter.states.imu_time import imu_time
from insgnss.filter.states.ionosphere import ionosphere
from insgnss.filter.states.lever_arm import lever_arm
from insgnss.filter.states.range_biases import range_biases
from insgnss.filter.states.rate_lag import rate_lag
from insgnss.filter.states.sensor_errors import SENSOR_ERRORS
from insgnss.filter.states.system_offsets import system_offsets
from insgnss.filter.states.wanted import StateInputs
from insgnss.filter.states.zenith_delay import zenith_delay

# the clock offsets come first: an observation names its own by number
STATES: Final[tuple[Callable[[StateInputs], StateBlock | None], ...]] = (
    *(system_offsets, glonass_channel_bias, zenith_delay, ionosphere, lever_arm, imu_time, rate_lag),
    *SENSOR_ERRORS,
    range_biases,
)


def layout_of(
    wanted: StateInputs, further: tuple[StateBlock, ...] = (), home: tuple[int, ...] = ()
) -> Layout:
    """Return the layout of a filter: its own blocks as the settings and the log want them, and ``further`` ones.

    ``home`` says which clock groups are tied, see ``Layout``.
    """
    own = [block for state in STATES if (block := state(wanted)) is not None]
    blocks = sorted((*own, *further), key=lambda block: not block.shown)
    return Layout(tuple(blocks), clone=wanted.with_carrier, home=home)
