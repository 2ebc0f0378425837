"""What a block of further states is chosen by."""

from __future__ import annotations

from typing import NamedTuple

from insgnss.config.filter import FilterConfig
from insgnss.config.flight import ImuGrade


class StatesWanted(NamedTuple):
    """The settings, and what the log holds."""

    config: FilterConfig
    clock_groups: tuple[str, ...]  # see ``gnss.clock_groups``; the first keeps the receiver clock
    with_carrier: bool  # carrier differences are used
    grade: ImuGrade
    n_satellites: int = 0  # whose range errors can be states at the same time
    slow_share: float = 1.0  # of the slow errors of the settings, that a base station leaves
