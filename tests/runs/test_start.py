"""How a filter starts: anywhere on the Earth, at rest and in motion, from a right, a vague and a wrong given state."""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
import pymap3d
import pytest

import insgnss
from insgnss.config.library import imu_grade
from insgnss.errors import StartError
from insgnss.runs.result import Run
from insgnss.simulation.sample_trajectories import (
    AIRFIELD,
    airborne_turns,
    car,
    circle,
    over_the_pole,
    static,
)
from insgnss.simulation.simulated_log import SimulatedLog, Simulator
from insgnss.tables import ImuTable
from tests.runs.scenes import (
    START_S,
    FlightInMemory,
    after,
    assert_honest,
    assert_sound,
    even_sky,
    flight,
    kinds,
    position_error_m,
    rows_where,
    simulator,
    true_start,
    turns,
)

PLACES = {
    "north-east": (48.0, 11.0, 500.0),
    "south-east": (-33.9, 151.2, 500.0),
    "south-west": (-22.9, -43.2, 500.0),
    "north-west": (40.0, -105.0, 1600.0),
    "equator": (0.0, 0.0, 300.0),
    "date line": (0.001, 179.9999, 300.0),
    "Antarctica": (-77.85, 166.7, 50.0),
}


@pytest.fixture(scope="module")
def log() -> SimulatedLog:
    return turns().draw(np.random.default_rng(1))


def replayed(flown: FlightInMemory, **settings: object) -> Run:
    """Return the run after the checks that hold whatever was wrong."""
    run = insgnss.replay(flown, settings=settings)
    assert_sound(run, flown)
    return run


def known_after_s(run: Run) -> float:
    """Return how long after the start the heading was known; one such event, no more."""
    known = run.events[run.events["kind"] == "heading_known"]["time_s"]
    assert len(known) == 1
    return float(known.iloc[0] - run.nav["time_s"].iloc[0])


# ------------------------------------------------------------------------------------------------ automatic


@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
def test_automatic_start_in_flight_works_anywhere(place: tuple[float, float, float]) -> None:
    base = simulator(airborne_turns(90.0, (place[0], place[1], 1500.0)), 90.0, navigation=even_sky())
    run = replayed(flight(base))
    assert known_after_s(run) < 20.0
    assert_honest(run, 0.0)


@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
def test_automatic_start_at_rest_works_anywhere(place: tuple[float, float, float]) -> None:
    """20 s at rest, then a drive: the heading is known soon after it begins to move."""
    run = replayed(flight(simulator(car(90.0, place), 90.0, navigation=even_sky())))
    assert "at rest" in run.events["detail"].iloc[0]
    assert 15.0 < known_after_s(run) < 40.0
    assert_honest(run, 0.0)


@pytest.mark.parametrize("bank_deg", [30.0, 45.0, 60.0])
@pytest.mark.parametrize("gnss_from_s", [1.0, 20.0], ids=["with the IMU", "after the IMU"])
def test_automatic_start_in_a_turn_at_100_metres_a_second(bank_deg: float, gnss_from_s: float) -> None:
    """The centripetal acceleration must not be taken for gravity, whichever log begins first."""
    radius_m = 100.0**2 / (9.81 * np.tan(np.radians(bank_deg)))
    trajectory = circle(75.0, *AIRFIELD[:2], 1500.0, radius_m=radius_m, speed_mps=100.0, bank_deg=bank_deg)
    run = replayed(flight(simulator(trajectory, 75.0, first_tag_s=gnss_from_s)))
    assert known_after_s(run) < 20.0
    assert "reset" not in kinds(run)
    assert_honest(run, 0.0)


