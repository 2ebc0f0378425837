"""The test for standstill: its rate of misses and of false alarms is the stated one, whatever the noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from insgnss.config.vehicle_kind import Standstill
from insgnss.filter.own_rows.state_estimate import InertialWindow
from insgnss.sensors.standstill import critical_ratio, window_statistics
from insgnss.tables import Float64
from tests.statistics_bounds import share_below_bounds

WINDOWS = 4000


def window(w_ib_b: Float64, f_b: Float64, *, unknown: bool = False) -> InertialWindow:
    return InertialWindow(np.arange(len(w_ib_b)) * 10_000_000, w_ib_b, f_b, unknown)


def share_at_rest(
    rng: np.random.Generator, sigma: float, motion: Float64 | float = 0.0, samples: int = 100
) -> float:
    """Return the share of windows of white noise, the first axis moving, that pass the test."""
    limit, passed = None, 0
    for _ in range(WINDOWS):
        x = sigma * rng.standard_normal((samples, 6))
        x[:, 0] += motion
        found = window_statistics(window(x[:, :3], x[:, 3:]))
        assert found is not None
        limit = limit or critical_ratio(0.05, found.parts, found.samples)
        passed += bool(found.f_ratio.max() <= limit)
    return passed / WINDOWS


@pytest.mark.parametrize("sigma", [1e-5, 0.3])
@pytest.mark.parametrize("samples", [10, 100])
def test_windows_at_rest_are_missed_as_often_as_stated(
    sigma: float, samples: int, rng: np.random.Generator
) -> None:
    """5 % over six axes, the product of six times 1 - 0.05/6; white noise of any level."""
    low, high = share_below_bounds((1.0 - 0.05 / 6.0) ** 6, WINDOWS)
    assert low <= share_at_rest(rng, sigma, samples=samples) <= high


@pytest.mark.parametrize("ratio", [1.0, 3.0])
def test_motion_passes_as_often_as_stated(ratio: float, rng: np.random.Generator) -> None:
    """A motion that is one draw for each part, with ``ratio`` times the sigma of a part's mean of noise."""
    parts, samples = 8, 12
    passed = 0
    limit = critical_ratio(0.05, parts, samples)
    for _ in range(WINDOWS):
        x = rng.standard_normal((parts * samples, 6))
        x[:, 0] += np.repeat(ratio / np.sqrt(samples) * rng.standard_normal(parts), samples)
        found = window_statistics(window(x[:, :3], x[:, 3:]))
        assert found is not None
        passed += bool(found.f_ratio[0] <= limit)
    wanted = stats.f.cdf(limit / (1.0 + ratio**2), parts - 1, parts * (samples - 1))
    low, high = share_below_bounds(float(wanted), WINDOWS)
    assert low <= passed / WINDOWS <= high


def test_engine_that_idles_is_no_motion(rng: np.random.Generator) -> None:
    """A line at 25 Hz thirty times the noise: it averages out in the parts, so fewer windows are missed."""
    line = 30.0 * np.sin(2.0 * np.pi * 25.0 * np.arange(100) * 0.01 + 1.0)
    assert share_at_rest(rng, 1.0, line) > 0.95


def test_good_gyro_that_sees_the_vehicle_rock_passes_with_the_rocking_that_is_allowed(
    rng: np.random.Generator,
) -> None:
    """Noise of 1e-4 rad/s and parts that rock by 5e-4: motion without the allowance of 1e-3, rest with it."""
    plain, allowed = 0, 0
    for _ in range(200):
        x = 1e-4 * rng.standard_normal((96, 6)) + np.repeat(5e-4 * rng.standard_normal((8, 6)), 12, axis=0)
        for rocking in ((0.0, 0.0), (1e-3, 1e-3)):
            found = window_statistics(window(x[:, :3], x[:, 3:]), rocking)
            assert found is not None
            rests = found.f_ratio.max() <= critical_ratio(0.01, found.parts, found.samples)
            plain, allowed = plain + (rests and not any(rocking)), allowed + (rests and any(rocking))
    assert plain == 0 and allowed == 200


def test_stuck_unknown_or_few_samples_say_nothing() -> None:
    w, f = np.zeros((100, 3)), np.tile([0.0, 0.0, -9.8], (100, 1))
    assert window_statistics(window(w, f)) is None
    noisy = w + np.random.default_rng(1).standard_normal((100, 3))
    assert window_statistics(window(noisy, f)) is not None
    assert window_statistics(window(noisy, f, unknown=True)) is None
    assert window_statistics(window(noisy[:8], f[:8])) is None


def test_limits_have_room_for_a_sensor_that_is_not_calibrated() -> None:
    assert Standstill().most_rate_deg_per_s > 3.0 * 300.0 / 3600.0  # three sigma of a consumer gyro's bias
