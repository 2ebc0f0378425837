"""From a list of manoeuvres to a course: one function for each kind, and errors that say which entry is impossible.

A sounding rocket leaves its rail, turns under gravity with its nose along the way, burns, spins and coasts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.integrate import solve_ivp

from insgnss.config import manoeuvres as told
from insgnss.constants import STANDARD_GRAVITY_MPS2, WGS84_A_M
from insgnss.errors import ConfigError
from insgnss.simulation.aerobatics import (
    BarrelRollFigure,
    LoopFigure,
    Sinusoid,
    WavesFigure,
    smoothstep_integral,
)
from insgnss.simulation.course import KNOT_S, LevelMotion, ManoeuvreSequence, smoothstep
from insgnss.simulation.gauss_markov_motion import GRID_S, GaussMarkovFigure, GaussMarkovProcess
from insgnss.tables import Float64
from insgnss.units import deg_to_rad

SEA_LEVEL_DENSITY_KGPM3: Final = 1.225  # ICAO standard atmosphere
SCALE_HEIGHT_M: Final = 8500.0
_BEYOND_S: Final = 5.0  # past the end, for the knots that the splines need there
STEEPEST_SMOOTHSTEP: Final = 1.875  # its largest slope, in the middle
_KNOTS_PER_TURN: Final = 40  # of a spinning body: the spline of attitude follows it to 1e-6 rad
_FINEST_KNOT_S: Final = 0.005
_AEROBATIC_KNOT_S: Final = 0.05
_ON_RAIL_BEFORE_S: Final = 10.0


@dataclass(frozen=True)
class RocketSettings:
    """A point mass of constant thrust over weight."""

    elevation_rad: float  # of the rail
    thrust_mps2: float
    burn_s: float
    ramp_s: float
    rail_m: float
    drag_m2_per_kg: float  # drag coefficient times area over mass
    spin_radps: float  # reached at the end of the burn


class AscentFigure:
    """The ascent from rest. Earth is round and turns only as far as the course is laid over the ellipsoid.

    Equation: ``V' = F - k rho V^2 / 2 - g sin y``, ``y' = -(g / V - V / (R + h)) cos y`` from the rail's end on, the
    rail's push fading over one more length of it; while the thrust comes up, the rail holds the weight in proportion.
    """

    def __init__(self, rocket: RocketSettings, ignition_s: float, flight_s: float) -> None:
        """Integrate ``flight_s`` from the ignition on, which is ``ignition_s`` after the figure's begin."""
        self.rocket, self.ignition_s = rocket, ignition_s
        end = flight_s + _BEYOND_S
        found = solve_ivp(
            self._rates,
            (0.0, end),
            (0.0, 0.0, rocket.elevation_rad, 0.0),
            method="DOP853",
            rtol=1e-10,
            atol=1e-8,
            max_step=0.25,
            dense_output=True,
            events=_touches_ground,
        )
        if len(found.t_events[0]):
            raise ConfigError(
                f"the rocket is back on the ground after {found.t_events[0][0]:.1f} s",
                advice="end the ascent earlier, or give more thrust",
            )
        self.path = found.sol

    def __call__(self, elapsed_s: Float64, motion: LevelMotion) -> LevelMotion:
        """Return the motion: speed along the nose, the nose's elevation, and the angle of spin."""
        rocket, flown_s = self.rocket, elapsed_s - self.ignition_s
        _, speed, elevation, _ = self.path(np.clip(flown_s, 0.0, self.path.t_max))
        # the body turns while the motor builds up the spin: it never loses it again
        spun = rocket.spin_radps * rocket.burn_s * smoothstep_integral(flown_s / rocket.burn_s)
        return motion._replace(
            forward=speed * np.cos(elevation), up=speed * np.sin(elevation), pitch=elevation, roll=spun
        )

    def _rates(self, t: float, state: Float64) -> list[float]:
        way, speed, elevation, height = (float(value) for value in state)
        rocket = self.rocket
        on = float(smoothstep(np.array(t / rocket.ramp_s)))
        off = float(smoothstep(np.array((t - rocket.burn_s) / rocket.ramp_s)))
        density = SEA_LEVEL_DENSITY_KGPM3 * math.exp(-max(height, -500.0) / SCALE_HEIGHT_M)
        gravity = STANDARD_GRAVITY_MPS2 * (WGS84_A_M / (WGS84_A_M + height)) ** 2
        drag = 0.5 * density * rocket.drag_m2_per_kg * speed**2
        faster = rocket.thrust_mps2 * (on - off) - drag - gravity * math.sin(elevation) * on
        free = float(smoothstep(np.array((way - rocket.rail_m) / rocket.rail_m)))
        curve = 0.0
        if free > 0.0:
            curve = -free * math.cos(elevation) * (gravity / speed - speed / (WGS84_A_M + height))
        return [speed, faster, curve, speed * math.sin(elevation)]


