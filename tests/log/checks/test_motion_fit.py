"""The fit of inertial paths to velocities: exact motion is explained, and what was put in comes back."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from insgnss.constants import NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.log.checks.axis_search import Match, search
from insgnss.log.checks.motion_fit import fit_costs, integrate, rotate, signed_permutations
from insgnss.log.checks.refinement import (
    BIAS_A,
    BIAS_G,
    LEVER,
    SCALE_A,
    SCALE_G,
    TAU,
    RefinedEstimate,
    Uncertainty,
    refine,
)
from insgnss.log.checks.stretches import STEP_S, GnssStretch, InertialGrid, inertial_grid, stretches
from insgnss.log.checks.track import GnssTrack
from insgnss.log.checks.vehicle_axes import candidates, names
from insgnss.tables import ImuTable

Float64 = npt.NDArray[np.float64]
DOWN_E = np.array([-0.6, 0.0, -0.8])  # gravity at 53 deg of latitude
LENGTH_S = 40.0
RATE_HZ = 100.0
START_S = 1000.0


class Drive:
    """A vehicle that speeds up, turns both ways with some roll and pitch, and its sensors without errors."""

    def __init__(self) -> None:
        self.t_s = np.arange(int((LENGTH_S + 8.0) * RATE_HZ)) / RATE_HZ - 4.0
        yaw = 0.9 * np.sin(0.35 * self.t_s) + 0.3 * np.sin(0.9 * self.t_s)
        pitch = 0.10 * np.sin(0.5 * self.t_s)
        roll = 0.25 * np.sin(0.7 * self.t_s + 1.0)
        self.C_nb = Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=1))
        speed = 12.0 + 3.0 * np.sin(0.4 * self.t_s)
        self.v_n = self.C_nb.apply(np.array([1.0, 0.0, 0.0])) * speed[:, None]
        north = np.array([-0.8, 0.0, 0.6])
        self.C_en = np.stack([north, np.cross(DOWN_E, north), DOWN_E], axis=1)
        f_n = np.gradient(self.v_n, self.t_s, axis=0) - 9.81 * np.array([0.0, 0.0, 1.0])
        self.f_b = self.C_nb.inv().apply(f_n)
        turn = (self.C_nb[:-1].inv() * self.C_nb[1:]).as_rotvec() * RATE_HZ
        self.w_b = np.concatenate((turn[:1], turn))

    def imu(self, later_s: float = 0.0) -> ImuTable:
        """Return the samples, their tags ``later_s`` too late."""
        t_ns = np.rint((self.t_s + later_s + START_S) * NS_PER_S).astype(np.int64)
        mean_f = self.f_b.copy()
        mean_f[1:] = 0.5 * (self.f_b[1:] + self.f_b[:-1])
        return ImuTable(t_ns, self.w_b, mean_f)

    def stretch(self, lever_b: Float64, rng: np.random.Generator, sigma: float) -> GnssStretch:
        """Return the antenna's velocity at 5 Hz."""
        at = np.flatnonzero((self.t_s >= 0.0) & (self.t_s <= LENGTH_S))[::20]
        arm = self.C_nb.apply(np.cross(self.w_b, lever_b))
        v_e = (self.v_n + arm)[at] @ self.C_en.T + rng.normal(0.0, sigma, (len(at), 3))
        s_e = v_e - 9.81 * self.t_s[at][:, None] * DOWN_E
        return GnssStretch(self.t_s[at], v_e, s_e, -DOWN_E, max(sigma, 0.01), 30.0)


ORIGIN_NS = int(START_S) * NS_PER_S
ZERO = np.zeros(3)


@pytest.fixture(scope="module")
def drive() -> Drive:
    return Drive()


def grid_of(imu: ImuTable, stretch: GnssStretch) -> InertialGrid:
    return inertial_grid(imu, ORIGIN_NS, [stretch], 1.5)


def refined(drive: Drive, rng: np.random.Generator, lever_b: Float64, imu: ImuTable) -> RefinedEstimate:
    stretch = drive.stretch(lever_b, rng, 0.03)
    return refine([stretch], grid_of(imu, stretch), np.eye(3), 1, ZERO)


