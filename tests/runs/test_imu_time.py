"""IMU tags that are off: found in turns as well as it is claimed, not found at rest or on a straight, told, written."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import insgnss
from insgnss.config.library import filter_config
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.log.flight import FlightInMemory
from insgnss.runs.installation import installation_findings
from insgnss.runs.setup import setup_filter
from tests.benchmarks.trust.flying import drawn
from tests.benchmarks.trust.motions import CORNERS, TO_KNOWN, scenario, straight
from tests.benchmarks.trust.rows import Row
from tests.filter.test_engine import stream
from tests.runs.scenes import flight, true_start, turns
from tests.runs.test_own_rows import random_delays
from tests.statistics_bounds import assert_mean_chi_square, mean_chi_square_bounds, nees

SIGMA_S = 0.02
SETTINGS = {"process.imu_time_sigma_s": SIGMA_S}
EXACT = {"process.imu_time_sigma_s": 0.0}
NO_LAG = {"process.range_rate_lag_sigma_s": 0.0}
# else the tags are suspected and the filter is set right, after many looks back
PLAIN = {"health.recovery": False, **EXACT}


@cache
def jet(seed: int) -> FlightInMemory:
    return drawn(Row("fast_jet", "jet", "fast_jet", (), "tactical"), seed)[2]


def with_late_imu(flown: FlightInMemory, late_s: float) -> FlightInMemory:
    """Return a flight whose inertial tags are ``late_s`` too large."""
    imu = flown.logs.imu
    late = replace(imu, t_ns=imu.t_ns + round(late_s * NS_PER_S))
    return replace(flown, logs=replace(flown.logs, imu=late))


def found(run: insgnss.Run) -> tuple[float, float]:
    """Return what has to be added to the tags as it was found at the end, and its sigma [s]."""
    last = run.nav.iloc[-1]
    return float(last["imu_time_offset_s"]), float(last["sd_imu_time_offset_s"])


def ratio(run: insgnss.Run, name: str) -> float:
    """Return the rms of an error over its sigma in the second half of a run."""
    assert run.errors is not None
    values = (run.errors[f"d_{name}"] / run.errors[f"sd_{name}"]).to_numpy()
    return float(np.sqrt(np.mean(np.square(values[len(values) // 2 :]))))


@pytest.mark.parametrize("smooth", [False, True])
def test_offset_is_found_in_turns_and_the_rows_stand_at_gps_time(smooth: bool) -> None:
    """Offsets drawn from the prior, so the sum of squared errors over sigma is chi^2."""
    rng, squares, ratios = np.random.default_rng(77 + smooth), [], []
    for seed in range(6):
        late_s = SIGMA_S * float(rng.standard_normal())
        flown = with_late_imu(flight(turns(180.0), seed=800 + seed), late_s)
        run = insgnss.replay(flown, settings=SETTINGS, smooth=smooth)
        value, sigma = found(run)
        squares.append(nees(np.array([[value + late_s]]), np.array([[[sigma**2]]])))
        assert sigma < 0.2 * SIGMA_S
        assert list(run.events["kind"]).count("installation_known") == 1
        ratios.append(
            [ratio(run, name) for name in ("n_m", "e_m", "vn_mps", "ve_mps", "roll_deg", "yaw_deg")]
        )
    assert_mean_chi_square(squares, 1)
    assert np.median(ratios, axis=0).max() < 1.5


def test_jet_with_20_ms_knows_them_to_a_fifth_of_a_millisecond() -> None:
    run, plain = (insgnss.replay(with_late_imu(jet(41), 0.02), settings=s) for s in (SETTINGS, PLAIN))
    value, sigma = found(run)
    assert abs(value + 0.02) < 3.0 * sigma < 6e-4
    assert ratio(run, "roll_deg") < 1.5 < ratio(plain, "roll_deg")


@cache
def drive(seed: int) -> FlightInMemory:
    """A car in town, at 6 to 14 m/s, with many corners."""
    text = scenario("drive", *TO_KNOWN, *CORNERS, *CORNERS)
    return drawn(Row("drive", "a car in town", text, (), "industrial", gnss_rate_hz=5.0), seed)[2]


def heading_sigmas(run: insgnss.Run) -> float:
    """Return by how many sigmas the heading is off at most, once it is known."""
    assert run.errors is not None
    known_s = run.events.loc[run.events["kind"] == "heading_single", "time_s"].iloc[0]
    after = run.errors[run.errors["time_s"] > known_s + 5.0]
    return float((after["d_yaw_deg"] / after["sd_yaw_deg"]).abs().max())


@pytest.mark.parametrize("late_s", [0.02, 0.05, -0.05])
def test_tags_by_arrival_do_not_turn_a_cars_heading(late_s: float) -> None:
    """Nothing is declared of the tags: exact ones turn the heading in each corner, and no test sees it.

    In a car without carriers rates that lag are nearly the same: only where there can be no lag is the offset known.
    """
    flown = with_late_imu(drive(7), late_s)
    run, exact = insgnss.replay(flown), insgnss.replay(flown, settings=PLAIN)
    value, sigma = found(run)
    assert abs(value + late_s) < 3.0 * sigma < 0.04
    assert heading_sigmas(run) < 4.0 < 5.0 < heading_sigmas(exact)
    value, sigma = found(insgnss.replay(flown, settings=NO_LAG))
    assert abs(value + late_s) < 3.0 * sigma < 0.01


def test_offset_that_differs_from_the_flight_file_is_news() -> None:
    flown = with_late_imu(drive(7), 0.02)
    run = insgnss.replay(flown, settings=NO_LAG)
    told = run.events.loc[run.events["kind"] == "installation_known", "detail"]
    assert len(told) == 1 and "imu_time_offset_s" in told.iloc[0]


def test_tags_that_are_exact_are_not_news() -> None:
    run = insgnss.replay(drive(8), settings=NO_LAG)
    value, sigma = found(run)
    assert abs(value) < 3.0 * sigma < 0.01
    assert "installation_known" not in set(run.events["kind"])


def shaken(flown: FlightInMemory, sigma_mps2: float) -> FlightInMemory:
    """Return a flight whose accelerometers vibrate: the velocity of it stays within a sample's."""
    imu = flown.logs.imu
    speed = np.random.default_rng(5).standard_normal((len(imu.t_ns) + 1, 3))
    f_b = imu.f_b + sigma_mps2 * np.diff(speed, axis=0) / np.sqrt(2.0)
    return replace(flown, logs=replace(flown.logs, imu=replace(imu, f_b=f_b)))