def _touches_ground(t: float, state: Any) -> float:
    return float(state[3]) + (1.0 if t < 1.0 else 0.0)


_touches_ground.terminal = True  # type: ignore[attr-defined]
_touches_ground.direction = -1.0  # type: ignore[attr-defined]


class ManoeuvreError(ConfigError):
    """An entry of the list cannot be flown; ``entry`` counts from zero."""

    def __init__(self, entry: int, message: str, advice: str) -> None:
        super().__init__(message, advice=advice)
        self.entry = entry


def course_of(manoeuvres: Sequence[told.Manoeuvre], speed_mps: float = 0.0) -> ManoeuvreSequence:
    """Return the course that flies the list from ``speed_mps`` on.

    Raises
    ------
    ManoeuvreError : an entry is impossible: no speed for a turn, a bank that the turn does not reach, a figure that
        does not begin in level flight, or anything after the ascent
    """
    course = ManoeuvreSequence(speed_mps)
    for entry, manoeuvre in enumerate(manoeuvres):
        try:
            _check_place(course, manoeuvre)
            _add(course, manoeuvre)
        except ConfigError as error:
            raise ManoeuvreError(entry, error.message, error.advice) from None
    ends = [end for _, end, _ in course.figures if math.isfinite(end)]
    for signal in (course.speed, course.climb_rate, course.bank, course.flat_turn_rate):
        ends += [start + duration for start, duration, _ in signal.steps]
    course.clock_s = max([course.clock_s, *ends])
    return course


def knot_s_of(manoeuvres: Sequence[told.Manoeuvre]) -> float:
    """Return how far apart the splines' knots may be: closer for figures, and for a body that spins."""
    knot = KNOT_S
    for manoeuvre in manoeuvres:
        if isinstance(manoeuvre, told.Loop | told.BarrelRoll | told.Ascent):
            knot = min(knot, _AEROBATIC_KNOT_S)
        if isinstance(manoeuvre, told.RandomMotion):
            knot = min(knot, GRID_S)
        if isinstance(manoeuvre, told.Ascent) and manoeuvre.spin_deg_per_s != 0.0:
            knot = min(knot, 360.0 / abs(manoeuvre.spin_deg_per_s) / _KNOTS_PER_TURN)
    return max(knot, _FINEST_KNOT_S)


def _check_place(course: ManoeuvreSequence, manoeuvre: told.Manoeuvre) -> None:
    """Refuse a manoeuvre that does not fit the end of the one before it."""
    if any(math.isinf(end) for _, end, _ in course.figures):
        advice = "make it the last manoeuvre"
        raise ConfigError("nothing can follow an ascent or a random motion", advice=advice)
    figure = isinstance(manoeuvre, told.Loop | told.BarrelRoll)
    if figure and abs(course.climb_rate.final) > 1e-9:
        raise ConfigError(f"a {manoeuvre.kind} begins in level flight", advice="end the climb before")
    if isinstance(manoeuvre, told.BarrelRoll) and course.speed.final <= 0.0:
        raise ConfigError("a barrel roll needs speed", advice="accelerate before")
    if isinstance(manoeuvre, told.Ascent) and (course.clock_s > 0.0 or course.speed.final != 0.0):
        raise ConfigError("an ascent is the only manoeuvre and begins at rest", advice="wait_s stands first")
    changing = any(start + duration > course.clock_s + 1e-9 for start, duration, _ in course.speed.steps)
    if changing and isinstance(manoeuvre, told.Turn | told.STurn | told.Loop | told.BarrelRoll):
        raise ConfigError(
            f"the speed still changes when this {manoeuvre.kind} begins", advice="let it end before"
        )
    if isinstance(manoeuvre, told.Landing | told.Steer) and course.speed.final <= 0.0:
        raise ConfigError(f"'{manoeuvre.kind}' needs speed", advice="accelerate before")


