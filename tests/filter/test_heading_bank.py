"""A bank of headings keeps what it knows: merging and splitting leave mean and variance of every state alone."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.filter.headings.heading_bank import (
    difference,
    merge_into,
    pruned,
    set_attitude,
    split,
    turn_member,
)
from insgnss.filter.headings.headings import (
    heading_variance,
    is_open_again,
    same_heading,
    share_noise_levels,
    turn_about,
    widest_variance,
    yaw_variance,
)
from insgnss.filter.state import BG, DR, MEANS, OFFSETS, PSI, Bank, new_bank
from insgnss.filter.update.closed_loop import close_loop
from insgnss.geodesy.local_level import up_direction
from insgnss.gnss.observation_rows import RANGE_RATE
from tests.layouts import layout_with

LAYOUT = layout_with(n_offsets=1, clone=True)
N = OFFSETS + LAYOUT.n_optional
PLACE_E = np.array([4.2e6, 0.6e6, 4.7e6])
UP = np.array(up_direction(PLACE_E))
EARTH_RATE = np.array([0.0, 0.0, WGS84_OMEGA_RADPS])
LEVER_B = np.array([1.2, -0.4, -0.8])
NEVER = math.log(1e-12)
C_BEGIN = Rotation.from_rotvec([0.3, -1.0, 0.6]).as_matrix()


def bank_of(headings_deg: list[float], sigma_deg: float, drift_s: float = 0.0) -> Bank:
    """Return members of one attitude turned about the vertical, whose gyros have drifted for a while unobserved."""
    bank = new_bank(len(headings_deg), LAYOUT.n_optional)
    for m, P, heading in zip(bank.state, bank.P, headings_deg, strict=True):
        m.r_e[:] = PLACE_E
        set_attitude(m, Rotation.from_rotvec(math.radians(heading) * UP).as_matrix() @ C_BEGIN)
        sigma = np.repeat([2.0, 0.1, 0.01, 0.02, 1e-3, 5.0, 0.1, 3.0, 1.0], [3, 3, 3, 3, 3, 1, 1, 1, N_CLONE])
        P[:] = np.diag(sigma**2)
        P[PSI : PSI + 3, PSI : PSI + 3] += np.outer(UP, UP) * math.radians(sigma_deg) ** 2
        Phi = np.eye(N)
        Phi[PSI : PSI + 3, BG : BG + 3] = -m.C_eb * drift_s
        P[:] = Phi @ P @ Phi.T
    return bank


N_CLONE = N - OFFSETS - 1


def vertical_bias(bank: Bank) -> tuple[float, float]:
    """Return mean and sigma of the vertical gyro bias over all members."""
    weight = np.exp(bank.state["log_weight"])
    up_b = np.array([m.C_eb.T @ UP for m in bank.state])
    mean = np.einsum("ij,ij->i", up_b, bank.state["b_g"])
    own = np.einsum("ij,ijk,ik->i", up_b, bank.P[:, BG : BG + 3, BG : BG + 3], up_b)
    middle = weight @ mean
    return float(middle), math.sqrt(weight @ (own + (mean - middle) ** 2))


def test_merged_members_have_mean_and_covariance_of_both() -> None:
    bank = bank_of([0.0, 3.0], 10.0)
    bank.state["log_weight"] = np.log([0.7, 0.3])
    rng = np.random.default_rng(5)
    bank.state["r_e"][1] += rng.standard_normal(3)
    bank.state["b_a"][1] += 0.01 * rng.standard_normal(3)
    bank.state["clock_clone"][1] += 0.4
    first, P = bank.state[0].copy(), bank.P.copy()
    d = difference(bank.state[1], bank.state[0], N, LAYOUT)

    merge_into(bank, 0, 1, LAYOUT)

    np.testing.assert_allclose(difference(bank.state[0], first, N, LAYOUT), 0.3 * d, atol=1e-9)
    np.testing.assert_allclose(
        bank.P[0], 0.7 * P[0] + 0.3 * P[1] + 0.21 * np.outer(d, d), rtol=1e-12, atol=1e-15
    )
    assert bank.state["log_weight"][0] == pytest.approx(0.0, abs=1e-12)


def test_a_circle_of_headings_is_never_merged_into_one() -> None:
    """Neighbours a sigma apart are different headings: of a full circle none may go."""
    bank = bank_of([30.0 * k for k in range(12)], 29.0)
    assert [same_heading(bank, i) for i in range(12)] == [-1] * 12
    assert len(pruned(bank, NEVER, LAYOUT).state) == 12


def test_members_of_half_a_sigma_are_one() -> None:
    bank = bank_of([0.0, 4.0, 90.0], 10.0)
    bank.state["log_weight"] = np.log([0.5, 0.3, 0.2])
    before = heading_variance(bank)

    left = pruned(bank, NEVER, LAYOUT)

    assert len(left.state) == 2
    # about the leader, whose heading is now the mean of both
    moved = math.radians(0.3 / 0.8 * 4.0)
    # both spread about it as before, the far one is nearer by as much
    assert heading_variance(left) == pytest.approx(
        before - 0.8 * moved**2 - 0.2 * (math.pi / 2) ** 2 + 0.2 * (math.pi / 2 - moved) ** 2, rel=1e-9
    )


@pytest.mark.parametrize("sigma_deg", [18.0, 25.0, 40.0])
def test_split_keeps_heading_and_its_variance(sigma_deg: float) -> None:
    bank = bank_of([20.0], sigma_deg)
    parts = split(bank, 12, NEVER, LEVER_B, LAYOUT)
    # the windows add up to a constant to 1.4 %
    assert heading_variance(parts) == pytest.approx(heading_variance(bank), rel=2e-2)
    assert np.exp(parts.state["log_weight"]).sum() == pytest.approx(1.0)
    sigmas = [math.degrees(math.sqrt(yaw_variance(m, P))) for m, P in zip(parts.state, parts.P, strict=True)]
    assert max(sigmas) < 15.0


def test_split_again_and_again_forgets_no_gyro_bias() -> None:
    """The drift that has made the members wide stays as uncertain as it is: 1e-3 rad/s, which nobody has measured."""
    bank = bank_of([30.0 * k for k in range(12)], 15.0, drift_s=300.0)
    mean, sigma = vertical_bias(bank)
    for _ in range(4):
        bank = split(bank, 12, NEVER, LEVER_B, LAYOUT)
        for m, P in zip(bank.state, bank.P, strict=True):
            Phi = np.eye(N)
            Phi[PSI : PSI + 3, BG : BG + 3] = -m.C_eb * 150.0
            P[:] = Phi @ P @ Phi.T
            set_attitude(m, m.C_eb @ Rotation.from_rotvec(-m.b_g * 150.0).as_matrix())
    assert vertical_bias(bank) == pytest.approx((mean, sigma), rel=1e-2, abs=1e-6)


def test_on_a_full_circle_the_heading_says_nothing_of_the_gyro_bias() -> None:
    """Each member correlates heading and bias by its drift; all together, from anywhere on the circle, they do not."""
    bank = bank_of([30.0 * k for k in range(12)], 15.0, drift_s=400.0)
    parts = split(bank, 12, NEVER, LEVER_B, LAYOUT)
    for m, P in zip(parts.state, parts.P, strict=True):
        up_b = m.C_eb.T @ UP
        common = UP @ P[PSI : PSI + 3, BG : BG + 3] @ up_b
        bias = up_b @ P[BG : BG + 3, BG : BG + 3] @ up_b
        assert abs(common) / math.sqrt(bias * yaw_variance(m, P)) < 0.1
        assert math.sqrt(bias) == pytest.approx(1e-3, rel=0.05)


@pytest.mark.parametrize("turn", [0.5, -0.5, 2.0])
def test_turned_member_keeps_the_antenna_and_what_the_gyros_show(turn: float) -> None:
    """What the measurements know: antenna against clone, to millimetres, and gyro bias plus Earth rate."""
    bank = bank_of([0.0], 20.0)
    m, P = bank.state[0], bank.P[0]
    antenna, apparent = m.r_e + m.C_eb @ LEVER_B, m.b_g + m.C_eb.T @ EARTH_RATE
    before = bank.state[0].copy()
    l_e = m.C_eb @ LEVER_B
    # gyros that have shown bias plus Earth rate to 1e-6 rad/s: db = -C^T (w x psi)
    shown = np.eye(N)
    w = EARTH_RATE[2]
    shown[BG : BG + 3, PSI : PSI + 3] = -m.C_eb.T @ [[0.0, -w, 0.0], [w, 0.0, 0.0], [0.0, 0.0, 0.0]]
    P[BG : BG + 3, BG : BG + 3] = 1e-12 * np.eye(3)
    P[:] = shown @ P @ shown.T
    # an antenna known to 1 cm, whatever the heading: dr = -psi x l and the antenna's own error
    J = np.eye(N)
    J[DR : DR + 3, PSI : PSI + 3] = [[0.0, -l_e[2], l_e[1]], [l_e[2], 0.0, -l_e[0]], [-l_e[1], l_e[0], 0.0]]
    P[DR : DR + 3] *= 0.0
    P[:, DR : DR + 3] *= 0.0
    P[DR : DR + 3, DR : DR + 3] = 1e-4 * np.eye(3)
    P[:] = J @ P @ J.T

    turn_member(m, P, turn, math.radians(15.0), LEVER_B, LAYOUT)

    assert turn_about(before, m) == pytest.approx(turn, abs=1e-9)
    np.testing.assert_allclose(m.r_e + m.C_eb @ LEVER_B, antenna, atol=1e-6)
    np.testing.assert_allclose(m.b_g + m.C_eb.T @ EARTH_RATE, apparent, atol=1e-6)
    l_e = m.C_eb @ LEVER_B
    H = np.zeros((3, N))
    H[:, DR : DR + 3] = np.eye(3)
    H[:, PSI : PSI + 3] = [[0.0, l_e[2], -l_e[1]], [-l_e[2], 0.0, l_e[0]], [l_e[1], -l_e[0], 0.0]]
    np.testing.assert_allclose(H @ P @ H.T, 1e-4 * np.eye(3), atol=1e-9)
    assert yaw_variance(m, P) == pytest.approx(math.radians(15.0) ** 2, rel=1e-9)


def test_attitude_of_the_epoch_before_turns_with_a_correction() -> None:
    """What is between the two counts as the gyros' rotation, and a correction is none."""
    bank = bank_of([0.0], 20.0)
    m = bank.state[0]
    then = Rotation.from_rotvec([0.01, 0.02, -0.03]).as_matrix()
    m.C_swung[:] = m.C_eb @ then
    correction = np.zeros(N)
    correction[PSI : PSI + 3] = 0.3, -0.8, 0.5

    close_loop(m, correction, N - N_CLONE)

    np.testing.assert_allclose(m.C_swung, m.C_eb @ then, atol=1e-12)
    assert np.linalg.norm(m.C_eb - C_BEGIN) > 0.1