@pytest.mark.parametrize("late_s", [0.05, -0.05])
def test_vibration_does_not_pass_for_the_motion_that_shows_the_offset(late_s: float) -> None:
    """0.6 m/s^2 in a sample made 0.033 of 0.05 s, with a sigma of 0.0013."""
    run = insgnss.replay(with_late_imu(shaken(drive(9), 0.6), late_s), settings=NO_LAG)
    value, sigma = found(run)
    assert abs(value + late_s) < 4.0 * sigma < 0.012
    assert heading_sigmas(run) < 4.0


@pytest.mark.parametrize("late_s", [0.02, -0.02])
def test_offset_and_lever_arm_as_states_do_not_pass_for_each_other(late_s: float) -> None:
    """At constant speed they are one error along the track, so what a jet finds of both is loose, and true."""
    settings = {**SETTINGS, "process.lever_arm_sigma_m": 0.2}
    squares, ratios = [], []
    for seed in (41, 42, 43):
        run = insgnss.replay(with_late_imu(jet(seed), late_s), settings=settings)
        value, sigma = found(run)
        last = run.nav.iloc[-1]
        error = np.array([[value + late_s], [last["lever_arm_x_m"]], [last["lever_arm_y_m"]]])
        sigmas = np.array([sigma, last["sd_lever_arm_x_m"], last["sd_lever_arm_y_m"]])
        squares += [nees(e[None], np.array([[[s**2]]])) for e, s in zip(error, sigmas, strict=True)]
        ratios.append([ratio(run, name) for name in ("n_m", "e_m", "roll_deg", "yaw_deg")])
    assert np.median(ratios, axis=0).max() < 1.5
    assert np.mean(squares) < mean_chi_square_bounds(1, len(squares))[1]


