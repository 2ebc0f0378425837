"""Further sensors in whole runs: what they are worth, whether their sigmas hold, and what faults do to them."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import insgnss
from insgnss.runs.result import Run
from insgnss.simulation.faults import outage
from insgnss.simulation.sample_trajectories import AIRFIELD, static
from insgnss.simulation.simulated_log import Simulator
from insgnss.tables import Float64
from tests.runs.scenes import START_S, even_sky, kinds, simulator, true_start, turns, with_faults
from tests.runs.test_heading_at_rest import CONSUMER
from tests.sensors.scenes import city_car, fault, flown, simulated, with_sensors
from tests.statistics_bounds import mean_chi_square_bounds

GONE_S = (70.0, 130.0)
SEEDS = 5
LEVER = (-1.5, 0.7, 0.4)


def at(run: Run, seconds: float) -> Any:
    assert run.errors is not None
    return run.errors[(run.errors["time_s"] - START_S - seconds).abs() < 1e-6].iloc[0]


# ------------------------------------------------------------------------------------------- what they are worth


@cache
def tunnel(with_them: bool) -> tuple[Float64, Float64]:
    """Return errors and sigmas north, east, down (seeds, 3) of a car after 59 s without satellites."""
    sensors = [
        simulated("odometer", rate_hz=2.0, lever_arm_m=LEVER, noise_mps=0.1, noise_time_s=1.0),
        simulated("barometer", rate_hz=1.0, noise_time_s=2.0),
    ]
    base = with_faults(city_car(), [outage(None, *GONE_S)])
    base = with_sensors(base, sensors if with_them else [])
    found = [
        at(insgnss.replay(flown(base, seed, true_start(base, 2.0)), output=1.0), 129.0)
        for seed in range(SEEDS)
    ]
    return (
        np.array([[row[f"d_{axis}_m"] for axis in "ned"] for row in found]),
        np.array([[row[f"sd_{axis}_m"] for axis in "ned"] for row in found]),
    )


def test_odometer_and_barometer_hold_a_car_in_a_tunnel() -> None:
    """A telephone's inertial sensor for 59 s, with corners: what is left is across the way, and no drift in height."""
    (free, _), (held, sigma) = tunnel(False), tunnel(True)

    assert np.sqrt(np.mean(held[:, :2] ** 2)) < 0.4 * np.sqrt(np.mean(free[:, :2] ** 2))
    assert np.sqrt(np.mean(held[:, 2] ** 2)) < 3.0 < 8.0 < np.sqrt(np.mean(free[:, 2] ** 2))
    assert sigma[:, 2].max() < 4.0


@pytest.mark.parametrize("axes", [(0, 1), (2,)])
def test_errors_in_the_tunnel_are_as_large_as_their_sigma(axes: tuple[int, ...]) -> None:
    held, sigma = tunnel(True)
    ratio2 = (held / sigma)[:, axes] ** 2
    low, high = mean_chi_square_bounds(1, ratio2.size)

    assert low < ratio2.mean() < high


EVERY_KIND = (
    simulated("odometer", rate_hz=2.0, lever_arm_m=LEVER),
    simulated("barometer", rate_hz=2.0, lever_arm_m=(1.0, 0.5, 0.2)),
    simulated("magnetometer", rate_hz=2.0),
    simulated("heading", rate_hz=1.0),
    simulated("attitude", rate_hz=1.0),
    simulated("position", lever_arm_m=(0.5, -0.4, -1.0), noise_time_s=0.0),
    simulated("velocity", lever_arm_m=(0.5, -0.4, -1.0)),
)
N_ROWS = {"magnetometer": 2, "attitude": 3, "position": 3, "velocity": 3}


@cache
def turning() -> Run:
    """Return an aircraft in banked turns with a sensor of every kind, white noise as declared."""
    base = with_sensors(turns(75.0), EVERY_KIND)
    return insgnss.replay(flown(base, 1, true_start(base, 2.0)))


