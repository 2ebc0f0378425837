"""Random manoeuvring has the statistics that its numbers say, is smooth, and is refused where it makes no sense."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError
from scipy import linalg

from insgnss.config.manoeuvres import Manoeuvre
from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.errors import ConfigError
from insgnss.simulation.gauss_markov_motion import GRID_S, GaussMarkovFigure, GaussMarkovProcess
from insgnss.simulation.itinerary import ManoeuvreError, course_of, knot_s_of
from insgnss.simulation.trajectory import Trajectory

LIST = TypeAdapter(list[Manoeuvre])
ALPHA = 0.3


def wandering(**changed: Any) -> dict[str, Any]:
    return {"kind": "gauss_markov", "duration_s": 60.0, "acceleration_g": 5.0, **changed}


def laid(*entries: dict[str, Any], speed_mps: float = 200.0) -> Trajectory:
    manoeuvres = LIST.validate_python(list(entries))
    return course_of(manoeuvres, speed_mps).lay(50.0, 10.0, 2e4, 30.0, knot_s=knot_s_of(manoeuvres))


def test_process_has_its_sigma_and_its_correlation_time() -> None:
    process, count = GaussMarkovProcess(49.03, 1.0 / ALPHA), 400_000
    x = process.values(count, np.random.default_rng(1))
    assert np.all(x[0] == 0.0)
    x = x[2000:]

    # 8000 s hold 8000 / (2 / 0.3) = 1200 independent values an axis: 1.2 % of sigma for three of them
    assert np.std(x) == pytest.approx(49.03, rel=0.035)
    lag = round(1.0 / ALPHA / GRID_S)
    correlation = np.mean(x[lag:] * x[:-lag]) / np.var(x)
    assert correlation == pytest.approx(math.exp(-1.0), abs=0.06)
    across = np.corrcoef(x.T)[np.triu_indices(3, 1)]
    assert np.abs(across).max() < 0.1


def test_velocity_is_the_integral_of_the_acceleration() -> None:
    process, none = GaussMarkovProcess(30.0, 2.0), GaussMarkovProcess(0.0, 1.0)
    figure = GaussMarkovFigure(process, none, 20.0, np.random.default_rng(3))
    a = process.values(1 + math.ceil(24.0 / GRID_S), np.random.default_rng(3))

    wanted = GRID_S * (np.cumsum(a, axis=0) - 0.5 * a)
    t = GRID_S * np.arange(len(a))
    np.testing.assert_allclose(figure.velocity(t), wanted, atol=1e-9 * np.abs(wanted).max())


def test_pull_bounds_speed_as_its_equation_says() -> None:
    return_s, W = 40.0, 2.0 * math.pi / 40.0
    A = np.array([[0.0, 1.0, 0.0], [-W * W, -math.sqrt(2.0) * W, 1.0], [0.0, 0.0, -ALPHA]])
    wanted = math.sqrt(linalg.solve_continuous_lyapunov(A, np.diag([0, 0, -2 * ALPHA * 49.03**2]))[1, 1])
    process, none = GaussMarkovProcess(49.03, 1.0 / ALPHA), GaussMarkovProcess(0.0, 1.0)
    figure = GaussMarkovFigure(process, none, 1500.0, np.random.default_rng(5), return_s)

    # 1400 s of three axes hold some 200 independent speeds
    assert np.std(figure.velocity(np.arange(100.0, 1500.0, 0.5))) == pytest.approx(wanted, rel=0.12)


def test_body_turns_at_the_rates_of_its_process() -> None:
    trajectory = laid(wandering(acceleration_g=0.0, turn_rate_deg_per_s=28.65, turn_time_s=1.0))
    t = GRID_S * np.arange(1, 2900)
    # the processes are drawn one after the other from one generator
    rng = np.random.default_rng(1)
    count = 1 + math.ceil(64.0 / GRID_S)
    GaussMarkovProcess(0.0, 10.0 / 3.0).values(count, rng)
    rates = GaussMarkovProcess(math.radians(28.65), 1.0).values(count, rng)

    turned = trajectory.rotation_eb(t)
    found = (turned[:-1].inv() * turned[1:]).as_rotvec() / GRID_S
    # the level frame turns by v / R = 3e-5 rad/s; a step of 0.01 rad is a rotation vector to 1e-4 of it
    np.testing.assert_allclose(found, 0.5 * (rates[1:2899] + rates[2:2900]), atol=1e-4)


def test_motion_goes_on_from_the_course_without_a_step() -> None:
    trajectory = laid({"kind": "straight", "duration_s": 20.0}, wandering(turn_rate_deg_per_s=30.0))
    t = np.arange(19.9, 20.1, 1e-3)

    assert np.abs(np.diff(trajectory.velocity_e(t), axis=0)).max() < 0.05
    assert np.abs(trajectory.velocity_e(np.array([10.0]))).max() < 201.0
    moved = trajectory.velocity_e(np.array([79.9])) - trajectory.velocity_e(np.array([20.0]))
    assert np.linalg.norm(moved) > 100.0


def test_acceleration_of_the_trajectory_has_the_sigma_of_the_process() -> None:
    trajectory = laid(wandering(duration_s=900.0))
    a = np.asarray(trajectory.offset_e(np.arange(20.0, 900.0, 0.1), 2))

    # 880 s hold some 130 independent values of each axis; 1e6 m away the level frame's own turning is 0.5 m/s^2
    assert np.sqrt(np.mean(a**2)) == pytest.approx(5.0 * STANDARD_GRAVITY_MPS2, rel=0.12)


def test_seed_names_the_motion() -> None:
    t = np.array([55.0])
    first, again, other = (laid(wandering(seed=seed, return_s=60.0)).position_e(t) for seed in (7, 7, 8))

    assert np.array_equal(first, again)
    assert np.linalg.norm(first - other) > 100.0


def test_random_motion_is_the_last_manoeuvre() -> None:
    with pytest.raises(ManoeuvreError, match="nothing can follow"):
        laid(wandering(), {"kind": "straight", "duration_s": 5.0})


@pytest.mark.parametrize(
    "changed",
    [
        {"duration_s": 0.0},
        {"acceleration_g": -1.0},
        {"acceleration_g": math.nan},
        {"acceleration_time_s": 0.0},
        {"return_s": 1.0},
        {"seed": -1},
        {"amount": 3},
    ],
)
def test_settings_that_make_no_sense_are_refused(changed: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        LIST.validate_python([wandering(**changed)])


@pytest.mark.parametrize(
    ("make", "key"),
    [
        (lambda: GaussMarkovProcess(-1.0, 1.0), "sigma"),
        (lambda: GaussMarkovProcess(1.0, 0.001), "time_s"),
        (lambda: GaussMarkovProcess(1.0, math.nan), "time_s"),
        (lambda: figure_of(math.nan, None), "duration_s"),
        (lambda: figure_of(10.0, 0.5), "return_s"),
    ],
)
def test_figures_that_make_no_sense_are_refused(make: Any, key: str) -> None:
    with pytest.raises(ConfigError) as refused:
        make()

    assert refused.value.key == key
    assert refused.value.advice


def figure_of(duration_s: float, return_s: float | None) -> GaussMarkovFigure:
    process = GaussMarkovProcess(1.0, 1.0)
    return GaussMarkovFigure(process, process, duration_s, np.random.default_rng(1), return_s)
