"""A sensor outage: an axis that holds its value or is saturated; compiled.

A sound sensor repeats a value now and then: how often, its own resolution and its noise say, and what the log has shown
so far. A run that these would bring once in a million million samples is an outage. Where a sensor is as coarse as its
noise, no run is long enough, and nothing is tested: what it hides is less than a step of its resolution.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.filter.imu.screen_state import ACCEL, SATURATED, STUCK, ScreenRecord
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

WINDOW: Final = 100  # samples, in which repeats are counted
SHOWN: Final = 300  # samples before anything is tested: what the log usually does must be seen first
COARSE: Final = 0.6  # share of repeats above which an axis is not tested
LEAST_RUN: Final = 8
_RARE: Final = math.log(1e-12)
# Sensors may be quieter than their grade, by smoothing or luck, and then repeat themselves more
QUIETER: Final = 0.3
AT_RANGE: Final = 0.999  # of the declared range, or of the largest value seen, as in ``log.imu.faults``
# Correlation time of a rate or a specific force: turns and manoeuvres of vehicles take seconds
MOTION_TIME_S: Final = 2.0
OUT_S: Final = 4.0  # seconds of change that a sensor which is out may hide at least: 10 deg/s, 2 m/s^2
SATURATED_S: Final = 16.0  # 20 deg/s, 4 m/s^2 beyond its range
SLOPE_S: Final = 0.05  # over which the slope at the end of the range is found: longer than vibration


@kernel(inline=True)
def is_alive(s: ScreenRecord, sensor: int) -> bool:
    """Return whether a sensor shows noise: an axis of it changes from sample to sample."""
    alive = False
    for axis in range(3 * sensor, 3 * sensor + 3):
        alive = alive or (
            s.finest[axis] < math.inf and s.most_repeats[axis] < COARSE and s.run[axis] < LEAST_RUN
        )
    return alive


@kernel(inline=True)
def is_unseen(s: ScreenRecord, sensor: int) -> bool:
    """Return whether a sensor has held one value in each axis from the beginning of the log."""
    first = 3 * sensor
    return bool(min(s.finest[first], s.finest[first + 1], s.finest[first + 2]) == math.inf)


@kernel(inline=True)
def needed_run(s: ScreenRecord, axis: int) -> int:
    """Return how many repeats in a row are an outage; 0: the axis is too coarse, or not seen for long enough.

    An axis that has held one value from the beginning is judged by the coarser of its sensor's other two. Where all
    three have, the sensor is dead if the other sensor is alive: it is not a simulation of rest without noise then.

    Equation: p^n < 1e-12, with p the larger of the log's share of repeats and r / (2 sqrt(pi) sigma), which is the
    probability that two values of a noise sigma fall into the same step r of the resolution
    """
    if is_unseen(s, axis // 3):
        return LEAST_RUN if s.n_steps >= WINDOW and is_alive(s, 1 - axis // 3) else 0
    if s.n_steps < SHOWN:
        return 0
    sigma = QUIETER * math.sqrt(s.noise_density[axis // 3] / s.step)
    share, step = max(s.most_repeats[axis], 1e-3), s.finest[axis]
    if step == math.inf:
        first = axis - axis % 3
        for other in range(first, first + 3):
            if s.finest[other] < math.inf:
                share = max(share, s.most_repeats[other])
                step = s.finest[other] if step == math.inf else max(step, s.finest[other])
    if step >= 3.5 * COARSE * sigma:
        return 0
    share = max(share, step / (3.5 * sigma))
    if share > COARSE:
        return 0
    return max(LEAST_RUN, math.ceil(_RARE / math.log(share)))


@kernel(apart=True)
def held_for_long(s: ScreenRecord, x: Float64, k: int, axis: int) -> int:
    """Return whether an axis is out from sample ``k`` of ``x`` (n, 3) on, whose value it holds.

    STUCK or SATURATED when it is, 0 when not, -1 when that takes samples which are not there yet.
    """
    needed = needed_run(s, axis)
    if needed == 0:
        return 0
    i = axis % 3
    run, j = s.run[axis] + 1 if x[k, i] == s.x[axis] else 0, k + 1
    while run < needed and j < x.shape[0] and x[j, i] == x[k, i]:
        run += 1
        j += 1
    if run >= needed:
        return stuck_kind(s, axis, x[k, i])
    return -1 if j == x.shape[0] else 0


@kernel(inline=True)
def note_repeats(s: ScreenRecord, x: Float64) -> None:
    """Count a sample's repeats, after it has been judged; an axis that is out says nothing about a valid one."""
    for axis in range(6):
        change = abs(x[axis] - s.x[axis])
        if change == 0.0:
            s.run[axis] += 1
            s.repeats[axis] += 1 if s.out[axis] == 0 else 0
        else:
            s.run[axis] = 0
            s.fresh[axis] = s.x[axis]
            s.finest[axis] = min(s.finest[axis], change)
        if s.out[axis] == 0:
            s.largest[axis // 3] = max(s.largest[axis // 3], abs(x[axis]))
    s.window += 1
    if s.window == WINDOW:
        for axis in range(6):
            seen = (s.run[axis] < WINDOW // 2 and s.out[axis] == 0) or s.n_steps < SHOWN
            if seen and s.finest[axis] < math.inf:
                s.most_repeats[axis] = max(s.most_repeats[axis], s.repeats[axis] / WINDOW)
            s.repeats[axis] = 0
        s.window = 0


@kernel(inline=True)
def is_all_well(s: ScreenRecord) -> bool:
    """Return whether no sensor is out, and none has just come back."""
    out = 0
    for axis in range(6):
        out += s.out[axis]
    return out == 0 and s.out_s[0] == 0.0 and s.out_s[1] == 0.0


@kernel(inline=True)
def stuck_kind(s: ScreenRecord, axis: int, value: float) -> int:
    """Return whether a value that is held is the largest of the log: then the sensor is rather saturated.

    A sensor that has never changed has shown no largest value.
    """
    largest = abs(value) >= AT_RANGE * s.largest[axis // 3] and value != 0.0
    return SATURATED if largest and not is_unseen(s, axis // 3) else STUCK


@kernel(inline=True)
def stand_in(s: ScreenRecord, axis: int, value: float) -> float:
    """Return the substitute value of an axis that is out.

    The value before it fades to the mean; a saturated one stays, as the truth lies beyond it.
    """
    if s.out[axis] == SATURATED:
        return value
    decay = math.exp(-s.out_s[axis // 3] / MOTION_TIME_S)
    stands: float = s.usual[axis] + decay * (s.fresh[axis] - s.usual[axis])
    return stands


@kernel(inline=True)
def unknown_variance(s: ScreenRecord, sensor: int, saturated: bool) -> float:
    """Return the variance of the motion that a sensor which is out does not show [rad^2/s^2] or [m^2/s^4].

    It is the log's spread, at least the usual change in some seconds, more of a saturated sensor; ``beyond_range`` has
    what its slope says. Of an accelerometer that has shown nothing yet, the weight is unknown as well.
    """
    seconds = SATURATED_S if saturated else OUT_S
    variance: float = max(s.most_spread2[sensor], seconds * s.least_change[sensor])
    if sensor == ACCEL and is_unseen(s, sensor):
        variance += STANDARD_GRAVITY_MPS2**2
    return variance


@kernel(inline=True)
def note_recent_mean(s: ScreenRecord, x: Float64, dt: float) -> None:
    """Let the mean of the last samples follow, of each axis that is not out."""
    share = min(dt / SLOPE_S, 1.0) if s.n > 0 else 1.0
    for axis in range(6):
        if s.out[axis] == 0:
            s.recent_mean[axis] += share * (x[axis] - s.recent_mean[axis])


@kernel(inline=True)
def note_slope(s: ScreenRecord, x: Float64, axis: int) -> None:
    """Keep the slope with which an axis goes beyond its range, the steepest of its sensor."""
    sensor = axis // 3
    s.slope[sensor] = max(s.slope[sensor], abs(x[axis] - s.recent_mean[axis]) / max(SLOPE_S, s.step))


@kernel(inline=True)
def beyond_range(s: ScreenRecord, sensor: int) -> float:
    """Return the sigma of what a saturated sensor does not show of its motion [rad/s] or [m/s^2].

    Equation: e = w' t / 2 at the time t after it left its range with the slope w'; the range itself at most. Motion
    w' t (1 - t / D) that is back after D hides the integral w' D^2 / 6; that of e is w' D^2 / 4
    """
    largest = s.range[sensor] if s.range[sensor] < math.inf else s.largest[sensor]
    excess: float = min(0.5 * s.slope[sensor] * s.beyond_s[sensor], largest)
    return excess


@kernel(inline=True)
def density_beyond_range(s: ScreenRecord, sensor: int, dt: float) -> float:
    """Carry on what a saturated sensor hides by a sample; return the density of it [rad^2/s] or [m^2/s^3].

    A gap before the sample has its own variance.
    """
    step, before = min(dt, s.step), s.hidden[sensor]
    s.beyond_s[sensor] += dt
    s.hidden[sensor] += beyond_range(s, sensor) * step
    density: float = (s.hidden[sensor] ** 2 - before**2) / step
    return density


@kernel(inline=True)
def unknown_density(s: ScreenRecord, sensor: int, variance: float) -> float:
    """Return the density with which the unknown motion enters angle or velocity [rad^2/s] or [m^2/s^3].

    Equation: 2 sigma^2 T (1 - exp(-t/T))^2 of a Gauss-Markov rate that was known at t = 0
    """
    grown = 1.0 - math.exp(-s.out_s[sensor] / MOTION_TIME_S)
    density: float = 2.0 * variance * MOTION_TIME_S * grown * grown
    return density