@pytest.mark.parametrize("bias_mps2", [(0.3, 0.0, 0.0), (0.3, 0.3, -0.3)])
def test_consumer_sensor_with_a_large_accelerometer_bias_starts(
    bias_mps2: tuple[float, float, float],
) -> None:
    base = simulator(airborne_turns(120.0), 120.0, grade=imu_grade("mems_consumer"))
    drawn = base.draw(np.random.default_rng(3))
    imu = ImuTable(drawn.imu.t_ns, drawn.imu.w_ib_b, drawn.imu.f_b + np.array(bias_mps2))
    run = replayed(flight(base, drawn, imu=imu), **{"process.sensor_error_columns": True})
    assert_honest(run, 0.0)
    # of a level flight the vertical one is bias and scale factor together, with f_z = -g
    last = run.nav.iloc[-1]
    found = last["accel_bias_z_mps2"] - 9.8e-6 * last["accel_scale_factor_z_ppm"]
    true = drawn.at_imu.accel_bias[-1, 2] + bias_mps2[2] - 9.8 * drawn.accel_scale_factor[2]
    assert found == pytest.approx(true, abs=0.05)


def test_four_satellites_are_enough_after_some_patience(log: SimulatedLog) -> None:
    kept = [log.gnss.sv_names.index(sv) for sv in ("G23", "G02", "G16", "G13")]
    run = replayed(flight(turns(), log, gnss=rows_where(log.gnss, np.isin(log.gnss.sv, kept))))
    assert run.nav["time_s"].iloc[0] - START_S == pytest.approx(11.0, abs=1.0)
    assert_honest(run, 0.0)


# ------------------------------------------------------------------------------------------------ poles


@cache
def polar_flight() -> Simulator:
    return simulator(over_the_pole(120.0), 120.0, navigation=even_sky())


def test_flight_over_the_pole_has_no_seam() -> None:
    """250 m/s over the north pole at 60 s; in ECEF, since north turns round within a metre of it."""
    run = replayed(flight(polar_flight()))
    assert run.nav["lat_deg"].max() > 89.99
    truth = polar_flight().scenario.trajectory.motion(run.nav["time_s"].to_numpy() - START_S)
    r_e, v_e = in_ecef(run.nav)
    horizontal = np.hypot(run.nav["sd_n_m"], run.nav["sd_e_m"])
    off = np.linalg.norm(r_e - truth.r_e, axis=1)
    assert np.all(off < 4.0 * np.hypot(horizontal, run.nav["sd_d_m"]))
    sigma = np.sqrt(np.square(run.nav[["sd_vn_mps", "sd_ve_mps", "sd_vd_mps"]]).sum(axis=1))
    # the axes of a position 1 m off turn by 1 / distance: 1e-2 m/s at the closest epoch, 125 m from the pole, is left
    assert np.all(np.linalg.norm(v_e - truth.v_e, axis=1) < 4.0 * sigma + 1e-2)
    assert "reset" not in kinds(run)


