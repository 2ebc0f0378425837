"""A given start whose attitude is wrong by far more than its sigma is found out; a right one changes no bit."""

from __future__ import annotations

import dataclasses
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import insgnss
from insgnss.config.flight import GivenStart, MountedAntenna
from insgnss.config.library import filter_config, imu_grade
from insgnss.filter import navigator
from insgnss.filter.engine import FilterEngine
from insgnss.filter.start.trial import StartValidation
from insgnss.filter.whole_log import run_filter
from insgnss.gnss.observation_rows import GnssRows, one_epoch
from insgnss.log.flight import Flight
from insgnss.runs.result import Run
from insgnss.runs.setup import setup_filter
from insgnss.simulation.course import ManoeuvreSequence
from insgnss.simulation.sample_trajectories import AIRFIELD, car, static
from insgnss.simulation.simulated_log import Simulator
from tests.filter.test_engine_arrivals import epochs, feed, with_latency
from tests.runs.scenes import (
    START_NS,
    START_S,
    FlightInMemory,
    after,
    assert_honest,
    assert_sound,
    even_sky,
    flight,
    kinds,
    ratios,
    simulator,
    true_start,
)

SAMPLE = Path(__file__).resolve().parents[2] / "data" / "sample_flight" / "flight.toml"
RATE_HZ = 50.0
AT_S = 3.0
MOVING_S = 30.0  # the car of ``drive`` has its speed by then
ANGLES = ["roll_deg", "pitch_deg", "yaw_deg"]


@cache
def drive() -> Simulator:
    """20 s at rest, then blocks with right and left corners, with a cheap sensor."""
    grade = imu_grade("mems_consumer")
    return simulator(car(110.0), 110.0, navigation=even_sky(), grade=grade, imu_rate_hz=RATE_HZ)


@cache
def late_drive() -> Simulator:
    """90 s at rest, longer than a trial waits, then two corners."""
    course = ManoeuvreSequence().hold(90.0).change_speed(14.0, 8.0).hold(12.0)
    course.change_speed(6.0, 5.0).steer(90.0, 5.0).change_speed(14.0, 8.0).hold(12.0).steer(90.0, 5.0).hold(
        25.0
    )
    way = course.lay(*AIRFIELD, 80.0)
    return simulator(way, 170.0, navigation=even_sky(), grade=imu_grade("mems_consumer"), imu_rate_hz=RATE_HZ)


@cache
def rest() -> Simulator:
    grade = imu_grade("mems_consumer")
    return simulator(static(60.0, *AIRFIELD), 60.0, navigation=even_sky(), grade=grade, imu_rate_hz=RATE_HZ)


def start(base: Simulator, at_s: float, roll: float = 0.0, yaw: float = 0.0, **changes: object) -> GivenStart:
    """Return the true state at a time, its attitude turned by ``roll`` and ``yaw`` [deg]."""
    truth = true_start(base, at_s)
    rpy_deg = (np.array(truth.rpy_deg) + [roll, 0.0, yaw] + 180.0) % 360.0 - 180.0
    return truth.model_copy(update={"rpy_deg": tuple(rpy_deg.tolist()), **changes})


def given(
    base: Simulator, at_s: float, roll: float = 0.0, yaw: float = 0.0, **changes: object
) -> FlightInMemory:
    """Return a drawn flight with such a start."""
    return flight(base, start=start(base, at_s, roll, yaw, **changes))


def replayed(flown: FlightInMemory) -> Run:
    run = insgnss.replay(flown)
    assert_sound(run, flown)
    return run


def assert_refused(run: Run) -> float:
    """Fail unless the start was refused, and nothing else set anew; return when [s]."""
    told = run.events[run.events["kind"].isin(["restart", "reset"])]
    assert len(told) == 1 and "contradict the given start" in told["detail"].iloc[0], told["detail"].tolist()
    return float(told["time_s"].iloc[0]) - START_S


def assert_attitude_right(run: Run, from_s: float) -> None:
    """Fail unless roll, pitch and yaw lie within five of their sigmas of the truth, and these say something."""
    worst = ratios(after(run, from_s))[ANGLES].max()
    assert worst.max() < 5.0, worst.to_dict()
    assert run.nav["sd_yaw_deg"].iloc[-1] < 5.0


