"""The doctor's parts that need no log: offsets taken apart, gaps and their cost, the behaviour of a clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insgnss.config.library import imu_grade
from insgnss.constants import C_MPS, NS_PER_S, S_PER_WEEK, STANDARD_GRAVITY_MPS2
from insgnss.log.checks.clock import clock_findings
from insgnss.log.checks.gap_cost import START_SD_MPS, gap_findings, outage_sigmas
from insgnss.log.checks.imu import GroundVelocity, imu_findings
from insgnss.log.checks.rates import jumps_that_agree
from insgnss.log.checks.time_offset import (
    HOUR_S,
    Timing,
    offset_findings,
    overlapping_shifts,
    split,
)
from insgnss.log.checks.track import GnssTrack
from insgnss.log.flight import Flight
from insgnss.tables import ImuTable
from insgnss.units import MPS2_PER_MG, SI_PER_UNIT
from tests.conftest import REPOSITORY
from tests.log.writing import WEEK, Float64


@pytest.mark.parametrize(
    ("offset_s", "parts"),
    [
        (0.25, (0, 0, 0, 0.25)),
        (-1.3, (0, 0, 0, -1.3)),
        (18.02, (0, 0, 1, 0.02)),
        (-18.0, (0, 0, -1, 0.0)),
        (17.0, (0, 0, 0, 17.0)),
        (3600.01, (0, 1, 0, 0.01)),
        (-2 * 3600.0 + 18.0, (0, -2, 1, 0.0)),
        (-604_800.1, (-1, 0, 0, -0.1)),
        (604_800.0 + 7200.0, (1, 2, 0, 0.0)),
    ],
)
def test_offset_is_taken_apart_into_weeks_hours_leap_seconds_and_rest(
    offset_s: float, parts: tuple[int, int, int, float]
) -> None:
    assert split(offset_s, 18) == pytest.approx(parts)


def test_shifts_are_sought_only_where_logs_do_not_overlap() -> None:
    span = (0, 600 * NS_PER_S)
    assert overlapping_shifts(span, (100 * NS_PER_S, 700 * NS_PER_S)) == []
    late = (HOUR_S * NS_PER_S, (HOUR_S + 600) * NS_PER_S)
    assert overlapping_shifts(late, span) == [-HOUR_S]
    early = (-S_PER_WEEK * NS_PER_S, (600 - S_PER_WEEK) * NS_PER_S)
    assert overlapping_shifts(early, span) == [S_PER_WEEK]
    assert (
        overlapping_shifts((1800 * NS_PER_S, 2400 * NS_PER_S), span) == []
    )  # half an hour is no label's error


def coasting(
    rng: np.random.Generator, length_s: float, n: int = 4000, steps: int = 400
) -> tuple[float, float]:
    """Return the rms of velocity and position errors of n simulated outages of a tactical IMU along one axis."""
    grade, g, dt = imu_grade("tactical"), 9.80665, length_s / steps
    b_a = rng.normal(0.0, grade.accel_bias_instability_mg * MPS2_PER_MG, n)
    b_g = rng.normal(0.0, np.deg2rad(grade.gyro_bias_instability_deg_per_h) / 3600.0, n)
    tilt = rng.normal(0.0, grade.accel_bias_instability_mg * MPS2_PER_MG / g, n)
    v, r = rng.normal(0.0, START_SD_MPS, n), np.zeros(n)
    for _ in range(steps):
        r += v * dt
        v += (b_a + g * tilt) * dt + rng.normal(0.0, grade.accel_vrw_mps_per_sqrt_h / 60.0 * np.sqrt(dt), n)
        tilt += b_g * dt + rng.normal(0.0, np.deg2rad(grade.gyro_arw_deg_per_sqrt_h) / 60.0 * np.sqrt(dt), n)
    return float(np.sqrt(np.mean(v**2))), float(np.sqrt(np.mean(r**2)))


@pytest.mark.parametrize("length_s", [1.0, 10.0, 60.0])
def test_predicted_growth_is_that_of_simulated_outages(length_s: float, rng: np.random.Generator) -> None:
    """The rms of 4000 is known to 1.1 %, one sigma; 5 % admits 4 sigmas and the steps' own error."""
    assert outage_sigmas(imu_grade("tactical"), length_s) == pytest.approx(coasting(rng, length_s), rel=0.05)


