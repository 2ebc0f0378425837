"""Allan deviation: the definition, the simulated sensor, the fit, and the grade file that replay accepts."""

from __future__ import annotations

from pathlib import Path

import allantools
import numpy as np
import pytest
from typer.testing import CliRunner

from insgnss.cli.main import app
from insgnss.config.flight import ImuGrade
from insgnss.config.strict import load_toml
from insgnss.errors import InputError
from insgnss.runs.allan import (
    AllanCurve,
    NoiseFit,
    allan_study,
    fit,
    gauss_markov_variance,
    grade_text,
    overlapping_allan,
)
from insgnss.simulation.imu import accelerometer_model, gyro_model, measure
from insgnss.tables import ImuTable
from insgnss.units import (
    deg_per_h_to_radps,
    deg_per_sqrt_h_to_rad_per_sqrt_s,
    mg_to_mps2,
    mps_per_sqrt_h_to_mps_per_sqrt_s,
)

STEP_S = 0.1
GRADE = ImuGrade(
    gyro_bias_deg_per_h=20.0,
    gyro_bias_instability_deg_per_h=12.0,
    gyro_correlation_time_s=150.0,
    gyro_arw_deg_per_sqrt_h=0.3,
    gyro_rate_random_walk_deg_per_h_per_sqrt_h=40.0,
    accel_bias_mg=3.0,
    accel_bias_instability_mg=0.5,
    accel_correlation_time_s=60.0,
    accel_vrw_mps_per_sqrt_h=0.06,
    source="made for this test",
)


def at_rest(hours: float, rng: np.random.Generator, grade: ImuGrade = GRADE) -> ImuTable:
    count = round(hours * 3600.0 / STEP_S)
    gravity = np.tile([0.0, 0.0, -9.80665], (count, 1))
    gyro = measure(np.zeros((count, 3)), STEP_S, gyro_model(grade), rng)
    accel = measure(gravity, STEP_S, accelerometer_model(grade), rng)
    t_ns = np.rint(np.arange(1, count + 1) * STEP_S * 1e9).astype(np.int64)
    return ImuTable(t_ns, gyro.value, accel.value)


def truth(sensor: str) -> NoiseFit:
    g = GRADE
    if sensor == "gyro":
        return NoiseFit(
            0.0,
            deg_per_sqrt_h_to_rad_per_sqrt_s(g.gyro_arw_deg_per_sqrt_h),
            deg_per_h_to_radps(g.gyro_bias_instability_deg_per_h),
            g.gyro_correlation_time_s,
            deg_per_h_to_radps(g.gyro_rate_random_walk_deg_per_h_per_sqrt_h) / 60.0,
        )
    return NoiseFit(
        0.0,
        mps_per_sqrt_h_to_mps_per_sqrt_s(g.accel_vrw_mps_per_sqrt_h),
        mg_to_mps2(g.accel_bias_instability_mg),
        g.accel_correlation_time_s,
        0.0,
    )