def test_running_product_of_steps_is_the_attitude_after_them(rng: np.random.Generator) -> None:
    """SciPy composes the same turns one by one."""
    theta = rng.normal(0.0, 0.2, (1, 37, 3))
    path = integrate(InertialGrid(np.zeros(1), theta, np.zeros((1, 37, 3)), 0.0, 1.0), np.eye(3)[None])
    whole = Rotation.identity()
    for k, one in enumerate(theta[0]):
        whole = whole * Rotation.from_rotvec(one)
        np.testing.assert_allclose(
            path.q[0, 0, k + 1, [1, 2, 3, 0]], whole.as_quat(canonical=False), atol=1e-12
        )
    v = rng.normal(size=3)
    np.testing.assert_allclose(rotate(path.q[0, 0, -1], v), whole.apply(v), atol=1e-12)


def test_fit_of_exact_motion_leaves_next_to_nothing(drive: Drive, rng: np.random.Generator) -> None:
    """What is left comes from the grid: 50 ms of turning at 0.5 rad/s, to second order below a cm/s."""
    stretch = drive.stretch(ZERO, rng, 0.0)
    grid = grid_of(drive.imu(), stretch)
    fit = fit_costs([stretch], grid, integrate(grid, np.eye(3)[None]), np.array([0.0, 0.5]))
    assert fit.rms[0, 0, 0] < 0.01
    assert fit.rms[0, 0, 1] > 0.2, "half a second of shift must matter"
    assert fit.rms[0, 1, 0] > 0.2, "a left-handed reading must matter"


def found(
    drive: Drive, rng: np.random.Generator, accel: Float64, gyro: Float64, factor: float = 1.0
) -> Match:
    imu = drive.imu()
    spoilt = ImuTable(imu.t_ns, factor * imu.w_ib_b @ gyro.T, imu.f_b @ accel.T)
    match = search(spoilt, ORIGIN_NS, [drive.stretch(ZERO, rng, 0.03)], np.eye(3), (1.0, np.pi / 180.0))
    assert match is not None
    return match


@pytest.mark.parametrize("index", [0, 5, 9, 14, 18, 23, 28, 33, 38, 43, 47])
def test_axes_that_were_turned_as_a_whole_are_found(
    drive: Drive, rng: np.random.Generator, index: int
) -> None:
    """f_s = M f_b, so the declaration is M transposed; M may be left-handed."""
    M = signed_permutations()[index]
    best = candidates(found(drive, rng, M, M).ranked, np.eye(3), np.eye(3))[0]
    assert names(best.accel) == names(M.T) and names(best.gyro) == names(M.T)


def test_gyros_of_other_axes_than_the_accelerometers_are_found(
    drive: Drive, rng: np.random.Generator
) -> None:
    G = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    best = candidates(found(drive, rng, np.eye(3), G).ranked, np.eye(3), np.eye(3))[0]
    assert names(best.accel) == ("+x", "+y", "+z") and names(best.gyro) == names(G.T)


def test_unit_of_the_gyros_is_found(drive: Drive, rng: np.random.Generator) -> None:
    match = found(drive, rng, np.eye(3), np.eye(3), 180.0 / np.pi)
    assert match.ranked[0].factor == pytest.approx(np.pi / 180.0)
    assert match.unit_gap > 100.0


def test_shift_of_the_tags_is_found_far_and_near(drive: Drive, rng: np.random.Generator) -> None:
    stretch = drive.stretch(ZERO, rng, 0.03)
    imu = drive.imu(later_s=1.3)
    match = search(imu, ORIGIN_NS, [stretch], np.eye(3), (1.0,))
    assert match is not None and match.shift_s == pytest.approx(-1.3, abs=0.13)


def test_offset_is_recovered_within_its_sigma(drive: Drive, rng: np.random.Generator) -> None:
    result = refined(drive, rng, ZERO, drive.imu(later_s=0.2))
    assert result.sd[TAU] < 0.01
    assert abs(result.x[TAU] + 0.2) < 4.0 * result.sd[TAU] + 0.002  # the grid's own error


