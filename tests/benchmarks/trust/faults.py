"""The rows of faults, each alone, in the sample flight: an aircraft with a tactical sensor under 11 satellites."""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.units import deg_per_h_to_radps
from tests.benchmarks.trust import spoiling
from tests.benchmarks.trust.flying import SAMPLE_FLIGHT
from tests.benchmarks.trust.measuring import position_m
from tests.benchmarks.trust.motions import CORNERS, TO_KNOWN, TO_KNOWN_S, scenario
from tests.benchmarks.trust.rows import (
    NO_FALSE_HEADING,
    REPORTED,
    SIGMAS,
    VICTIM,
    Case,
    Check,
    Row,
    Spoiler,
    honest,
    no_event,
)

AT_S: Final = 380.0  # legs, turns of 30 and 43.5 deg of bank follow
SPREAD_S: Final = 60.0
LASTS_S: Final = 60.0
DURATION_S: Final = 640.0
RATE_HZ: Final = 50.0
NUMBERS: Final = Check("every number is one", "most", "bad_numbers", high=0.0)
QUIET: Final = Check("no Python warning", "most", "warnings", high=0.0)
_OFFSET_FOUND: Final = r"^installation_known.*imu_time_offset_s"
_OFFSET_WORDS: Final = r"(?i)\b(time[ _]offset|late|delay(ed)?|time[ _]tags?|synchron)"
# a turn of 30 deg of bank turns at 0.05 rad/s and pulls 11.3 m/s^2
_LIMITS: Final = {"gyro": 0.02, "accel": 9.9}
_SPIKES: Final = {"gyro": 5.0, "accel": 100.0}


def _row(name: str, title: str, spoil: Spoiler, checks: tuple[Check, ...], **more: object) -> Row:
    """Return a fault's row; every one asks for finite numbers and for no false heading."""
    given: dict[str, object] = {
        "rate_hz": RATE_HZ,
        "duration_s": DURATION_S,
        "origin_s": AT_S,
        "spread_s": SPREAD_S,
        **more,
    }
    return Row(
        name,
        title,
        SAMPLE_FLIGHT,
        (*checks, NUMBERS, QUIET, NO_FALSE_HEADING),
        "tactical",
        spoil=spoil,
        fault=True,
        **given,  # type: ignore[arg-type]
    )


def _step(sensor: spoiling.Sensor, size: float, words: str) -> Row:
    return _row(
        f"fault_{sensor}_step",
        f"{words} on one axis, for good",
        spoiling.bias_step(sensor, size),
        (*honest("from 30 s on", limit=SIGMAS), REPORTED),
        windows={"from 30 s on": (30.0, np.inf)},
        event=sensor,
        in_tests=sensor == "gyro",
    )


def _doppler(name: str, title: str, spoil: Spoiler) -> Row:
    return _row(
        name,
        title,
        spoil,
        (
            Check("position within 10 m", "most", "position_m", high=10.0),
            *honest("since", limit=SIGMAS),
            REPORTED,
        ),
        windows={"since": (0.0, np.inf)},
        measures={"position_m": position_m(0.0, np.inf)},
        event=r"(?i)doppler|range.rate",
        in_tests=name == "fault_doppler_frozen",
    )


def _ramp(count: int, rate_mps: float) -> Row:
    """One or two are found within 60 s; three may be found, or the sigmas are wide enough."""
    found = Check("found after 60 s (share refused)", "least", "found", low=0.8)
    return _row(
        f"fault_ramp_{count}sv_{rate_mps:g}mps",
        f"code and Doppler of {count} of 11 satellites run away by {rate_mps:g} m/s",
        spoiling.ramps(count, rate_mps),
        (*((found,) if count < 3 else ()), *honest("from 60 s on", limit=SIGMAS), REPORTED),
        windows={"from 60 s on": (60.0, np.inf)},
        event=VICTIM,
        in_tests=count == 2 or rate_mps == 0.3,
    )


def _sensor(kind: str, sensor: spoiling.Sensor, spoil: Spoiler) -> Row:
    words = {
        "stuck": "repeats one sample for 60 s",
        "zero": "gives zeros for 60 s",
        "saturated": "saturates for 60 s",
        "spikes": "has a spike in each second of 60",
    }[kind]
    return _row(
        f"fault_{sensor}_{kind}",
        f"{sensor} {words}",
        spoil,
        (
            *honest("since", limit=SIGMAS),
            REPORTED,
            Check("back within 60 s: position [m]", "most", "back_m", high=10.0),
        ),
        windows={"since": (0.0, np.inf)},
        measures={"back_m": position_m(LASTS_S + 60.0, np.inf)},
        event=r"(?i)imu|gyro|accel|sample",
        in_tests=(sensor, kind) in (("gyro", "zero"), ("accel", "stuck"), ("gyro", "spikes")),
    )


