"""The status of a measurement: one code for each entry of the ledger, and its name.

Codes below 10 mean the row reached the filter; from 10 the satellite side refused it, from 20 the epoch did, from 30
the carrier's history, from 39 what antennas have in common.
"""

from __future__ import annotations

from typing import Final

USED: Final = 0  # it corrected the state
GATED: Final = 1  # normalised innovation above the gate, judged on the prior
MASKED_ELEVATION: Final = 2  # below the elevation mask
MASKED_CN0: Final = 3  # below the C/N0 mask
NO_CLOCK: Final = 4  # its constellation's clock offset is not known yet: the row started it
INCONSISTENT: Final = 5  # the epoch's rows do not agree with each other, and it is the one that stands out
DRIFTING: Final = 6  # it creeps away from all others: a slow error no single gate sees
REFLECTED: Final = 7  # much weaker than expected at its elevation: not the direct signal
MASKED_GAIN: Final = 8  # in the vehicle's attitude no antenna has enough gain towards it
MASKED_OBSTRUCTION: Final = 9  # in the vehicle's attitude the airframe hides it from the antenna
NO_EPHEMERIS: Final = 10
STALE_EPHEMERIS: Final = 11
UNHEALTHY: Final = 12
UNKNOWN_SIGNAL: Final = 13
SIGNAL_NOT_USED: Final = 14  # a setting: another signal of the same satellite is used
CONSTELLATION_NOT_USED: Final = 15  # a setting
BAD_VALUE: Final = 16  # not a number, or outside any physical range
BAD_SIGMA: Final = 17  # the log states a sigma that is zero, negative or beyond any use (1000 km, 100 km/s)
DUPLICATE: Final = 18  # the satellite and signal appear twice in the epoch; the first one counts
SWITCHED_OFF: Final = 19  # a setting: this kind of measurement is not used
NOT_STARTED: Final = 20  # before the filter had a start, or at the epoch at which it was lost
NO_IMU: Final = 21  # outside the time the inertial log covers
TOO_LATE: Final = 22  # it reached the engine after its latency limit
# refused with its whole epoch: the receiver's clock jumped and the step is not yet known
CLOCK_JUMP: Final = 23
USED_FOR_START: Final = 24  # it went into the single-point solution that started or restarted the filter
REFUSED_AT_START: Final = 25  # the single-point solution excluded it
NO_CHANNEL: Final = (
    26  # GLONASS, satellite side: neither the messages nor the log state its frequency channel
)
COMBINED: Final = 27  # its value is in another row of the satellite: the ionosphere-free combination
# the ionosphere-free combination needs a second signal, and this satellite has one
NO_SECOND_SIGNAL: Final = 28
NO_SOLUTION: Final = 29  # the epoch has no point solution
NO_CORRECTION: Final = 37  # the base station has none for this signal, message and time
NO_EPOCH_BEFORE: Final = 30  # no carrier of this signal in the epoch before, or the filter was not there yet
SLIP_INDICATED: Final = 31  # cycle slip: the receiver says so
SLIP_DOPPLER: Final = 32  # cycle slip: carrier and Doppler (without one, pseudorange) disagree
SLIP_GEOMETRY_FREE: Final = 33  # cycle slip: two carriers of the satellite disagree
HALF_CYCLE: Final = 34  # the half-cycle ambiguity was resolved or lost between the two epochs
MESSAGE_CHANGED: Final = 35  # the two epochs' satellite states are from different messages
CLOCK_STEPPED: Final = 36  # the receiver's clock stepped in between
NO_RANGE: Final = 38  # no pseudorange with the carrier to give the time of transmission
NO_DIFFERENCE: Final = 39  # no other antenna has the signal, or it is the one that the others count from
CYCLES_OPEN: Final = 40  # whole cycles of the difference between two antennas are not known for certain
CYCLES_WRONG: Final = 41  # they are known to be wrong: the difference is off by whole cycles
STUCK: Final = 42  # the receiver repeats a number that the satellite's motion has changed: no measurement
CONTRADICTS: Final = (
    43  # the rows of its kind contradict the other measurements: none is used until they agree
)
# the epoch's GNSS time tag has jumped: by how much is not certain yet, or too much for this kind
TAG_JUMP: Final = 45
PHASE_NOT_LOCKED: Final = 44  # carrier: too many of its differences have failed a test

NAMES: Final[dict[int, str]] = {
    USED: "used",
    GATED: "gated",
    MASKED_ELEVATION: "masked_elevation",
    MASKED_CN0: "masked_cn0",
    NO_CLOCK: "no_clock",
    INCONSISTENT: "inconsistent",
    DRIFTING: "drifting",
    REFLECTED: "reflected",
    MASKED_GAIN: "masked_gain",
    MASKED_OBSTRUCTION: "masked_obstruction",
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
    TAG_JUMP: "tag_jump",
    USED_FOR_START: "used_for_start",
    REFUSED_AT_START: "refused_at_start",
    COMBINED: "combined",
    NO_SECOND_SIGNAL: "no_second_signal",
    NO_SOLUTION: "no_solution",
    NO_CORRECTION: "no_correction",
    NO_EPOCH_BEFORE: "no_epoch_before",
    SLIP_INDICATED: "slip_indicated",
    SLIP_DOPPLER: "slip_doppler",
    SLIP_GEOMETRY_FREE: "slip_geometry_free",
    HALF_CYCLE: "half_cycle",
    MESSAGE_CHANGED: "message_changed",
    CLOCK_STEPPED: "clock_stepped",
    NO_RANGE: "no_range",
    NO_CHANNEL: "no_channel",
    NO_DIFFERENCE: "no_difference",
    CYCLES_OPEN: "cycles_open",
    CYCLES_WRONG: "cycles_wrong",
    STUCK: "stuck",
    CONTRADICTS: "contradicts",
    PHASE_NOT_LOCKED: "phase_not_locked",
}
