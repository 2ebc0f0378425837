"""Points of the body, quaternion and covariances: against draws of the state's error, and against each other."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest
from scipy.spatial.transform import Rotation

from insgnss.filter.loop import ImuSamples
from insgnss.filter.output.further_columns import COVARIANCES, POINT, POINT_COVARIANCES, QUATERNION
from insgnss.filter.output.writing import N_NAV
from insgnss.filter.smoothing.body_points import (
    PointColumns,
    further_values,
    local_levels_of,
    rates_at,
)
from insgnss.filter.state import BG, DR, DV, PSI
from insgnss.tables import Float64
from tests.filter.scene import attitude, parameters, place

DRAWS = 40_000
WITHIN = 0.05  # of a variance by 40 000 draws: seven sigmas
LEVER_B = (30.0, -20.0, 12.0)
RATE = np.array([0.3, -0.2, 0.5])
EVERYTHING = PointColumns(LEVER_B, quaternion=True, covariance=True)
AT = place(h_m=1500.0)
C_EB = attitude(AT, 35.0, -12.0, 140.0)
V_E = AT.C_ne.T @ np.array([60.0, -30.0, 5.0])


def covariance(rng: np.random.Generator, sd_r: float) -> Float64:
    """Return a covariance (15, 15) whose states share their errors."""
    sigma = np.zeros(15)
    for at, sd in ((DR, sd_r), (DV, 0.05), (PSI, 5e-4), (9, 1e-2), (BG, 2e-3)):
        sigma[at : at + 3] = sd
    mixed = rng.normal(size=(15, 15)) + 2.0 * np.eye(15)
    P = mixed @ mixed.T
    scale = sigma / np.sqrt(np.diagonal(P))
    return P * np.outer(scale, scale)


def rows(r_e: Float64, v_e: Float64, C_eb: Float64) -> Float64:
    """Return navigation rows (m, N_NAV) of states; their biases are zero."""
    value = np.zeros((len(r_e), N_NAV))
    geodetic, C_ne = local_levels_of(r_e)
    value[:, :3], value[:, 3:6] = geodetic, np.einsum("kij,kj->ki", C_ne, v_e)
    value[:, 6:9] = Rotation.from_matrix(C_ne @ C_eb).as_euler("ZYX", degrees=True)[:, ::-1]
    return value


def values_of(value: Float64, P: Float64, rates: Float64, noise: float) -> dict[str, Float64]:
    m = len(value)
    found = further_values(EVERYTHING, value, np.broadcast_to(P, (m, 15, 15)), rates, np.full(m, noise))
    return dict(zip(EVERYTHING.columns, found.T, strict=True))


def full(of: dict[str, Float64], columns: tuple[str, ...]) -> Float64:
    """Return the covariance (3, 3) that six columns hold, of the only row."""
    xx, xy, xz, yy, yz, zz = (float(of[name][0]) for name in columns)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@pytest.mark.parametrize("sd_r", [0.5, 2000.0])
def test_covariances_are_those_of_drawn_errors(sd_r: float, rng: np.random.Generator) -> None:
    """Two kilometres turn the local level by as much as the attitude errs: that part has to be right too."""
    P, noise = covariance(rng, sd_r), 1e-6
    d = rng.multivariate_normal(np.zeros(15), P, size=DRAWS, method="cholesky")
    turned = Rotation.from_rotvec(d[:, PSI : PSI + 3]).as_matrix() @ C_EB
    rates = RATE - d[:, BG : BG + 3] + np.sqrt(noise) * rng.normal(size=(DRAWS, 3))
    drawn_rows = rows(AT.r_e + d[:, :3], V_E + d[:, DV : DV + 3], turned)
    drawn = values_of(drawn_rows, P, rates, noise)
    true_row = rows(AT.r_e[None], V_E[None], C_EB[None])
    truth = values_of(true_row, P, RATE[None], noise)

    def position_errors(of: Float64, reference: Float64) -> Float64:
        r = np.column_stack(pymap3d.geodetic2ecef(*of.T))
        origin = np.column_stack(pymap3d.geodetic2ecef(*reference.T))
        return (r - origin) @ local_levels_of(origin)[1][0].T

    columns = iter(COVARIANCES[i : i + 6] for i in (0, 6, 12))
    point = np.column_stack([drawn[name] for name in POINT[:3]])
    true_point = np.column_stack([truth[name] for name in POINT[:3]])
    C_nb = Rotation.from_euler("ZYX", drawn_rows[:, [8, 7, 6]], degrees=True)
    true_C_nb = Rotation.from_euler("ZYX", true_row[:, [8, 7, 6]], degrees=True)
    checked = [
        (position_errors(drawn_rows[:, :3], true_row[:, :3]), next(columns)),
        (drawn_rows[:, 3:6] - true_row[:, 3:6], next(columns)),
        ((C_nb * true_C_nb.inv()).as_rotvec(degrees=True), next(columns)),
        (position_errors(point, true_point), POINT_COVARIANCES[:6]),
        (np.column_stack([drawn[name] - truth[name] for name in POINT[3:6]]), POINT_COVARIANCES[6:]),
    ]
    for errors, names in checked:
        expected = full(truth, names)
        sigma = np.sqrt(np.diagonal(expected))
        np.testing.assert_allclose(
            np.cov(errors.T) / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=WITHIN
        )
    for name, at in zip(POINT[6:], (0, 3, 5, 6, 9, 11), strict=True):
        assert truth[name][0] == pytest.approx(np.sqrt(truth[POINT_COVARIANCES[at]][0]))


def test_point_at_the_imu_is_the_row_itself(rng: np.random.Generator) -> None:
    value = rows(AT.r_e[None], V_E[None], C_EB[None])
    P = covariance(rng, 0.5)[None]

    found = further_values(PointColumns((0.0, 0.0, 0.0)), value, P, RATE[None], np.zeros(1))[0]

    np.testing.assert_allclose(found[:6], value[0, :6], rtol=1e-11)
    np.testing.assert_allclose(found[6:9] ** 2, np.diagonal(AT.C_ne @ P[0, :3, :3] @ AT.C_ne.T), rtol=1e-9)


def test_quaternion_is_the_rows_attitude() -> None:
    value = rows(AT.r_e[None], V_E[None], C_EB[None])

    found = further_values(
        PointColumns(quaternion=True), value, np.zeros((1, 15, 15)), RATE[None], np.zeros(1)
    )[0]

    assert len(found) == len(QUATERNION)
    assert found[0] >= 0.0
    turned = Rotation.from_quat(found[[1, 2, 3, 0]]).as_matrix()
    np.testing.assert_allclose(turned, AT.C_ne @ C_EB, atol=1e-12)


def test_point_turns_about_the_imu_with_the_rate_against_the_earth() -> None:
    """A vehicle at rest that turns about its own axis: the point goes round at rate times arm."""
    C_eb = AT.C_ne.T
    value = rows(AT.r_e[None], np.zeros((1, 3)), C_eb[None])
    rate = C_eb.T @ np.array([0.0, 0.0, 7.292115e-5]) + [0.0, 0.0, 0.5]

    found = further_values(
        PointColumns((10.0, 0.0, 0.0)), value, np.zeros((1, 15, 15)), rate[None], np.full(1, 4e-6)
    )[0]

    np.testing.assert_allclose(found[3:6], [0.0, 5.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(found[9:12], [0.0, 0.02, 0.02], atol=1e-6)  # of the gyros' noise alone


def test_rate_at_an_instant_is_that_between_two_means() -> None:
    """A rate that grows steadily has its mean in the middle of each interval."""
    t_ns = 1_000_000_000 + np.arange(0, 500_000_000, 10_000_000, dtype=np.int64)
    w = np.outer(1e-9 * (t_ns - t_ns[0]) - 0.005, [1.0, 2.0, -1.0])
    imu = ImuSamples(t_ns, w, np.zeros_like(w))
    at_ns = t_ns[[3, 20]] + np.array([0, 4_000_000])

    rate, variance = rates_at(imu, at_ns, parameters()[0])

    np.testing.assert_allclose(rate[:, 0], 1e-9 * (at_ns - t_ns[0]), atol=1e-12)
    density = float(parameters()[0].gyro_density)
    assert variance[0] == pytest.approx(0.5 * density / 0.01)
    assert variance[1] > variance[0]