@pytest.mark.parametrize("late_s", [0.0, 0.02, -0.02])
def test_given_start_tells_nothing_of_the_offset(late_s: float) -> None:
    """It is a state at GPS time: ten seconds of a straight must not find in it when the IMU took its samples."""
    straight_on = turns(10.0)
    start = true_start(straight_on, 1.0).model_copy(update={"sd_position_m": 0.3, "sd_velocity_mps": 0.1})
    run = insgnss.replay(with_late_imu(flight(straight_on, start=start, seed=3), late_s), settings=SETTINGS)
    value, sigma = found(run)
    assert sigma > 0.9 * SIGMA_S
    assert abs(value) < 0.5 * SIGMA_S


@pytest.mark.parametrize("moves", [True, False])
def test_vehicle_that_keeps_its_velocity_shows_no_offset(moves: bool) -> None:
    """Ten minutes with carriers; on the straight the row is the antenna's place whatever the offset."""
    speed = 60.0 if moves else 0.0
    text = scenario("time_straight", straight(600.0), rate_hz=50.0, speed_mps=speed, carrier=True)
    row = Row("time_straight", "straight", text, (), "industrial", looks={"end": 598.0})
    _, _, flown = drawn(row, 8)
    run = insgnss.replay(with_late_imu(flown, 0.02), settings=SETTINGS, output=10.0)
    value, sigma = found(run)
    assert sigma > 0.8 * SIGMA_S
    assert abs(value) < 0.5 * SIGMA_S
    assert "installation_known" not in set(run.events["kind"])


def test_what_a_run_has_found_is_written_into_the_flight_file(tmp_path: Path) -> None:
    """A number that was changed since the run, or that nothing speaks against, is left alone."""
    flown = with_late_imu(flight(turns(180.0), seed=811), 0.03)
    run = insgnss.replay(flown, settings=SETTINGS)
    findings = installation_findings(run, flown.config)
    proposals = {p.key: p.value for finding in findings for p in finding.proposals}
    assert set(proposals) == {"imu.time.offset_s"}
    assert proposals["imu.time.offset_s"] == pytest.approx(-0.03, abs=2e-3)
    run.save(tmp_path / "run")
    loaded = insgnss.Run.load(tmp_path / "run")
    assert installation_findings(loaded, flown.config) == findings
    time = flown.config.imu.time.model_copy(update={"offset_s": -0.03})
    changed = flown.config.model_copy(update={"imu": flown.config.imu.model_copy(update={"time": time})})
    assert not any(finding.proposals for finding in installation_findings(run, changed))


def test_run_without_doubts_has_found_nothing() -> None:
    flown = flight(turns(60.0), seed=5)
    (finding,) = installation_findings(insgnss.replay(flown, settings=EXACT), flown.config)
    assert finding.severity == "ok" and "process.imu_time_sigma_s" in finding.advice


def test_live_engine_reports_the_same_numbers_as_determined_at_the_same_times() -> None:
    """Lever arm and time as states; epochs that are late by up to a few tenths of a second."""
    flown = with_late_imu(flight(turns(150.0), seed=811), 0.015)
    settings = {**SETTINGS, "process.lever_arm_sigma_m": 0.3}
    run = insgnss.replay(flown, settings=settings)
    wanted = run.events[run.events["kind"] == "installation_known"]
    engine = insgnss.Engine(setup_filter(flown, flown.logs, filter_config("tight", settings)))
    stream(engine, flown.logs, random_delays())
    engine.take_results(all_of_them=True)
    events = [event for event in engine.events if event.kind == "installation_known"]

    told = sorted(
        (event.detail.split(" is ")[0], event.t_ns % NS_PER_WEEK / NS_PER_S)
        for event in events
        if event.t_ns is not None
    )
    known = sorted(
        (detail.split(" is ")[0], t) for detail, t in zip(wanted["detail"], wanted["time_s"], strict=True)
    )
    assert {"imu_time_offset_s", "lever_arm_z_m"} <= {name for name, _ in told}
    assert [name for name, _ in told] == [name for name, _ in known]
    np.testing.assert_allclose([t for _, t in told], [t for _, t in known], atol=1e-3)