def test_members_are_split_where_a_motion_shows_more_than_they_are_linear_in() -> None:
    """sigma^2 / 2 sqrt(sum of w I) = 0.1 sigmas of the rows, and no finer than a third of the widest."""
    bank, widest = bank_of([0.0, 30.0], 15.0), math.radians(25.0) ** 2
    bank.state["log_weight"] = np.log([0.75, 0.25])
    assert widest_variance(bank, widest) == widest  # nothing was shown
    bank.state["motion_information"] = [20.0, 4.0]
    assert widest_variance(bank, widest) == pytest.approx(2.0 * 0.1 / math.sqrt(16.0))
    bank.state["motion_information"] = 1e6
    assert widest_variance(bank, widest) == pytest.approx(widest / 9.0)
    assert widest_variance(bank, math.inf) == math.inf  # one heading alone is wanted


def test_heading_that_counts_as_known_is_open_again_where_several_lie_far_apart() -> None:
    bank, widest = bank_of([0.0, 90.0], 3.0), math.radians(25.0) ** 2
    bank.state["log_weight"] = np.log([0.95, 0.05])
    assert not is_open_again(bank, widest)
    bank.state["log_weight"] = np.log([0.9, 0.1])  # 90 deg sqrt(0.1) = 28 deg
    assert is_open_again(bank, widest)
    bank.head["heading_open"] = 1
    assert not is_open_again(bank, widest)
    bank.head["heading_open"], bank.head["more_than_headings"] = 0, 1
    assert not is_open_again(bank, widest)


