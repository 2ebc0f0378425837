"""Manoeuvres of a scenario file become smooth courses that do what their numbers say, or errors that say why not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from insgnss.config.manoeuvres import Manoeuvre
from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.simulation.aerobatics import smoothstep_integral
from insgnss.simulation.course import smoothstep
from insgnss.simulation.itinerary import ManoeuvreError, course_of, knot_s_of
from insgnss.simulation.trajectory import Trajectory, reference_table

LIST = TypeAdapter(list[Manoeuvre])
PLACE = (60.0, 30.0, 500.0, 10.0)


def straight(duration_s: float) -> dict[str, Any]:
    return {"kind": "straight", "duration_s": duration_s}


def flown(*entries: dict[str, Any], speed_mps: float = 0.0) -> tuple[Trajectory, float]:
    manoeuvres = LIST.validate_python(list(entries))
    course = course_of(manoeuvres, speed_mps)
    return course.lay(*PLACE, knot_s=knot_s_of(manoeuvres)), course.clock_s


def velocity_b(trajectory: Trajectory, t: np.ndarray) -> np.ndarray:
    motion = trajectory.motion(t)
    return np.asarray(np.einsum("nji,nj->ni", motion.C_eb, motion.v_e))


def test_integral_of_the_smoothstep_has_it_as_its_derivative() -> None:
    x, h = np.linspace(-0.5, 2.0, 251), 1e-4
    slope = (smoothstep_integral(x + h) - smoothstep_integral(x - h)) / (2.0 * h)
    assert slope == pytest.approx(smoothstep(x), abs=1e-7)


FIGURES: list[tuple[dict[str, Any], float]] = [
    ({"kind": "loop", "radius_m": 180.0, "top_speed_mps": 65.0}, 90.0),
    ({"kind": "barrel_roll", "duration_s": 7.0, "radius_m": 40.0, "direction": "left"}, 90.0),
    ({"kind": "turn", "by_deg": -120.0, "bank_deg": 60.0, "roll_in_deg_per_s": 60.0}, 90.0),
    ({"kind": "s_turn", "by_deg": 50.0, "bank_deg": 40.0}, 90.0),
    ({"kind": "sea", "duration_s": 60.0, "roll_deg": 9.0, "heave_m": 1.0}, 7.0),
]


@pytest.mark.parametrize(("figure", "speed"), FIGURES, ids=[f["kind"] for f, _ in FIGURES])
def test_a_figure_ends_level_at_its_height_with_its_speed(figure: dict[str, Any], speed: float) -> None:
    trajectory, end = flown(straight(5.0), figure, straight(5.0), speed_mps=speed)
    truth = reference_table(trajectory.motion(np.array([end])), 0)
    assert truth.h_m[0] == pytest.approx(500.0, abs=1e-4)
    assert np.linalg.norm(truth.v_n[0]) == pytest.approx(speed, abs=1e-5)
    assert truth.rpy_deg[0, :2] == pytest.approx([0.0, 0.0], abs=1e-3)


@pytest.mark.parametrize(("figure", "speed"), FIGURES, ids=[f["kind"] for f, _ in FIGURES])
def test_acceleration_and_rates_of_a_figure_have_no_step(figure: dict[str, Any], speed: float) -> None:
    trajectory, end = flown(straight(5.0), figure, straight(5.0), speed_mps=speed)
    t = np.arange(0.0, end, 1e-3)
    for values, unit in (
        (trajectory.specific_force_b(t), STANDARD_GRAVITY_MPS2),
        (trajectory.angular_rate_b(t), 1.0),
    ):
        # within a millisecond: jerk below 10 g/s and angular acceleration below 10 rad/s^2; a step would be 1 or more
        assert np.max(np.abs(np.diff(values, axis=0))) < 0.01 * unit


@pytest.mark.parametrize("kind", ["loop", "barrel_roll"])
def test_nose_of_a_figure_lies_along_its_velocity(kind: str) -> None:
    figure = next(f for f, _ in FIGURES if f["kind"] == kind)
    trajectory, end = flown(straight(5.0), figure, straight(5.0), speed_mps=90.0)
    across = velocity_b(trajectory, np.arange(0.0, end, 0.1))[:, 1:]
    assert np.max(np.abs(across)) < 1e-3  # the splines between knots of 0.05 s


def test_loop_pulls_what_its_radius_asks_and_turns_over_once() -> None:
    trajectory, _ = flown(straight(5.0), {"kind": "loop", "radius_m": 400.0}, straight(5.0), speed_mps=120.0)
    t = np.arange(5.0, 30.0, 0.05)
    f_b = trajectory.specific_force_b(t)
    # constant speed: centripetal 36 m/s^2 all the way, gravity with it at the bottom and against it at the top
    assert -f_b[:, 2].min() == pytest.approx(120.0**2 / 400.0 + 9.81, abs=0.5)
    assert np.ptp(reference_table(trajectory.motion(t), 0).h_m) == pytest.approx(800.0, rel=0.1)
    assert trajectory.rate_eb_b(t)[:, 1].sum() * 0.05 == pytest.approx(2.0 * np.pi, abs=1e-3)


def test_barrel_roll_rolls_once_to_its_side() -> None:
    for direction, side in (("right", 1.0), ("left", -1.0)):
        figure = {"kind": "barrel_roll", "duration_s": 6.0, "radius_m": 0.0, "direction": direction}
        trajectory, _ = flown(straight(2.0), figure, straight(2.0), speed_mps=90.0)
        rolled = trajectory.rate_eb_b(np.arange(0.0, 10.0, 0.01))[:, 0].sum() * 0.01
        assert rolled == pytest.approx(side * 2.0 * np.pi, abs=1e-3)


def test_roll_rates_of_a_turn_are_the_largest_ones_in_and_out() -> None:
    turn = {
        "kind": "turn",
        "by_deg": 180.0,
        "bank_deg": 45.0,
        "roll_in_deg_per_s": 30.0,
        "roll_out_deg_per_s": 12.0,
    }
    trajectory, end = flown(straight(5.0), turn, straight(5.0), speed_mps=90.0)
    p = np.degrees(trajectory.rate_eb_b(np.arange(0.0, end, 0.01))[:, 0])
    assert p.max() == pytest.approx(30.0, abs=0.05) and p.min() == pytest.approx(-12.0, abs=0.05)
    # counted against the geodesic ahead: north itself turns by 0.026 deg over 1.65 km at 60 deg
    heading = reference_table(trajectory.motion(np.array([end])), 0).rpy_deg[0, 2]
    assert (heading - 190.0 + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.03)


def test_take_off_and_landing_lead_from_rest_to_rest() -> None:
    trajectory, end = flown(
        straight(10.0),
        {"kind": "take_off", "speed_mps": 60.0, "run_s": 25.0, "climb_m": 300.0, "rate_mps": 6.0},
        {"kind": "landing", "descend_m": 300.0, "rate_mps": 5.0, "run_s": 20.0, "approach_mps": 50.0},
    )
    truth = reference_table(trajectory.motion(np.linspace(0.0, end, 500)), 0)
    speed = np.linalg.norm(truth.v_n, axis=1)
    assert speed[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-5) and speed.max() > 60.0
    assert truth.h_m.max() == pytest.approx(800.0, abs=1e-3)
    assert truth.h_m[-1] == pytest.approx(500.0, abs=1e-3)


ROCKET = {"kind": "ascent", "duration_s": 90.0, "wait_s": 10.0, "thrust_g": 8.0, "burn_s": 10.0}


def test_rocket_without_drag_coasts_in_free_fall_and_spins_as_told() -> None:
    trajectory, end = flown({**ROCKET, "spin_deg_per_s": 720.0})
    on_rail, burning, coasting = np.arange(1.0, 9.0), np.arange(13.0, 19.0), np.arange(22.0, 89.0)
    truth = reference_table(trajectory.motion(np.array([0.0, end])), 0)
    assert truth.rpy_deg[0, 1] == pytest.approx(85.0, abs=1e-6)
    assert np.linalg.norm(trajectory.specific_force_b(on_rail), axis=1) == pytest.approx(9.82, abs=0.01)
    assert trajectory.specific_force_b(burning)[:, 0] == pytest.approx(8.0 * STANDARD_GRAVITY_MPS2, rel=2e-3)
    # the way is laid over the ellipsoid: Coriolis (2 w v, 0.1 m/s^2 at 750 m/s) and the model of gravity remain
    assert np.max(np.abs(trajectory.specific_force_b(coasting))) < 0.2
    assert np.degrees(trajectory.rate_eb_b(coasting)[:, 0]) == pytest.approx(720.0, abs=0.05)


def test_waves_move_a_ship_by_their_amplitudes() -> None:
    sea = {"kind": "sea", "duration_s": 300.0, "roll_deg": 8.0, "pitch_deg": 3.0, "heave_m": 1.5}
    trajectory, _ = flown(sea, speed_mps=6.0)
    truth = reference_table(trajectory.motion(np.arange(15.0, 285.0, 0.1)), 0)
    for values, size in ((truth.rpy_deg[:, 0], 8.0), (truth.rpy_deg[:, 1], 3.0), (truth.h_m - 500.0, 1.5)):
        assert values.max() == pytest.approx(size, rel=0.01) and values.min() == pytest.approx(
            -size, rel=0.01
        )


@pytest.mark.parametrize(
    ("entries", "speed", "entry", "told"),
    [
        ([straight(5.0), {"kind": "turn", "by_deg": 90.0, "bank_deg": 30.0}], 0.0, 1, "needs speed"),
        ([{"kind": "turn", "by_deg": 1.0, "bank_deg": 60.0}], 80.0, 0, "over while rolling in"),
        ([{"kind": "turn", "by_deg": 0.0, "bank_deg": 60.0}], 80.0, 0, "is none"),
        ([straight(1.0), {"kind": "loop", "radius_m": 1.0}], 100.0, 1, "radius of at least"),
        ([{"kind": "barrel_roll", "duration_s": 4.0}], 0.0, 0, "needs speed"),
        ([{"kind": "landing", "descend_m": 5.0, "rate_mps": 5.0, "run_s": 9.0}], 50.0, 0, "before its ramp"),
        ([ROCKET, straight(5.0)], 0.0, 1, "nothing can follow"),
        ([straight(5.0), ROCKET], 0.0, 1, "only manoeuvre"),
        ([{**ROCKET, "duration_s": 900.0, "thrust_g": 2.0}], 0.0, 0, "back on the ground"),
        (
            [
                {"kind": "accelerate", "to_mps": 90.0, "duration_s": 30.0, "meanwhile": True},
                {"kind": "turn", "by_deg": 90.0, "bank_deg": 30.0},
            ],
            50.0,
            1,
            "speed still changes",
        ),
    ],
)
def test_impossible_manoeuvre_is_told_by_its_number(
    entries: list[dict[str, Any]], speed: float, entry: int, told: str
) -> None:
    with pytest.raises(ManoeuvreError) as caught:
        course_of(LIST.validate_python(entries), speed)
    assert caught.value.entry == entry
    assert told in f"{caught.value.message} {caught.value.advice}"