@pytest.mark.parametrize("yaw", [180.0, -75.0])
def test_wrong_heading_is_found_out_where_it_chooses_the_satellites(yaw: float) -> None:
    """A wrong heading masks the wrong satellites. Without a trial the truth came after 84 s and three resets."""
    flown = Flight.load(SAMPLE)
    gnss = flown.config.gnss.model_copy(update={"antenna": (MountedAntenna(pattern="patch_l1"),)})
    nav = insgnss.replay(flown).nav
    truth = nav[nav["time_s"] >= START_S + 150.0].iloc[0]
    roll_deg, pitch_deg, yaw_deg, *velocity, lat_deg, lon_deg, h_m = truth[
        [*ANGLES, "vn_mps", "ve_mps", "vd_mps", "lat_deg", "lon_deg", "h_m"]
    ].tolist()
    wrong = GivenStart(
        time_s=float(truth["time_s"]),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        h_m=h_m,
        v_ned_mps=tuple(velocity),
        rpy_deg=(roll_deg, pitch_deg, (yaw_deg + yaw + 180.0) % 360.0 - 180.0),
        sd_position_m=5.0,
        sd_velocity_mps=0.5,
        sd_roll_pitch_deg=1.0,
        sd_yaw_deg=1.0,
    )
    config = flown.config.model_copy(update={"start": wrong, "gnss": gnss})
    run = insgnss.replay(FlightInMemory(flown.path, config, flown.imu_grade, flown.oscillator, flown.read()))
    refused = run.events[run.events["kind"].isin(["restart", "reset"])]
    assert len(refused) == 1 and "contradict the given start" in refused["detail"].iloc[0]
    assert run.events["kind"].eq("masking_on").any()
    found_s = float(refused["time_s"].iloc[0]) - wrong.time_s
    assert found_s < 20.0
    assert_attitude_right(run, wrong.time_s - START_S + found_s + 1.0)


@pytest.mark.parametrize("at_s", [AT_S, MOVING_S], ids=["at rest", "moving"])
@pytest.mark.parametrize(("yaw", "sd_yaw_deg"), [(90.0, 1.0), (180.0, 1.0), (180.0, 10.0)])
def test_heading_of_a_car_far_outside_its_sigma_is_found_out(
    at_s: float, yaw: float, sd_yaw_deg: float
) -> None:
    """The biases of a cheap sensor swallow it: the filter alone stays 10 to 200 sigmas off to the end."""
    run = replayed(given(drive(), at_s, yaw=yaw, sd_yaw_deg=sd_yaw_deg))
    assert_refused(run)
    assert_attitude_right(run, 75.0)


@pytest.mark.parametrize("roll", [30.0, 180.0])
@pytest.mark.parametrize("at_s", [AT_S, MOVING_S], ids=["at rest", "moving"])
def test_car_on_its_side_or_roof_is_found_out(at_s: float, roll: float) -> None:
    run = replayed(given(drive(), at_s, roll=roll))
    assert_refused(run)
    assert_attitude_right(run, 75.0)


def test_heading_stays_known_where_only_roll_was_wrong() -> None:
    """Nothing at rest would bring a heading back that was given up with the roll."""
    run = replayed(given(rest(), AT_S, roll=30.0, sd_yaw_deg=2.0))
    assert_refused(run)
    last = after(run, 55.0).iloc[-1]
    assert abs(last["d_roll_deg"]) < 5.0 * last["sd_roll_deg"] < 15.0
    assert abs(last["d_yaw_deg"]) < 3.0 * last["sd_yaw_deg"] < 60.0


def test_wrong_heading_is_found_out_when_a_long_rest_ends() -> None:
    run = replayed(given(late_drive(), AT_S, yaw=180.0))
    assert assert_refused(run) > 90.0
    assert_attitude_right(run, 150.0)