def test_gap_of_the_imu_costs_what_the_motion_of_the_log_may_have_done() -> None:
    """Forces that change by 2 m/s^2 rms from second to second: 10 s without samples may be 20 m/s and 100 m."""
    t_ns = (np.arange(6000) * 10_000_000).astype(np.int64)
    t_ns[3000:] += 10 * NS_PER_S
    f_b = np.zeros((6000, 3))
    f_b[:, 0] = np.repeat(np.resize([2.0, 2.0, -2.0, -2.0], 60), 100)
    imu = ImuTable(t_ns, np.zeros((6000, 3)), f_b)
    lines = [f.text for f in gap_findings(imu, t_ns[::100], imu_grade("tactical"), WEEK)]
    gap = next(line for line in lines if line.startswith("IMU gap of 10 s"))
    assert "sigma grows to 20 m/s and 100 m" in gap
    assert any(line.startswith("GNSS gap of 11 s") for line in lines)


def clock(clock_m: Float64, drift_mps: Float64) -> str:
    t_s = np.arange(len(clock_m)).astype(float)
    zeros = np.zeros((len(t_s), 3))
    track = GnssTrack(t_s, zeros, zeros, t_s, clock_m, drift_mps, 0, len(t_s), len(t_s), len(t_s))
    return "\n".join(finding.line() for finding in clock_findings(track))


def test_clock_that_drifts_is_left_alone() -> None:
    t = np.arange(100.0)
    text = clock(50.0 * t + 9e4, np.full(100, 50.0))
    assert "not steered" in text and "+50 m/s (+0.167 ppm)" in text and "WARNING" not in text


def test_clock_that_jumps_is_told_with_number_and_size() -> None:
    t = np.arange(100.0)
    jumps = np.floor(t / 25.0) * 1e-3 * C_MPS
    drift = 1e-3 * C_MPS / 25.0
    for drifted, how in ((drift * t, "held near"), (-drift * t, "moved away from")):
        text = clock(drifted - jumps, np.full(100, drifted[1]))
        assert f"{how} GPS time by jumps" in text and "3 jump(s) of 1 ms" in text


def test_multiples_of_a_jump_are_jumps_too() -> None:
    """Two of them between epochs where one is missing."""
    t = np.arange(100.0)
    jumps = (np.floor(t / 25.0) + (t >= 75.0)) * 1e-3 * C_MPS
    assert "3 jump(s) of 1 ms" in clock(50.0 * t - jumps, np.full(100, 50.0))


def test_leaps_that_do_not_agree_in_size_are_bad_epochs() -> None:
    """Three bad fixes: the clock is off by some kilometres and is back at the next epoch, six leaps."""
    t = np.arange(100.0)
    off = np.zeros(100)
    off[[20, 45, 70]] = (9e3, -2.3e4, 4.1e3)
    text = clock(50.0 * t + off, np.full(100, 50.0))

    assert "not steered" in text and "jump(s) of" not in text
    assert "WARNING" in text and "leaps 6 time(s) by 0.014 to 0.077 ms" in text and "bad epochs" in text


BAD_EPOCHS_M = (1000.0, -700.0, 2500.0, -1800.0, 430.0, -900.0)


def test_bad_epochs_whose_sizes_agree_by_chance_are_no_jumps() -> None:
    """900 and 1800 m agree, as 430 and 900 m do: the clock is back at the next epoch each time."""
    t = np.arange(100.0)
    off = np.zeros(100)
    off[10:70:10] = BAD_EPOCHS_M
    text = clock(50.0 * t + off, np.full(100, 50.0))
    assert "not steered" in text and "jump(s) of" not in text and "leaps 12 time(s)" in text


def test_jumps_are_most_of_the_leaps_that_stay() -> None:
    sizes = np.array([1000.0, -700.0, 2000.0, -1800.0, -430.0, -1100.0, 3000.0])
    assert not jumps_that_agree(sizes).any()  # three of seven
    assert jumps_that_agree(np.array([1000.0, 2000.0, -1800.0])).tolist() == [True, True, False]


def test_bad_epoch_among_jumps_is_told_beside_them() -> None:
    t = np.arange(100.0)
    jumps = np.floor(t / 25.0) * 1e-3 * C_MPS
    jumps[10] += 7e4
    text = clock(50.0 * t - jumps, np.full(100, 50.0))

    assert "3 jump(s) of 1 ms" in text and "leaps 2 time(s)" in text


