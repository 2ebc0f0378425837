"""The checks that are expected to fail, each with what will mend it; a mark whose checks all hold is to go."""

from __future__ import annotations

from fnmatch import fnmatch
from typing import Final

from tests.benchmarks.trust.rows import Mark

LASTING: Final = "multipath that lasts has no state: issue 'What lasts, and what the vehicle knows'"
SCALE: Final = (
    "scale factors and misalignments have no states: issue 'What lasts, and what the vehicle knows'"
)
TIME_OFFSET: Final = "a time offset has no state: issue 'What lasts, and what the vehicle knows'"

# what a later issue brings
LATER: Final = (
    Mark("loiter_*", "nees tilt*", SCALE, in_tests=False),
    Mark("outage_*", "nees * before its end", SCALE, in_tests=False),
    Mark("city_*_multipath", "* position *", LASTING),
    Mark("city_car", "* position *", LASTING),
    Mark("ship_in_waves", "* position *", LASTING),
    Mark("fault_gnss_50ms", "worst *", TIME_OFFSET),
    Mark("fault_gnss_50ms", "no false heading", TIME_OFFSET),
    Mark("fault_imu_50ms", "worst *", TIME_OFFSET),
    Mark("fault_imu_50ms", "no false heading", TIME_OFFSET),
)
# what this issue brings, finding by finding
NOW: Final[tuple[Mark, ...]] = ()


def marks_of(row: str) -> tuple[Mark, ...]:
    """Return the marks of a row."""
    return tuple(mark for mark in (*LATER, *NOW) if fnmatch(row, mark.rows))