def test_wrong_position_is_no_contradiction_of_the_attitude() -> None:
    run = replayed(given(rest(), AT_S, lat_deg=true_start(rest(), AT_S).lat_deg + 0.003, sd_position_m=10.0))
    assert "restart" not in kinds(run)
    assert_honest(run, 30.0)


@pytest.mark.parametrize("base", [drive, late_drive], ids=["drive", "late drive"])
def test_right_start_is_left_alone_to_the_bit(base: object, monkeypatch: pytest.MonkeyPatch) -> None:
    flown = given(base(), AT_S, roll=2.0, yaw=-10.0)  # type: ignore[operator]
    with_trial = replayed(flown)
    monkeypatch.setattr(navigator, "validation", lambda setup, is_given: None)
    alone = replayed(flown)
    assert with_trial.nav.equals(alone.nav)
    assert with_trial.measurements.equals(alone.measurements)
    assert kinds(with_trial) == kinds(alone)


def test_trial_of_a_right_start_costs_little_at_rest_and_ends_in_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Alternatives cost as much as the filter each: an epoch a second for a minute, then one in ten, until a corner."""
    taken: list[float] = []
    update = StartValidation._update_bank

    def noted(self: StartValidation, imu: object, rows: GnssRows, epoch: int, *others: object) -> None:
        taken.append(float(rows.epoch_ns[epoch] - START_NS) / 1e9)
        update(self, imu, rows, epoch, *others)  # type: ignore[arg-type]

    monkeypatch.setattr(StartValidation, "_update_bank", noted)
    replayed(given(late_drive(), AT_S))
    seconds = np.round(taken)
    assert (
        np.diff(seconds[seconds < 62.0]).tolist() == [1.0] * 56
    )  # rest is shown by two fixes, a second apart
    assert np.count_nonzero((seconds > 66.0) & (seconds < 90.0)) in (2, 3)
    assert 92.0 < seconds[-1] < 130.0, "the first corner decides"
    assert np.all(np.diff(seconds[seconds > 95.0]) == 1.0)


@pytest.mark.parametrize("base", [drive, late_drive], ids=["drive", "late drive"])
def test_engine_gives_the_bits_of_replay_through_a_trial(base: object) -> None:
    """With late epochs, an outage longer than the latency, and alternatives that are put off and taken up again."""
    flown = given(base(), AT_S, yaw=180.0)  # type: ignore[operator]
    logs = flown.read()
    second = (logs.gnss.t_ns - logs.imu.t_ns[0]) / 1e9
    logs = dataclasses.replace(logs, gnss=logs.gnss.take(np.flatnonzero((second < 12.0) | (second > 17.0))))
    setup = with_latency(flown, logs)
    rows = setup.rows(logs.gnss, setup.navigation)
    out, events = run_filter(setup, logs.imu, rows, "gnss")
    engine = FilterEngine(setup)
    late_ns = (0, 1_700_000_000)  # every other epoch comes after the one that follows it
    arrivals = [(int(e.t_ns[0]) + late_ns[i % 2], e) for i, e in enumerate(epochs(logs.gnss))]
    feed(engine, logs.imu, arrivals)
    results = engine.take_results(all_of_them=True)
    nav = out.nav[: out.counts[0].nav]
    written = [r.out.nav[0].tobytes() for r in results if r.out.counts[0].nav == 1]
    assert written == [row.tobytes() for row in nav]
    assert [(e.t_ns, e.kind, e.detail) for e in engine.events] == [(e.t_ns, e.kind, e.detail) for e in events]
    assert "restart" in [e.kind for e in events]


def test_rows_of_one_epoch_are_those_of_the_log() -> None:
    flown = given(drive(), AT_S)
    logs = flown.read()
    setup = setup_filter(flown, logs, filter_config("tight17"))
    rows = setup.rows(logs.gnss, setup.navigation)
    alone = one_epoch(rows, 7)
    part = slice(int(rows.first[7]), int(rows.first[8]))
    assert alone.epoch_ns.tolist() == [rows.epoch_ns[7]]
    assert alone.first.tolist() == [0, part.stop - part.start]
    assert alone.observation.tobytes() == rows.observation[part].tobytes()
    assert np.array_equal(alone.sat, rows.sat[part])