def _sensors() -> tuple[Row, ...]:
    rows: list[Row] = []
    sensors: tuple[spoiling.Sensor, ...] = ("gyro", "accel")
    for sensor in sensors:
        rows += [
            _sensor("stuck", sensor, spoiling.stuck(sensor, LASTS_S)),
            _sensor("zero", sensor, spoiling.zero(sensor, LASTS_S)),
            _sensor("saturated", sensor, spoiling.saturated(sensor, _LIMITS[sensor], LASTS_S)),
            _sensor("spikes", sensor, spoiling.spikes(sensor, _SPIKES[sensor], LASTS_S)),
        ]
    return tuple(rows)


def _measurements() -> tuple[Row, ...]:
    since = {"since": (0.0, np.inf)}
    return (
        _row(
            "fault_four_ranges",
            "four of 11 pseudoranges 50 m too long for 60 s",
            spoiling.range_steps(4, 50.0, LASTS_S),
            honest("since", limit=SIGMAS),
            windows=since,
            in_tests=True,
        ),
        _row(
            "fault_noise_20",
            "noise of ranges and rates 20 times the ordinary for 60 s",
            spoiling.noise_times(20.0, LASTS_S),
            (*honest("since", limit=SIGMAS), REPORTED),
            windows=since,
            event="noise_risen",
            in_tests=True,
        ),
        _row(
            "fault_gnss_ends",
            "no epoch comes any more",
            spoiling.gnss_ends,
            (
                *honest("since", limit=SIGMAS),
                REPORTED,
                Check("reported within 15 s", "most", "reported_s", high=15.0),
            ),
            windows=since,
            event="no_measurements|gnss|GNSS",
            output=1.0,
            in_tests=True,
        ),
        _row(
            "fault_ephemeris",
            "one satellite's message holds an impossible number",
            spoiling.corrupt_ephemeris,
            (
                *honest(limit=SIGMAS),
                REPORTED,
                Check("its rows are refused (share)", "least", "found", low=1.0),
            ),
            origin_s=0.0,
            spread_s=0.0,
            event=f"(?i)ephemeris|{VICTIM}",
            duration_s=300.0,
            in_tests=True,
        ),
    )


def _late_doppler() -> Row:
    """Rates that lag show in the first change of velocity, which is at once."""
    return Row(
        "fault_doppler_late",
        "range rates of all satellites 0.2 s late, for good: a car in town",
        scenario("late Doppler", *TO_KNOWN, *CORNERS, *CORNERS, *CORNERS),
        (
            Check("position within 10 m", "most", "position_m", high=10.0),
            *honest("from 60 s on", limit=SIGMAS),
            REPORTED,
            *(NUMBERS, QUIET, NO_FALSE_HEADING),
        ),
        "industrial",
        gnss_rate_hz=5.0,
        origin_s=TO_KNOWN_S,
        windows={"from 60 s on": (60.0, np.inf)},
        measures={"position_m": position_m(0.0, np.inf)},
        spoil=spoiling.late_doppler,
        fault=True,
        event="rates_late",
    )


def _lever_arms() -> tuple[Row, ...]:
    """A lever arm shows where the vehicle turns: in town within 40 s, in the flight after the third or fourth turn."""
    checks = (*honest("from then on", limit=SIGMAS), REPORTED, NUMBERS, QUIET, NO_FALSE_HEADING)
    return (
        Row(
            "fault_lever_arm_car",
            "the lever arm is declared 1 m too far to the right: a car in town",
            scenario("wrong lever arm", *TO_KNOWN, *CORNERS, *CORNERS, *CORNERS),
            checks,
            "industrial",
            gnss_rate_hz=5.0,
            windows={"from then on": (TO_KNOWN_S + 60.0, np.inf)},
            lever_off_m=(0.0, 1.0, 0.0),
            fault=True,
            event="lever_arm_suspect",
        ),
        _row(
            "fault_lever_arm",
            "the lever arm is declared 2 m too far to the right: a flight",
            lambda case, at_s, rng: case,
            checks[:4],
            origin_s=0.0,
            spread_s=0.0,
            windows={"from then on": (430.0, np.inf)},
            lever_off_m=(0.0, 2.0, 0.0),
            event="lever_arm_suspect",
        ),
    )


