"""Impossible inertial samples and spikes: values beyond any sensor's range, leaps of one to three samples; compiled.

A leap of one sample beyond what vehicles do is an error. A smaller one, down to a fifth of that, or one of two or three
samples may be an error or a shock: half of it is taken for motion, and as much counts as unknown. Spikes of 45 m/s^2
every five seconds in samples at 50 Hz, taken for motion, had left a velocity 70 sigma off, those of 11 m/s^2 10 sigma.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.imu.screen_state import ACCEL, GYRO, ScreenRecord
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int64

WARM: Final = 50  # samples that must have been seen before a spike is one
# A spike leaps and returns within a step: what vehicles do stays below (racing drones 300 rad/s^2, shocks of 5 g in
# 10 ms), a slow log's mean over its step below the second number
SLEW: Final = (75.0, 2500.0)  # [rad/s^2], [m/s^3]
SLEW_MOST: Final = (3.0, 60.0)  # [rad/s], [m/s^2]
_DOUBTFUL: Final = 0.2  # share of it from which a leap of one sample may be an error
ALONE: Final = 5  # samples before and after a spike without another: vibration leaps again and again
LONGEST: Final = 3  # samples of a spike
NEAR_STEPS: Final = 3.5  # typical steps to the sample before, within which a leap is one


@kernel(inline=True)
def is_possible(s: ScreenRecord, w: Float64, f: Float64, k: int) -> bool:
    """Return whether a sensor can have given sample ``k``; what is not a number is not smaller than anything."""
    for i in range(3):
        if not (abs(w[k, i]) <= s.limit[GYRO] and abs(f[k, i]) <= s.limit[ACCEL]):
            return False
    return True


@kernel(inline=True)
def find_spike(s: ScreenRecord, t_ns: Int64, w: Float64, f: Float64, k: int) -> int:
    """Return 1 or 2 when sample ``k`` is a spike of the gyros or the accelerometers, 0 when not, -1 when undecided."""
    if s.spike_sigma <= 0.0 or s.n_wiggles < WARM or s.n == 0:
        return 0
    if (t_ns[k] - s.t_ns) * 1e-9 > NEAR_STEPS * s.step:
        return 0
    for sensor in range(2):
        x = w if sensor == GYRO else f
        limit2 = s.spike_sigma * s.spike_sigma * s.wiggle2[sensor]
        limit2 = max(limit2, (_DOUBTFUL * least_spike(s, sensor)) ** 2)
        if leap(s, x, k, sensor) ** 2 <= limit2:
            continue
        judged = s.calm >= ALONE or 0 < s.spike < LONGEST
        alone = stands_alone(s, w, f, k, sensor, math.sqrt(limit2)) if judged else 0
        if alone < 0:
            return -1
        s.calm = 0
        if alone > 0:
            return sensor + 1
    return 0


@kernel(inline=True)
def leap(s: ScreenRecord, x: Float64, k: int, sensor: int) -> float:
    """Return by how much sample ``k`` differs from the newest one taken, the largest axis."""
    most = 0.0
    for i in range(3):
        most = max(most, abs(x[k, i] - s.x[3 * sensor + i]))
    return most


@kernel(apart=True)
def stands_alone(s: ScreenRecord, w: Float64, f: Float64, k: int, sensor: int, limit: float) -> int:
    """Return 1 when the samples after ``k`` are back where it leapt from, 0 when not, -1 when they are missing.

    The next ones may belong to the same spike.
    """
    x = w if sensor == GYRO else f
    n, j, more = 0, k + 1, LONGEST - 1 - s.spike
    while n < ALONE and j < w.shape[0]:
        if is_possible(s, w, f, j):
            off = 0.0
            for i in range(3):
                off = max(off, abs(x[k, i] - 0.5 * (x[j, i] + s.x[3 * sensor + i])))
            if off <= limit or leap(s, x, j, sensor) >= 0.5 * off:
                if n > 0 or more == 0:
                    return 0
                more -= 1
            else:
                n += 1
        j += 1
    return 1 if n == ALONE else -1


@kernel(inline=True)
def least_spike(s: ScreenRecord, sensor: int) -> float:
    """Return by how much a spike stands out at least, whatever the noise [rad/s] or [m/s^2]."""
    least: float = min(SLEW[sensor] * s.step, SLEW_MOST[sensor])
    return least


@kernel(inline=True)
def note_spike(s: ScreenRecord, w: Float64, f: Float64, k: int) -> None:
    """Add what sample ``k`` of a spike would have changed: its excess over the newest sample taken, over a step."""
    s.spike += 1
    if leap(s, w, k, GYRO) <= least_spike(s, GYRO) and leap(s, f, k, ACCEL) <= least_spike(s, ACCEL):
        s.spike_in_doubt = 1
    for i in range(3):
        s.in_spike[i] += (w[k, i] - s.x[i]) * s.step
        s.in_spike[3 + i] += (f[k, i] - s.x[3 + i]) * s.step


@kernel(inline=True)
def taken_of_spike(s: ScreenRecord, i: int) -> float:
    """Return what is taken for motion of axis ``i`` of a spike [rad] or [m/s]: half of what may be a shock."""
    return 0.5 * float(s.in_spike[i]) if s.spike > 1 or s.spike_in_doubt == 1 else 0.0


@kernel(inline=True)
def end_spike(s: ScreenRecord) -> None:
    """Forget a spike once the next sample is taken."""
    s.spike = s.spike_in_doubt = 0
    for i in range(6):
        s.in_spike[i] = 0.0
