"""Sigma of the aiding: rows of H against the values themselves, the parts' sum, and coverage of drawn errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insgnss.aiding.antenna_motion import VehicleTrace, place_motion, turn_about_axis
from insgnss.aiding.observables import LANES, N_LANE_ROWS, expand_satellite, towards
from insgnss.aiding.table import AidingSetup, AidingTable, compute_aiding
from insgnss.aiding.trace import Covariances
from insgnss.aiding.uncertainty import ACCELERATION_PARTS, N_PARTS, RATE_PARTS, motion_rows
from insgnss.constants import NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI
from insgnss.inertial.clock_model import ClockModel
from insgnss.inertial.sensor_model import BiasModel, SensorModel
from insgnss.tables import Float64
from tests.aiding.exact import (
    LEVER_B,
    SIGNALS,
    ExactRun,
    correlated_covariance,
    exact_run,
    grid,
    one_covariance,
    setup,
    sky_arcs,
    spinning,
    turning,
)
from tests.jacobian import finite_difference_jacobian
from tests.runs.scenes import WEEK
from tests.statistics_bounds import assert_mean_chi_square

PERFECT = SensorModel(0.0, 0.0, BiasModel(0.0, 1.0, 0.0), BiasModel(0.0, 1.0, 0.0), 0.0, 0.0, 0.0)
STEPS = np.repeat([100.0, 0.5, 1e-3, 0.1, 1e-3], 3)


def perfect_setup(**changes: Any) -> AidingSetup:
    """Return a setup that doubts nothing but the covariance."""
    sure = {"satellite_range_sigma_m": 0.0, "satellite_rate_sigma_mps": 0.0, "jerk_sigma_mps3": 0.0}
    config = setup(**(sure | {"satellite_acceleration_sigma_mps2": 0.0} | changes)).config
    return AidingSetup(config, PERFECT, ClockModel(0.0, 0.0), LEVER_B, troposphere=False)


def displaced(run: ExactRun, x: Float64) -> ExactRun:
    """Return the run with the state's error (17,) added: estimate = truth + error."""
    t = run.trace
    turned = np.asarray((Rotation.from_rotvec(x[PSI : PSI + 3]) * Rotation.from_matrix(t.C_eb)).as_matrix())
    moved = t._replace(
        r_e=t.r_e + x[DR : DR + 3],
        v_e=t.v_e + x[DV : DV + 3],
        C_eb=turned,
        b_a=t.b_a + x[BA : BA + 3],
        b_g=t.b_g + x[BG : BG + 3],
        clock=t.clock + x[[CLOCK, DRIFT]],
    )
    return ExactRun(moved, run.imu)


def one_time(at: str) -> ExactRun:
    """Return one exact time of a motion."""
    return exact_run(
        *{"turning": (turning(), grid(np.array([14.03]))), "spinning": (spinning(), grid(np.array([2.2])))}[
            at
        ]
    )


def table_of(run: ExactRun, of: AidingSetup, P: Float64, age_s: float = 0.0) -> AidingTable:
    """Return the aiding with one covariance."""
    return compute_aiding(of, sky_arcs(), run.trace, run.imu, one_covariance(run, P, age_s))


def rows_of_satellite(run: ExactRun, satellite: int) -> Float64:
    """Return (3, 17) rows of H of range, rate and acceleration."""
    arcs = sky_arcs().arcs
    work, h, e = np.zeros((28, 3)), np.zeros((4, OFFSETS)), np.zeros(N_LANE_ROWS * LANES)
    p, since_s, _, _ = place_motion(VehicleTrace(run.trace, run.imu, np.array(LEVER_B), 1), 0, arcs, work)
    expand_satellite(arcs.pieces[satellite, p], since_s, work[0:4], e, 0)
    rho = towards(e, 0, work[0:4], work[18:20])
    turn_about_axis(work, 18, 20, -WGS84_OMEGA_RADPS * since_s)
    motion_rows(rho, work[18:20], run.trace.C_eb[0], work, h, work[20:26])
    return h[:3]


