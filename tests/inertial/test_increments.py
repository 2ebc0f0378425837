"""Coning and sculling against their theory, with equal and unequal steps, and on whole flights."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insgnss.inertial.increments import effective_rates
from tests.inertial.inertial_frame import earth_turn, travel
from tests.inertial.strapdown import angle_of, fly, means

PLACE_E = np.array([6_378_137.0, 0.0, 0.0])
CONE = math.radians(1.0)  # half angle
OMEGA = 2.0 * math.pi * 5.0  # of the vibration [rad/s]
SHAKE_MPS2 = 20.0
UNEVEN = np.tile([0.002, 0.008], 2)


def edges_of(pattern_s: np.ndarray, duration_s: float) -> np.ndarray:
    """Return edges that repeat a pattern of steps from zero on."""
    steps = np.tile(pattern_s, round(duration_s / float(np.sum(pattern_s))))
    return np.concatenate([[0.0], np.cumsum(steps)])


def left_over(x: float) -> float:
    """Return what the two-sample correction leaves of ``x - sin x``; x is the vibration's phase in a step.

    Equation: x - sin x - 2/3 sin^2(x/2) sin x = x^5 / 30 + ...: the increments' products are 4 sin^2(x/2) sin(x), each
    times 1/12, of which the correction needs (x - sin x) / 2.
    """
    return x - math.sin(x) - 2.0 / 3.0 * math.sin(0.5 * x) ** 2 * math.sin(x)


# --- coning ---------------------------------------------------------------------------------------------------------


def cone_attitude(t: np.ndarray) -> Rotation:
    """Return C_ib: the axis of a small turn goes round."""
    return Rotation.from_rotvec(CONE * np.column_stack([np.cos(OMEGA * t), np.sin(OMEGA * t), 0.0 * t]))


def cone_rate(t: np.ndarray) -> np.ndarray:
    """Return w_ib_b of classical coning: the mean about the third axis stands for no turn at all."""
    s, c = math.sin(CONE), math.cos(CONE)
    return OMEGA * np.column_stack([-s * np.sin(OMEGA * t), s * np.cos(OMEGA * t), 0.0 * t - (1.0 - c)])


def coning_drift(pattern_s: np.ndarray, corrected: bool) -> float:
    """Return the drift about the cone's axis [rad/s] from second 1 to 21: the first sample has no neighbour."""
    edges = edges_of(pattern_s, 21.0)
    w = means(cone_rate, edges)
    C_eb = cone_attitude(edges[:1]).as_matrix()[0]
    flown = fly(np.diff(edges), w, np.zeros_like(w), C_eb, PLACE_E, np.zeros(3), corrected=corrected).C_eb
    errors = []
    for k in (round((len(w)) / 21), len(w)):
        C_ib = cone_attitude(edges[k : k + 1]).as_matrix()[0]
        errors.append(Rotation.from_matrix(earth_turn(edges[k]) @ flown[k - 1] @ C_ib.T).as_rotvec()[2])
    return (errors[1] - errors[0]) / 20.0


@pytest.mark.parametrize("step_s", [0.02, 0.01, 0.005])
def test_coning_drift_is_what_theory_leaves_after_two_samples(step_s: float) -> None:
    x = OMEGA * step_s

    # the cone is finite: theory holds to CONE^2 = 3e-4; 5.1, 0.33 and 0.021 deg/h
    drift = coning_drift(np.array([step_s]), corrected=True)
    assert drift == pytest.approx(-0.5 * CONE**2 * left_over(x) / step_s, rel=0.01)


@pytest.mark.parametrize("step_s", [0.02, 0.01, 0.005])
def test_coning_must_matter(step_s: float) -> None:
    x = OMEGA * step_s

    without = coning_drift(np.array([step_s]), corrected=False)

    assert without == pytest.approx(-0.5 * CONE**2 * (x - math.sin(x)) / step_s, rel=0.01)
    # x^2 / 5 of it is left with the correction
    assert coning_drift(np.array([step_s]), corrected=True) / without == pytest.approx(x**2 / 5.0, rel=0.05)


def test_coning_with_steps_of_2_and_8_ms_is_corrected_as_well() -> None:
    with_uneven, without = (coning_drift(UNEVEN, corrected) for corrected in (True, False))

    # a correction made for equal steps would leave 4e-5 rad/s; with their true lengths 1.6e-7 = 0.03 deg/h is left
    assert abs(with_uneven) < abs(without) / 200.0
    assert coning_drift(0.5 * UNEVEN, True) == pytest.approx(with_uneven / 16.0, rel=0.05)


# --- sculling -------------------------------------------------------------------------------------------------------


def rocking_rate(t: np.ndarray) -> np.ndarray:
    """Return w_ib_b of rocking about the first axis by ``CONE sin(OMEGA t)``."""
    return np.column_stack([CONE * OMEGA * np.cos(OMEGA * t), 0.0 * t, 0.0 * t])


