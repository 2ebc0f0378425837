"""What the errors of attitude and bias do together: the unseen force, and the turn of their axes with the heading."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from insgnss.fusion.closed_loop import turn_attitude_errors
from insgnss.fusion.motion import unknown_force
from insgnss.fusion.state import BA, OFFSETS, PSI, new_bank
from insgnss.geodesy.local_level import up_direction

GRAVITY_E = np.array([-4.1, 3.2, -8.3])
PLACE_E = np.array([2.7e6, -2.1e6, 5.4e6])


def covariance(n: int, seed: int) -> np.ndarray:
    """Return a covariance (n, n) in which everything is correlated with everything."""
    root = np.random.default_rng(seed).standard_normal((n, n))
    return root @ root.T


def test_unknown_force_is_the_horizontal_trace_of_its_covariance() -> None:
    C_eb = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    P = covariance(OFFSETS, 1)
    g2 = float(GRAVITY_E @ GRAVITY_E)

    found = unknown_force(C_eb, P, GRAVITY_E, g2, np.zeros(OFFSETS))

    x, y, z = GRAVITY_E
    M = np.hstack([np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]), -C_eb])  # df = g x psi - C b_a
    both = [*range(PSI, PSI + 3), *range(BA, BA + 3)]
    horizontal = np.eye(3) - np.outer(GRAVITY_E, GRAVITY_E) / g2
    np.testing.assert_allclose(found, np.trace(horizontal @ M @ P[np.ix_(both, both)] @ M.T), rtol=1e-12)


def test_attitude_errors_turn_about_the_vertical_with_the_correction_of_the_heading() -> None:
    n = OFFSETS + 2
    P, m = covariance(n, 2), new_bank(1, 0).state[0]
    m.r_e[:] = PLACE_E
    correction = np.zeros(n)
    correction[PSI : PSI + 3] = [0.4, 0.2, -0.5]
    up = np.array(up_direction(PLACE_E))
    turn = np.eye(n)
    turn[PSI : PSI + 3, PSI : PSI + 3] = Rotation.from_rotvec(
        up * (up @ correction[PSI : PSI + 3])
    ).as_matrix()
    expected = turn @ P @ turn.T

    turn_attitude_errors(m, P, correction)

    np.testing.assert_allclose(P, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())
    assert (P.T == P).all()
    correction[PSI : PSI + 3] = np.cross(up, [1.0, 2.0, 3.0])  # a tilt turns nothing
    before = P.copy()
    turn_attitude_errors(m, P, correction)
    np.testing.assert_allclose(P, before, rtol=0.0, atol=1e-13 * np.abs(expected).max())
