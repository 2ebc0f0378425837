"""The inputs that choose a block of further states."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

from insgnss.config.filter import FilterConfig
from insgnss.config.flight import ImuGrade


class SlowSizes(NamedTuple):
    """One sigma of the range errors that last for minutes [m], as models, products and a base station leave them."""

    ionosphere: float  # at the zenith, on L1
    troposphere: float  # at the zenith
    satellite: Mapping[str, float]  # along the line of sight, by constellation: all of them are there


NO_SLOW: Final = SlowSizes(0.0, 0.0, {})


class StateInputs(NamedTuple):
    """The settings, and the content of the log."""

    config: FilterConfig
    clock_groups: tuple[str, ...]  # see ``gnss.clock_groups``; the first keeps the receiver clock
    with_carrier: bool  # carrier differences are used
    grade: ImuGrade
    n_satellites: int = 0  # whose range errors can be states at the same time
    slow: SlowSizes = NO_SLOW  # of the range errors that last
