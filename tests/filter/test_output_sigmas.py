"""The sigmas of a navigation row against finite differences of the row's own values, far from and near a pole."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.filter.output.writing import COUNT_DTYPE, NAV_COLUMNS, NAV_DTYPE, mixture_covariance, write_nav
from insgnss.filter.state import DR, DV, OFFSETS, PSI, Bank, new_bank
from insgnss.tables import Float64
from tests.filter.scene import attitude, new_filter, parameters, place
from tests.filter.test_measurement_jacobians import moved
from tests.jacobian import finite_difference_jacobian
from tests.statistics_bounds import mean_chi_square_bounds

VALUES = [
    NAV_COLUMNS.index(name) for name in ("vn_mps", "ve_mps", "vd_mps", "roll_deg", "pitch_deg", "yaw_deg")
]
SIGMAS = [NAV_COLUMNS.index("sd_" + NAV_COLUMNS[i]) for i in VALUES]


def row_of(bank: Bank, P: Float64) -> Float64:
    """Return the navigation row of a filter of one hypothesis (k,)."""
    nav, count = np.zeros(1, NAV_DTYPE), np.zeros(1, COUNT_DTYPE)
    write_nav(nav, np.zeros((1, 0)), count[0], 0, bank.state[0], P, parameters()[0], (0, 1))
    return np.asarray(nav["value"][0])


def flying(lat_deg: float) -> Bank:
    """Return a filter in fast flight, banked and pitched."""
    at = place(lat_deg, 151.0, 9000.0)
    small = new_filter(at, v_n=(180.0, -170.0, 12.0), C_eb=attitude(at, 50.0, -20.0, 140.0))
    bank = new_bank(1, 1)
    bank.state[0], bank.head[0] = small.state[0], small.head[0]
    return bank


@pytest.mark.parametrize("lat_deg", [-33.0, 0.0, 88.0])
def test_sigmas_of_velocity_and_attitude_hold_the_turn_of_the_local_level(
    lat_deg: float, rng: np.random.Generator
) -> None:
    """An hour without GNSS: kilometres of position, Schuler's tilt and velocity all of one error."""
    bank = flying(lat_deg)
    root = rng.normal(size=(9, 9))
    scale = np.repeat([3000.0, 3.0, 3000.0 / 6.4e6], 3)
    P = np.eye(OFFSETS + 1)
    P[:9, :9] = (root @ root.T) * np.outer(scale, scale)

    def values(d: Float64) -> Float64:
        return row_of(moved(bank, np.append(d, np.zeros(OFFSETS - 8))), P)[VALUES]

    steps = np.repeat([300.0, 0.1, 1e-3], 3)
    J = finite_difference_jacobian(values, np.zeros(9), steps)
    expected = np.sqrt(np.diag(J @ P[:9, :9] @ J.T))

    # the rounding of a position of 6.4e6 m and the bend over 300 m near the pole
    np.testing.assert_allclose(row_of(bank, P)[SIGMAS], expected, rtol=1e-4)
    without = J.copy()
    without[:, DR : DR + 3] = 0.0
    assert np.max(np.abs(np.sqrt(np.diag(without @ P[:9, :9] @ without.T)) / expected - 1.0)) > 0.1


def test_level_that_follows_the_wrong_place_is_known_as_such() -> None:
    """Schuler: a platform that keeps to the local level of its own estimate is level there, wherever it is in truth."""
    bank = flying(0.0)
    at = place(0.0, 151.0, 9000.0)
    P = np.zeros((OFFSETS + 1, OFFSETS + 1))
    north = at.C_ne[0]
    # a place 5 km too far north, and the attitude turned with it about the axis to the west
    J = np.zeros((9, 1))
    meridian_m = 6_378_137.0 * (1.0 - 0.00669437999) + 9000.0
    J[DR : DR + 3, 0] = 5000.0 * north
    J[PSI : PSI + 3, 0] = -5000.0 / meridian_m * at.C_ne[1]
    J[DV : DV + 3, 0] = np.cross(J[PSI : PSI + 3, 0], bank.state[0].v_e)
    P[:9, :9] = J @ J.T

    # nothing of 5000 m / 6.3e6 m = 0.045 deg and 0.2 m/s is left
    assert np.all(row_of(bank, P)[SIGMAS] < [1e-5] * 6)