@pytest.mark.parametrize("kind", [sensor.kind for sensor in EVERY_KIND])
def test_normalised_innovations_of_every_kind_are_chi_square(kind: str) -> None:
    run = turning()
    rows = run.measurements[(run.measurements["kind"] == kind) & (run.measurements["status"] == "used")]
    low, high = mean_chi_square_bounds(1, len(rows))

    assert len(rows) > 70 * N_ROWS.get(kind, 1) * 0.97
    assert low < rows["nis"].mean() < high


def test_states_of_the_sensors_stand_in_the_navigation_table() -> None:
    run = turning()
    for name in (
        "odometer_scale_percent",
        "barometer_offset_m",
        "magnetometer_iron_x_ut",
        "heading_offset_deg",
    ):
        assert run.nav[f"sd_{name}"].iloc[-1] < 0.8 * run.nav[f"sd_{name}"].iloc[0], name
    assert run.errors is not None
    ratios = [
        run.errors[f"d_{name}"].iloc[-1] / run.errors[f"sd_{name}"].iloc[-1] for name in ("n_m", "yaw_deg")
    ]
    assert np.abs(ratios).max() < 4.0


@pytest.mark.parametrize("seed", range(2))
def test_magnetometer_tells_the_heading_at_rest(seed: int) -> None:
    base = simulator(static(30.0, *AIRFIELD), 30.0, navigation=even_sky(), grade=CONSUMER)
    base = with_sensors(base, [simulated("magnetometer", rate_hz=1.0)])
    run = insgnss.replay(flown(base, seed))

    last = at(run, 29.0)
    assert last["sd_yaw_deg"] < 4.5  # 1 uT of hard iron in 20 uT: 2.9 deg
    assert last["sd_yaw_deg"] > 2.0  # more than readings can average away
    assert abs(last["d_yaw_deg"]) < 3.0 * last["sd_yaw_deg"]
    assert "heading_known" in kinds(run)


def test_position_and_velocity_fixes_carry_on_alone_when_the_raw_data_end() -> None:
    base = with_sensors(with_faults(turns(75.0), [outage(None, 15.0, 80.0)]), EVERY_KIND[-2:])
    run = insgnss.replay(flown(base, 3, true_start(base, 2.0)), output=1.0)

    assert run.errors is not None
    gone = run.errors[run.errors["time_s"] > START_S + 25.0]
    assert gone[["d_n_m", "d_e_m", "d_d_m"]].abs().to_numpy().max() < 4.0
    ratio2 = (
        gone[["d_n_m", "d_e_m", "d_d_m"]].to_numpy() / gone[["sd_n_m", "sd_e_m", "sd_d_m"]].to_numpy()
    ) ** 2
    low, high = mean_chi_square_bounds(1, ratio2.size, effective_share=0.1)  # errors last some ten fixes
    assert low < ratio2.mean() < high


# ------------------------------------------------------------------------------------------------------------ faults


def faulty(base: Simulator, sensor: Any, wrong: Any, **otherwise: Any) -> tuple[Run, Run]:
    """Return runs with a sensor in order and with its fault, of the same draw."""
    sound, spoilt = (with_sensors(base, [sensor], faults) for faults in ([], [wrong]))
    runs = [
        insgnss.replay(flown(one, 5, true_start(base, 2.0), **otherwise), output=1.0)
        for one in (sound, spoilt)
    ]
    return runs[0], runs[1]


def worst_ratio(run: Run, names: tuple[str, ...], from_s: float) -> float:
    assert run.errors is not None
    late = run.errors[run.errors["time_s"] >= START_S + from_s]
    return float(max((late[f"d_{name}"] / late[f"sd_{name}"]).abs().max() for name in names))


def furthest(sound: Run, spoilt: Run, names: tuple[str, ...], from_s: float) -> float:
    """Return by how much a fault has moved the solution at most."""
    assert sound.errors is not None and spoilt.errors is not None
    late = sound.errors["time_s"] >= START_S + from_s
    return float(max((sound.errors[f"d_{n}"] - spoilt.errors[f"d_{n}"])[late].abs().max() for n in names))


def told(run: Run, kind: str) -> str:
    return "; ".join(run.events[run.events["kind"] == kind]["detail"])