def test_lever_arm_is_recovered_within_its_sigma(drive: Drive, rng: np.random.Generator) -> None:
    lever_b = np.array([0.8, -0.4, -1.1])
    result = refined(drive, rng, lever_b, drive.imu())
    assert (result.sd[LEVER] < 0.15).all()
    assert (np.abs(result.x[LEVER] - lever_b) < 4.0 * result.sd[LEVER] + 0.01).all()


def test_biases_are_recovered_within_their_sigma(drive: Drive, rng: np.random.Generator) -> None:
    imu = drive.imu()
    b_a, b_g = np.array([0.05, -0.03, 0.08]), np.array([1e-3, -2e-3, 1.5e-3])
    result = refined(drive, rng, ZERO, ImuTable(imu.t_ns, imu.w_ib_b + b_g, imu.f_b + b_a))
    assert (np.abs(result.x[BIAS_A] - b_a) < 4.0 * result.sd[BIAS_A] + 5e-3).all()
    assert (np.abs(result.x[BIAS_G] - b_g) < 4.0 * result.sd[BIAS_G] + 2e-4).all()


def test_scale_errors_are_recovered_within_their_sigma(drive: Drive, rng: np.random.Generator) -> None:
    """Without them the fit leaves four times the noise."""
    imu, stretch = drive.imu(), drive.stretch(ZERO, rng, 0.03)
    M_a, M_g = 0.01 * rng.standard_normal((2, 3, 3))
    spoilt = ImuTable(imu.t_ns, imu.w_ib_b + imu.w_ib_b @ M_g.T, imu.f_b + imu.f_b @ M_a.T)
    grid = grid_of(spoilt, stretch)
    known = np.full((2, 3, 3), 0.01)
    result = refine([stretch], grid, np.eye(3), 1, ZERO, Uncertainty(scale=known))
    for at, M in ((SCALE_A, M_a), (SCALE_G, M_g)):
        assert (np.abs(result.x[at] - M.ravel()) < 4.0 * result.sd[at] + 5e-4).all()
    assert result.sd[SCALE_G][8] < 0.004, "the turns show the scale of gyro z, known to 0.01 before"
    assert result.rms_mps < 0.04 and refine([stretch], grid, np.eye(3), 1, ZERO).rms_mps > 0.08


def test_turn_of_the_earth_is_not_left_in_the_velocity() -> None:
    """A force that is constant in axes that do not turn gains velocity along one line, in 40 s to a mm/s."""
    t_s, force, omega = np.arange(0.0, 40.5, 0.5), np.array([20.0, -5.0, 3.0]), WGS84_OMEGA_RADPS

    def motion(t: float, state: Float64) -> Float64:
        gravity = np.empty(3)
        normal_gravity_ecef(state[:3], gravity)
        f_e = Rotation.from_euler("z", -omega * t).apply(force)
        coriolis = 2.0 * np.cross([0.0, 0.0, omega], state[3:])
        return np.concatenate((state[3:], f_e + gravity - coriolis))

    start = np.array([4.2e6, 1.0e6, 4.7e6, 200.0, -150.0, 100.0])
    way = solve_ivp(motion, (0.0, 40.0), start, t_eval=t_s, rtol=1e-10, atol=1e-6).y.T
    sd = np.full(len(t_s), 0.02)
    track = GnssTrack(t_s, way[:, :3], way[:, 3:], sd, 0.0 * t_s, 0.0 * t_s, 0, len(t_s), len(t_s), len(t_s))
    (one,) = stretches(track, 40.0, [(-1.0, 41.0)])
    np.testing.assert_allclose(one.s_e - one.s_e[0], np.outer(one.t_s, force), atol=2e-3)


def test_standing_vehicle_gives_no_match(rng: np.random.Generator) -> None:
    still = GnssStretch(np.arange(50) * 0.2, np.zeros((50, 3)), np.zeros((50, 3)), -DOWN_E, 0.03, 0.7)
    n = int(60.0 / STEP_S)
    imu = ImuTable(np.arange(n) * 50_000_000, np.zeros((n, 3)), np.tile([0.0, 0.0, -9.81], (n, 1)))
    assert search(imu, 0, [still], np.eye(3), (1.0,)) is None