def test_overlapping_deviation_is_the_definition(rng: np.random.Generator) -> None:
    values = rng.standard_normal((300, 3)).cumsum(axis=0) + rng.standard_normal((300, 3))
    curve = overlapping_allan(values, STEP_S)
    for row in (0, len(curve.tau_s) // 2, -1):
        m = round(curve.tau_s[row] / STEP_S)
        means = np.array([values[k : k + m].mean(axis=0) for k in range(300 - m + 1)])
        expected = np.sqrt(np.mean((means[m:] - means[:-m]) ** 2, axis=0) / 2.0)
        assert curve.deviation[row] == pytest.approx(expected, rel=1e-9)


def test_overlapping_deviation_is_that_of_allantools(rng: np.random.Generator) -> None:
    values = rng.standard_normal((5000, 1))
    curve = overlapping_allan(values, STEP_S)
    taus, deviation, _, _ = allantools.oadev(
        values[:, 0], rate=1.0 / STEP_S, data_type="freq", taus=curve.tau_s
    )
    assert taus == pytest.approx(curve.tau_s)
    assert curve.deviation[:, 0] == pytest.approx(deviation, rel=1e-9)


def test_variance_of_a_gauss_markov_process_joins_its_series_and_its_limits() -> None:
    t = np.array([0.00999999, 0.01000001])
    assert np.diff(gauss_markov_variance(t, 1.0))[0] == pytest.approx(2.0 * 2e-8 / 3.0, rel=0.1)
    # far below T a random walk of density 2 s^2 / T, far above it white noise of density 2 s^2 T
    assert gauss_markov_variance(np.array([1e-4]), 1.0)[0] == pytest.approx(2.0 / 3.0 * 1e-4, rel=1e-3)
    assert gauss_markov_variance(np.array([1e4]), 1.0)[0] == pytest.approx(2.0 / 1e4, rel=1e-3)
    # the largest deviation is 0.617 of sigma, at 1.89 T [IEEE Std 952-1997, C.1.1.5: 0.437 q_c sqrt(T_c)]
    x = np.linspace(0.5, 5.0, 2000)
    peak = gauss_markov_variance(x, 1.0)
    assert np.sqrt(peak.max()) == pytest.approx(0.437 * np.sqrt(2.0), rel=2e-3)
    assert x[np.argmax(peak)] == pytest.approx(1.89, abs=0.01)


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_simulated_record_has_the_deviation_of_its_grade(sensor: str, rng: np.random.Generator) -> None:
    model, make = truth(sensor), {"gyro": gyro_model, "accel": accelerometer_model}[sensor]
    runs = [measure(np.zeros((36_000, 3)), STEP_S, make(GRADE), rng).value for _ in range(20)]
    values = np.concatenate(runs, axis=1)
    for tau_s in (0.1, 1.0, 10.0, 60.0, 300.0):
        found = [
            allantools.oadev(axis, rate=1.0 / STEP_S, data_type="freq", taus=[tau_s])[1][0] ** 2
            for axis in values.T
        ]
        expected = float(model.variance(np.array([tau_s]))[0])
        # 60 independent axes: four standard errors of their mean, itself measured
        assert np.mean(found) == pytest.approx(
            expected, abs=4.0 * np.std(found) / np.sqrt(60.0) + 1e-3 * expected
        )


def test_fit_of_the_exact_curve_finds_its_terms() -> None:
    tau = np.geomspace(0.1, 3000.0, 60)
    for wanted in (truth("gyro"), truth("accel"), NoiseFit(1e-4, 1e-3, 2e-4, 80.0, 0.0)):
        curve = AllanCurve(tau, np.sqrt(wanted.variance(tau))[:, None] * np.ones(3), np.full(60, 1e-3))
        found = fit(curve)
        assert found.variance(tau) == pytest.approx(wanted.variance(tau), rel=0.02)
        assert found.random_walk == pytest.approx(wanted.random_walk, rel=0.01)


def test_study_of_a_long_rest_gives_the_grade_back(rng: np.random.Generator, tmp_path: Path) -> None:
    study = allan_study(at_rest(10.0, rng))
    grade = study.grade
    assert grade.gyro_arw_deg_per_sqrt_h == pytest.approx(0.3, rel=0.02)
    assert grade.accel_vrw_mps_per_sqrt_h == pytest.approx(0.06, rel=0.02)
    # 240 and 600 correlation times in three axes: 6 % of sigma; the time itself to a factor
    assert grade.accel_bias_instability_mg == pytest.approx(0.5, rel=0.15)
    assert 30.0 < grade.accel_correlation_time_s < 120.0
    assert 8.0 < grade.gyro_bias_instability_deg_per_h < 40.0
    paths = study.save(tmp_path / "out")
    assert [path.name for path in paths] == ["grade.toml", "allan.csv", "allan.png"]
    assert load_toml(paths[0], ImuGrade) == grade
    assert paths[2].stat().st_size > 10_000


def test_lost_samples_and_jitter_hardly_change_the_deviation(rng: np.random.Generator) -> None:
    imu = at_rest(0.5, rng)
    kept = rng.random(len(imu.t_ns)) > 0.002
    part = ImuTable(imu.t_ns[kept], imu.w_ib_b[kept], imu.f_b[kept])
    whole, holed = allan_study(imu).grade, allan_study(part).grade
    assert holed.gyro_arw_deg_per_sqrt_h == pytest.approx(whole.gyro_arw_deg_per_sqrt_h, rel=0.02)


def test_quantised_sensor_shows_its_resolution(rng: np.random.Generator) -> None:
    # half a step of noise in each sample: the remainders are as good as independent
    coarse = GRADE.model_copy(update={"gyro_quantisation_deg": 1e-3, "gyro_arw_deg_per_sqrt_h": 0.1})
    found = allan_study(at_rest(1.0, rng, coarse)).grade
    assert found.gyro_quantisation_deg == pytest.approx(1e-3, rel=0.15)


def test_instability_that_is_not_seen_is_at_most_the_lowest_deviation(rng: np.random.Generator) -> None:
    white = GRADE.model_copy(
        update={
            "gyro_bias_instability_deg_per_h": 0.0,
            "gyro_rate_random_walk_deg_per_h_per_sqrt_h": 0.0,
            "gyro_arw_deg_per_sqrt_h": 0.3,
        }
    )
    study = allan_study(at_rest(0.5, rng, white))
    assert study.gyro_fit.instability == 0.0 == study.gyro_fit.rate_random_walk
    # the longest averaging time of half an hour is 200 s: 0.3 deg/sqrt(h) are 1.27 deg/h there
    assert study.grade.gyro_bias_instability_deg_per_h == pytest.approx(1.27, rel=0.4)
    assert study.grade.gyro_correlation_time_s == pytest.approx(1800.0, abs=1.0)


def test_like_keeps_what_rest_does_not_show(rng: np.random.Generator) -> None:
    like = GRADE.model_copy(update={"gyro_scale_factor_ppm": 321.0, "gyro_range_deg_per_s": 250.0})
    found = allan_study(at_rest(0.2, rng), like).grade
    assert found.gyro_scale_factor_ppm == 321.0 and found.gyro_range_deg_per_s == 250.0
    assert found.gyro_bias_deg_per_h == 20.0


def test_moving_sensor_is_refused_with_its_time(rng: np.random.Generator) -> None:
    imu = at_rest(0.2, rng)
    imu.w_ib_b[3000:3100] += 0.5
    with pytest.raises(InputError, match="299 s after"):
        allan_study(imu)
    with pytest.raises(InputError, match="too few"):
        allan_study(ImuTable(imu.t_ns[:50], imu.w_ib_b[:50], imu.f_b[:50]))


def test_stuck_sensor_is_refused() -> None:
    t_ns = 10_000_000 * np.arange(1, 1001)
    with pytest.raises(InputError, match="do not change"):
        allan_study(ImuTable(t_ns, np.zeros((1000, 3)), np.tile([0.0, 0.0, -9.8], (1000, 1))))


def write_log(path: Path, imu: ImuTable, scale: float = 1.0) -> None:
    rows = np.column_stack([imu.t_ns / 1e9, imu.w_ib_b * scale, imu.f_b])
    header = "time_s,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9f")


