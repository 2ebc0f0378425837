"""Only a motion that was shown tells headings apart: what counts as shown, and what it can say at most."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.filter.headings.headings import weigh_headings
from insgnss.filter.headings.motion import motion_specific_force, sees_earth_rate, velocity_changed
from insgnss.filter.parameters import PARAMETERS_DTYPE
from insgnss.filter.state import BG, DV, OFFSETS, PSI, Bank, StateRecord, new_bank
from insgnss.filter.update.epoch_space import new_epoch, new_workspace
from insgnss.filter.update.epoch_update import use_rows
from insgnss.filter.update.scalar_update import predicted_variance
from insgnss.gnss.observation_rows import RANGE_RATE
from insgnss.status import USED
from insgnss.units import deg_per_h_to_radps
from tests.layouts import layout_with

PLACE_E = np.array([4.2e6, 0.6e6, 4.7e6])
UP_E = np.array([0.0, 0.0, 1.0])  # at the pole


def parameters(gate: float = 5.0) -> np.ndarray:
    par = np.zeros(1, PARAMETERS_DTYPE)
    par["motion_gate2"] = gate**2
    return par[0]


def two_headings(
    log_likelihoods: tuple[float, float], information: float, *, in_full: bool = False
) -> np.ndarray:
    """Return the weights of two hypotheses after an epoch."""
    bank = open_bank(information)
    bank.state["log_likelihood"] = log_likelihoods
    weigh_headings(bank, parameters(), in_full)
    return np.exp(bank.state["log_weight"])


def open_bank(information: float) -> Bank:
    """Return two equally likely headings; the motion of each epoch shows so many squared sigmas."""
    bank = new_bank(2, 0)
    bank.state["r_e"] = PLACE_E
    bank.P[:] = np.eye(OFFSETS)
    bank.state["motion_information"] = information
    return bank


def test_without_motion_no_likelihood_moves_a_weight() -> None:
    np.testing.assert_array_equal(two_headings((0.0, -50.0), 0.0), [0.5, 0.5])


WRONG = 0.01  # odds that an epoch is wrong altogether
NOISE = 2.0  # squared sigmas by which noise moves an epoch


@pytest.mark.parametrize(("information", "share"), [(0.1, 0.1 / 2.1), (3.0, 0.6), (1e6, 1.0)])
def test_motion_counts_by_its_share_of_what_moves_the_rows(information: float, share: float) -> None:
    heavier, lighter = two_headings((0.0, -2.0), information)
    assert lighter / heavier == pytest.approx((np.exp(-2.0 * share) + WRONG) / (1.0 + WRONG), rel=1e-5)


def test_rows_that_measure_the_heading_count_in_full() -> None:
    heavier, lighter = two_headings((0.0, -2.0), 0.0, in_full=True)
    assert lighter / heavier == pytest.approx((np.exp(-2.0) + WRONG) / (1.0 + WRONG))


def test_weight_of_a_heading_is_the_share_of_the_runs_in_which_it_is_right() -> None:
    """Of twenty epochs with half a squared sigma of motion and two of noise each; all told apart by 1 rad.

    If the weights w are right, the mean weight of the right heading is that of the sum of w^2.
    """
    runs, epochs, shown = 1000, 20, 0.5
    rng = np.random.default_rng(20)
    log_ratio = 0.5 * shown + np.sqrt(shown + NOISE) * rng.standard_normal((runs, epochs))  # right over wrong
    of_right, squares = np.empty(runs), np.empty(runs)
    for run in range(runs):
        bank = open_bank(shown)
        for found in log_ratio[run]:
            bank.state["log_likelihood"] = (found, 0.0)
            weigh_headings(bank, parameters(), False)
        weights = np.exp(bank.state["log_weight"])
        of_right[run], squares[run] = weights[0], weights @ weights
    excess = of_right - squares
    assert abs(excess.mean()) < 3.0 * excess.std() / np.sqrt(runs)
    assert of_right.mean() > 0.6  # not the half that they begin with


def test_one_epoch_alone_chooses_no_heading() -> None:
    """However unlikely it makes a heading: its rows may all be wrong."""
    heavier, lighter = two_headings((0.0, -1000.0), 10.0)
    assert lighter / heavier == pytest.approx(WRONG / (1.0 + WRONG))


def test_a_lost_hypothesis_has_no_weight() -> None:
    np.testing.assert_array_equal(two_headings((-3.0, -np.inf), 10.0), [1.0, 0.0])


def test_response_is_the_difference_of_two_filters_with_and_without_the_motion() -> None:
    """Both filters see the same measurements; one has been moved by q before. It is q that the updates leave of it."""
    rng = np.random.default_rng(3)
    root = rng.standard_normal((OFFSETS, OFFSETS))
    start, q = root @ root.T, rng.standard_normal(OFFSETS)
    after, left, information = [], np.zeros(0), 0.0
    for moved in (np.zeros(OFFSETS), q):
        s = new_epoch(6, OFFSETS)
        for j, line in enumerate(s.lines):
            columns = line.columns[RANGE_RATE][: line.count[RANGE_RATE]]
            line.status[RANGE_RATE] = USED
            line.h[RANGE_RATE][: len(columns)] = np.sin(np.arange(len(columns)) * (j + 1.0))
            line.variance[RANGE_RATE] = 0.5 + j
            line.innovation[RANGE_RATE] = j - line.h[RANGE_RATE][: len(columns)] @ moved[columns]
            line.predicted[RANGE_RATE] = predicted_variance(start, line.h[RANGE_RATE], columns)
        left = q.copy()
        P = start.copy()
        _, information = use_rows(P, s.lines, s.vectors, RANGE_RATE, 25.0, 1.0, left)
        after.append(moved + s.vectors[0, :OFFSETS])
    np.testing.assert_allclose(left, after[1] - after[0], atol=1e-9)
    # q^T H^T (H P H^T + R)^-1 H q
    H = np.zeros((6, OFFSETS))
    for j, line in enumerate(s.lines):
        columns = line.columns[RANGE_RATE][: line.count[RANGE_RATE]]
        H[j, columns] = line.h[RANGE_RATE][: len(columns)]
    S = H @ start @ H.T + np.diag(0.5 + np.arange(6))
    assert information == pytest.approx((H @ q) @ np.linalg.solve(S, H @ q), rel=1e-9)


def tilted(force_mps2: np.ndarray) -> tuple[StateRecord, np.ndarray]:
    """Return a state that feels a force (east, north, up) for a second, its attitude unsure by 1 deg."""
    m, P = new_bank(1, 0).state[0], np.zeros((OFFSETS, OFFSETS))
    m.r_e[:], m.C_eb[:], m.sum_dt = np.linalg.norm(PLACE_E) * UP_E, np.eye(3), 1.0
    m.f_smooth[:] = m.sum_dv[:] = force_mps2
    P[PSI : PSI + 3, PSI : PSI + 3] = np.radians(1.0) ** 2 * np.eye(3)
    for i in range(BG, BG + 3):
        P[i, i] = deg_per_h_to_radps(100.0) ** 2  # these gyros do not see the Earth's rate
    return m, P


def test_drag_of_a_fall_is_not_what_tilt_leaves_of_gravity() -> None:
    """Of 0.6 m/s^2 along the way, 10 deg off the vertical, 1 deg of tilt hides 0.01 m/s^2: the rest has a direction.

    A transition that turned it into the vertical would let the velocity show the angle about the nose. At rest
    the same tilt turns gravity by 0.17 m/s^2, and the same horizontal force shows nothing.
    """
    drag = -0.6 * np.array([np.sin(np.radians(10.0)), 0.0, np.cos(np.radians(10.0))])
    m, P = tilted(drag)
    *found, _ = motion_specific_force(m, P, parameters(), -9.8 * UP_E, np.zeros_like(P))
    assert np.linalg.norm(np.cross(found, drag)) < 0.1 * abs(drag[0] * drag[2])
    m, P = tilted(drag * [1.0, 1.0, 0.0] + 9.8 * UP_E)
    *found, _ = motion_specific_force(m, P, parameters(), -9.8 * UP_E, np.zeros_like(P))
    np.testing.assert_allclose(found, 9.8 * UP_E, atol=1e-12)


@pytest.mark.parametrize(("change", "seen"), [(0.3, False), (0.75, True)])
def test_velocity_has_changed_beyond_five_sigma_of_now_and_before(change: float, seen: bool) -> None:
    """0.1 m/s now and 0.1 m/s in the mean: five sigmas are 0.71 m/s."""
    m, P = new_bank(1, 0).state[0], np.zeros((OFFSETS, OFFSETS))
    m.r_e[:] = PLACE_E
    P[DV : DV + 3, DV : DV + 3] = 0.01 * np.eye(3)
    m.v_mean_variance = 0.01
    m.v_e[:] = change * np.cross(PLACE_E, [0.0, 0.0, 1.0]) / np.hypot(*PLACE_E[:2])
    assert velocity_changed(m, P, 25.0) is seen


def test_vertical_velocity_tells_no_heading() -> None:
    m, P = new_bank(1, 0).state[0], 0.01 * np.eye(OFFSETS)
    m.r_e[:] = PLACE_E
    m.v_e[:] = 10.0 * PLACE_E / np.linalg.norm(PLACE_E)
    assert not velocity_changed(m, P, 25.0)


@pytest.mark.parametrize(("bias_deg_per_h", "seen"), [(0.5, True), (3.0, False)])
def test_gyros_see_the_earth_turn_where_their_bias_is_a_fifth_of_it(
    bias_deg_per_h: float, seen: bool
) -> None:
    """At 47 deg of latitude the horizontal Earth rate is 10.2 deg/h: a fifth is 2.0 deg/h."""
    m, P = new_bank(1, 0).state[0], np.zeros((OFFSETS, OFFSETS))
    m.r_e[:] = PLACE_E
    for i in range(BG, BG + 3):
        P[i, i] = deg_per_h_to_radps(bias_deg_per_h) ** 2
    assert sees_earth_rate(m, np.zeros(1, PARAMETERS_DTYPE)[0], P) is seen


def test_workspace_has_room_for_the_response() -> None:
    layout = layout_with(n_offsets=5, channel_bias=True, zenith_delay=True, clone=True)
    bank, work = new_bank(2, layout.n_optional), new_workspace(3, layout)
    assert bank.state["motion_response"].shape[1] >= OFFSETS + layout.n_optional
    assert work.epoch.vectors.shape[1] >= OFFSETS + layout.n_optional
