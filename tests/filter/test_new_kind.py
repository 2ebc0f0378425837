"""A block of states that the package does not know, added from here alone: a gyro scale factor on a turn-table."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import insgnss
from insgnss.config.library import filter_config
from insgnss.errors import ConfigError
from insgnss.filter.layout import Layout, diagonal
from insgnss.filter.output.writing import NAV_COLUMNS
from insgnss.runs.setup import setup_filter
from insgnss.runs.simulate import simulate
from tests.filter.test_engine import no_delay, stream

SCALE = 1000e-6  # of the simulated gyro about the axis of the table

GYRO_SCALE = insgnss.StateBlock(
    name="gyro_scale",
    columns=("gyro_scale_x_ppm", "gyro_scale_y_ppm", "gyro_scale_z_ppm"),
    unit="ppm",
    sigma=2000.0,
    couples=diagonal("gyro"),
    si_per_unit=1e-6,
)

# circles of some metres at 68 deg/s, seven turns in each direction
TABLE = """
name = "turn-table"
source = "made for this test"
gps_week = 2385
start_s = 200000.0
place = { lat_deg = 46.52, lon_deg = 6.57, h_m = 420.0, heading_deg = 35.0 }
speed_mps = 3.0

[[manoeuvre]]
kind = "straight"
duration_s = 10.0
[[manoeuvre]]
kind = "turn"
by_deg = 2520.0
bank_deg = 20.0
roll_in_deg_per_s = 40.0
roll_out_deg_per_s = 40.0
[[manoeuvre]]
kind = "straight"
duration_s = 10.0
[[manoeuvre]]
kind = "turn"
by_deg = -2520.0
bank_deg = 20.0
roll_in_deg_per_s = 40.0
roll_out_deg_per_s = 40.0
[[manoeuvre]]
kind = "straight"
duration_s = 10.0

[imu.grade]
gyro_bias_deg_per_h = 10.0
gyro_bias_instability_deg_per_h = 1.0
gyro_correlation_time_s = 600.0
gyro_arw_deg_per_sqrt_h = 0.1
accel_bias_mg = 3.0
accel_bias_instability_mg = 0.1
accel_correlation_time_s = 600.0
accel_vrw_mps_per_sqrt_h = 0.06

[gnss]
rate_hz = 5.0
lever_arm_m = [0.3, 0.0, -0.5]
"""


def turned(folder: Path, seed: int) -> insgnss.Flight:
    """Return a flight on the table whose gyro z measures 1000 ppm too much."""
    scenario = folder / "table.toml"
    scenario.write_text(TABLE)
    made = simulate(scenario, seed=seed)
    rates = made.log.imu.w_ib_b.copy()
    rates[:, 2] *= 1.0 + SCALE
    log = dataclasses.replace(made.log, imu=dataclasses.replace(made.log.imu, w_ib_b=rates))
    dataclasses.replace(made, log=log).save(folder / "log")
    return insgnss.Flight.load(folder / "log" / "flight.toml")


@pytest.mark.parametrize("seed", [21, 22, 23])
def test_turn_table_shows_the_gyros_scale_factor(tmp_path: Path, seed: int) -> None:
    flight = turned(tmp_path, seed)

    run = insgnss.replay(flight, states=[GYRO_SCALE])
    without = insgnss.replay(flight)

    last = run.nav.iloc[-1]
    error = last["gyro_scale_z_ppm"] - 1e6 * SCALE
    assert last["sd_gyro_scale_z_ppm"] < 300.0
    assert abs(error) < 3.0 * last["sd_gyro_scale_z_ppm"]
    yaw = [r.errors["d_yaw_deg"][r.errors["time_s"] > r.heading_known_s() + 20.0] for r in (run, without)]
    assert np.sqrt(np.mean(yaw[0] ** 2)) < np.sqrt(np.mean(yaw[1] ** 2))


def test_streaming_engine_estimates_the_same_states_with_the_same_bits(tmp_path: Path) -> None:
    flight = turned(tmp_path, 24)
    exact = {"process.imu_time_sigma_s": 0.0}
    run = insgnss.replay(flight, settings=exact, states=[GYRO_SCALE])
    logs = flight.read()
    setup = setup_filter(flight, logs, filter_config("tight", exact))
    engine = insgnss.Engine(dataclasses.replace(setup, states_wanted=(GYRO_SCALE,)))

    stream(engine, logs, no_delay())

    last = run.nav.iloc[-1]
    live = {r.t_ns: r.out for r in engine.take_results(all_of_them=True)}[int(logs.gnss.t_ns[-1])]
    assert live.nav["value"][0].tolist() == last[list(NAV_COLUMNS)].tolist()
    for column in (*GYRO_SCALE.columns, *(f"sd_{name}" for name in GYRO_SCALE.columns)):
        assert engine.state.values[column] == pytest.approx(last[column], rel=1e-3)
    assert (live.optional[0] / 1e-6).tolist() == [
        last[f"{sd}{name}"] for sd in ("", "sd_") for name in GYRO_SCALE.columns
    ]


@pytest.mark.parametrize(
    "wrong",
    [
        {"name": "no name"},
        {"columns": ()},
        {"sigma": 0.0},
        {"sigma": float("nan")},
        {"si_per_unit": 0.0},
        {"couples": diagonal("gyro")[:2]},
        {"couples": (insgnss.Coupling("gyro", "w", "w_x"),) * 3},
        {"couples": (insgnss.Coupling("clock", "x", "w_x"),) * 3},
        {"couples": (insgnss.Coupling("gyro", "x", "g_x"),) * 3},
        {"process": insgnss.RandomWalk(float("inf"))},
    ],
)
def test_unusable_block_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="state block"):
        dataclasses.replace(GYRO_SCALE, **wrong)


def test_blocks_need_names_of_their_own_and_room() -> None:
    with pytest.raises(ConfigError, match="two states are called 'gyro_scale'"):
        Layout((GYRO_SCALE, GYRO_SCALE))
    with pytest.raises(ConfigError, match="gyro_scale_x_ppm"):
        Layout((GYRO_SCALE, dataclasses.replace(GYRO_SCALE, name="other")))
    with pytest.raises(ConfigError, match="'clock_bias'"):
        Layout((dataclasses.replace(GYRO_SCALE, name="clock_bias"),))
    many = tuple(
        dataclasses.replace(GYRO_SCALE, name=f"b{i}", columns=tuple(f"c{i}_{k}" for k in range(3)))
        for i in range(17)
    )
    with pytest.raises(ConfigError, match="too many"):
        Layout(many)


def test_a_state_returns_to_zero_with_its_correlation_time() -> None:
    process = insgnss.GaussMarkov(sigma=2.0, time_s=50.0)

    assert process.rate == 0.02
    assert process.variance_per_s / (2.0 * process.rate) == pytest.approx(4.0)
