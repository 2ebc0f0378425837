"""A sounding rocket: it leaves its rail, turns under gravity with its nose along the way, burns, spins and coasts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.integrate import solve_ivp

from insgnss.constants import STANDARD_GRAVITY_MPS2, WGS84_A_M
from insgnss.errors import ConfigError
from insgnss.simulation.aerobatics import smoothstep_integral
from insgnss.simulation.course import LevelMotion, smoothstep
from insgnss.tables import Float64

SEA_LEVEL_DENSITY_KGPM3: Final = 1.225  # ICAO standard atmosphere
SCALE_HEIGHT_M: Final = 8500.0
_BEYOND_S: Final = 5.0  # past the end, for the knots that the splines need there


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