@pytest.mark.parametrize(
    ("offset_s", "sd_s", "agrees"),
    [(0.041, 0.004, False), (-0.085, 0.027, False), (0.041, 0.020, True), (0.0, 0.01, True)],
)
def test_offset_beyond_three_sigmas_is_suspect(offset_s: float, sd_s: float, agrees: bool) -> None:
    flight = Flight.load(REPOSITORY / "data" / "sample_flight" / "flight.toml")
    (finding,) = offset_findings(flight, Timing(offset_s, sd_s, 0.0, 100.0), 50.0, WEEK * 604_800 * NS_PER_S)

    assert ("tags agree" in finding.text) is agrees
    assert finding.severity == ("ok" if agrees else "warning")
    assert (f"imu.time.offset_s = {offset_s:+.3f}" in finding.advice) is not agrees
    assert finding.proposals == ()


def ahead(speed_mps: Float64) -> Float64:
    """Return velocities of one direction."""
    return np.outer(speed_mps, [1.0, 0.0, 0.0])


def steady_imu(seconds: int) -> ImuTable:
    t_ns = (np.arange(100 * seconds) * 10_000_000).astype(np.int64)
    return ImuTable(t_ns, np.zeros((len(t_ns), 3)), np.tile([0.0, 0.0, -9.81], (len(t_ns), 1)))


@pytest.mark.parametrize(
    ("speed_mps", "sd_mps", "words"),
    [
        (70.0, 0.1, "in steady motion at 70 m/s for 60 s"),
        (0.05, 0.1, "at rest for 60 s"),
        (0.9, 0.3, "at rest for 60 s"),  # of a poor receiver: within three of its sigmas
    ],
)
def test_steady_motion_is_not_called_rest_where_the_speed_is_known(
    speed_mps: float, sd_mps: float, words: str
) -> None:
    epochs = np.arange(-1, 62) * NS_PER_S
    velocity = GroundVelocity(epochs, ahead(np.full(63, speed_mps)), np.full(63, sd_mps))
    text = "\n".join(finding.text for finding in imu_findings(steady_imu(60), 0, velocity))

    assert words in text and ("at rest" in text) is words.startswith("at rest")


@pytest.mark.parametrize(
    ("sensor", "key"), [("gyros", "gyro_arw_deg_per_sqrt_h"), ("accelerometers", "accel_vrw_mps_per_sqrt_h")]
)
@pytest.mark.parametrize("times", [2.0, 4.5])
def test_noise_at_rest_is_compared_with_the_grade(sensor: str, key: str, times: float) -> None:
    """White noise of so many times the grade's, beside a vibration of 23 Hz, which averages out."""
    grade, rng = imu_grade("industrial"), np.random.default_rng(5)
    imu, velocity = (
        steady_imu(120),
        GroundVelocity(np.arange(122) * NS_PER_S, np.zeros((122, 3)), np.full(122, 0.1)),
    )
    rates, forces = np.zeros(imu.w_ib_b.shape), np.zeros(imu.w_ib_b.shape)
    wave = np.sin(2.0 * np.pi * 23.0 * np.arange(len(rates)) / 100.0)[:, None]
    white = times * getattr(grade, key) / 60.0 * 10.0 * rng.standard_normal(rates.shape)
    if sensor == "gyros":
        rates = np.radians(white + 0.5 * wave)
    else:
        forces = white + 0.2 * wave
    noisy = replace(imu, w_ib_b=imu.w_ib_b + rates, f_b=imu.f_b + forces)

    told = [f for f in imu_findings(noisy, 0, velocity, grade) if "have a noise" in f.text]

    assert [f"the {sensor} have a noise" in f.text and key in f.advice for f in told] == [True] * (
        times > 3.0
    )


@pytest.mark.parametrize(
    ("off_deg_per_s", "begin_s", "end_s", "told"),
    [
        (0.4, 0.0, 9.0, "the x gyro changes by 0.4 deg/s until 9 s after the first sample"),
        (0.4, 6.0, 9.0, ""),  # touched in passing
        (0.4, 0.0, 70.0, ""),  # no longer than it is off
        (0.02, 0.0, 9.0, ""),  # within the biases of the grade
    ],
)
def test_gyro_that_settles_after_the_start_is_told(
    off_deg_per_s: float, begin_s: float, end_s: float, told: str
) -> None:
    grade, imu, rng = imu_grade("mems_consumer"), steady_imu(120), np.random.default_rng(8)
    velocity = GroundVelocity(np.arange(122) * NS_PER_S, np.zeros((122, 3)), np.full(122, 0.1))
    t_s = imu.t_ns / NS_PER_S
    w_ib_b = np.radians(0.01) * rng.standard_normal(imu.w_ib_b.shape)
    w_ib_b[:, 0] -= np.radians(off_deg_per_s) * ((t_s >= begin_s) & (t_s < end_s))
    found = imu_findings(replace(imu, w_ib_b=w_ib_b), 0, velocity, grade)

    warnings = [f for f in found if "warms up" in f.advice]
    assert [told in f.text and f.severity == "warning" for f in warnings] == [True] * bool(told)


