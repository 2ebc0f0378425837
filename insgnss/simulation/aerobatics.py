"""Figures flown from level flight and back to it: a loop and a barrel roll.

Both turn at a rate that rises and falls along a smoothstep, so that position is smooth to its third derivative.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from insgnss.errors import ConfigError
from insgnss.simulation.course import LevelMotion, smoothstep
from insgnss.tables import Float64


def smoothstep_integral(x: Float64) -> Float64:
    """Return the integral of ``smoothstep`` from 0 to ``x``: 2.5 x^4 - 3 x^5 + x^6, and beyond 1 a line."""
    u = np.clip(x, 0.0, 1.0)
    return np.asarray(u**4 * (2.5 + u * (u - 3.0)) + np.maximum(x - 1.0, 0.0))


def turned(elapsed_s: Float64, rate_radps: float, duration_s: float, ramp_s: float) -> Float64:
    """Return the angle turned at a rate that comes and goes within ``ramp_s``; in all rate (duration - ramp)."""
    rise = smoothstep_integral(elapsed_s / ramp_s)
    fall = smoothstep_integral((elapsed_s - duration_s + ramp_s) / ramp_s)
    return rate_radps * ramp_s * (rise - fall)


@dataclass(frozen=True)
class LoopFigure:
    """A circle upwards at a pitch rate that is constant between its ramps; the speed falls towards the top."""

    rate_radps: float
    duration_s: float
    ramp_s: float
    top_over_bottom: float  # speed at the top over that at the bottom

    @classmethod
    def of_radius(
        cls, speed_mps: float, radius_m: float, ramp_s: float, top_speed_mps: float | None
    ) -> LoopFigure:
        """Return the loop that begins with ``speed_mps`` on a circle of ``radius_m``."""
        if speed_mps <= 0.0:
            raise ConfigError("a loop needs speed", advice="accelerate before")
        rate = speed_mps / radius_m
        duration = 2.0 * math.pi / rate + ramp_s
        if duration < 2.0 * ramp_s:
            advice = (
                f"take a radius of at least {ramp_s * speed_mps / (2.0 * math.pi):.0f} m, or a shorter ramp_s"
            )
            raise ConfigError(
                f"a loop of {radius_m:g} m at {speed_mps:g} m/s ends before its pull-up is complete",
                advice=advice,
            )
        return cls(rate, duration, ramp_s, 1.0 if top_speed_mps is None else top_speed_mps / speed_mps)

    def __call__(self, elapsed_s: Float64, motion: LevelMotion) -> LevelMotion:
        """Return the motion: the nose follows the circle, wings level."""
        angle = turned(elapsed_s, self.rate_radps, self.duration_s, self.ramp_s)
        speed = motion.forward * (1.0 - (1.0 - self.top_over_bottom) * 0.5 * (1.0 - np.cos(angle)))
        return motion._replace(
            forward=speed * np.cos(angle), up=motion.up + speed * np.sin(angle), pitch=motion.pitch + angle
        )


@dataclass(frozen=True)
class BarrelRollFigure:
    """A full roll whose lift drives the way along a helix: up and sideways, then down again.

    Equation: with the roll angle p the velocity across is ``u (1 - cos p)`` to the side of the roll and ``u sin p`` up,
    ``u`` = radius times the roll's rate; the nose is kept along the velocity.
    """

    duration_s: float
    radius_m: float
    side: float  # 1 to the right, -1 to the left

    def __call__(self, elapsed_s: Float64, motion: LevelMotion) -> LevelMotion:
        """Return the motion; the roll's rate comes and goes within a quarter of the duration each."""
        ramp = 0.25 * self.duration_s
        rate = 2.0 * math.pi / (self.duration_s - ramp)
        angle = turned(elapsed_s, rate, self.duration_s, ramp)
        along = self.radius_m * rate
        right, up = self.side * along * (1.0 - np.cos(angle)), motion.up + along * np.sin(angle)
        return motion._replace(
            right=motion.right + right,
            up=up,
            roll=motion.roll + self.side * angle,
            pitch=np.arctan2(up, np.hypot(motion.forward, right)),
            yaw=motion.yaw + np.arctan2(right, motion.forward),
        )


@dataclass(frozen=True)
class Sinusoid:
    """A sine: amplitude, period, phase."""

    amplitude: float
    period_s: float
    phase: float

    def __call__(self, t_s: Float64) -> Float64:
        """Return the value at the times ``t_s``."""
        return self.amplitude * np.sin(2.0 * np.pi * t_s / self.period_s + self.phase)

    def rate(self, t_s: Float64) -> Float64:
        """Return the derivative by time."""
        w = 2.0 * np.pi / self.period_s
        return self.amplitude * w * np.cos(w * t_s + self.phase)


@dataclass(frozen=True)
class WavesFigure:
    """The sea's motions of a ship, added to its course; they come and go within ``ramp_s``."""

    duration_s: float
    ramp_s: float
    roll: Sinusoid  # [rad]
    pitch: Sinusoid  # [rad]
    yaw: Sinusoid  # [rad]
    heave: Sinusoid  # [m], up

    def __call__(self, elapsed_s: Float64, motion: LevelMotion) -> LevelMotion:
        """Return the motion with the waves: heave's rate is that of amplitude times envelope."""
        begin, end = elapsed_s / self.ramp_s, (elapsed_s - self.duration_s + self.ramp_s) / self.ramp_s
        size = smoothstep(begin) - smoothstep(end)
        return motion._replace(
            up=motion.up
            + size * self.heave.rate(elapsed_s)
            + self._growth(begin, end) * self.heave(elapsed_s),
            roll=motion.roll + size * self.roll(elapsed_s),
            pitch=motion.pitch + size * self.pitch(elapsed_s),
            yaw=motion.yaw + size * self.yaw(elapsed_s),
        )

    def _growth(self, begin: Float64, end: Float64) -> Float64:
        """Return the derivative of the envelope by time: 30 x^2 (1 - x)^2 / ramp in each ramp."""
        rise, fall = (30.0 * u**2 * (1.0 - u) ** 2 for u in (np.clip(begin, 0, 1), np.clip(end, 0, 1)))
        return np.asarray((rise - fall) / self.ramp_s)
