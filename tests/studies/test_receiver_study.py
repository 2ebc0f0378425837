"""Receivers that close their loops through the filter: an independent program's numbers, consistency, identities."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from scipy import stats

from insgnss.antenna.obstruction import directions
from insgnss.config.flight import ImuGrade
from insgnss.config.library import imu_grade
from insgnss.config.manoeuvres import RandomMotion
from insgnss.config.simulation import SimulationConfig
from insgnss.errors import ConfigError
from insgnss.interference import PhaseLoop, discriminator
from insgnss.simulation.closed_loop_sky import GLONASS_RADIUS_M
from insgnss.studies import ManoeuvringReceiver, ReceiverOptions, receiver_study
from insgnss.studies.receiver.interval_message import add_observation, carry_message, solve_message
from insgnss.studies.receiver.runs import ReceiverRun, Setting, run_many
from insgnss.studies.receiver.scene import scene_of
from insgnss.studies.receiver.variants import VARIANTS, Variant

# a loop over the phase forgets its begin within seconds, one over the delay in a minute
LASTS_S: Final = {"coherent": 40.0, "noncoherent": 110.0}
SETTLES_S: Final = {"coherent": 15.0, "noncoherent": 50.0}
# 80 deg/h, 0.06 m/s^2, 0.3 deg/sqrt(h), 0.12 m/s/sqrt(h), biases Gauss-Markov of 600 s; nothing else is wrong
LOW: Final = ImuGrade(
    gyro_bias_deg_per_h=0.0,
    gyro_bias_instability_deg_per_h=80.0,
    gyro_correlation_time_s=600.0,
    gyro_arw_deg_per_sqrt_h=0.3,
    accel_bias_mg=0.0,
    accel_bias_instability_mg=0.06 / 9.80665e-3,
    accel_correlation_time_s=600.0,
    accel_vrw_mps_per_sqrt_h=0.12,
)
MEDIUM: Final = LOW.model_copy(
    update={
        "gyro_bias_instability_deg_per_h": 3.0,
        "gyro_correlation_time_s": 1000.0,
        "gyro_arw_deg_per_sqrt_h": 0.1,
        "accel_bias_instability_mg": 0.01 / 9.80665e-3,
        "accel_correlation_time_s": 1000.0,
        "accel_vrw_mps_per_sqrt_h": 0.06,
    }
)


@cache
def motion() -> SimulationConfig:
    """Return 5 g on each axis with 0.3 1/s, 0.5 rad/s with 1 s."""
    return SimulationConfig(
        name="5 g",
        gps_week=2385,
        start_s=0.0,
        place={"lat_deg": 55.0, "lon_deg": 37.0, "h_m": 2e4, "heading_deg": 0.0},  # type: ignore[arg-type]
        manoeuvre=(
            RandomMotion(
                kind="gauss_markov",
                duration_s=LASTS_S["noncoherent"] + 2.0,
                acceleration_g=5.0,
                turn_rate_deg_per_s=math.degrees(0.5),
                seed=11,
            ),
        ),
    )


@cache
def setting(tracking: str, with_ins: bool, drift: float, medium: bool = False) -> Setting:
    """Return the coherent laboratory at 5 ms, the other one at 10 ms with a code of 511 kHz."""
    coherent = tracking == "coherent"
    options = ReceiverOptions(
        duration_s=LASTS_S[tracking],
        settle_s=SETTLES_S[tracking],
        step_s=5e-3 if coherent else 10e-3,
        carrier_hz=1.6e9,
        chip_hz=1.022e6 if coherent else 0.511e6,
        orbit_radius_m=GLONASS_RADIUS_M,
    )
    grade = (MEDIUM if medium else LOW) if with_ins else None
    return scene_of(motion(), tracking, grade, {"drift_density": drift}, options).setting


def flown(of: Setting, variant: Variant, cn0_dbhz: float, runs: int = 6, seed: int = 5) -> list[ReceiverRun]:
    return run_many(of, variant, np.float64(cn0_dbhz), runs, seed, 2)


def settled(of: Setting, runs: list[ReceiverRun], columns: slice, solved: bool = False) -> float:
    """Return the rms of three axes together after settling."""
    first = math.ceil(of.settle / of.record_every)
    errors = [(run.least_squares if solved else run.error)[first:, columns] for run in runs]
    return math.sqrt(np.mean([np.sum(e**2, axis=1).mean() for e in errors]))


POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)


# An independent program: 40 closed loops, 40 dBHz, the same sensors, motion and oscillator; its bound is 15 %
@pytest.mark.parametrize(
    ("drift", "medium", "velocity_mps", "attitude_arcmin"),
    [(100.0, False, 0.0042, 0.83), (1.0, False, 0.0042, 0.83), (100.0, True, 0.0022, 0.25)],
)
def test_one_stage_with_ins_has_an_independent_programs_errors(
    drift: float, medium: bool, velocity_mps: float, attitude_arcmin: float
) -> None:
    of = setting("coherent", True, drift, medium)
    runs = flown(of, VARIANTS["one_stage"], 40.0)

    assert not any(run.lost for run in runs)
    assert settled(of, runs, VELOCITY) == pytest.approx(velocity_mps, rel=0.15)
    assert math.degrees(settled(of, runs, ATTITUDE)) * 60.0 == pytest.approx(attitude_arcmin, rel=0.15)


@pytest.mark.parametrize(("drift", "velocity_mps"), [(100.0, 0.039), (1.0, 0.0080)])
def test_channels_aided_by_two_stages_have_an_independent_programs_velocity(
    drift: float, velocity_mps: float
) -> None:
    of = setting("coherent", True, drift)
    runs = flown(of, VARIANTS["two_stage"], 40.0)

    assert settled(of, runs, VELOCITY, solved=True) == pytest.approx(velocity_mps, rel=0.2)


def test_receivers_without_ins_have_an_independent_programs_velocity() -> None:
    of = setting("coherent", False, 100.0)

    alone = settled(of, flown(of, VARIANTS["scalar"], 40.0), VELOCITY)
    one_stage = settled(of, flown(of, VARIANTS["one_stage"], 40.0), VELOCITY)

    assert alone == pytest.approx(0.261, rel=0.15)
    assert one_stage == pytest.approx(0.194, rel=0.15)


@pytest.mark.parametrize(
    ("medium", "cn0_dbhz", "position_m", "velocity_mps", "attitude_arcmin"),
    [
        (False, 40.0, 0.77, 0.091, 2.6),
        (True, 40.0, 0.76, 0.056, 0.75),
        (False, 24.0, 6.3, 0.39, 5.4),
        (False, 20.0, 12.8, 0.63, 6.8),
    ],
)
def test_receivers_without_phase_have_an_independent_programs_errors(
    medium: bool, cn0_dbhz: float, position_m: float, velocity_mps: float, attitude_arcmin: float
) -> None:
    of = setting("noncoherent", True, 100.0, medium)
    one, optimal, simple = (
        flown(of, VARIANTS[name], cn0_dbhz, 6) for name in ("one_stage", "optimal", "two_stage")
    )

    # runs of 110 s have not settled as those of 200 s have
    assert settled(of, one, POSITION) == pytest.approx(position_m, rel=0.25)
    assert settled(of, one, VELOCITY) == pytest.approx(velocity_mps, rel=0.2)
    assert math.degrees(settled(of, one, ATTITUDE)) * 60.0 == pytest.approx(attitude_arcmin, rel=0.4)
    for block in (POSITION, VELOCITY, ATTITUDE):
        assert settled(of, optimal, block) == pytest.approx(settled(of, one, block), rel=0.02)
        assert settled(of, simple, block) > 1.02 * settled(of, one, block)


def nees_within_bounds(of: Setting, runs: list[ReceiverRun]) -> bool:
    """Return whether the mean NEES is right, each run counted as one look."""
    first = math.ceil(of.settle / of.record_every)
    states = int(np.isfinite(runs[0].sd[0]).sum())
    low, high = stats.chi2.interval(0.999, states * len(runs))
    return bool(low < np.mean([run.nees[first:].mean() for run in runs]) * states * len(runs) < high)


# without INS the phase is lost at 26 dBHz
@pytest.mark.parametrize(
    ("tracking", "name", "with_ins", "cn0_dbhz"),
    [
        *(("coherent", "one_stage", True, cn0) for cn0 in (45.0, 35.0, 25.0)),
        *(("coherent", "one_stage", False, cn0) for cn0 in (45.0, 35.0, 30.0)),
        *(("noncoherent", "one_stage", True, cn0) for cn0 in (45.0, 25.0)),
        *(("noncoherent", "optimal", True, cn0) for cn0 in (45.0, 25.0)),
    ],
)
def test_filter_is_consistent_where_nothing_is_counted_twice(
    tracking: str, name: str, with_ins: bool, cn0_dbhz: float
) -> None:
    of = setting(tracking, with_ins, 100.0)

    assert nees_within_bounds(of, flown(of, VARIANTS[name], cn0_dbhz))


@pytest.mark.parametrize("cn0_dbhz", [45.0, 35.0, 28.0])
def test_phase_of_each_channel_is_as_large_as_the_covariance_along_the_motion_says(cn0_dbhz: float) -> None:
    scene = scene_of(motion(), "coherent", LOW, {"drift_density": 100.0}, small(
        duration_s=LASTS_S["coherent"], settle_s=15.0, carrier_hz=1.6e9, chip_hz=1.022e6))  # fmt: skip
    as_gauss_markov = LOW.model_copy(
        update={"accel_bias_mg": LOW.accel_bias_instability_mg, "gyro_bias_deg_per_h": 80.0}
    )
    sky = directions(scene.azimuth_deg, scene.elevation_deg)
    covariance = ManoeuvringReceiver.of(scene.trajectory, as_gauss_markov, 100.0, 1.6e9, sky, 5e-3)
    loop = PhaseLoop(discriminator("IQ", 0.076), 1.022e6, 5e-3)
    predicted = covariance.errors(loop, cn0_dbhz, 15.0).phase_rms_rad
    runs = flown(scene.setting, VARIANTS["one_stage"], cn0_dbhz, 6)
    found = (
        np.sqrt(np.mean([run.rms[:, 0] ** 2 for run in runs], axis=0)) * scene.setting.channels.radians_per_m
    )

    assert found == pytest.approx(predicted, rel=0.1)


def test_simplified_second_stage_with_a_good_oscillator_runs_away_and_each_cure_stops_it() -> None:
    of = setting("noncoherent", True, 1.0)
    first = math.ceil(of.settle / of.record_every)

    def nees(variant: Variant, **changed: Any) -> float:
        runs = flown(replace(of, **changed), variant, 40.0, 6, 3)
        return float(np.median([run.nees[first:].mean() for run in runs]))

    runs = flown(of, VARIANTS["two_stage"], 40.0, 6, 3)
    early, simple = (
        float(np.median([run.nees[a:b].mean() for run in runs])) for a, b in ((20, 60), (first, None))
    )
    optimal = flown(of, VARIANTS["optimal"], 40.0, 6, 3)

    assert simple > 50.0  # it claims to know seven times better than it does, ...
    assert simple > 2.0 * early  # ... and worse with time
    assert settled(of, runs, VELOCITY) > 1.5 * settled(of, optimal, VELOCITY)
    assert nees_within_bounds(of, optimal)
    for cure in (
        nees(replace(VARIANTS["two_stage"], widening=100.0)),
        nees(VARIANTS["two_stage"], interval=200),
        nees(replace(VARIANTS["two_stage"], inflation=100.0)),
    ):
        assert cure < simple / 2.0


# range and rate along an inertial path; with the acceleration along one whose acceleration is an estimate that fades
@pytest.mark.parametrize("offsets", [2, 3])
def test_message_of_an_interval_is_what_one_stage_would_have_taken_from_it(offsets: int) -> None:
    rng = np.random.default_rng(20)
    T, count, variances, of = 0.01, 12, (4.0, 0.09), slice(offsets)
    A = np.array([[1.0, T, 0.5 * T**2], [0.0, 1.0, T], [0.0, 0.0, math.exp(-0.3 * T)]])[of, of]
    H, back = np.eye(2, offsets), np.linalg.inv(A)
    x, P = (
        np.array([3.0, -0.4, 2.0])[of],
        np.diag([9.0, 0.5, 30.0])[of, of],
    )  # offsets from the path, as they are known
    truth = x + np.linalg.cholesky(P) @ rng.standard_normal(offsets)
    replicas = 0.5 * rng.standard_normal((count, 2))  # wherever the channel has steered them
    sums, message, C = np.zeros((offsets, offsets + 1)), np.zeros(offsets), np.zeros((offsets, offsets))
    one_x, one_P, two_x, two_P = x.copy(), P.copy(), x.copy(), P.copy()
    for k in range(count):
        truth, one_x, one_P = A @ truth, A @ one_x, A @ one_P @ A.T
        two_x, two_P = A @ two_x, A @ two_P @ A.T
        carry_message(sums, back)
        z = truth[:2] + np.sqrt(variances) * rng.standard_normal(2)
        add_observation(sums, replicas[k], np.zeros(2), np.array([*(z - replicas[k]), 0.0]), variances)
        K = one_P @ H.T @ np.linalg.inv(H @ one_P @ H.T + np.diag(variances))
        one_x, one_P = one_x + K @ (z - H @ one_x), (np.eye(offsets) - K @ H) @ one_P
    assert solve_message(sums, message, C)
    K = two_P @ np.linalg.inv(two_P + C)
    two_x, two_P = two_x + K @ (message - two_x), (np.eye(offsets) - K) @ two_P

    assert two_x == pytest.approx(one_x, rel=1e-9)
    assert two_P == pytest.approx(one_P, rel=1e-9)


@pytest.mark.parametrize("offsets", [2, 3])
def test_interval_that_does_not_observe_all_offsets_says_nothing(offsets: int) -> None:
    sums, message, C = np.zeros((offsets, offsets + 1)), np.zeros(offsets), np.zeros((offsets, offsets))
    add_observation(sums, np.zeros(2), np.zeros(2), np.array([1.0, 0.0, 0.0]), (1.0, 0.0))

    assert not solve_message(sums, message, C)


def test_result_does_not_depend_on_threads() -> None:
    of = setting("coherent", True, 100.0)
    one, two = (run_many(of, VARIANTS["optimal"], np.float64(35.0), 3, 8, n) for n in (1, 3))

    for a, b in zip(one, two, strict=True):
        assert np.array_equal(a.error, b.error) and np.array_equal(a.nees, b.nees)


def test_late_inertial_samples_cost_the_replicas_and_not_the_filter() -> None:
    of = setting("coherent", True, 100.0)
    options = ReceiverOptions(
        duration_s=LASTS_S["coherent"],
        settle_s=SETTLES_S["coherent"],
        carrier_hz=1.6e9,
        chip_hz=1.022e6,
        latency_s=0.02,
        orbit_radius_m=GLONASS_RADIUS_M,
    )
    late = scene_of(motion(), "coherent", LOW, {"drift_density": 100.0}, options).setting
    at_once, after = (flown(x, VARIANTS["one_stage"], 40.0, 4) for x in (of, late))
    rate = [math.sqrt(np.mean([run.rms[:, 1] ** 2 for run in runs])) for runs in (at_once, after)]

    assert rate[1] > 1.5 * rate[0]
    assert settled(late, after, VELOCITY) == pytest.approx(settled(of, at_once, VELOCITY), rel=0.1)


@pytest.mark.parametrize("cn0_dbhz", [40.0, 28.0])
def test_estimated_cn0_costs_little(cn0_dbhz: float) -> None:
    of = setting("coherent", True, 100.0)
    told = flown(of, VARIANTS["one_stage"], cn0_dbhz, 4)
    estimated = flown(
        replace(of, options=replace(of.options, estimates_cn0=True)), VARIANTS["one_stage"], cn0_dbhz, 4
    )

    assert np.nanmean([run.cn0_dbhz for run in estimated]) == pytest.approx(cn0_dbhz, abs=0.4)
    assert settled(of, estimated, VELOCITY) == pytest.approx(settled(of, told, VELOCITY), rel=0.15)


def test_channel_without_a_signal_is_left_out_and_comes_back() -> None:
    of = setting("coherent", True, 100.0)
    cn0 = np.full(of.truth.ranges.shape, 40.0)
    cn0[5000:6000, 2:] = np.nan  # 5 s with two satellites
    for name in ("two_stage", "optimal", "one_stage"):
        for run in run_many(of, VARIANTS[name], cn0, 2, 4, 2):
            assert not np.isfinite(run.lost_s[:2]).any()
            assert np.abs(run.error[-1, VELOCITY] / run.sd[-1, VELOCITY]).max() < 5.0
            hidden, before = (run.sd[k // of.record_every, VELOCITY].max() for k in (5980, 4980))
            assert hidden > 1.5 * before


def small(**changed: Any) -> ReceiverOptions:
    return ReceiverOptions(**{"duration_s": 30.0, "settle_s": 10.0, **changed})


def test_study_tells_errors_thresholds_and_saves(tmp_path: Path) -> None:
    done: list[tuple[int, int]] = []
    study = receiver_study(
        motion(), variants=("two_stage", "one_stage"), imu=LOW, oscillator={"drift_density": 100.0},
        cn0=(45.0, 22.0, 12.0), runs=6, seed=2, options=small(carrier_hz=1.6e9, chip_hz=1.022e6),
        report=lambda a, b: done.append((a, b)),
    )  # fmt: skip

    assert done[-1] == (6, 6)
    assert list(study.summary["variant"].unique()) == ["two_stage", "one_stage"]
    correlation = study.summary.set_index(["variant", "cn0_dbhz"])["innovation_correlation"]
    assert abs(correlation["one_stage", 45.0]) < 0.05 < correlation["two_stage", 45.0]
    assert (study.summary.groupby("variant")["lost"].max() == 1.0).all()
    limits = study.thresholds.set_index("variant")
    assert limits.loc["one_stage", "cn0_dbhz"] < limits.loc["two_stage", "cn0_dbhz"]
    assert (limits["low_dbhz"] <= limits["cn0_dbhz"]).all() and (
        limits["cn0_dbhz"] <= limits["high_dbhz"]
    ).all()
    assert study.summary["js_db"].to_numpy() == pytest.approx(
        10.0 * math.log10(1.022e6) - study.summary["cn0_dbhz"].to_numpy()
    )
    strong = study.summary[study.summary["cn0_dbhz"] == 45.0].set_index("variant")
    one, two = strong.loc["one_stage"], strong.loc["two_stage"]
    assert one["linear_phase_rad"] == pytest.approx(one["phase_rad"], rel=0.1)
    assert one["linear_velocity_mps"] == pytest.approx(one["velocity_mps"], rel=0.1)
    assert one["linear_attitude_deg"] == pytest.approx(one["attitude_deg"], rel=0.2)
    assert two["linear_phase_rad"] == pytest.approx(two["phase_rad"], rel=0.05)
    assert two["linear_channels_mps"] == pytest.approx(two["channels_mps"], rel=0.05)
    assert math.isnan(two["linear_velocity_mps"]) and math.isnan(one["linear_channels_mps"])
    seen = study.channels[(study.channels["cn0_dbhz"] == 45.0)]
    assert seen["range_predicted_m"].to_numpy() == pytest.approx(seen["range_m"].to_numpy(), rel=0.1)
    assert seen["rate_predicted_mps"].to_numpy() == pytest.approx(seen["rate_mps"].to_numpy(), rel=0.1)
    saved = study.save(tmp_path / "out")
    assert {path.suffix for path in saved.iterdir()} == {".csv", ".json", ".png"}
    assert "ReceiverStudy" in repr(study)


@pytest.mark.parametrize(
    ("asked", "told", "key"),
    [
        ({"cn0": (-20.0,)}, "C/N0 of -20", "cn0"),
        ({"cn0": ()}, "C/N0 of nothing", "cn0"),
        ({"variants": ("one",)}, "unknown receiver", "variants"),
        ({"variants": ()}, "no receiver", "variants"),
        ({"imu": None, "variants": ("aided",)}, "none is given", "variants"),
        (
            {"imu": None, "variants": ("optimal",), "options": small(interval_s=0.01)},
            "two integrations",
            "interval_s",
        ),
        ({"tracking": "phase"}, "unknown kind of tracking", "tracking"),
        ({"runs": 0}, "whole number", "runs"),
        ({"oscillator": {"drift": 1.0}}, "an oscillator of drift", "oscillator"),
        ({"options": small(step_s=0.04)}, "longer than a symbol", "step_s"),
        ({"options": small(interval_s=0.0123)}, "not a whole number", "interval_s"),
        ({"options": small(spacing_chips=3.0)}, "outside of", "spacing_chips"),
        ({"options": small(latency_s=0.2)}, "outside of", "latency_s"),
        ({"options": small(duration_s=500.0)}, "the motion lasts", "duration_s"),
        ({"options": small(settle_s=30.0)}, "settle", "duration_s"),
        ({"options": small(elevation_deg=(10.0,))}, "not a valid sky", "elevation_deg"),
    ],
)
def test_nonsense_is_told(asked: dict[str, Any], told: str, key: str) -> None:
    wanted: dict[str, Any] = {
        "options": small(),
        "imu": LOW,
        "runs": 1,
        "variants": ("one_stage",),
        "cn0": (40.0,),
    }
    with pytest.raises(ConfigError) as error:
        receiver_study(motion(), **{**wanted, **asked})

    assert told in str(error.value) and error.value.key == key


def test_oscillator_without_drift_and_grade_by_name_work() -> None:
    study = receiver_study(
        motion(), variants=("one_stage",), imu="tactical", oscillator={"drift_density": 0.0}, cn0=(40.0,), runs=1,
        options=small(),
    )  # fmt: skip

    assert study.summary["lost"].item() == 0.0
    assert math.isnan(study.thresholds["linear_cn0_dbhz"].item())
    assert imu_grade("tactical").accel_bias_mg > 0.0


def test_identical_geometry_gives_the_asked_directions() -> None:
    of = setting("coherent", True, 100.0)
    scene = scene_of(
        motion(),
        "coherent",
        LOW,
        {"drift_density": 100.0},
        small(elevation_deg=(10.0, 80.0), azimuth_deg=(0.0, 90.0)),
    )
    truth = scene.setting.truth
    up = truth.r_e[0] / np.linalg.norm(truth.r_e[0])
    u = truth.satellites[0, :, :3] - truth.r_e[0]
    u /= np.linalg.norm(u, axis=1)[:, None]

    assert np.degrees(np.arcsin(u @ up)) == pytest.approx([10.0, 80.0], abs=0.5)  # the geocentric vertical
    rates = np.gradient(truth.ranges, truth.step_s, axis=0)[1:-1]
    assert rates == pytest.approx(truth.rates[1:-1], abs=2e-2)
    assert len(of.truth.t_s) == round(LASTS_S["coherent"] / 5e-3)
