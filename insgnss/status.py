"""What became of a measurement: one code for each entry of the ledger, and its name.

Codes below 10 mean the row reached the filter; from 10 the satellite side refused it, from 20 the epoch did.
"""

from __future__ import annotations

from typing import Final

USED: Final = 0  # it corrected the state
GATED: Final = 1  # normalised innovation above the gate, judged on the prior
MASKED_ELEVATION: Final = 2  # below the elevation mask
MASKED_CN0: Final = 3  # below the C/N0 mask
NO_CLOCK: Final = 4  # its constellation's clock offset is not known yet: the row started it
NO_EPHEMERIS: Final = 10
STALE_EPHEMERIS: Final = 11
UNHEALTHY: Final = 12
UNKNOWN_SIGNAL: Final = 13
SIGNAL_NOT_USED: Final = 14  # a setting: another signal of the same satellite is used
CONSTELLATION_NOT_USED: Final = 15  # a setting
BAD_VALUE: Final = 16  # not a number, or outside any physical range
BAD_SIGMA: Final = 17  # the log states a sigma that is zero, negative or not a number
DUPLICATE: Final = 18  # the satellite and signal stand twice in the epoch; the first one counts
SWITCHED_OFF: Final = 19  # a setting: this kind of measurement is not used
NOT_STARTED: Final = 20  # before the filter had a start
NO_IMU: Final = 21  # outside the time the inertial log covers
TOO_LATE: Final = 22  # it reached the engine after its latency limit
CLOCK_JUMP: Final = (
    23  # refused with its whole epoch: the receiver's clock jumped and the step is not yet known
)
USED_FOR_START: Final = 24  # it went into the single-point solution that started or restarted the filter
REFUSED_AT_START: Final = 25  # the single-point solution excluded it

NAMES: Final[dict[int, str]] = {
    USED: "used",
    GATED: "gated",
    MASKED_ELEVATION: "masked_elevation",
    MASKED_CN0: "masked_cn0",
    NO_CLOCK: "no_clock",
    NO_EPHEMERIS: "no_ephemeris",
    STALE_EPHEMERIS: "stale_ephemeris",
    UNHEALTHY: "unhealthy",
    UNKNOWN_SIGNAL: "unknown_signal",
    SIGNAL_NOT_USED: "signal_not_used",
    CONSTELLATION_NOT_USED: "constellation_not_used",
    BAD_VALUE: "bad_value",
    BAD_SIGMA: "bad_sigma",
    DUPLICATE: "duplicate",
    SWITCHED_OFF: "switched_off",
    NOT_STARTED: "not_started",
    NO_IMU: "no_imu",
    TOO_LATE: "too_late",
    CLOCK_JUMP: "clock_jump",
    USED_FOR_START: "used_for_start",
    REFUSED_AT_START: "refused_at_start",
}