@pytest.mark.parametrize("at", ["turning", "spinning"])
def test_rows_are_the_derivatives_of_the_values(at: str) -> None:
    run = one_time(at)
    none = np.zeros((OFFSETS, OFFSETS))

    def values(x: Float64) -> Float64:
        v = table_of(
            displaced(run, np.append(x, [0.0, 0.0])), perfect_setup(receiver_clock=False), none
        ).values
        return np.stack([v.pseudorange, v.range_rate, v.acceleration.astype(np.float64)])

    found = finite_difference_jacobian(values, np.zeros(15), STEPS).reshape(3, 11, 15)
    for satellite in (0, 3, 9):
        H = rows_of_satellite(run, satellite)[:, :15]
        # the rows leave out what light time makes of a displacement, 1e-5 of each entry; rounding of the range 1e-10
        np.testing.assert_allclose(found[0, satellite], H[0], atol=3e-5, rtol=0.0)
        np.testing.assert_allclose(found[1, satellite], H[1], atol=3e-5 + 3e-5 * np.abs(H[1]).max(), rtol=0.0)
        # of the acceleration: gravity's gradient 3e-6 / s^2; its 32 bits over the steps: 356 m/s^2 6e-8 / 1e-3
        rounding = 2e-7 * max(1.0, np.abs(table_of(run, setup(), none).values.acceleration).max()) / STEPS
        error = np.abs(found[2, satellite] - H[2])
        assert (error <= 1e-5 + 5e-5 * np.abs(H[2]).max() + 3.0 * rounding).all()


@pytest.mark.parametrize("latency_s", [0.0, 0.05])
@pytest.mark.parametrize("receiver_clock", [True, False])
def test_parts_and_cross_add_up_to_the_total(latency_s: float, receiver_clock: bool) -> None:
    of = setup(latency_s=latency_s, receiver_clock=receiver_clock, jerk_sigma_mps3=0.5)
    c = table_of(one_time("turning"), of, correlated_covariance(), age_s=0.3).columns(WEEK, parts=True)
    wavelength = of.wavelengths(("G01",))[0]

    for name, unit, square, doppler in (
        ("rate", "mps", "m2ps2", "sd_doppler_hz"),
        ("acceleration", "mps2", "m2ps4", "sd_doppler_rate_hz_per_s"),
    ):
        parts = [c[k].astype(np.float64) for k in c if k.startswith(f"sd_{name}_") and k.endswith(f"_{unit}")]
        total = np.sum(np.square(parts), axis=0) + c[f"cross_{name}_{square}"]
        assert len(parts) == N_PARTS
        np.testing.assert_allclose((wavelength * c[doppler]) ** 2, total, rtol=1e-5)
        assert (np.abs(c[f"cross_{name}_{square}"]) > 1e-3 * total).any(), "the correlations must matter"
    if not receiver_clock:
        np.testing.assert_allclose(wavelength * c["sd_doppler_hz"], c["sd_range_rate_mps"], rtol=1e-6)


@pytest.mark.parametrize("at", ["turning", "spinning"])
def test_sigma_covers_errors_drawn_from_the_covariance(at: str) -> None:
    run, P = one_time(at), correlated_covariance()
    of = perfect_setup()
    truth = table_of(run, of, P)
    c = truth.columns(WEEK)
    rng = np.random.default_rng(11)
    draws = rng.multivariate_normal(np.zeros(OFFSETS), P, size=300)
    nis = {
        name: np.zeros((300, 11))
        for name in ("range_rate_mps", "range_acceleration_mps2", "doppler_hz", "pseudorange_m")
    }
    for i, x in enumerate(draws):
        found = table_of(displaced(run, x), of, P).columns(WEEK)
        for name, values in nis.items():
            values[i] = ((found[name] - c[name]) / c[f"sd_{name}"]) ** 2

    for values in nis.values():
        for satellite in range(11):
            assert_mean_chi_square(values[:, satellite], 1)


def test_attitude_through_the_lever_arm_matters_at_high_roll_rate() -> None:
    P = np.zeros((OFFSETS, OFFSETS))
    P[PSI : PSI + 3, PSI : PSI + 3] = 1e-3**2 * np.eye(3)
    fast = table_of(one_time("spinning"), perfect_setup(), P)
    slow = table_of(one_time("turning"), perfect_setup(), P)

    # 1 mrad of 20.4 m/s
    assert 0.5 * 20.4e-3 < fast.sigma[:, RATE_PARTS + 1].max() <= 20.5e-3
    assert slow.sigma[:, RATE_PARTS + 1].max() < 1e-3
    # and of 356 m/s^2 and gravity
    assert fast.sigma[:, ACCELERATION_PARTS + 1].max() > 0.15


