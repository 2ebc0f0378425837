"""A course over the ellipsoid: speed, climb, turn and bank as smooth functions of time.

Every change runs along a smoothstep with continuous second derivative. A straight leg is a geodesic, and a turn is
counted against the geodesic ahead, not against north, so a course leads over a pole like over any other place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.errors import ConfigError
from insgnss.geodesy.ellipsoid import ecef_to_geodetic, geodetic_to_ecef, radii
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.kernels.jit import kernel
from insgnss.simulation.trajectory import Trajectory
from insgnss.tables import Bool, Float64
from insgnss.units import deg_to_rad

KNOT_S = 0.1  # a change of motion takes seconds: the splines follow it to 1e-9 of its size
# knots before the first and after the last moment, for receiver clocks that are ahead or behind
MARGIN_S = 2.0


def smoothstep(x: Float64) -> Float64:
    """Return 0 below 0, 1 above 1, and between them 10 x^3 - 15 x^4 + 6 x^5: twice continuously differentiable."""
    u = np.clip(x, 0.0, 1.0)
    return np.asarray(u**3 * (10.0 + u * (6.0 * u - 15.0)))


@dataclass
class SmoothSignal:
    """A value that changes in smooth steps: (start [s], duration [s], change) each."""

    initial: float = 0.0
    steps: list[tuple[float, float, float]] = field(default_factory=list)

    def __call__(self, t_s: Float64) -> Float64:
        """Return the value at the times ``t_s``."""
        value = np.full_like(t_s, self.initial)
        for start, duration, change in self.steps:
            value += change * smoothstep((t_s - start) / duration)
        return value

    @property
    def final(self) -> float:
        """The value after the last step."""
        return self.initial + sum(change for _, _, change in self.steps)


class LevelMotion(NamedTuple):
    """Velocity along the axes of the level frame, its turning, and the attitude in it, at given times."""

    forward: Float64  # [m/s]; negative where a loop leads back over itself
    right: Float64  # [m/s]
    up: Float64  # [m/s]
    turn_rate: Float64  # of the level frame, to the right [rad/s]
    roll: Float64  # [rad]
    pitch: Float64  # [rad]
    yaw: Float64  # of the nose against the level frame's forward [rad]


class Figure(Protocol):
    """A temporary change of a level motion: a loop, a roll, waves."""

    def __call__(self, elapsed_s: Float64, motion: LevelMotion) -> LevelMotion:
        """Return the motion at the times ``elapsed_s`` since the figure's begin, from the motion without it."""


