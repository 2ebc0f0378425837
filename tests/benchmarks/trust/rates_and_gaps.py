"""The rows of inertial logs that are slow, jitter, or miss samples."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.tables import ImuTable
from tests.benchmarks.trust.flying import Flown
from tests.benchmarks.trust.measuring import nav_at
from tests.benchmarks.trust.motions import (
    CORNERS,
    CORNERS_S,
    TO_KNOWN,
    TO_KNOWN_S,
    accelerate,
    scenario,
    steer,
    straight,
)
from tests.benchmarks.trust.rows import (
    MOTION,
    NO_FALSE_HEADING,
    Case,
    Check,
    Measure,
    Row,
    Spoiler,
    honest,
    nees,
    no_event,
)

GAP_AT_S: Final = TO_KNOWN_S + 60.0
_TURN_S: Final = 36.0  # three circles of 30 deg/s
_GAPS_S: Final = (0.1, 0.5, 2.0, 5.0, 30.0)
_BIAS_KEPT: Final = Check("sigma of gyro bias <= 1.2 times before", "most", "bias_ratio", high=1.2)
_NO_GAP: Final = no_event("imu_gap", "restart", "reset", "clock_jump")


def _rate(rate_hz: float) -> Row:
    name = f"rate_{rate_hz:.0f}hz"
    jitter_s = min(0.002, 0.3 / rate_hz)  # at 400 Hz tags of 2 ms jitter would change their order
    return Row(
        name,
        f"drive, IMU at {rate_hz:.0f} Hz, tags with {1e3 * jitter_s:.2g} ms jitter",
        scenario(name, *TO_KNOWN, *CORNERS, rate_hz=rate_hz, imu=f"tag_jitter_s = {jitter_s}"),
        (*_NO_GAP, *nees(*MOTION), *honest(), NO_FALSE_HEADING),
        "industrial",
        looks={"end": TO_KNOWN_S + CORNERS_S - 2.0},
        windows={"known": (100.0, TO_KNOWN_S + CORNERS_S)},
        in_tests=rate_hz in (10.0, 50.0),
    )


def without_samples(length_s: float) -> Spoiler:
    """Return the fault of inertial samples that are missing for a while."""

    def spoil(case: Case, at_s: float, rng: np.random.Generator) -> Case:
        at_ns = case.start_ns + round(at_s * NS_PER_S)
        imu = case.imu
        # sample intervals end at their tags: what is left out is the motion from at_s on
        kept = (imu.t_ns <= at_ns) | (imu.t_ns > at_ns + round(length_s * NS_PER_S))
        return replace(case, imu=ImuTable(imu.t_ns[kept], imu.w_ib_b[kept], imu.f_b[kept]))

    return spoil


def _gap(length_s: float, turning: bool) -> Row:
    name = f"gap_{length_s:g}s_{'turn' if turning else 'straight'}"
    middle = (steer(30.0 * _TURN_S, _TURN_S),) if turning else (straight(_TURN_S),)
    # the gap begins at GAP_AT_S, in the middle of the turn but for that of 30 s, which hides nearly all of it
    before_s = GAP_AT_S - TO_KNOWN_S - (3.0 if length_s > 10.0 else 15.0)
    # rows of the same motion have the same text, and share its truth
    text = scenario("gaps", *TO_KNOWN, straight(before_s), *middle, straight(30.0), *CORNERS, straight(20.0))
    after = "after.yaw"
    checks: tuple[Check, ...] = (*nees(*MOTION), *honest("from the gap on"), NO_FALSE_HEADING)
    checks += no_event("clock_jump", "reset")
    if not turning and length_s <= 2.0:
        checks += (
            Check("yaw error (rms) <= 1 deg after it", "rms", f"{after}.error_square", high=1.0),
            Check("sigma of yaw <= 5 deg after it", "most", f"{after}.most_sigma", high=5.0),
        )
    if not turning and length_s == 5.0:
        checks += (Check("heading known at once", "most", f"{after}.most_sigma", high=5.0),)
    checks += (_BIAS_KEPT,)
    if turning and length_s == 2.0:
        checks += (
            Check("velocity e/s <= 1.5", "rms", "after.velocity.square", high=1.5),
            Check("tilt e/s <= 1.5", "rms", "after.tilt.square", high=1.5),
            Check("yaw e/s <= 1.5", "rms", "after.yaw.square", high=1.5),
        )
    return Row(
        name,
        f"inertial samples missing for {length_s:g} s, {'in a turn of 30 deg/s' if turning else 'on a straight'}",
        text,
        checks,
        "industrial",
        looks={"end": -5.0},
        windows={
            "after": (length_s, length_s + 20.0),
            "from the gap on": (0.0, np.inf),
        },
        measures={"bias_ratio": _bias_ratio(length_s)},
        spoil=without_samples(length_s),
        origin_s=GAP_AT_S,
        in_tests=length_s == 2.0 or (length_s == 5.0 and not turning),
    )


def _parked() -> Row:
    """Parked on both sides of a gap: the attitude is what it was."""
    moves = (*TO_KNOWN, accelerate(0.0, 10.0), straight(90.0), *CORNERS, straight(20.0))
    length_s = 30.0
    return Row(
        "gap_30s_parked",
        "inertial samples missing for 30 s while parked",
        scenario("gap_30s_parked", *moves),
        (
            Check("yaw error (rms) <= 1 deg after it", "rms", "after.yaw.error_square", high=1.0),
            Check("sigma of yaw <= 5 deg after it", "most", "after.yaw.most_sigma", high=5.0),
            _BIAS_KEPT,
            *nees(*MOTION),
            *honest("from the gap on"),
            NO_FALSE_HEADING,
            *no_event("clock_jump", "reset"),
        ),
        "industrial",
        looks={"end": -5.0},
        windows={"after": (length_s, length_s + 20.0), "from the gap on": (0.0, np.inf)},
        measures={"bias_ratio": _bias_ratio(length_s)},
        spoil=without_samples(length_s),
        origin_s=TO_KNOWN_S + 40.0,
        in_tests=True,
    )


def _bias_ratio(length_s: float) -> Measure:
    """Return the measure of by what the gyro bias' sigma grew over a gap (the largest of three axes)."""

    def measure(flown: Flown) -> float:
        names = [f"sd_gyro_bias_{axis}_radps" for axis in "xyz"]
        ratios = [nav_at(flown, n, length_s + 3.0) / nav_at(flown, n, -0.5) for n in names]
        return max(ratios)

    return measure


def rate_and_gap_rows() -> tuple[Row, ...]:
    """Return all rows of this file."""
    return (
        *(_rate(rate_hz) for rate_hz in (5.0, 10.0, 20.0, 50.0, 100.0, 400.0)),
        *(_gap(length_s, turning) for turning in (False, True) for length_s in _GAPS_S),
        _parked(),
    )