def _add(course: ManoeuvreSequence, manoeuvre: told.Manoeuvre) -> None:
    """Add one manoeuvre to the course."""
    match manoeuvre:
        case told.Straight():
            course.hold(manoeuvre.duration_s)
        case told.Accelerate():
            course.change_speed(manoeuvre.to_mps, manoeuvre.duration_s, meanwhile=manoeuvre.meanwhile)
        case told.Climb():
            course.climb(
                manoeuvre.by_m, manoeuvre.rate_mps, ramp_s=manoeuvre.ramp_s, meanwhile=manoeuvre.meanwhile
            )
        case told.Turn():
            _turn(course, manoeuvre, manoeuvre.by_deg)
        case told.STurn():
            for part in (1.0, -2.0, 1.0):
                _turn(course, manoeuvre, part * manoeuvre.by_deg)
        case told.Steer():
            course.steer(manoeuvre.by_deg, manoeuvre.duration_s)
        case told.Loop():
            loop = LoopFigure.of_radius(
                course.speed.final, manoeuvre.radius_m, manoeuvre.ramp_s, manoeuvre.top_speed_mps
            )
            course.fly(loop, loop.duration_s)
        case told.BarrelRoll():
            side = 1.0 if manoeuvre.direction == "right" else -1.0
            roll = BarrelRollFigure(manoeuvre.duration_s, manoeuvre.radius_m, side)
            course.fly(roll, manoeuvre.duration_s)
        case told.TakeOff():
            course.change_speed(manoeuvre.speed_mps, manoeuvre.run_s)
            course.climb(manoeuvre.climb_m, manoeuvre.rate_mps, ramp_s=manoeuvre.ramp_s)
        case told.Landing():
            if manoeuvre.approach_mps is not None:
                half_s = 0.5 * manoeuvre.descend_m / manoeuvre.rate_mps
                course.change_speed(manoeuvre.approach_mps, half_s, meanwhile=True)
            course.climb(-manoeuvre.descend_m, manoeuvre.rate_mps, ramp_s=manoeuvre.ramp_s)
            course.change_speed(0.0, manoeuvre.run_s)
        case told.Sea():
            course.fly(_waves(manoeuvre), manoeuvre.duration_s, meanwhile=manoeuvre.meanwhile)
        case told.Ascent():
            _ascend(course, manoeuvre)
        case told.RandomMotion():
            _wander(course, manoeuvre)


def _turn(course: ManoeuvreSequence, turn: told.Turn | told.STurn, by_deg: float) -> None:
    if by_deg == 0.0:
        raise ConfigError("a turn by zero degrees is none", advice="give by_deg, right positive")
    roll_in, roll_out = (
        STEEPEST_SMOOTHSTEP * turn.bank_deg / rate
        for rate in (turn.roll_in_deg_per_s, turn.roll_out_deg_per_s)
    )
    course.turn(by_deg, turn.bank_deg, roll_s=roll_in, roll_out_s=roll_out)


def _waves(sea: told.Sea) -> WavesFigure:
    # phases a third of the golden angle apart, so that the motions do not peak together
    return WavesFigure(
        sea.duration_s,
        sea.ramp_s,
        roll=Sinusoid(deg_to_rad(sea.roll_deg), sea.roll_period_s, 0.0),
        pitch=Sinusoid(deg_to_rad(sea.pitch_deg), sea.pitch_period_s, 0.8),
        yaw=Sinusoid(deg_to_rad(sea.yaw_deg), sea.yaw_period_s, 1.6),
        heave=Sinusoid(sea.heave_m, sea.heave_period_s, 2.4),
    )


def _ascend(course: ManoeuvreSequence, ascent: told.Ascent) -> None:
    rocket = RocketSettings(
        elevation_rad=deg_to_rad(ascent.elevation_deg),
        thrust_mps2=ascent.thrust_g * STANDARD_GRAVITY_MPS2,
        burn_s=ascent.burn_s,
        ramp_s=ascent.ramp_s,
        rail_m=ascent.rail_m,
        drag_m2_per_kg=ascent.drag_m2_per_kg,
        spin_radps=deg_to_rad(ascent.spin_deg_per_s),
    )
    # the rail holds the rocket up before the course begins, too
    ignition_s = _ON_RAIL_BEFORE_S + ascent.wait_s
    figure = AscentFigure(rocket, ignition_s, ascent.duration_s - ascent.wait_s)
    course.figures.append((-_ON_RAIL_BEFORE_S, math.inf, figure))
    course.clock_s = ascent.duration_s


def _wander(course: ManoeuvreSequence, wanted: told.RandomMotion) -> None:
    figure = GaussMarkovFigure(
        GaussMarkovProcess(wanted.acceleration_g * STANDARD_GRAVITY_MPS2, wanted.acceleration_time_s),
        GaussMarkovProcess(deg_to_rad(wanted.turn_rate_deg_per_s), wanted.turn_time_s),
        wanted.duration_s,
        np.random.default_rng(wanted.seed),
        wanted.return_s,
    )
    course.figures.append((course.clock_s, math.inf, figure))
    course.clock_s += wanted.duration_s