@pytest.mark.parametrize("turn_deg", [0.0, 60.0, 150.0, 179.0, -120.0])
def test_pitch_of_other_headings_is_in_the_sigma_of_the_pitch(turn_deg: float) -> None:
    """The leader pitches by 20 deg too much, the others are level at another heading: the roll of all is zero."""
    at = place(48.0, 11.0, 500.0)
    bank = new_bank(2, 1)
    for i, (pitch, yaw) in enumerate(((20.0, 30.0), (0.0, 30.0 + turn_deg))):
        one = new_filter(at, C_eb=attitude(at, 0.0, pitch, yaw))
        bank.state[i], bank.head[0] = one.state[0], one.head[0]
        bank.state[i].log_weight = np.log(0.5)
    bank.head[0].leader = 0
    P = np.zeros((OFFSETS + 1, OFFSETS + 1))
    mixture_covariance(bank, P)
    roll, pitch, yaw = row_of(bank, P)[SIGMAS[3:]]
    assert roll < 0.01  # the vertical is good to 2e-5 rad
    assert pitch == pytest.approx(20.0 / np.sqrt(2.0), rel=1e-4)
    assert yaw == pytest.approx(abs(turn_deg) / np.sqrt(2.0), abs=0.01)


def test_velocity_near_a_pole_is_as_good_as_the_meridian_is_known(rng: np.random.Generator) -> None:
    """Places drawn a metre off, 200 m from the pole: north and east turn by 0.3 deg, 1 m/s of 250 m/s."""
    bank = flying(89.9982)
    P = np.zeros((OFFSETS + 1, OFFSETS + 1))
    P[DR : DR + 3, DR : DR + 3] = np.eye(3)
    truth = row_of(bank, P)
    errors = []
    for _ in range(300):
        off = moved(bank, np.append(rng.normal(size=3), np.zeros(OFFSETS - 2)))
        errors.append(row_of(off, P)[VALUES[:2]] - truth[VALUES[:2]])
    ratios = np.array(errors) / truth[SIGMAS[:2]]
    low, high = mean_chi_square_bounds(1, 300)
    assert np.all(low < np.mean(ratios**2, axis=0)) and np.all(np.mean(ratios**2, axis=0) < high)
    assert np.all(truth[SIGMAS[:2]] > 0.5)


def test_yaw_at_a_pole_is_not_known_and_stays_a_number() -> None:
    bank = flying(89.99999)
    P = np.eye(OFFSETS + 1) * 100.0

    row = row_of(bank, P)[SIGMAS]

    assert np.isfinite(row).all() and np.all(row[3:] <= 180.0)


@pytest.mark.parametrize("off_deg", [1.0, 0.03, 0.01, 0.003])
def test_roll_and_yaw_of_a_vehicle_on_its_tail_are_as_wide_as_their_errors(
    off_deg: float, rng: np.random.Generator
) -> None:
    """True attitudes drawn 0.01 deg off: where the pitch is as near to 90 deg, roll and yaw may have any value."""
    at = place(48.0, 11.0, 500.0)
    small = new_filter(at, C_eb=attitude(at, 20.0, 90.0 - off_deg, 140.0))
    bank = new_bank(1, 1)
    bank.state[0], bank.head[0] = small.state[0], small.head[0]
    P = np.zeros((OFFSETS + 1, OFFSETS + 1))
    P[PSI : PSI + 3, PSI : PSI + 3] = np.radians(0.01) ** 2 * np.eye(3)
    estimate = row_of(bank, P)

    errors = []
    for _ in range(500):
        off = np.zeros(OFFSETS + 1)
        off[PSI : PSI + 3] = np.radians(0.01) * rng.normal(size=3)
        errors.append(row_of(moved(bank, off), P)[VALUES[3::2]] - estimate[VALUES[3::2]])
    rms = np.sqrt(np.mean(np.square(np.remainder(np.array(errors) + 180.0, 360.0) - 180.0), axis=0))

    # of two normal errors in a plane: 1.23 at most, near one and a half sigmas, and 104 deg of 180 in the end
    ratio = rms / estimate[SIGMAS[3::2]]
    assert np.all(ratio < 1.35) and np.all(ratio > 0.45)
