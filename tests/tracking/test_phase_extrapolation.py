"""Thirty minutes of extrapolated ranges beside the true ones: a GLONASS satellite and a user in a 5 g circle."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import pytest

from insgnss.errors import ConfigError
from insgnss.tables import Float64
from insgnss.tracking.phase_extrapolation import RULES, accumulated_ranges, extrapolate_ranges

GM: Final = 3.986004418e14
ORBIT_M, NODE, INCLINATION, START = 25510e3, 0.3, math.radians(64.8), 0.9
USER_M: Final = np.array([2.8, 1.6, 5.5]) * 1e6
PULL_MPS2, TURN = 5.0 * 9.80665, 2.0 * math.pi / 20.0
SPAN_S, BLOCK = 1800.0, 90_000


def satellite(t_s: Float64) -> tuple[Float64, Float64]:
    """Return positions and velocities on a circular orbit, (n, 3) inertial."""
    n = math.sqrt(GM / ORBIT_M**3)
    node = np.array([math.cos(NODE), math.sin(NODE), 0.0])
    across = np.array(
        [-math.sin(NODE) * math.cos(INCLINATION), math.cos(NODE) * math.cos(INCLINATION), math.sin(INCLINATION)]
    )  # fmt: skip
    c, s = np.cos(START + n * t_s)[:, None], np.sin(START + n * t_s)[:, None]
    return ORBIT_M * (c * node + s * across), ORBIT_M * n * (c * across - s * node)


def user(t_s: Float64) -> tuple[Float64, Float64, Float64]:
    """Return position, velocity, acceleration: 5 g that turn in 20 s, from 200 m/s, (n, 3) inertial."""
    w, c, s, zero = TURN, np.cos(TURN * t_s), np.sin(TURN * t_s), np.zeros(len(t_s))
    a = PULL_MPS2 * np.stack([c, s, zero], axis=1)
    v = np.stack([PULL_MPS2 / w * s, 200.0 + PULL_MPS2 / w * (1.0 - c), zero], axis=1)
    moved = [PULL_MPS2 / w**2 * (1.0 - c), 200.0 * t_s + PULL_MPS2 / w * (t_s - s / w), zero]
    return USER_M + np.stack(moved, axis=1), v, a


def errors(step_s: float, rule: str, span_s: float = SPAN_S, drift: float = 0.0) -> Float64:
    """Return extrapolated less true change of the range at every step [m]."""
    count = round(span_s / step_s)
    total, found = 0.0, [np.zeros(1)]
    for first in range(0, count, BLOCK):
        t = np.asarray(np.arange(first, min(first + BLOCK, count) + 1) * step_s)
        (r_sat, v_sat), (r, v, a) = satellite(t), user(t)
        distance = np.linalg.norm(r_sat - r, axis=1)
        u = (r_sat - r) / distance[:, None]
        ranges = accumulated_ranges(u[:, None], v_sat[:, None], v, a, step_s, drift, rule)[:, 0]
        found.append(total + (ranges - (distance - distance[0]))[1:])
        total = found[-1][-1]
    return np.concatenate(found)


@pytest.mark.parametrize(
    ("step_s", "end", "largest"),
    [
        (1e-3, -2.6e-6, 1.04e-5),
        (5e-3, -6.5e-5, 2.6e-4),
        (1e-2, -2.6e-4, 1.04e-3),
        (2e-2, -1.04e-3, 4.1e-3),
    ],
)
def test_trapezoid_follows_the_range_for_half_an_hour(step_s: float, end: float, largest: float) -> None:
    error = errors(step_s, "trapezoid")

    # computed independently of this project, to two digits; a sum of 2e6 steps rounds to some 1e-7 m
    assert error[-1] == pytest.approx(end, rel=0.04, abs=2e-7)
    assert np.abs(error).max() == pytest.approx(largest, rel=0.02)
    # bounded: the last five minutes are no worse than the first
    tenth = len(error) // 6
    assert np.ptp(error[-tenth:]) < 1.05 * np.ptp(error[:tenth])


@pytest.mark.parametrize(
    ("step_s", "plain", "accelerated"),
    [
        (1e-3, -0.1865, -0.1906),
        (5e-3, -0.9323, -0.9530),
        (1e-2, -1.8646, -1.9061),
        (2e-2, -3.7290, None),
    ],
)
def test_rectangle_drifts_by_half_a_step_of_the_range_rate(
    step_s: float, plain: float, accelerated: float | None
) -> None:
    assert errors(step_s, "rectangle")[-1] == pytest.approx(plain, abs=6e-5 if step_s < 0.02 else 6e-4)
    if accelerated is not None:
        assert errors(step_s, "rectangle_accelerated")[-1] == pytest.approx(accelerated, abs=6e-5)


def test_error_of_one_step_falls_with_the_third_power_of_it() -> None:
    one = [abs(errors(step_s, "trapezoid", step_s)[-1]) for step_s in (0.4, 0.2, 0.1)]

    np.testing.assert_allclose([one[0] / one[1], one[1] / one[2]], 8.0, rtol=0.1)


def test_drift_of_the_clock_adds_to_the_range() -> None:
    still, drifting = (errors(1e-2, "trapezoid", 10.0, drift) for drift in (0.0, 3.0))

    assert drifting[-1] - still[-1] == pytest.approx(30.0, abs=1e-6)


def test_channels_of_one_step_do_not_touch_each_other() -> None:
    t = np.array([0.0, 0.02])
    (r_sat, v_sat), (r, v, a) = satellite(t), user(t)
    u = (r_sat - r) / np.linalg.norm(r_sat - r, axis=1)[:, None]
    both = np.stack([u, -u], axis=1), np.stack([v_sat, 0.5 * v_sat], axis=1)
    for number, rule in enumerate(RULES):
        steps = np.zeros(2)
        extrapolate_ranges(
            number, (both[0][0], both[1][0]), (both[0][1], both[1][1]), (v[0], a[0], 0.25), 0.02, steps
        )
        for c in range(2):
            alone = accumulated_ranges(both[0][:, [c]], both[1][:, [c]], v, a, 0.02, 0.25, rule)
            assert steps[c] == alone[1, 0]


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("rule", {"rule": "simpson"}),
        ("step_s", {"step_s": 0.0}),
        ("directions", {"directions": np.ones((3, 3))}),
        ("directions", {"directions": np.full((3, 2, 3), np.nan)}),
        ("satellite_velocities", {"satellite_velocities": np.ones((3, 1, 3))}),
        ("velocities", {"velocities": np.ones((2, 3))}),
        ("accelerations", {"accelerations": np.full((3, 3), np.inf)}),
        ("clock_drift_mps", {"clock_drift_mps": np.nan}),
    ],
)
def test_bad_input_is_refused_with_its_key(key: str, change: dict[str, object]) -> None:
    good = {
        "directions": np.ones((3, 2, 3)) / math.sqrt(3.0), "satellite_velocities": np.ones((3, 2, 3)),
        "velocities": np.ones((3, 3)), "accelerations": np.ones((3, 3)), "step_s": 0.01,
    }  # fmt: skip
    with pytest.raises(ConfigError) as refused:
        accumulated_ranges(**{**good, **change})  # type: ignore[arg-type]

    assert refused.value.key == key
    assert refused.value.advice
