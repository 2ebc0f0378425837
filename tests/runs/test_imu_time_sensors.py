"""IMU tags that are off by 20 ms, and what shows it beside raw GNSS data: fixes, attitudes, further antennas."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import pytest

import insgnss
from insgnss.constants import NS_PER_S
from insgnss.log.flight import Flight, FlightInMemory
from tests.attitude.several_flights import scenario_text, write_flight
from tests.runs.scenes import START_S, turns
from tests.runs.test_imu_time import PLAIN, SETTINGS, SIGMA_S, found, with_late_imu
from tests.sensors.scenes import city_car, simulated
from tests.sensors.test_fixes_alone import FIXES, fixes_alone
from tests.statistics_bounds import assert_mean_chi_square, mean_chi_square_bounds

LATE_S: Final = 0.02
TURN: Final = """[[manoeuvre]]
kind = "straight"
duration_s = 10.0
[[manoeuvre]]
kind = "turn"
by_deg = 80.0
bank_deg = 30.0
"""
SEEDS: Final = range(900, 908)
FEW_SEEDS: Final = SEEDS[:3]
BEGIN_S: Final = START_S + 25.0
# errors of six to nine quantities that have much in common, the means of some ten seconds of 35
ALIKE: Final = 0.5
PLACE, VELOCITY, ANGLES = (
    ("n_m", "e_m", "d_m"),
    ("vn_mps", "ve_mps", "vd_mps"),
    ("roll_deg", "pitch_deg", "yaw_deg"),
)
HEADING = simulated("heading", rate_hz=2.0, noise_deg=0.1, noise_time_s=0.0)
ATTITUDE = simulated("attitude", rate_hz=2.0, noise_deg=(0.1, 0.1, 0.1), noise_time_s=0.0)
GOOD_FIXES = (simulated("position", noise_time_s=0.0, noise_m=(0.2, 0.2, 0.4)), FIXES[1])
SENSORS = {"fixes": GOOD_FIXES, "heading": (*FIXES, HEADING), "attitude": (*FIXES, ATTITUDE)}
# largest sigma of the offset at the end, as a share of that declared
KNOWN = {"fixes": 0.3, "heading": 0.2, "attitude": 0.1}


def flown(kind: str, seed: int) -> FlightInMemory:
    """Return an aircraft in turns without raw GNSS data."""
    return with_late_imu(fixes_alone(turns(60.0), seed, fixes=SENSORS[kind]), LATE_S)


def squares_of(run: insgnss.Run, names: Iterable[str], from_s: float) -> list[float]:
    """Return the squared errors over their variances, from a time on."""
    assert run.errors is not None
    late = run.errors[run.errors["time_s"] >= from_s]
    return [float(np.mean((late[f"d_{name}"] / late[f"sd_{name}"]) ** 2)) for name in names]


def offset_square(run: insgnss.Run) -> float:
    value, sigma = found(run)
    return ((value + LATE_S) / sigma) ** 2


@pytest.mark.parametrize("kind", SENSORS)
def test_offset_is_found_by_fixes_and_attitudes_as_well_as_it_is_claimed(kind: str) -> None:
    names, offsets, ends = (*PLACE, *VELOCITY, *ANGLES), [], []
    for seed in SEEDS:
        run = insgnss.replay(flown(kind, seed), settings=SETTINGS)
        ends += squares_of(run, names, BEGIN_S)
        offsets.append(offset_square(run))
        assert found(run)[1] < KNOWN[kind] * SIGMA_S
    assert_mean_chi_square(offsets, 1)
    assert_mean_chi_square(ends, 1, effective_share=ALIKE)
    plain = [squares_of(insgnss.replay(flown(kind, seed)), names, BEGIN_S) for seed in FEW_SEEDS]
    assert np.mean(plain) > 1.5 * mean_chi_square_bounds(1, 9 * len(FEW_SEEDS), effective_share=ALIKE)[1]


def test_smoothed_attitude_is_true_where_the_tags_are_off() -> None:
    settings, ends = {True: SETTINGS, False: {}}, {True: list[float](), False: list[float]()}
    for seed in FEW_SEEDS:
        for estimated, squares in ends.items():
            run = insgnss.replay(flown("attitude", seed), settings=settings[estimated], smooth=True)
            squares += squares_of(run, (*VELOCITY, *ANGLES), START_S + 10.0)
    assert_mean_chi_square(ends[True], 1, effective_share=ALIKE)
    assert np.mean(ends[False]) > 2.0 * mean_chi_square_bounds(1, len(ends[False]), effective_share=ALIKE)[1]


def several_antennas(folder: Path, seed: int) -> Flight:
    """Return an aircraft with three antennas in turns."""
    text = scenario_text(manoeuvres=TURN, speed_mps=60.0)
    flight = Flight.load(write_flight(folder, text, seed=seed))
    imu = flight.config.imu
    assert imu is not None
    late = imu.model_copy(update={"time": imu.time.model_copy(update={"offset_s": LATE_S})})
    return replace(flight, config=flight.config.model_copy(update={"imu": late}))


def test_attitude_of_several_antennas_is_true_where_the_tags_are_off(tmp_path: Path) -> None:
    names, begin_s, offsets, ends, smoothed, plain = (*VELOCITY, *ANGLES), 150_012.0, [], [], [], []
    for seed in range(8):
        flight = several_antennas(tmp_path / str(seed), seed)
        run = insgnss.replay(flight, settings=SETTINGS)
        ends += squares_of(run, names, begin_s)
        offsets.append(offset_square(run))
        assert found(run)[1] < 0.05 * SIGMA_S
        if seed < len(FEW_SEEDS):
            smoothed += squares_of(insgnss.replay(flight, settings=SETTINGS, smooth=True), names, begin_s)
            plain += squares_of(insgnss.replay(flight, settings=PLAIN), names, begin_s)
    assert_mean_chi_square(offsets, 1)
    for squares in (ends, smoothed):
        assert_mean_chi_square(squares, 1, effective_share=ALIKE)
    assert np.mean(plain) > 2.0 * mean_chi_square_bounds(1, len(plain), effective_share=ALIKE)[1]


def with_clock(flight: FlightInMemory, kind: str, clock: str) -> FlightInMemory:
    sensors = [
        one.model_copy(update={"clock": clock}) if one.kind == kind else one for one in flight.config.sensor
    ]
    return replace(flight, config=flight.config.model_copy(update={"sensor": tuple(sensors)}))


def with_late_sensor(flight: FlightInMemory, kind: str) -> FlightInMemory:
    tables = [
        replace(one, t_ns=one.t_ns + round(LATE_S * NS_PER_S)) if one.name == kind else one
        for one in flight.logs.sensors
    ]
    return replace(flight, logs=replace(flight.logs, sensors=tuple(tables)))


def test_sensor_on_the_imus_clock_shares_its_offset() -> None:
    """Attitudes whose tags are off as those of the IMU: declared so they tell nothing wrong, else a wrong offset."""
    squares: dict[str, list[float]] = {"imu": [], "gps": []}
    for seed in FEW_SEEDS:
        shared = with_late_sensor(flown("attitude", seed), "attitude")
        for clock, of_clock in squares.items():
            run = insgnss.replay(with_clock(shared, "attitude", clock), settings=SETTINGS)
            of_clock += [offset_square(run), *squares_of(run, ANGLES, BEGIN_S)]
    low, high = mean_chi_square_bounds(1, len(squares["imu"]))
    assert low < np.mean(squares["imu"]) < high
    assert np.mean(squares["gps"]) > 2.0 * high


def test_vehicle_at_rest_shows_no_offset_by_its_fixes_and_attitudes() -> None:
    run = insgnss.replay(
        with_late_imu(fixes_alone(city_car(18.0), 1, fixes=SENSORS["attitude"]), LATE_S), settings=SETTINGS
    )
    value, sigma = found(run)
    assert sigma > 0.99 * SIGMA_S
    assert abs(value) < 0.05 * SIGMA_S


def test_clock_of_a_sensor_changes_nothing_where_the_tags_are_exact() -> None:
    flight = fixes_alone(turns(30.0), 1, fixes=SENSORS["attitude"])
    runs = [insgnss.replay(with_clock(flight, "attitude", clock)) for clock in ("gps", "imu")]
    pd.testing.assert_frame_equal(runs[0].nav, runs[1].nav, check_exact=True)