class ManoeuvreSequence:
    """A sequence of manoeuvres in time order; ``clock_s`` is where the next one begins.

    A manoeuvre called with ``meanwhile=True`` does not move the clock: the next one begins together with it.
    """

    def __init__(self, speed_mps: float = 0.0) -> None:
        self.clock_s = 0.0
        self.speed = SmoothSignal(speed_mps)  # horizontal [m/s]
        self.climb_rate = SmoothSignal()  # up [m/s]
        self.bank = SmoothSignal()  # right wing down [rad]
        self.flat_turn_rate = SmoothSignal()  # turning right without bank [rad/s]
        self.figures: list[tuple[float, float, Figure]] = []  # from and to [s]

    def hold(self, duration_s: float) -> ManoeuvreSequence:
        """Go on as before for ``duration_s``."""
        self.clock_s += duration_s
        return self

    def hold_until(self, clock_s: float) -> ManoeuvreSequence:
        """Go on as before until ``clock_s``; an error when that moment has passed."""
        if clock_s < self.clock_s:
            raise ConfigError(
                f"the course has already lasted {self.clock_s:.1f} s at the moment {clock_s:.1f} s"
            )
        return self.hold(clock_s - self.clock_s)

    def change_speed(self, to_mps: float, duration_s: float, *, meanwhile: bool = False) -> ManoeuvreSequence:
        """Change the horizontal speed to ``to_mps`` within ``duration_s``."""
        self.speed.steps.append((self.clock_s, duration_s, to_mps - self.speed.final))
        return self._done(duration_s, meanwhile)

    def climb(
        self, by_m: float, rate_mps: float, *, ramp_s: float = 6.0, meanwhile: bool = False
    ) -> ManoeuvreSequence:
        """Climb (``by_m`` positive) or descend by ``by_m`` at ``rate_mps`` (its size), with ramps at both ends."""
        duration = abs(by_m) / rate_mps  # from the middle of one ramp to the middle of the other
        if duration < ramp_s:
            raise ConfigError(f"a climb of {by_m} m at {rate_mps} m/s is over before its ramp of {ramp_s} s")
        rate = math.copysign(rate_mps, by_m)
        self.climb_rate.steps += [(self.clock_s, ramp_s, rate), (self.clock_s + duration, ramp_s, -rate)]
        return self._done(duration + ramp_s, meanwhile)

    def turn(
        self,
        by_deg: float,
        bank_deg: float,
        *,
        roll_s: float = 4.0,
        roll_out_s: float | None = None,
        meanwhile: bool = False,
    ) -> ManoeuvreSequence:
        """Turn right (``by_deg`` positive) or left, coordinated, at ``bank_deg`` (its size), at constant speed.

        Equation: ``turn rate = g tan(bank) / speed``; the turn while rolling in and out is integrated along the ramp.
        """
        speed = float(self.speed(np.array([self.clock_s]))[0])
        if speed <= 0.0:
            raise ConfigError("a banked turn needs speed: turn after accelerating, or steer")
        bank = deg_to_rad(bank_deg)
        rate = STANDARD_GRAVITY_MPS2 / speed
        nodes, weights = np.polynomial.legendre.leggauss(20)
        mean = 0.5 * float(weights @ np.tan(bank * smoothstep(0.5 + 0.5 * nodes)))
        rolling_s = roll_s + (roll_s if roll_out_s is None else roll_out_s)
        steady_s = (deg_to_rad(abs(by_deg)) - rolling_s * rate * mean) / (rate * math.tan(bank))
        if steady_s < 0.0:
            raise ConfigError(
                f"a turn by {by_deg} deg at {bank_deg} deg of bank is over while rolling in",
                advice="bank less or roll faster",
            )
        side = math.copysign(bank, by_deg)
        roll_out = self.clock_s + roll_s + steady_s
        self.bank.steps += [(self.clock_s, roll_s, side), (roll_out, rolling_s - roll_s, -side)]
        return self._done(rolling_s + steady_s, meanwhile)

    def fly(self, figure: Figure, duration_s: float, *, meanwhile: bool = False) -> ManoeuvreSequence:
        """Fly a figure for ``duration_s``; without an end (``inf``) it is the last thing on the course."""
        self.figures.append((self.clock_s, self.clock_s + duration_s, figure))
        return self._done(duration_s, meanwhile)

    def steer(self, by_deg: float, duration_s: float, *, meanwhile: bool = False) -> ManoeuvreSequence:
        """Turn right (``by_deg`` positive) or left like a car, without bank, within ``duration_s``."""
        half = 0.5 * duration_s
        rate = deg_to_rad(by_deg) / half
        self.flat_turn_rate.steps += [(self.clock_s, half, rate), (self.clock_s + half, half, -rate)]
        return self._done(duration_s, meanwhile)

    def _done(self, duration_s: float, meanwhile: bool) -> ManoeuvreSequence:
        if not meanwhile:
            self.clock_s += duration_s
        return self

    def turn_rate(self, t_s: Float64) -> Float64:
        """Return the rate of turn to the right [rad/s] at the times ``t_s``: of coordinated and of flat turns."""
        coordinated = STANDARD_GRAVITY_MPS2 * np.tan(self.bank(t_s)) / np.maximum(self.speed(t_s), 1e-3)
        return np.asarray(coordinated + self.flat_turn_rate(t_s))

    def motion(self, t_s: Float64) -> LevelMotion:
        """Return velocity, turning and attitude at the times ``t_s``: nose along the velocity, roll the bank."""
        speed, climb = self.speed(t_s), self.climb_rate(t_s)
        none = np.zeros_like(speed)
        motion = LevelMotion(
            speed, none, climb, self.turn_rate(t_s), self.bank(t_s), np.arctan2(climb, speed), none
        )
        for first_s, last_s, figure in self.figures:
            during = (t_s >= first_s) & (t_s < last_s)
            inside = figure(t_s[during] - first_s, LevelMotion(*(values[during] for values in motion)))
            motion = LevelMotion(*(_put(*pair, during) for pair in zip(motion, inside, strict=True)))
        return motion

    def lay(
        self, lat_deg: float, lon_deg: float, h_m: float, heading_deg: float, *, knot_s: float = KNOT_S
    ) -> Trajectory:
        """Return the trajectory of this course from a place and heading; it covers 0 to ``clock_s`` and 2 s around.

        The nose points along the velocity (pitch = climb angle, yaw = track); roll is the bank.
        """
        place = deg_to_rad(lat_deg), deg_to_rad(lon_deg), h_m, deg_to_rad(heading_deg)
        before = self._way(place, round(MARGIN_S / knot_s), -knot_s)
        after = self._way(place, math.ceil((self.clock_s + MARGIN_S) / knot_s), knot_s)
        t, r_e, C_el = (
            np.concatenate([back[:0:-1], ahead]) for back, ahead in zip(before, after, strict=True)
        )
        motion = self.motion(t)
        C_lb = Rotation.from_euler("ZYX", np.column_stack([motion.yaw, motion.pitch, motion.roll]))
        return Trajectory.from_knots(t, r_e, Rotation.from_matrix(C_el) * C_lb)

    def _way(
        self, place: tuple[float, float, float, float], count: int, step_s: float
    ) -> tuple[Float64, Float64, Float64]:
        """Return times, positions and level frames of ``count`` knots from the place on; a negative step goes back."""
        half_steps = 0.5 * step_s * np.arange(2 * count + 1, dtype=np.float64)
        r_e, C_el = np.empty((count + 1, 3)), np.empty((count + 1, 3, 3))
        _start(*place, r_e[0], C_el[0])
        motion = self.motion(half_steps)
        lay_over_ellipsoid(motion.forward, motion.right, motion.up, motion.turn_rate, step_s, r_e, C_el)
        return half_steps[::2], r_e, C_el


