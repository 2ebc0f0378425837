"""The time by which range rates lag behind the motion: T seconds, a constant of the receiver.

A range rate is that of the antenna's velocity T earlier, so it grows with T by u . a less the satellite's part of the
range's acceleration (``rows.late_rates``). Early inertial tags do the same to it, but in motion they change the
pseudoranges, too: where both are states, pseudoranges and carriers say which it is. So the lag is a state only beside
the offset of the tags, from the start or when a filter has found them to be early. It adds to a declared lag.
"""

from __future__ import annotations

from typing import Final

from insgnss.filter.layout import StateBlock
from insgnss.filter.states.imu_time import imu_time
from insgnss.filter.states.wanted import StateInputs

RATE_LAG: Final = "range_rate_lag"
_COLUMNS: Final = ("range_rate_lag_s",)
LOOP_SIGMA_S: Final = 0.05  # of a receiver's loops
# of a filter that has found tags to be off
UNKNOWN_RATE_LAG: Final = StateBlock(RATE_LAG, _COLUMNS, "s", 0.1, shown=False)


def rate_lag(wanted: StateInputs) -> StateBlock | None:
    """Return the block where the settings doubt the IMU's tags and use range rates."""
    if imu_time(wanted) is None or not wanted.config.measurements.range_rate:
        return None
    declared = wanted.config.process.range_rate_lag_sigma_s
    sigma = LOOP_SIGMA_S if declared is None else declared
    return StateBlock(RATE_LAG, _COLUMNS, "s", sigma) if sigma > 0.0 else None
