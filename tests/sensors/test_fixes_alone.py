"""Flights without raw GNSS data: position fixes start and carry the filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import insgnss
from insgnss.config.flight import FlightConfig, GivenStart
from insgnss.config.library import find, imu_grade
from insgnss.constants import NS_PER_S
from insgnss.errors import ConfigError, StartError
from insgnss.log.checks.report import AXES_FIT
from insgnss.log.flight import FlightInMemory
from insgnss.log.gnss_log import without_gnss
from insgnss.runs.check import examine
from insgnss.runs.simulate import simulate
from insgnss.simulation.simulated_log import Simulator
from tests.real_flights import without_knock
from tests.runs.scenes import START_S, kinds, true_start, turns
from tests.sensors.scenes import city_car, fault, flown, simulated, with_sensors
from tests.statistics_bounds import mean_chi_square_bounds

FIXES = (simulated("position", noise_time_s=0.0, noise_m=(1.0, 1.0, 2.0)), simulated("velocity"))


# of a receiver with a base station, four times a second
CLOSE_FIXES = (
    simulated("position", rate_hz=4.0, noise_time_s=0.0, noise_m=(0.02, 0.02, 0.03)),
    simulated("velocity", rate_hz=4.0),
)


def fixes_alone(
    base: Simulator,
    seed: int,
    start: GivenStart | None = None,
    fixes: Sequence[Any] = FIXES,
    faults: Sequence[Any] = (),
) -> FlightInMemory:
    """Return a flight whose flight file has no [gnss]."""
    made = flown(with_sensors(base, fixes, faults), seed)
    data = made.config.model_dump(exclude={"gnss", "start"}) | {"start": start or "automatic"}
    config = FlightConfig.model_validate(data)
    assert not config.gnss.files
    return replace(made, config=config, logs=replace(made.logs, gnss=without_gnss().gnss, navigation=None))


@pytest.mark.parametrize("start", ["automatic", "given"])
def test_fixes_alone_give_position_velocity_and_attitude(start: str) -> None:
    """An aircraft that turns for a minute: the heading is found, errors are as large as their sigmas."""
    base = turns(90.0)
    made = fixes_alone(base, 2, true_start(base, 2.0) if start == "given" else None)
    run = insgnss.replay(made)

    assert run.errors is not None
    assert len(run.measurements) and set(run.measurements["kind"].astype(str)) == {"position", "velocity"}
    late = run.errors[run.errors["time_s"] > START_S + 60.0]
    names = ("n_m", "e_m", "d_m", "vn_mps", "ve_mps", "vd_mps", "roll_deg", "pitch_deg", "yaw_deg")
    ratio2 = np.array([(late[f"d_{name}"] / late[f"sd_{name}"]) ** 2 for name in names])
    low, high = mean_chi_square_bounds(1, ratio2.size, effective_share=0.1)  # errors last some ten fixes
    assert low < ratio2.mean() < high
    assert late[["d_n_m", "d_e_m", "d_d_m"]].abs().to_numpy().max() < 4.0
    assert late["d_yaw_deg"].abs().max() < 3.0
    assert "start" in kinds(run) and "without raw GNSS data" in run.events["detail"].iloc[0]


def shaken(made: FlightInMemory, deg_per_s: float, rng: np.random.Generator) -> FlightInMemory:
    """Return a flight whose gyros have more white noise than their grade, as on a vibrating mount."""
    imu = made.logs.imu
    noise = np.radians(deg_per_s) * rng.standard_normal(imu.w_ib_b.shape)
    return replace(made, logs=replace(made.logs, imu=replace(imu, w_ib_b=imu.w_ib_b + noise)))


def test_fixes_of_a_fast_log_start_the_filter() -> None:
    """Two fixes of a start are half a second apart, however many stand between them."""
    run = insgnss.replay(fixes_alone(turns(30.0), 1, fixes=CLOSE_FIXES))

    assert run.nav["time_s"].iloc[0] - START_S < 4.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_filter_whose_gyros_are_noisier_than_their_grade_stays_with_its_fixes(
    seed: int, rng: np.random.Generator
) -> None:
    """Refused for good, the fixes would leave it hundreds of metres behind."""
    run = insgnss.replay(shaken(fixes_alone(turns(120.0), seed, fixes=CLOSE_FIXES), 5.0, rng))

    assert run.errors is not None
    late = run.errors[run.errors["time_s"] > START_S + 40.0]
    names = ("n_m", "e_m", "d_m")
    error = np.array([late[f"d_{name}"] for name in names])
    sigma = np.array([late[f"sd_{name}"] for name in names])
    assert np.abs(error).max() < 0.3
    assert 0.7 < np.sqrt(np.mean((error / sigma) ** 2)) < 1.3
    doubted = run.events[run.events["kind"] == "filter_doubted"]
    assert len(doubted) and doubted["detail"].str.contains("grade of the inertial sensor").all()


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_filter_is_not_doubted_where_all_errors_are_as_stated(seed: int) -> None:
    run = insgnss.replay(fixes_alone(turns(120.0), seed, fixes=CLOSE_FIXES))

    assert not {"filter_doubted", "sensor_refused"}.intersection(kinds(run))


@pytest.mark.parametrize("frozen", [("position", "velocity"), ("position",), ("velocity",)])
@pytest.mark.parametrize("flight", ["car", "aircraft"])
def test_fixes_that_stand_still_for_half_a_minute_do_not_take_the_filter_along(
    frozen: tuple[str, ...], flight: str
) -> None:
    """It was 250 m (car) and 2.5 km (aircraft) behind, at 250 and 2200 sigma."""
    faults = [fault("frozen", 70.0, 100.0, sensor=sensor) for sensor in frozen]
    run = insgnss.replay(fixes_alone(city_car() if flight == "car" else turns(120.0), 6, faults=faults))

    assert run.errors is not None
    late = run.errors[run.errors["time_s"] > START_S + 50.0]
    for names in (("n_m", "e_m", "d_m"), ("vn_mps", "ve_mps", "vd_mps")):
        for name in names:  # the first repeated fix may pass the gate
            assert (late[f"d_{name}"] / late[f"sd_{name}"]).abs().max() < 8.0, name
    assert np.hypot(late["d_n_m"], late["d_e_m"]).max() < 40.0
    assert {"sensor_refused", "sensor_agrees"} <= set(kinds(run))
    assert "filter_doubted" not in kinds(run)


def test_fixes_that_repeat_at_rest_are_used() -> None:
    faults = [fault("frozen", 8.0, 28.0, sensor=sensor) for sensor in ("position", "velocity")]
    run = insgnss.replay(fixes_alone(city_car(60.0), 6, faults=faults))

    rows = run.measurements
    standing = rows[rows["time_s"].between(START_S + 9.0, START_S + 27.0)]
    assert (standing["status"] == "used").mean() > 0.95
    assert "sensor_refused" not in kinds(run)


def warming_up(made: FlightInMemory) -> FlightInMemory:
    """Return a flight whose first gyro is off by 1.2 deg/s for 3 s, then by 0.45 deg/s, which fades within 6 s."""
    imu = made.logs.imu
    t_s = (imu.t_ns - imu.t_ns[0]) / NS_PER_S
    w_ib_b = imu.w_ib_b.copy()
    w_ib_b[:, 0] -= np.radians(np.where(t_s < 3.0, 1.2, 0.45 * np.exp(-(t_s - 3.0) / 6.0)))
    return replace(made, logs=replace(made.logs, imu=replace(imu, w_ib_b=w_ib_b)))


@pytest.mark.parametrize("seed", [51, 52, 53])
def test_gyro_that_warms_up_at_rest_does_not_lead_any_heading_away(seed: int) -> None:
    """The bias at the start is wrong by ten of its sigmas; with all headings open one alone could drift away."""
    run = insgnss.replay(warming_up(fixes_alone(city_car(90.0), seed)))

    errors = run.errors
    assert errors is not None
    assert np.hypot(errors["d_n_m"], errors["d_e_m"]).max() < 5.0
    assert np.hypot(errors["d_vn_mps"], errors["d_ve_mps"]).max() < 5.0
    late = errors[errors["time_s"] > errors["time_s"].iloc[0] + 60.0]
    for angle in ("roll", "pitch", "yaw"):
        assert (late[f"d_{angle}_deg"] / late[f"sd_{angle}_deg"]).abs().max() < 5.0
    assert "sensor_refused" not in kinds(run)


@pytest.mark.parametrize("raw", [True, False])
def test_start_at_rest_learns_the_biases_of_an_uncalibrated_phone(raw: bool) -> None:
    """Up to fifty biases of the grade: gravity shows that the vehicle does not tilt; about gravity it might turn."""
    base, gyro_b = city_car(90.0), np.radians([-0.6, -2.1, 3.8])
    made = flown(base, 71) if raw else fixes_alone(base, 71)
    imu = made.logs.imu
    run = insgnss.replay(replace(made, logs=replace(made.logs, imu=replace(imu, w_ib_b=imu.w_ib_b + gyro_b))))

    assert run.errors is not None
    assert "at rest" in run.events.loc[run.events["kind"] == "start", "detail"].iloc[0]
    begin = run.nav.iloc[0]
    assert begin["gyro_bias_y_radps"] == pytest.approx(gyro_b[1], abs=5.0 * begin["sd_gyro_bias_y_radps"])
    assert begin["sd_gyro_bias_y_radps"] < 0.2 * abs(gyro_b[1])
    assert abs(begin["gyro_bias_z_radps"] - gyro_b[2]) < 2.0 * begin["sd_gyro_bias_z_radps"]
    assert (run.errors["d_yaw_deg"] / run.errors["sd_yaw_deg"]).abs().max() < 5.0
    assert run.errors[["d_roll_deg", "d_pitch_deg"]].abs().to_numpy().max() < 6.0  # 2.1 deg/s are more in 3 s
    assert np.hypot(run.errors["d_n_m"], run.errors["d_e_m"]).max() < 10.0


def test_one_fix_far_off_is_refused_and_costs_little() -> None:
    made = fixes_alone(turns(90.0), 2, fixes=CLOSE_FIXES)
    position = next(table for table in made.logs.sensors if table.name == "position")
    values = position.values.copy()
    values[len(values) // 2, 0] += np.radians(0.001)  # 100 m
    others = [table for table in made.logs.sensors if table is not position]
    spoilt = replace(made, logs=replace(made.logs, sensors=(replace(position, values=values), *others)))

    usual, run = insgnss.replay(made), insgnss.replay(spoilt)

    far = run.measurements[run.measurements["innovation"].abs() > 50.0]
    assert set(far["status"].astype(str)) == {"gated"}
    sigmas = ["sd_n_m", "sd_e_m", "sd_d_m", "sd_roll_deg", "sd_pitch_deg", "sd_yaw_deg"]
    assert (run.nav[sigmas].iloc[-1] < 1.2 * usual.nav[sigmas].iloc[-1]).all()
    assert "filter_doubted" not in kinds(run)


def test_start_at_rest_knows_gyro_biases_and_level() -> None:
    """Level to the accelerometers' biases; the gyros' reading is shared between bias and g-sensitivity."""
    ratio2, sd_bias, sd_level = [], [], []
    for seed in range(31, 43):
        run = insgnss.replay(fixes_alone(city_car(20.0), seed))
        assert run.errors is not None
        assert "at rest" in run.events.loc[run.events["kind"] == "start", "detail"].iloc[0]
        row = run.errors.iloc[8]
        ratio2 += [(row[f"d_{name}"] / row[f"sd_{name}"]) ** 2 for name in ("roll_deg", "pitch_deg")]
        sd_level.append(row["sd_roll_deg"])
        sd_bias.append(np.degrees(run.nav["sd_gyro_bias_z_radps"].iloc[8]) * 3600.0)
    low, high = mean_chi_square_bounds(1, len(ratio2))
    assert low < np.mean(ratio2) < high
    grade = imu_grade("mems_consumer")
    assert max(sd_bias) < 0.85 * grade.gyro_bias_deg_per_h
    assert max(sd_level) < np.degrees(1.3e-3 * grade.accel_bias_mg)


def without_fixes(made: FlightInMemory, from_s: float, to_s: float) -> FlightInMemory:
    """Return a flight whose sensors give nothing for a while, in seconds after its start."""
    tables = []
    for table in made.logs.sensors:
        after_s = (table.t_ns - made.logs.imu.t_ns[0]) / NS_PER_S
        kept = (after_s < from_s) | (after_s > to_s)
        tables.append(
            replace(table, t_ns=table.t_ns[kept], values=table.values[kept], sigma=table.sigma[kept])
        )
    return replace(made, logs=replace(made.logs, sensors=tuple(tables)))


def test_fixes_alone_are_smoothed_also_over_a_pause() -> None:
    """Half a minute without fixes: the smoother's errors are far smaller, and as large as their sigmas."""
    rms, ratio2 = {}, []
    for smooth in (False, True):
        squares = []
        for seed in range(21, 29):
            made = without_fixes(fixes_alone(turns(120.0), seed), 50.0, 80.0)
            run = insgnss.replay(made, smooth=smooth)
            assert run.errors is not None
            inside = run.errors[run.errors["time_s"].between(START_S + 52.0, START_S + 78.0)]
            squares.append([float(np.mean(inside[f"d_{name}"] ** 2)) for name in ("n_m", "e_m", "d_m")])
            if smooth:
                middle = inside.iloc[len(inside) // 2]
                names = (
                    "n_m",
                    "e_m",
                    "d_m",
                    "vn_mps",
                    "ve_mps",
                    "vd_mps",
                    "roll_deg",
                    "pitch_deg",
                    "yaw_deg",
                )
                ratio2 += [(middle[f"d_{name}"] / middle[f"sd_{name}"]) ** 2 for name in names]
        rms[smooth] = np.sqrt(np.mean(squares))

    assert rms[True] < 0.35 * rms[False]
    low, high = mean_chi_square_bounds(1, len(ratio2), effective_share=0.3)  # components are correlated
    assert low < np.mean(ratio2) < high


def test_run_of_fixes_alone_can_be_saved_and_reported(tmp_path: Path) -> None:
    base = turns(90.0)
    made = fixes_alone(base, 2, true_start(base, 2.0))
    run = insgnss.replay(made, output=2.0, smooth=True)
    assert np.isfinite(run.nav.drop(columns=run.nav.filter(like="slow")).to_numpy(np.float64)).all()
    run.save(tmp_path / "run")
    assert len(insgnss.Run.load(tmp_path / "run").nav) == len(run.nav)
    assert run.report(tmp_path / "run.html").stat().st_size > 10_000


def level_velocities(made: FlightInMemory) -> FlightInMemory:
    """Return a flight whose velocities have no vertical component, as those of NMEA."""
    names = made.config.sensor[1].columns.model_copy(update={"velocity": ("vn_mps", "ve_mps", "none")})
    sensors = made.config.sensor[0], made.config.sensor[1].model_copy(update={"columns": names})
    tables = [
        replace(table, values=table.values * (1.0, 1.0, np.nan)) if table.name == "velocity" else table
        for table in made.logs.sensors
    ]
    config = made.config.model_copy(update={"sensor": sensors})
    return replace(made, config=config, logs=replace(made.logs, sensors=tuple(tables)))


def test_level_velocities_show_rest_with_the_heights_of_the_fixes() -> None:
    run = insgnss.replay(level_velocities(fixes_alone(city_car(40.0), 4, fixes=CLOSE_FIXES)))
    start = run.events.loc[run.events["kind"] == "start", "detail"].iloc[0]
    assert "at rest" in start and run.errors is not None
    whole = insgnss.replay(fixes_alone(city_car(40.0), 4, fixes=CLOSE_FIXES))
    begin = run.nav.iloc[0]
    assert begin["sd_gyro_bias_z_radps"] == pytest.approx(whole.nav.iloc[0]["sd_gyro_bias_z_radps"], rel=0.05)
    assert (run.errors["d_roll_deg"] / run.errors["sd_roll_deg"]).abs().max() < 4.0


def test_flight_with_neither_gnss_nor_fixes_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "flight.toml"
    path.write_text('gps_week = 2385\n[imu]\nfiles = ["imu.csv"]\ngrade = "tactical"\n')
    with pytest.raises(ConfigError, match="no GNSS: give"):
        insgnss.Flight.load(path)


def test_fixes_outside_the_inertial_samples_cannot_start() -> None:
    made = fixes_alone(turns(90.0), 2)
    late = tuple(replace(table, t_ns=table.t_ns + 10**12) for table in made.logs.sensors)
    with pytest.raises(StartError, match="no two position fixes"):
        insgnss.replay(replace(made, logs=replace(made.logs, sensors=late)))


def saved_without_gnss(folder: Path, scenario: str, duration_s: float, further: str = "") -> Path:
    """Return the flight file of a saved simulation with [gnss] taken out of it; ``further`` sensors."""
    file = folder / "scenario.toml"
    text = find("scenarios", scenario).read_text(encoding="utf-8")
    file.write_text(text + '\n[[sensor]]\nkind = "position"\n[[sensor]]\nkind = "velocity"\n' + further)
    simulate(file, 3, duration_s=duration_s).save(folder / "flight")
    path = folder / "flight" / "flight.toml"
    said = path.read_text(encoding="utf-8")
    first, last = said.index("[gnss]"), said.index("[[sensor]]")
    path.write_text(said[:first] + said[last:], encoding="utf-8")
    return path


def test_check_holds_the_inertial_samples_against_the_fixes(tmp_path: Path) -> None:
    path = saved_without_gnss(tmp_path, "steep_turns", 240.0)
    found = examine(insgnss.Flight.load(path)).findings
    assert any(f.kind == AXES_FIT for f in found)
    assert not [f for f in found if f.proposals or f.severity == "error"]

    said = path.read_text(encoding="utf-8")
    path.write_text(said.replace("[imu]", "[imu]\ntime.offset_s = 0.2", 1), encoding="utf-8")
    late = [p for f in examine(insgnss.Flight.load(path)).findings for p in f.proposals]
    assert [p.key for p in late] == ["imu.time.offset_s"]
    assert late[0].value == pytest.approx(0.0, abs=0.05)


def test_check_tells_how_long_fixes_and_velocities_pause(tmp_path: Path) -> None:
    path = saved_without_gnss(tmp_path, "steep_turns", 240.0)
    for name in ("sensor_position.csv", "sensor_velocity.csv"):
        log = pd.read_csv(path.parent / name, dtype=str)
        log.drop(index=range(100, 103)).to_csv(path.parent / name, index=False)

    gaps = [f.text for f in examine(insgnss.Flight.load(path)).findings if f.text.startswith("GNSS gap")]
    assert len(gaps) == 1 and gaps[0].startswith("GNSS gap of 4 s from ")


def test_check_holds_other_sensors_against_the_fixes(tmp_path: Path) -> None:
    """A magnetometer in mG that is declared in uT, beside one that is right."""
    path = saved_without_gnss(tmp_path, "steep_turns", 120.0, '[[sensor]]\nkind = "magnetometer"\n')
    right = {
        f.text: f.severity for f in examine(insgnss.Flight.load(path)).findings if f.topic == "magnetometer"
    }
    assert set(right.values()) == {"ok"} and any("from the GNSS course" in text for text in right)

    log = pd.read_csv(path.parent / "sensor_magnetometer.csv")
    log.iloc[:, 1:] *= 10.0
    log.to_csv(path.parent / "sensor_magnetometer.csv", index=False)
    wrong = [f for f in examine(insgnss.Flight.load(path)).findings if f.severity == "warning"]
    assert any("the Earth's field is 22 to 67 uT" in f.advice for f in wrong)


def test_check_and_replay_of_a_saved_flight_of_fixes_alone(tmp_path: Path) -> None:
    path = saved_without_gnss(tmp_path, "turning_flight", 40.0)

    report = insgnss.check_flight(insgnss.Flight.load(path))
    assert not report.of("error") and any("no raw GNSS data" in f.text for f in report.findings)
    with pytest.raises(ConfigError, match="no raw GNSS data"):
        insgnss.point(path)
    with pytest.raises(ConfigError, match="starts with raw GNSS epochs"):
        insgnss.engine_settings(path)
    run = insgnss.replay(path)
    assert run.errors is not None
    assert run.errors[["d_n_m", "d_e_m", "d_d_m"]].abs().to_numpy().max() < 15.0


@pytest.mark.real_data
def test_walk_on_its_receivers_fixes_alone_has_the_heading_of_the_tight_filter(
    data_root: Path, tmp_path: Path
) -> None:
    """A handheld log with four fixes a second of a receiver with a base station."""
    folder = data_root / "walk_boulder_20250828"
    fixes = f'files = ["{folder / "reference.csv"}"]'
    path = tmp_path / "flight.toml"
    path.write_text(
        f'gps_week = 2381\n[imu]\nfiles = ["{folder / "imu.csv"}"]\ngrade = "mems_consumer"\n[imu.columns]\n'
        'gyro = ["wx_radps", "wy_radps", "wz_radps"]\naccel = ["fx_mps2", "fy_mps2", "fz_mps2"]\n'
        f'[[sensor]]\nkind = "position"\n{fixes}\nsigma_m = [0.1, 0.1, 0.2]\n'
        f'[[sensor]]\nkind = "velocity"\n{fixes}\nsigma_mps = [0.1, 0.1, 0.1]\n'
        'columns = { velocity = ["vn", "ve", "vd"] }\n'
    )
    loose = insgnss.replay(path, output=1.0)
    tight = insgnss.replay(without_knock("walk"), output=1.0)

    assert (loose.measurements["status"] == "used").mean() > 0.95
    both = loose.nav.merge(tight.nav, on="time_s", suffixes=("", "_tight"))
    both = both[(both["sd_yaw_deg"] < 5.0) & (both["sd_yaw_deg_tight"] < 5.0)]
    apart = np.remainder(both["yaw_deg"] - both["yaw_deg_tight"] + 180.0, 360.0) - 180.0
    assert len(both) > 60
    assert (apart.abs() < 3.0 * np.hypot(both["sd_yaw_deg"], both["sd_yaw_deg_tight"])).all()