def _put(outside: Float64, inside: Float64, during: Bool) -> Float64:
    """Return a copy of ``outside`` with the values of ``inside`` where the mask holds."""
    values = outside.copy()
    values[during] = inside
    return values


def _start(lat: float, lon: float, h: float, heading: float, r_e: Float64, C_el: Float64) -> None:
    """Write the first position and the first level frame (forward, right, down columns)."""
    geodetic_to_ecef(lat, lon, h, r_e)
    C_ne = np.empty((3, 3))
    ecef_to_ned_matrix(lat, lon, C_ne)
    C_el[:] = C_ne.T @ Rotation.from_euler("Z", heading).as_matrix()


@kernel
def _way_rates(
    r: Float64,
    forward: Float64,
    speed: float,
    lateral: float,
    climb: float,
    turn: float,
    dr: Float64,
    df: Float64,
) -> None:
    """Write the derivatives of position and forward direction.

    Equation: ``r' = V f + s (f x u) + w u``, ``f' = turn (f x u) - (f . u') u`` with u the ellipsoid's normal,
    which turns with ``u' = n v_n / (M + h) + e v_e / (N + h)``.
    """
    lat, lon, h = ecef_to_geodetic(r)
    C_ne = np.empty((3, 3))
    ecef_to_ned_matrix(lat, lon, C_ne)
    m, n = radii(lat)
    forward_north = C_ne[0, 0] * forward[0] + C_ne[0, 1] * forward[1] + C_ne[0, 2] * forward[2]
    forward_east = C_ne[1, 0] * forward[0] + C_ne[1, 1] * forward[1] + C_ne[1, 2] * forward[2]
    bend = speed * (forward_north * forward_north / (m + h) + forward_east * forward_east / (n + h))
    bend += lateral * forward_north * forward_east * (1.0 / (n + h) - 1.0 / (m + h))
    for i in range(3):
        up = -C_ne[2, i]
        # f x u = (f_n n + f_e e) x u = f_n e - f_e n, to the right
        right = forward_north * C_ne[1, i] - forward_east * C_ne[0, i]
        dr[i] = speed * forward[i] + climb * up + lateral * right
        df[i] = turn * right - bend * up


@kernel
def _level_frame(r: Float64, forward: Float64, C_el: Float64) -> None:
    """Put ``forward`` back into the level plane and write the level frame (forward, right, down columns)."""
    lat, lon, _ = ecef_to_geodetic(r)
    C_ne = np.empty((3, 3))
    ecef_to_ned_matrix(lat, lon, C_ne)
    down = C_ne[2]
    along = forward[0] * down[0] + forward[1] * down[1] + forward[2] * down[2]
    for i in range(3):
        forward[i] -= along * down[i]
    norm = math.sqrt(forward[0] ** 2 + forward[1] ** 2 + forward[2] ** 2)
    for i in range(3):
        forward[i] /= norm
        C_el[i, 0] = forward[i]
        C_el[i, 2] = down[i]
    # right = down x forward
    C_el[0, 1] = down[1] * forward[2] - down[2] * forward[1]
    C_el[1, 1] = down[2] * forward[0] - down[0] * forward[2]
    C_el[2, 1] = down[0] * forward[1] - down[1] * forward[0]


@kernel
def lay_over_ellipsoid(
    speed: Float64,
    lateral: Float64,
    climb: Float64,
    turn: Float64,
    knot_s: float,
    r_e: Float64,
    C_el: Float64,
) -> None:
    """Fill positions ``r_e`` (n, 3) and level frames ``C_el`` (n, 3, 3) after the first ones; classical Runge-Kutta.

    The signals are sampled at every half step, (2 n - 1,). The error of the integration moves the way by less than a
    millimetre in an hour; the truth is the spline through the result.
    """
    # loops in the place of whole vectors: the compiler takes a quarter of the time
    stage, weight = (0.0, 0.5, 0.5, 1.0), (1.0 / 6.0, 2.0 / 6.0, 2.0 / 6.0, 1.0 / 6.0)
    dr, df = np.zeros((4, 3)), np.zeros((4, 3))
    forward, r, f = C_el[0, :, 0].copy(), np.zeros(3), np.zeros(3)
    for k in range(len(r_e) - 1):
        for j in range(4):
            moment, ahead_s = 2 * k + int(2.0 * stage[j]), stage[j] * knot_s
            for i in range(3):
                r[i], f[i] = r_e[k, i], forward[i]
                if j > 0:
                    r[i] += ahead_s * dr[j - 1, i]
                    f[i] += ahead_s * df[j - 1, i]
            _way_rates(r, f, speed[moment], lateral[moment], climb[moment], turn[moment], dr[j], df[j])
        for i in range(3):
            r_e[k + 1, i] = r_e[k, i]
            for j in range(4):
                r_e[k + 1, i] += weight[j] * knot_s * dr[j, i]
                forward[i] += weight[j] * knot_s * df[j, i]
        _level_frame(r_e[k + 1], forward, C_el[k + 1])
