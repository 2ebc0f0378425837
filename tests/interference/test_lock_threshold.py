"""Loss of lock by Monte Carlo: table 1, the levels of other lifetimes, the same numbers with any number of threads."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.errors import ConfigError
from insgnss.interference.discriminators import DISCRIMINATORS, Discriminator, discriminator
from insgnss.interference.lock_thresholds import (
    LIFETIME,
    LockThreshold,
    count_slips,
    lock_threshold,
    slip_loop,
)

# What simulation with matched loops gave before, independently of this package: ranges over five loops each.
# atan, divided by its true slope, has 0.077; the printed 0.067 belongs to an output that is not (below).
EARLIER = {
    "Q": (0.0755, 0.0764),
    "atan(Q/I)": (0.0769, 0.0776),
    "sign(I)Q": (0.0755, 0.0772),
    "IQ": (0.0779, 0.0785),
}
_FOUND: dict[str, LockThreshold] = {}


def found(kind: Discriminator) -> LockThreshold:
    """Return the simulation of a discriminator, made once: 5 % of a lifetime's sigma, 0.4 % of C_A.

    The bounds below are 1.3 % of C_A beyond what was found earlier.
    """
    if kind.name not in _FOUND:
        _FOUND[kind.name] = lock_threshold(kind, np.random.default_rng(7), slips=400)
    return _FOUND[kind.name]


@pytest.mark.slow
@pytest.mark.parametrize("kind", DISCRIMINATORS, ids=lambda kind: kind.name)
def test_thresholds_at_300_over_b_are_those_found_earlier_and_of_table_1(kind: Discriminator) -> None:
    ratio = found(kind).ratio(LIFETIME)
    low, high = EARLIER[kind.name]

    assert low - 0.001 <= ratio <= high + 0.001
    if kind.name != "atan(Q/I)":
        assert ratio == pytest.approx(kind.threshold_ratio, abs=0.004)


@pytest.mark.slow
def test_atan_without_its_true_slope_is_near_the_printed_figure() -> None:
    # 2 ms of a loop of 18 Hz: 0.069 found earlier, 0.067 printed, 0.077 with the slope. 200 slips: sigma 0.0004
    kind = discriminator("atan(Q/I)")
    one = lock_threshold(
        kind,
        np.random.default_rng(3),
        bandwidth_time=0.036,
        normalised=False,
        levels=(0.062, 0.066, 0.07, 0.075),
        slips=200,
    )
    assert one.ratio() == pytest.approx(0.067, abs=0.004)
    assert one.ratio() < found(kind).ratio() - 0.004


@pytest.mark.slow
@pytest.mark.parametrize(("lifetime", "level"), [(100, 0.086), (200, 0.080), (500, 0.073), (1000, 0.069)])
def test_other_lifetimes_have_the_levels_found_earlier(lifetime: float, level: float) -> None:
    # "about": two digits, over the discriminators
    mean = np.mean([found(kind).ratio(lifetime) for kind in DISCRIMINATORS])
    assert mean == pytest.approx(level, abs=0.0015)


@pytest.mark.slow
def test_true_error_at_the_threshold_is_larger_than_the_linear_theory_says() -> None:
    one = found(discriminator("IQ"))
    measured = float(np.interp(one.ratio(), one.level, one.measured))
    assert 0.087 - 0.006 <= measured <= 0.094  # found earlier: 0.087 to 0.094, over all discriminators


def test_lifetime_grows_as_the_level_falls_and_bounds_hold_it() -> None:
    one = lock_threshold(discriminator("Q"), np.random.default_rng(1), levels=(0.09, 0.1, 0.11), slips=200)

    assert (np.diff(one.lifetime) < 0.0).all() and (one.slips >= 200).all()
    assert ((one.low < one.lifetime) & (one.lifetime < one.high)).all()
    # 200 slips: 7 % of one sigma, so bounds of 95 % lie 14 % away
    assert one.high / one.low == pytest.approx(math.exp(4.0 / math.sqrt(200.0)), rel=0.15)


def test_result_does_not_depend_on_the_number_of_threads() -> None:
    runs = [
        lock_threshold(
            discriminator("sign(I)Q"),
            np.random.default_rng(5),
            levels=(0.1, 0.12),
            slips=100,
            workers=workers,
        )
        for workers in (1, 3)
    ]
    assert runs[0].lifetime.tobytes() == runs[1].lifetime.tobytes()
    assert runs[0].measured.tobytes() == runs[1].measured.tobytes()


def test_errors_of_a_strong_signal_have_the_variance_of_the_linear_theory(rng: np.random.Generator) -> None:
    # far below the threshold the loop is linear: predicted variance of the discrete filter, P = r alpha / (1 - alpha)
    kind, level, bt = discriminator("IQ"), 0.01, 0.02
    loop = slip_loop(kind, level, bt)
    draws = rng.standard_normal((64, 4096, 4))
    state, slips, squares = np.zeros((64, 2)), np.zeros(64, np.int64), np.zeros(64)
    count_slips(loop, draws, state, slips, squares)
    r = 0.5 * 0.75 * (kind.aperture_rad * level) ** 2 / bt  # S_n / 2 over a period of one
    filtered = r * loop.alpha  # the error after the update is what is summed

    # 262144 samples, one independent in some 50: 2 % of one sigma of the variance
    assert slips.sum() == 0
    assert squares.sum() / draws[..., 0].size == pytest.approx(filtered, rel=0.08)


def test_loop_without_noise_and_drift_comes_to_rest() -> None:
    for kind in DISCRIMINATORS:
        loop = slip_loop(kind, 0.05, 0.05)
        state, slips, squares = np.full((1, 2), [0.3, 0.0]), np.zeros(1, np.int64), np.zeros(1)
        count_slips(loop, np.zeros((1, 2000, 4)), state, slips, squares)
        assert slips[0] == 0 and abs(state[0, 0]) < 1e-6


def test_error_beyond_the_aperture_slips_once() -> None:
    loop = slip_loop(discriminator("IQ"), 0.05, 0.05)
    state, slips, squares = np.array([[0.5 * math.pi, 0.6]]), np.zeros(1, np.int64), np.zeros(1)
    count_slips(loop, np.zeros((1, 500, 4)), state, slips, squares)
    assert slips[0] == 1 and state[0].tolist() == [0.0, 0.0]


def test_lifetimes_beyond_the_levels_are_refused() -> None:
    one = lock_threshold(discriminator("Q"), np.random.default_rng(1), levels=(0.1, 0.12), slips=50)
    with pytest.raises(ConfigError, match="lifetime"):
        one.ratio(5000.0)


@pytest.mark.parametrize(
    ("options", "key"),
    [
        ({"levels": (0.076,)}, "levels"),
        ({"levels": (0.0, 0.1)}, "levels"),
        ({"levels": (0.1, 7.6)}, "levels"),
        ({"slips": 0}, "slips"),
        ({"bandwidth_time": 0.9}, "accumulation_s"),
        ({"bandwidth_time": -1.0}, "bandwidth_time"),
    ],
)
def test_impossible_simulations_are_refused(options: dict[str, object], key: str) -> None:
    with pytest.raises(ConfigError) as caught:
        lock_threshold(discriminator("Q"), np.random.default_rng(1), **options)  # type: ignore[arg-type]
    assert caught.value.key == key and caught.value.advice