def test_headings_share_their_noise_levels() -> None:
    """One that took an epoch for noise would never be contradicted again; a mean keeps the variance of all."""
    bank = bank_of([0.0, 40.0, 90.0], 10.0)
    bank.state["log_weight"] = np.log([0.7, 0.2, 0.1])
    bank.state["noise_factor"] = [[1.0] * 5, [1.0, 30.0, 1.0, 1.0, 1.0], [2.0, 300.0, 1.0, 1.0, 1.0]]
    bank.state["lasting"][:, RANGE_RATE, MEANS] = 2.0, 5.0, 20.0
    share_noise_levels(bank)
    assert np.allclose(bank.state["noise_factor"], [1.1, 36.7, 1.0, 1.0, 1.0])
    assert np.allclose(bank.state["lasting"][:, RANGE_RATE, MEANS], 4.4)


def test_hypotheses_of_more_than_headings_keep_their_noise_levels() -> None:
    """There the noise says which of them has the right position; how long errors last is the same for all."""
    bank = bank_of([0.0, 40.0], 10.0)
    bank.head["more_than_headings"] = 1
    bank.state["noise_factor"] = [[1.0] * 5, [9.0] * 5]
    bank.state["lasting"][:, RANGE_RATE, MEANS] = 2.0, 5.0
    share_noise_levels(bank)
    assert np.all(bank.state["noise_factor"] == [[1.0] * 5, [9.0] * 5])
    # likelihoods compare only where it is the same
    assert np.allclose(bank.state["lasting"][:, RANGE_RATE, MEANS], 3.5)


def test_lost_heading_has_no_part_in_the_noise_levels() -> None:
    bank = bank_of([0.0, 40.0], 10.0)
    bank.state["log_weight"] = [0.0, -np.inf]
    bank.state["noise_factor"] = [[1.5] * 5, [np.nan] * 5]
    share_noise_levels(bank)
    assert np.all(bank.state["noise_factor"][0] == 1.5)