@pytest.mark.parametrize(
    ("mps", "course_degps", "gyro_degps", "told"),
    [
        (0.0, 0.0, 3.8, "at rest the z gyro reads +3.8 deg/s"),
        (0.0, 0.0, 0.3, ""),  # four biases of the grade
        (18.0, 0.0, 3.8, "on a straight the z gyro reads +3.8 deg/s"),
        (18.0, 3.8, 3.8, ""),  # the vehicle turns as the gyro says
    ],
)
def test_gyro_that_reads_more_than_its_grade_without_a_turn_is_told(
    mps: float, course_degps: float, gyro_degps: float, told: str
) -> None:
    imu, t_s = steady_imu(60), np.arange(-1.0, 62.0)
    course = np.radians(course_degps) * t_s
    v_e = mps * np.column_stack([np.cos(course), np.sin(course), np.zeros(len(t_s))])
    velocity = GroundVelocity((t_s * NS_PER_S).astype(np.int64), v_e, np.full(63, 0.1))
    turning = replace(imu, w_ib_b=imu.w_ib_b + np.radians([0.0, 0.0, gyro_degps]))

    found = imu_findings(turning, 0, velocity, imu_grade("mems_consumer"))

    warnings = [f for f in found if "gyro reads" in f.text]
    assert [told in f.text and "gyro_bias_deg_per_h = 1.4e+04" in f.advice for f in warnings] == [
        True
    ] * bool(told)


@pytest.mark.parametrize(
    ("declared", "written", "told"),
    [
        ("mg", "cm/s^2", "(-1.93 % of g), as if the column were in cm/s^2"),
        ("cm/s^2", "mg", "(+1.97 % of g), as if the column were in mg"),
        ("m/s^2", "m/s^2", "(+0.00 % of g)"),
    ],
)
def test_unit_that_is_mistaken_for_a_scale_error_is_named(declared: str, written: str, told: str) -> None:
    """1 mg is 0.980665 cm/s^2: gravity at rest is off by 1.9 %, as a poor sensor's is."""
    at_rest = steady_imu(60)
    size = np.linalg.norm(at_rest.f_b[0]) / STANDARD_GRAVITY_MPS2
    imu = replace(at_rest, f_b=at_rest.f_b / size * SI_PER_UNIT[declared] / SI_PER_UNIT[written])
    finding = next(found for found in imu_findings(imu, 0, accel_unit=declared) if "|f|" in found.text)
    assert finding.text.endswith(told)
    assert (f"imu.accel_unit = '{written}'" in finding.advice) is (declared != written)
    # off by as much, and no unit explains it
    biased = replace(at_rest, f_b=1.03 * at_rest.f_b / size)
    assert not any("as if" in found.text for found in imu_findings(biased, 0, accel_unit=declared))


def test_steady_log_without_a_speed_is_not_called_rest() -> None:
    text = "\n".join(finding.text for finding in imu_findings(steady_imu(60), 0))

    assert "at rest or in steady motion for 60 s" in text and "at rest for" not in text


def test_rest_counts_only_where_the_vehicle_stood() -> None:
    epochs = np.arange(-1, 62) * NS_PER_S
    velocity = GroundVelocity(epochs, ahead(np.where(epochs < 20 * NS_PER_S, 0.0, 70.0)), np.full(63, 0.1))
    text = "\n".join(finding.text for finding in imu_findings(steady_imu(60), 0, velocity))

    assert "at rest for 20 s" in text or "at rest for 19 s" in text


def test_clock_that_is_steered_in_the_code_alone_is_a_warning() -> None:
    """The pseudoranges stay at GPS time while the range rates carry an oscillator off by 30 m/s."""
    text = clock(np.zeros(100), np.full(100, 30.0))
    assert "WARNING" in text and "+30 m/s by the range rates" in text
    assert "steered to GPS time" in text
