"""The checks that are expected to fail, each with what will mend it; a mark whose checks all hold is to go."""

from __future__ import annotations

from fnmatch import fnmatch
from typing import Final

from tests.benchmarks.trust.rows import Mark

IN_TURNS: Final = "the lever arm becomes a state when the first turns have shown that it is wrong"

# faults that are mended once they are found
LATER: Final = (
    Mark("fault_lever_arm_car", "no false heading", IN_TURNS),
    Mark("fault_lever_arm", "no false heading", IN_TURNS, in_tests=False),
)
A6: Final = "a fault that shows late, or not before the next turn"

UNSEEN: Final = (
    "until the fault shows, the heading is off by 0.1 deg and its sigma is 0.02: no test is faster"
)
CAUTIOUS: Final = (
    "the filter lets 5 % of a scale factor change, which at two turns a second is most of its sigma: the simulated"
    " one stays"
)

# faults and situations of which the reason is known
NOW: Final = (
    Mark("fault_accel_step", "no false heading", UNSEEN, in_tests=False),
    Mark("fault_gyro_step", "*", A6),
    Mark("sounding_rocket", "nees tilt end", CAUTIOUS, in_tests=False),
    Mark("sounding_rocket", "nees yaw end", CAUTIOUS, in_tests=False),
)


def marks_of(row: str) -> tuple[Mark, ...]:
    """Return the marks of a row."""
    return tuple(mark for mark in (*LATER, *NOW) if fnmatch(row, mark.rows))
