"""The supposed faults, and the filter of that time with the failed part unknown."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.jumps import ACCELEROMETER, GYRO, bias_of
from insgnss.filter.layout import SENSORS as ERROR_OF
from insgnss.filter.setup import FilterSetup
from insgnss.filter.state import DR, DV, PSI, Bank, copy_bank
from insgnss.filter.update.lasting_errors import epochs_of_an_error
from insgnss.gnss.observation_rows import CARRIER, N_BANDS, RANGE_RATE, GnssRows
from insgnss.status import DRIFTING, USED
from insgnss.tables import Float64

EITHER = "accelerometer or gyro"
SATELLITES, IMU_TAGS, LEVER = "satellites", "imu tags", "lever arm"
INSTALLATION: Final = (IMU_TAGS, LEVER)  # at constant speed one looks like the other along the way
RATES = "range rates"  # of all satellites
LATE_RATES = "late range rates"  # of all satellites
FURTHER_SENSOR = "further sensor"
NOISE = "noise"  # the noise of all satellites has risen: no sensor or satellite has failed
LAPSE = "lapse"  # of a sensor that lied for a moment and works again
# the same of a few samples of the accelerometers: a spike, or a shock beyond their bandwidth; a tilt that changes at
# once would look like a bias that jumps
SHOCK = "shock"
EITHER_OR_LAPSE, EITHER_OR_SHOCK = "either or a lapse", "either or a shock"
# all inertial samples are far noisier than their grade: vibration, a grade that is too good, wrong units or axes
INERTIAL_NOISE = "inertial noise"
SENSORS: Final = (ACCELEROMETER, GYRO, EITHER, LAPSE, SHOCK, INERTIAL_NOISE)

_TOGETHER: Final = {
    EITHER: (ACCELEROMETER, GYRO),
    EITHER_OR_SHOCK: (ACCELEROMETER, GYRO, SHOCK),
    EITHER_OR_LAPSE: (ACCELEROMETER, GYRO, LAPSE),
}

# of each axis of a sensor, each satellite and the time tags in the minute that is looked at: once in a hundred hours
LOG_PRIOR: Final = math.log(1.0 / 6000.0)
SURE: Final = math.log(1e4)  # odds; likelihoods take for independent what lasts for seconds in a street
CLEAR: Final = 10.0 * SURE  # the same odds where what was seen for ten seconds counts once
# by which a variance may have risen, all at once: of the satellites' rows, of the inertial samples
RISEN2: Final = {NOISE: (9.0, 100.0), INERTIAL_NOISE: (1e2, 3e3, 1e5, 3e6, 1e8)}
_FOR_GOOD_NS: Final = np.iinfo(np.int64).max
EARLIEST_S: Final = 90.0
# sigmas of velocity [m/s] and attitude [rad] after wrong readings
_LIE: Final = {LAPSE: (10.0, math.radians(10.0)), SHOCK: (1.0, 0.0)}
_LIE_S: Final = 3.0  # for which it lasted: so far only has the position gone with the velocity


def together(suspect: str) -> tuple[str, ...]:
    """Return the faults that a suspicion supposes at once."""
    return _TOGETHER.get(suspect, (suspect,))


def with_fault(
    bank: Bank,
    setup: FilterSetup,
    suspect: str,
    widths: Float64 | None = None,
    earlier: bool = False,
    later_s: float = 0.0,
    risen2: float = 1.0,
) -> Bank:
    """Return a copy of a filter in which what is supposed to have failed is unknown, as the biases of a sensor.

    Their jumps have the sigmas ``widths`` (3,) [rad/s] or [m/s^2]. After a lapse these are the states that the wrong
    readings changed: attitude, velocity and position; of noise its level, ``risen2`` times the former or the grade's.

    The jump need not be at the bank: up to ``later_s`` after it, or, of a gyro, up to 90 s ``earlier``, as it does not
    show on a straight. Velocity or attitude differ by C b t then, t uniform in between. Neglects: by what the position
    does.
    """
    faulty_bank = copy_bank(bank)
    if suspect == NOISE:
        faulty_bank.state["noise_factor"][:, :CARRIER] *= risen2
        return faulty_bank
    if suspect == INERTIAL_NOISE:
        faulty_bank.state["noise_excess"] = np.maximum(faulty_bank.state["noise_excess"], risen2)
        return faulty_bank
    if suspect == RATES:
        faulty_bank.state["rates_out_ns"] = _FOR_GOOD_NS
        return faulty_bank
    if suspect in _LIE:
        lie_mps, lie_rad = _LIE[suspect]
        moved_s = 0.5 * _LIE_S
        for i in range(3):
            faulty_bank.P[0, PSI + i, PSI + i] += lie_rad**2
            faulty_bank.P[0, [[DV + i], [DR + i]], [DV + i, DR + i]] += lie_mps**2 * np.outer(
                [1.0, moved_s], [1.0, moved_s]
            )
        return faulty_bank
    at, moved = bias_of(suspect, setup)[0], ERROR_OF[suspect]
    assert widths is not None
    faulty_bank.state["failed"][:, (ACCELEROMETER, GYRO).index(suspect)] = 1
    variance = np.diag(widths**2)
    low_s, high_s = (-EARLIEST_S, 0.0) if earlier and suspect == GYRO else (0.0, later_s)
    C = faulty_bank.state[0].C_eb
    shared = 0.5 * (low_s + high_s) * C @ variance
    b, x = slice(at, at + 3), slice(moved, moved + 3)
    faulty_bank.P[0, b, b] += variance
    faulty_bank.P[0, x, b] += shared
    faulty_bank.P[0, b, x] += shared.T
    faulty_bank.P[0, x, x] += (low_s**2 + low_s * high_s + high_s**2) / 3.0 * C @ variance @ C.T
    return faulty_bank


def quiet(parameters: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the filter's numbers with nothing that stops the loop, and with noise that follows no innovation."""
    calm = parameters.copy()
    calm["suspicion_limit"] = 0.0
    calm["lockout_epochs"] = math.inf
    calm["divergence_nis"] = math.inf
    calm["rate_memory_s"] = 0.0  # no explanation may choose the noise that it is judged by
    return calm


def with_errors_that_last(calm: npt.NDArray[Any], bank: Bank) -> npt.NDArray[Any]:
    """Return the numbers with errors of rates and carrier differences that last as long as ``bank`` has found.

    Likelihoods compare only where all explanations count errors alike, and so do satellites that are left out; and
    where none has its worst rows refused because a GNSS tag would explain them.
    """
    fixed, lead = calm.copy(), bank.state[bank.head[0].leader]
    interval_s = int(bank.head[0].epoch_step_ns) / NS_PER_S
    for kind in (RANGE_RATE, CARRIER) if interval_s > 0.0 else ():
        found_s = interval_s * epochs_of_an_error(lead, calm[0], kind, interval_s)
        fixed["kind"]["correlation"][0, kind] = max(calm["kind"]["correlation"][0, kind], found_s)
    fixed["rate_error_s"] = 0.0
    fixed["tag_jump_odds"] = math.inf
    return fixed


def without(rows: GnssRows, satellites: tuple[int, ...]) -> GnssRows:
    """Return rows without those of some satellites."""
    if not satellites:
        return rows
    gone = np.isin(rows.observation["slot"] // N_BANDS, satellites)
    observation = rows.observation.copy()
    status = observation["status"]
    status[gone[:, None] & (status == USED)] = DRIFTING
    carrier = rows.carrier
    if len(carrier):
        carrier = carrier.copy()
        carrier["status"][gone & (carrier["status"] == USED)] = DRIFTING
    return rows._replace(observation=observation, carrier=carrier)