def test_sigma_grows_with_the_age_of_the_covariance_as_the_acceleration_integrates() -> None:
    P = np.zeros((OFFSETS, OFFSETS))
    P[BA : BA + 3, BA : BA + 3] = 0.01**2 * np.eye(3)
    run = one_time("turning")
    sd = [table_of(run, perfect_setup(), P, age_s=age).sigma[:, 1] for age in (0.0, 0.5, 1.0)]

    np.testing.assert_allclose(sd[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(sd[1], 0.005, rtol=1e-4)
    np.testing.assert_allclose(sd[2], 0.01, rtol=1e-4)


def test_latency_adds_the_jerk_that_the_vehicle_may_have() -> None:
    run, P = one_time("turning"), np.zeros((OFFSETS, OFFSETS))
    table = table_of(run, perfect_setup(latency_s=0.1, jerk_sigma_mps3=5.0), P)

    np.testing.assert_allclose(table.sigma[:, 1], 0.5 * 5.0 * 0.01, rtol=1e-5)
    np.testing.assert_allclose(table.sigma[:, 2], 0.5, rtol=1e-5)
    np.testing.assert_allclose(table.sigma[:, 0], 5.0 * 1e-3 / 6.0, rtol=1e-5)


def test_sample_noise_is_that_of_the_differences() -> None:
    """Samples with white noise: the scatter of acceleration and jerk is what their sigma says."""
    run = one_time("turning")
    of = setup(satellite_acceleration_sigma_mps2=0.0, slope_samples=1)
    P = np.zeros((OFFSETS, OFFSETS))
    truth = table_of(run, of, P)
    rng = np.random.default_rng(5)
    sd_f = np.sqrt(of.sensor.accel_density / 0.005)
    sd_w = np.sqrt(of.sensor.gyro_density / 0.005)
    squares = np.zeros((400, 2, 11))
    for i in range(400):
        noisy = run.imu._replace(
            f_b=run.imu.f_b + sd_f * rng.standard_normal((3, 3)),
            w_ib_b=run.imu.w_ib_b + sd_w * rng.standard_normal((3, 3)),
        )
        v = table_of(ExactRun(run.trace, noisy), of, P).values
        squares[i, 0] = (v.acceleration - truth.values.acceleration) / truth.sigma[:, 2]
        squares[i, 1] = (v.jerk - truth.values.jerk) / truth.sigma[:, 3]

    # 0.06 m/s/sqrt h at 200 Hz is 0.0141 m/s^2, 1.58 times that at the interval's end; the rest is the lever arm's
    assert truth.sigma[:, 2].min() > 0.0223
    for kind in range(2):
        for satellite in range(11):
            # scale factors are in the sigma too: here below 1e-3 of it
            assert_mean_chi_square(squares[:, kind, satellite] ** 2, 1)


def test_covariance_of_the_future_is_not_used() -> None:
    run = exact_run(turning(), grid(np.array([14.0, 15.5])))
    P = correlated_covariance()
    later = Covariances(run.trace.t_ns[:1] + NS_PER_S, P[None])
    table = compute_aiding(setup(), sky_arcs(), run.trace, run.imu, later)

    assert np.isnan(table.sigma[:11]).all()
    assert np.isfinite(table.sigma[11:]).all()


def test_satellite_of_a_group_the_filter_does_not_know_has_no_pseudorange() -> None:
    run = one_time("turning")
    config = setup().config
    of = AidingSetup(config, PERFECT, ClockModel(0.0, 0.0), LEVER_B, clock_groups=("E",), troposphere=False)
    c = table_of(run, of, correlated_covariance()).columns(WEEK)

    assert set(SIGNALS) == {"G"}
    assert np.isnan(c["pseudorange_m"]).all()
    assert np.isnan(c["sd_pseudorange_m"]).all()
    assert np.isfinite(c["doppler_hz"]).all()