def _times() -> tuple[Row, ...]:
    return (
        _row(
            "fault_gnss_50ms",
            "GNSS tags 50 ms late for 60 s",
            spoiling.tags_late(0.05, LASTS_S),
            (*honest("since", limit=SIGMAS), REPORTED),
            windows={"since": (0.0, np.inf)},
            event=_OFFSET_WORDS,
        ),
        _row(
            "fault_gnss_second",
            "GNSS tags a second late for 60 s: a leap second",
            spoiling.tags_late(1.0, LASTS_S),
            (*honest("since", limit=SIGMAS), REPORTED),
            windows={"since": (0.0, np.inf)},
            event=_OFFSET_WORDS,
        ),
        _row(
            "fault_gnss_jitter",
            "GNSS tags off by 20 ms (rms), each by itself",
            spoiling.tags_jitter(0.02),
            (*honest("from 30 s on", limit=SIGMAS), REPORTED),
            windows={"from 30 s on": (30.0, np.inf)},
            event=_OFFSET_WORDS,
        ),
        _row(
            "fault_imu_50ms",
            "IMU tags 50 ms late from the start",
            spoiling.imu_late(0.05),
            (*honest(limit=SIGMAS), REPORTED),
            origin_s=0.0,
            spread_s=0.0,
            event=_OFFSET_FOUND,
        ),
        _row(
            "fault_imu_early",
            "IMU tags 50 ms early from the start",
            spoiling.imu_late(-0.05),
            (*honest(limit=SIGMAS), REPORTED),
            origin_s=0.0,
            spread_s=0.0,
            event=_OFFSET_FOUND,
        ),
        _row(
            "fault_imu_50ms_state",
            "IMU tags 50 ms late from the start, their time a state",
            spoiling.imu_late(0.05),
            (*honest(limit=SIGMAS), REPORTED),
            origin_s=0.0,
            spread_s=0.0,
            event=_OFFSET_FOUND,
            settings={"process.imu_time_sigma_s": 0.05},
        ),
    )


def _wild() -> Row:
    return _row(
        "fault_wild_value",
        "one inertial value between 1e6 and 1e300",
        spoiling.wild_value,
        (
            *honest("since", limit=SIGMAS),
            REPORTED,
            Check("position within 10 m", "most", "position_m", high=10.0),
            *no_event("restart", "reset"),
        ),
        windows={"since": (0.0, np.inf)},
        measures={"position_m": position_m(0.0, np.inf)},
        event=r"(?i)imu|sample",
        times=2,
        in_tests=True,
    )


def _future_tag() -> Row:
    """A live engine is not deaf after one tag of another year."""
    return _row(
        "fault_future_tag",
        "live engine: one inertial tag in the far future",
        _as_it_is,
        (
            Check("later samples are taken", "least", "taken", low=1.0),
            Check("position within 10 m", "most", "position_m", high=10.0),
            REPORTED,
            Check("reported once", "most", "reports", high=1.0),
        ),
        event=r"(?i)imu|sample|tag",
        live=True,
        duration_s=180.0,
        origin_s=120.0,
        spread_s=30.0,
        in_tests=True,
    )


def _as_it_is(case: Case, at_s: float, rng: np.random.Generator) -> Case:
    return case


def _from_the_start() -> tuple[Row, ...]:
    """Faults that are there from the first sample or epoch on: nothing was sound before."""
    spoilers = {
        "gyro_dead": ("gyros give zeros for the first 60 s", spoiling.zero("gyro", LASTS_S)),
        "accel_dead": ("accelerometers give zeros for the first 60 s", spoiling.zero("accel", LASTS_S)),
        "gyro_spikes": (
            "gyro has a spike in each second from the first on",
            spoiling.spikes("gyro", 5.0, np.inf),
        ),
        "accel_spikes": ("accelerometer has a spike in each second", spoiling.spikes("accel", 100.0, np.inf)),
        "noise_20": (
            "noise of ranges and rates 20 times the ordinary, always",
            spoiling.noise_times(20.0, np.inf),
        ),
    }
    return tuple(
        _row(
            f"fault_start_{name}",
            title,
            spoil,
            honest(limit=SIGMAS),
            origin_s=0.0,
            spread_s=0.0,
            duration_s=240.0,
            in_tests=name == "noise_20",
        )
        for name, (title, spoil) in spoilers.items()
    )


def _nothing() -> Row:
    """The flight without a fault: what the other rows would show of themselves."""
    return _row(
        "fault_none",
        "no fault at all",
        _as_it_is,
        (*honest(limit=SIGMAS), *no_event("reset", "restart", "clock_jump", "lockout")),
    )


def fault_rows() -> tuple[Row, ...]:
    """Return all rows of this file."""
    five_mg = 5e-3 * STANDARD_GRAVITY_MPS2
    return (
        _nothing(),
        _step("accel", five_mg, "accelerometer bias steps by 5 mg"),
        _step("gyro", deg_per_h_to_radps(36.0), "gyro bias steps by 36 deg/h"),
        _doppler("fault_doppler_frozen", "Doppler frozen for 60 s", spoiling.frozen_doppler(LASTS_S)),
        _doppler(
            "fault_doppler_reversed", "Doppler of the wrong sign for 60 s", spoiling.reversed_doppler(LASTS_S)
        ),
        _ramp(1, 0.3),
        _ramp(1, 1.0),
        _ramp(2, 0.5),
        _ramp(3, 1.0),
        _wild(),
        _future_tag(),
        *_sensors(),
        _late_doppler(),
        *_measurements(),
        *_times(),
        *_lever_arms(),
        *_from_the_start(),
    )
