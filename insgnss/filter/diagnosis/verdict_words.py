"""The filter's event texts for the faults that it finds."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.filter.diagnosis.hindsight import Verdict
from insgnss.filter.diagnosis.jumps import ACCELEROMETER, GYRO
from insgnss.filter.diagnosis.supposed_faults import (
    EITHER,
    FURTHER_SENSOR,
    IMU_TAGS,
    LAPSE,
    LATE_RATES,
    LEVER,
    RATES,
    SATELLITES,
    SHOCK,
)
from insgnss.filter.state import BA, BG, OFFSETS, Bank
from insgnss.filter.states.imu_time import IMU_TIME
from insgnss.filter.states.lever_arm import LEVER_ARM
from insgnss.filter.states.rate_lag import RATE_LAG
from insgnss.gnss.observation_rows import satellite_name
from insgnss.tables import Event

RATES_DISAGREE: Final = (
    "the range rates agree on no velocity and the pseudoranges on a place that the filter excludes; range rates are"
    " left out for at least ten minutes (check their unit, wavelength and time)"
)
STUCK_RATES: Final = (
    "the receiver repeats the range rates of an earlier epoch; they are refused while it does"
)


def in_words(t_ns: int, was: Bank, verdict: Verdict) -> Event:
    """Return the event of a verdict; ``was`` is the filter before the fault."""
    if verdict.suspect == SATELLITES:
        names = _names(verdict.satellites)
        detail = f"{names}: code and Doppler drift away from those of all others; left out, the last minute recomputed"
        return Event(t_ns, "satellite_suspect", detail)
    if verdict.suspect == IMU_TAGS:
        return Event(t_ns, "time_tag_suspect", _of_tags(verdict))
    if verdict.suspect == LEVER:
        return Event(t_ns, "lever_arm_suspect", _of_lever_arm(verdict))
    if verdict.suspect == LATE_RATES:
        late_s = float(verdict.bank.state[0].rates_late_s)
        detail = (
            f"the range rates lag {late_s:.2f} s behind the motion that pseudoranges and inertial sensors show: the"
            " receiver smooths them, or dates them too late. The lag is used from now on, and the last minute is"
            f" recomputed with it; gnss.range_rate_lag_s = {late_s:.2f} makes it known from the start"
        )
        if late_s < 0.005:  # none, as it is written
            detail = (
                "the range rates do not lag behind the motion, as was declared or found before: the last minute is"
                " recomputed without a lag (check gnss.range_rate_lag_s)"
            )
        return Event(t_ns, "rates_late", detail)
    if verdict.suspect == RATES:
        detail = (
            "the range rates of all satellites contradict the pseudoranges and the inertial sensors; they are left out,"
            " the last minute recomputed"
        )
        return Event(t_ns, "kind_refused", detail)
    if verdict.suspect == FURTHER_SENSOR:
        late = f"its readings are about {abs(verdict.size):.1f} s {'late' if verdict.size > 0.0 else 'early'}"
        what = late if verdict.size else "its errors are larger than its sigma"
        until = "" if verdict.size else " until it agrees"
        detail = (
            f"'{verdict.kinds[0]}' contradicts the satellites and the inertial sensors: {what}; the last minute is"
            f" recomputed without it, and it is left out{until}; check its time, unit, sign, axes and sigma"
        )
        return Event(t_ns, "rows_contradict", detail)
    if verdict.suspect in (LAPSE, SHOCK):
        detail = "an inertial sensor was wrong for a moment: attitude, velocity and position are re-estimated"
        return Event(t_ns, "sensor_suspect", detail)
    if verdict.suspect == EITHER:
        detail = "an accelerometer or gyro bias has jumped, not yet known which; both are re-estimated"
        return Event(t_ns, "sensor_suspect", detail)
    return Event(t_ns, "sensor_suspect", _of_sensor(was, verdict))


def refused_in_words(kind: int) -> str:
    """Return what is said of a kind that contradicts the other."""
    names = ("pseudoranges", "range rates")
    return f"the {names[kind]} contradict the {names[1 - kind]} and the inertial sensors; they are refused"


def creeping_in_words(t_ns: int, satellites: tuple[int, ...]) -> Event:
    """Return the event of satellites that are left out from now on, though what they did before is not clear."""
    detail = f"{_names(satellites)}: range rates drift away from those of all others; left out while they do"
    return Event(t_ns, "satellite_suspect", detail)


def _names(satellites: tuple[int, ...]) -> str:
    return ", ".join(sorted(satellite_name(slot) for slot in satellites))


def _of_tags(verdict: Verdict) -> str:
    size = abs(verdict.size)
    signs = ("late", "early") if verdict.size > 0.0 else ("early", "late")
    rates = ""
    if verdict.size < 0.0 and verdict.setup is None:  # inertial tags early, GNSS tags late
        rates = f", and so would, at low speed, range rates that lag by {size:.2f} s (gnss.range_rate_lag_s)"
    sigmas = "the sigmas do not include it"
    if verdict.setup is not None:
        named = {
            IMU_TIME: "the offset",
            RATE_LAG: "a lag of the range rates",
            LEVER_ARM: "an error of the lever arm",
        }
        states = [words for block, words in named.items() if verdict.setup.layout.at(block) >= 0]
        sigmas = f"the last minute is recomputed with {' and '.join(states)} unknown"
    along_m = size * float(np.linalg.norm(verdict.bank.state[0].v_e))
    return (
        f"the inertial time tags are about {size:.2f} s {signs[0]}, or the GNSS tags {signs[1]}: the residuals"
        f" follow the motion; {sigmas}. A lever arm error of"
        f" {along_m:.1f} m along the direction of motion would look the same{rates}"
    )


def _of_lever_arm(verdict: Verdict) -> str:
    what = "the lever arm of the flight file is wrong: the residuals follow the attitude"
    if verdict.setup is None:
        return f"{what}; the sigmas do not include it. Check its order, signs and point of origin"
    layout, m = verdict.setup.layout, verdict.bank.state[0]
    at = layout.at(LEVER_ARM)
    sigma = np.sqrt(verdict.bank.P[0].diagonal()[at : at + 3])
    error = zip(m.optional[at - OFFSETS : at - OFFSETS + 3], sigma, "forward right down".split(), strict=True)
    add = ", ".join(f"{value:+.1f} (sigma {own:.1f}) {axis}" for value, own, axis in error)
    tags = " and the offset of the inertial tags, which looks alike," if layout.at(IMU_TIME) >= 0 else ""
    return (
        f"{what}. To be added to it, in metres: {add}. The last minute is recomputed with this error{tags} as states"
        " (from the start: process.lever_arm_sigma_m). Check the lever arm's order, signs and point of origin"
    )


def _of_sensor(was: Bank, verdict: Verdict) -> str:
    before, after, P = was.state[0], verdict.bank.state[0], verdict.bank.P[0]
    name, at = ("b_a", BA) if verdict.suspect == ACCELEROMETER else ("b_g", BG)
    moved = after[name] - before[name]
    sigma = np.sqrt(P[range(at, at + 3), range(at, at + 3)])
    axes = "/".join("xyz"[axis] for axis in verdict.axes)
    scale, unit = (
        (math.degrees(3600.0), "deg/h") if verdict.suspect == GYRO else (1e3 / STANDARD_GRAVITY_MPS2, "mg")
    )
    by = ", ".join(f"{value:.1f}" for value in moved * scale)
    within = ", ".join(f"{value:.1f}" for value in sigma * scale)
    return f"{verdict.suspect} {axes}: its bias has jumped by ({by}) {unit}, sigma ({within}); it is re-estimated"