def test_command_writes_a_grade_from_a_plain_log(rng: np.random.Generator, tmp_path: Path) -> None:
    write_log(tmp_path / "rest.csv", at_rest(0.3, rng), 180.0 / np.pi)
    call = [
        "allan",
        str(tmp_path / "rest.csv"),
        "--gyro-unit",
        "deg/s",
        "-o",
        str(tmp_path / "out"),
        "--from",
        "60",
    ]
    result = CliRunner().invoke(app, [*call, "--no-pictures", "--like", "tactical"])
    assert result.exit_code == 0, result.output
    grade = load_toml(tmp_path / "out" / "grade.toml", ImuGrade)
    assert grade.gyro_arw_deg_per_sqrt_h == pytest.approx(0.3, rel=0.05)
    assert grade.gyro_scale_factor_ppm == 150.0
    assert not (tmp_path / "out" / "allan.png").exists()
    assert "1020 s at rest" in result.output


def test_command_refuses_units_that_do_not_go_together(tmp_path: Path) -> None:
    (tmp_path / "rest.csv").write_text("time_s\n")
    result = CliRunner().invoke(app, ["allan", str(tmp_path / "rest.csv"), "--gyro-unit", "deg"])
    assert result.exit_code == 2 and "--gyro-unit" in result.output


def test_grade_text_is_a_grade_file(tmp_path: Path) -> None:
    (tmp_path / "grade.toml").write_text(grade_text(GRADE))
    assert load_toml(tmp_path / "grade.toml", ImuGrade) == GRADE