def in_ecef(nav: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    place = [nav[c].to_numpy() for c in ("lat_deg", "lon_deg", "h_m")]
    velocity = [nav[c].to_numpy() for c in ("vn_mps", "ve_mps", "vd_mps")]
    r_e = np.column_stack(pymap3d.geodetic2ecef(*place))
    return r_e, np.column_stack(pymap3d.enu2uvw(velocity[1], velocity[0], -velocity[2], *place[:2]))


@pytest.mark.parametrize("lat_deg", [90.0, -90.0], ids=["north", "south"])
def test_filter_starts_and_stays_on_a_pole(lat_deg: float) -> None:
    base = simulator(static(60.0, lat_deg, 0.0, 2800.0), 60.0, navigation=even_sky())
    run = replayed(flight(base))
    r_e, v_e = in_ecef(run.nav)
    off = np.linalg.norm(r_e - base.gnss_motion.r_e[0], axis=1)
    sigma = np.sqrt(np.square(run.nav[["sd_n_m", "sd_e_m", "sd_d_m"]]).sum(axis=1))
    assert np.all(off < 4.0 * sigma)
    assert np.linalg.norm(v_e[-1]) < 0.1


# ------------------------------------------------------------------------------------------------ given


def given(**changes: object) -> insgnss.config.flight.GivenStart:
    return true_start(turns(), 2.0).model_copy(update=changes)


def turned(by_deg: float) -> tuple[float, float, float]:
    roll, pitch, yaw = true_start(turns(), 2.0).rpy_deg
    return roll, pitch, yaw + by_deg


def test_right_given_start_is_kept(log: SimulatedLog) -> None:
    start = given(sd_position_m=5.0, sd_velocity_mps=0.5, sd_roll_pitch_deg=1.0, sd_yaw_deg=2.0)
    run = replayed(flight(turns(), log, start=start))
    assert kinds(run) == ["start", "heading_known"]
    assert run.nav["time_s"].iloc[0] == pytest.approx(START_S + 2.0)
    assert_honest(run, 0.0)


@pytest.mark.parametrize("off_deg", [0.0, 100.0, 180.0])
def test_heading_of_no_knowledge_is_found_on_a_moving_platform(log: SimulatedLog, off_deg: float) -> None:
    run = replayed(flight(turns(), log, start=given(rpy_deg=turned(off_deg), sd_yaw_deg=180.0)))
    assert known_after_s(run) < 20.0
    assert "reset" not in kinds(run)
    assert_honest(run, 0.0)


@pytest.mark.parametrize("off_deg", [90.0, 180.0])
def test_heading_far_outside_its_sigma_is_noticed_and_corrected(log: SimulatedLog, off_deg: float) -> None:
    run = replayed(flight(turns(), log, start=given(rpy_deg=turned(off_deg), sd_yaw_deg=5.0)))
    assert "restart" in kinds(run)
    assert_honest(run, 60.0)


def test_attitude_upside_down_is_noticed_and_corrected(log: SimulatedLog) -> None:
    roll, pitch, yaw = true_start(turns(), 2.0).rpy_deg
    run = replayed(flight(turns(), log, start=given(rpy_deg=(roll + 180.0, pitch, yaw))))
    assert "restart" in kinds(run)
    assert_honest(run, 60.0)


@pytest.mark.parametrize("off_km", [1.0, 1000.0])
def test_position_far_outside_its_sigma_is_noticed_and_corrected(log: SimulatedLog, off_km: float) -> None:
    """At 1000 km the vertical is 9 deg off as well: the attitude is as wrong as the position."""
    lat_deg = true_start(turns(), 2.0).lat_deg - off_km / 111.2
    run = replayed(flight(turns(), log, start=given(lat_deg=lat_deg, sd_position_m=10.0)))
    assert {"reset", "restart"} & set(kinds(run))
    assert position_error_m(after(run, 30.0)).max() < 10.0
    assert_honest(run, 60.0)


def test_velocity_far_outside_its_sigma_is_corrected(log: SimulatedLog) -> None:
    north, east, down = true_start(turns(), 2.0).v_ned_mps
    run = replayed(flight(turns(), log, start=given(v_ned_mps=(north - 30.0, east, down))))
    assert_honest(run, 30.0)


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg"), [(0.0, 0.0), (-33.9, 151.2), (-60.0, -150.0)], ids=["zeros", "Sydney", "antipode"]
)
def test_start_from_which_the_satellites_cannot_be_seen_is_refused(
    log: SimulatedLog, lat_deg: float, lon_deg: float
) -> None:
    """All would be below the elevation mask: nothing is left for a gate to refuse, the filter would coast."""
    wrong = given(lat_deg=lat_deg, lon_deg=lon_deg, h_m=0.0, sd_position_m=10.0)
    run = replayed(flight(turns(), log, start=wrong))
    told = run.events.set_index("kind")["detail"]
    assert kinds(run)[:2] == ["start_refused", "start"]
    assert "below the horizon" in told["start_refused"] and "automatic" in told["start"]
    assert_honest(run, 60.0)


def test_start_below_the_horizon_of_a_few_satellites_is_kept(log: SimulatedLog) -> None:
    """From 2000 km further north two of the eleven are not to be seen: the gates and the lock-out see to it."""
    run = replayed(flight(turns(), log, start=given(lat_deg=78.0, sd_position_m=10.0)))
    assert "start_refused" not in kinds(run)
    assert {"reset", "restart"} & set(kinds(run))
    assert_honest(run, 60.0)


@pytest.mark.parametrize(
    ("time_s", "words"),
    [(START_S - 100.0, "before the first inertial sample"), (START_S + 1000.0, "after the last epoch")],
    ids=["before", "after"],
)
def test_given_start_outside_the_log_is_a_typed_error(log: SimulatedLog, time_s: float, words: str) -> None:
    with pytest.raises(StartError, match=words):
        insgnss.replay(flight(turns(), log, start=given(time_s=time_s)))
