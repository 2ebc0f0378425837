"""The helpers that prove others are proved first: on known derivatives and on drawn chi-square values."""

from __future__ import annotations

import numpy as np
import pytest

from tests.jacobian import finite_difference_jacobian
from tests.statistics_bounds import assert_mean_chi_square, mean_chi_square_bounds, nees, share_below_bounds


def test_jacobian_of_a_range_equals_the_unit_vector() -> None:
    satellite = np.array([15e6, -8e6, 20e6])
    user = np.array([2.9e6, 1.3e6, 5.5e6])

    jacobian = finite_difference_jacobian(lambda r: np.linalg.norm(satellite - r), user, 100.0)

    # rounding of a 2.2e7 m range is 4e-9 m, over a base of 100 m
    direction = (satellite - user) / np.linalg.norm(satellite - user)
    np.testing.assert_allclose(jacobian, -direction[None, :], atol=2e-10)


def test_jacobian_with_a_step_per_component_resolves_mixed_scales() -> None:
    def function(x: np.ndarray) -> np.ndarray:
        return np.array([np.sin(x[0]) * x[1], x[1] ** 3 / 1e18])

    x = np.array([0.3, 7e6])
    expected = [[np.cos(0.3) * 7e6, np.sin(0.3)], [0.0, 3.0 * 49e12 / 1e18]]

    np.testing.assert_allclose(
        finite_difference_jacobian(function, x, [1e-3, 1e3]), expected, rtol=1e-9, atol=1e-12
    )


def test_jacobian_error_is_of_fourth_order() -> None:
    errors = [abs(finite_difference_jacobian(np.exp, [0.0], h)[0, 0] - 1.0) for h in (0.2, 0.1)]

    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.05)


def test_jacobian_refuses_a_step_of_zero() -> None:
    with pytest.raises(ValueError, match="step"):
        finite_difference_jacobian(np.sin, [1.0], 0.0)


def test_chi_square_bounds_equal_the_tabulated_values() -> None:
    # chi2(100) quantiles 0.025 and 0.975 are 74.222 and 129.561 (any table), over 50 runs of 2 states
    assert mean_chi_square_bounds(2, 50, 0.95) == pytest.approx((74.222 / 50, 129.561 / 50), rel=1e-5)


def test_chi_square_bounds_widen_when_values_are_not_independent() -> None:
    low, high = mean_chi_square_bounds(3, 1000)
    wide_low, wide_high = mean_chi_square_bounds(3, 1000, effective_share=0.1)

    assert wide_low < low < 3.0 < high < wide_high


def test_nees_of_drawn_errors_lies_inside_its_bounds(rng: np.random.Generator) -> None:
    factor = rng.normal(size=(6, 6))
    covariance = factor @ factor.T
    errors = rng.multivariate_normal(np.zeros(6), covariance, size=300)

    assert_mean_chi_square(nees(errors, np.broadcast_to(covariance, (300, 6, 6))), dof=6)


@pytest.mark.parametrize(("scale", "verdict"), [(1.3, "confident"), (0.7, "modest")])
def test_nees_of_a_wrong_covariance_is_refused(rng: np.random.Generator, scale: float, verdict: str) -> None:
    errors = scale * rng.normal(size=(200, 3))

    with pytest.raises(AssertionError, match=verdict):
        assert_mean_chi_square(nees(errors, np.broadcast_to(np.eye(3), (200, 3, 3))), dof=3)


def test_share_bounds_hold_the_nominal_share() -> None:
    low, high = share_below_bounds(0.95, 2000)

    assert 0.93 < low < 0.95 < high < 0.97