def test_wheel_that_slips_is_refused_and_named() -> None:
    """30 % for 14 s in the tunnel, at 14 m/s: 59 m of way that was not gone."""
    base = with_faults(city_car(), [outage(None, *GONE_S)])
    odometer = simulated("odometer", rate_hz=2.0, lever_arm_m=LEVER, noise_mps=0.1, noise_time_s=1.0)
    sound, spoilt = faulty(base, odometer, fault("slip", 72.0, 86.0))

    assert "'odometer' has been refused" in told(spoilt, "sensor_refused")
    assert "slips" in told(spoilt, "sensor_refused")
    assert "agrees" in told(spoilt, "sensor_agrees")
    assert told(sound, "sensor_refused") == ""
    assert furthest(sound, spoilt, ("n_m", "e_m"), 30.0) < 5.0
    assert (
        abs(spoilt.nav["odometer_scale_percent"].iloc[-1] - sound.nav["odometer_scale_percent"].iloc[-1])
        < 2.0
    )


def test_draught_through_a_window_is_named_and_the_height_stays() -> None:
    base = city_car()
    barometer = simulated("barometer", rate_hz=2.0)
    sound, spoilt = faulty(base, barometer, fault("draught", 50.0, 75.0, size_hpa=0.8))

    assert "several readings of 'barometer'" in told(spoilt, "sensor_stepped")
    assert furthest(sound, spoilt, ("d_m",), 10.0) < 1.0  # of 6.7 m
    late = spoilt.measurements.query("kind == 'barometer' and time_s > @START_S + 80.0")
    assert (late["status"] == "used").mean() > 0.9


def test_motor_beside_the_magnetometer_is_refused_as_a_whole() -> None:
    base = with_sensors(turns(60.0), [])
    sensor = simulated("magnetometer", rate_hz=2.0)
    _, spoilt = faulty(base, sensor, fault("disturbance", 30.0, 50.0))

    rows = spoilt.measurements.query(
        "kind == 'magnetometer' and time_s > @START_S + 31 and time_s < @START_S + 49"
    )
    assert (rows["status"] == "gated").mean() > 0.9
    by_time = rows.groupby("time_s")["status"].nunique()
    assert (by_time == 1).all()  # never one component alone
    assert "motors" in told(spoilt, "sensor_refused")
    assert worst_ratio(spoilt, ("yaw_deg",), 10.0) < 4.5


def test_heading_that_stands_still_in_a_turn_is_found_and_refused() -> None:
    base = with_sensors(turns(60.0), [])
    _, spoilt = faulty(base, simulated("heading", rate_hz=2.0), fault("frozen", 25.0, 55.0, sensor="heading"))

    assert "'heading' repeats one value for 3" in told(spoilt, "sensor_frozen")
    assert "'heading' has been refused" in told(spoilt, "sensor_refused")
    assert worst_ratio(spoilt, ("yaw_deg",), 10.0) < 4.5


def test_empty_cells_are_refused_as_bad_values_and_told() -> None:
    base = with_sensors(turns(60.0), [])
    _, spoilt = faulty(
        base, simulated("barometer", rate_hz=2.0), fault("sensor_silence", 25.0, 45.0, sensor="barometer")
    )

    rows = spoilt.measurements.query(
        "kind == 'barometer' and time_s > @START_S + 25.1 and time_s < @START_S + 44.9"
    )
    assert (rows["status"] == "bad_value").all() and len(rows) > 35
    assert "no usable number" in told(spoilt, "sensor_refused")


def test_position_fixes_that_jump_do_not_move_the_filter() -> None:
    base = with_sensors(turns(60.0), [])
    jump = fault("sensor_step", 30.0, 45.0, sensor="position", size=(0.0, 0.0, 60.0))
    _, spoilt = faulty(base, simulated("position", rate_hz=1.0), jump)

    rows = spoilt.measurements.query(
        "kind == 'position' and time_s > @START_S + 30.1 and time_s < @START_S + 44.9"
    )
    assert (rows["status"] == "gated").all() and len(rows) == 42  # north and east too
    assert worst_ratio(spoilt, ("n_m", "e_m", "d_m"), 10.0) < 5.0