def shaking_force(t: np.ndarray) -> np.ndarray:
    """Return f_b along the second axis, in step with the rocking."""
    return np.column_stack([0.0 * t, SHAKE_MPS2 * np.sin(OMEGA * t), 0.0 * t])


def shaking_force_i(t: float) -> np.ndarray:
    """Return the same in the inertial frame."""
    angle, force = CONE * math.sin(OMEGA * t), SHAKE_MPS2 * math.sin(OMEGA * t)
    return np.array([0.0, force * math.cos(angle), force * math.sin(angle)])


def sculling_acceleration(pattern_s: np.ndarray, corrected: bool) -> np.ndarray:
    """Return the false acceleration from second 1 to 6 (3,) [m/s^2]."""
    edges = edges_of(pattern_s, 6.0)
    w, f = means(rocking_rate, edges), means(shaking_force, edges)
    flown = fly(np.diff(edges), w, f, np.eye(3), PLACE_E, np.zeros(3), corrected=corrected)
    first, last = round(len(w) / 6), len(w)
    wrong = [
        flown.v_e[k - 1] - travel(PLACE_E, np.zeros(3), shaking_force_i, edges[k])[1] for k in (first, last)
    ]
    return np.asarray((wrong[1] - wrong[0]) / 5.0)


@pytest.mark.parametrize("step_s", [0.02, 0.01])
def test_sculling_is_what_theory_leaves_after_two_samples_and_must_matter(step_s: float) -> None:
    x = OMEGA * step_s
    rectified = 0.5 * CONE * SHAKE_MPS2 / x

    with_correction = sculling_acceleration(np.array([step_s]), corrected=True)
    without = sculling_acceleration(np.array([step_s]), corrected=False)

    # at 10 ms: 290 ug without, 5.7 ug with
    assert without[2] == pytest.approx(-rectified * (x - math.sin(x)), rel=0.01)
    assert with_correction[2] == pytest.approx(-rectified * left_over(x), rel=0.01)
    assert with_correction[:2] == pytest.approx([0.0, 0.0], abs=1e-7)


def test_sculling_with_steps_of_2_and_8_ms_is_corrected_as_well() -> None:
    with_uneven, without = (sculling_acceleration(UNEVEN, corrected)[2] for corrected in (True, False))

    assert abs(with_uneven) < abs(without) / 100.0


# --- one interval ---------------------------------------------------------------------------------------------------


def test_effective_rates_of_a_straight_line_give_the_rotation_of_its_integral() -> None:
    w0, slope = np.array([1.0, -2.0, 0.5]), np.array([30.0, 40.0, -60.0])
    f0, pull = np.array([5.0, -3.0, -9.0]), np.array([100.0, -200.0, 150.0])
    before, now = 0.003, 0.005

    def line(start: np.ndarray, growth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return start - 0.5 * before * growth, start + 0.5 * now * growth

    w_c, f_c = np.zeros(3), np.zeros(3)
    (w1, w2), (f1, f2) = line(w0, slope), line(f0, pull)
    effective_rates(w2, f2, w1, f1, now, before, w_c, f_c)

    # phi' = w + phi x w / 2 + ..., and the part of the force's increment that a constant rate does not give
    turn = np.cross(w0, slope) * now**3 / 12.0
    push = (np.cross(w0, pull) + np.cross(f0, slope)) * now**3 / 12.0
    assert (w_c - w2) * now == pytest.approx(turn, rel=1e-8, abs=0.0)
    assert (f_c - f2) * now == pytest.approx(push, rel=1e-8, abs=0.0)


def test_effective_rates_of_constant_rates_are_these() -> None:
    w, f, w_c, f_c = np.array([1.0, 2.0, 3.0]), np.array([-4.0, 5.0, -6.0]), np.zeros(3), np.zeros(3)

    effective_rates(w, f, w, f, 0.01, 0.004, w_c, f_c)

    assert w_c == pytest.approx(w, abs=1e-15)
    assert f_c == pytest.approx(f, abs=1e-15)


def test_attitude_error_falls_with_the_third_power_of_uneven_steps() -> None:
    def rate(t: np.ndarray) -> np.ndarray:
        return np.column_stack([np.sin(1.3 * t), np.cos(0.7 * t), 0.5 * np.sin(0.4 * t + 1.0)])

    errors = []
    reference = None
    for share in (0.05, 0.5, 1.0):
        edges = edges_of(share * np.array([0.004, 0.016]), 4.0)
        w = means(rate, edges)
        last = fly(np.diff(edges), w, np.zeros_like(w), np.eye(3), PLACE_E, np.zeros(3)).C_eb[-1]
        reference = last if reference is None else reference
        errors.append(angle_of(last @ reference.T))

    # "second order" is what a correction must keep; the curvature of the rates gives the third
    assert errors[2] < 1e-6
    assert errors[2] / errors[1] > 6.0
