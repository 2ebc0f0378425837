"""Screening of inertial samples: gaps, bad samples, spikes, sensors that are out; compiled and causal.

A log is judged by its earlier samples: its own step, its own noise, how fast its rates change. A verdict on a
sample may need the samples after it (a spike is known by the return): until they are there it is undecided, and so is
what follows. ``replay`` hands over a whole log and the streaming engine what has arrived: both come to the same
verdicts with the same bits.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.imu.screen_state import (
    ACCEL,
    BAD_SAMPLE,
    BRIDGE,
    BRIDGE_TOLD,
    CUT,
    GYRO,
    OUT_BEGINS,
    OUT_ENDS,
    REPLACED,
    SATURATED,
    SPIKE,
    Edits,
    ScreenRecord,
)
from insgnss.filter.imu.sensor_outage import (
    AT_RANGE,
    MOTION_TIME_S,
    beyond_range,
    density_beyond_range,
    held_for_long,
    is_all_well,
    is_unseen,
    note_recent_mean,
    note_repeats,
    note_slope,
    stand_in,
    unknown_density,
    unknown_variance,
)
from insgnss.filter.imu.spikes import (
    end_spike,
    find_spike,
    is_possible,
    least_spike,
    note_spike,
    taken_of_spike,
)
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int64

ROOM: Final = 8  # most verdicts on one sample
GAP_STEPS: Final = 1.75  # steps of more typical ones lack a sample: tags of loggers jitter by less
STEPS_MEMORY: Final = 64  # steps over which the typical one follows
TOLD_STEPS: Final = 5.0  # gaps of so many steps are reported, if longer than ...
TOLD_S: Final = 0.05  # ... this: as ``log.imu.time`` reports them
WIGGLE_TIME_S: Final = 2.0
MEAN_S: Final = 0.25  # over which samples are averaged to see motion in noise
CHANGE_TIME_S: Final = 60.0  # over which the changes of the means are averaged
CALM_TIME_S: Final = 600.0  # in which the most of it is forgotten
USUAL_TIME_S: Final = 30.0
# Gaps fall into manoeuvres too, which are more violent than the average of a minute
ABOVE_AVERAGE: Final = 2.0


@kernel
def screen(
    s: ScreenRecord,
    t_ns: Int64,
    w_ib_b: Float64,
    f_b: Float64,
    first: int,
    edits: Edits,
    count: Int64,
    x: Float64,
) -> int:
    """Judge samples from ``first`` on; return the first that is undecided, or for which ``edits`` has no room.

    Parameters
    ----------
    s : what is remembered of the samples before
    t_ns, w_ib_b, f_b : (n,), (n, 3), (n, 3) samples in increasing time
    edits, count : verdicts, written from ``count[0]`` on
    x : (6,) scratch
    """
    n = t_ns.shape[0]
    k = first
    while k < n and count[0] + ROOM <= edits.shape[0]:
        if not is_possible(s, w_ib_b, f_b, k):
            write(edits, count, k, t_ns[k], BAD_SAMPLE, 0.0 if s.in_bad_run else 1.0)
            s.in_bad_run = 1
            s.left_out += 1
            k += 1
            continue
        spike = find_spike(s, t_ns, w_ib_b, f_b, k)
        if spike < 0 or not repeats_decided(s, w_ib_b, f_b, k):
            break
        s.in_bad_run = 0
        if spike > 0:
            write(edits, count, k, t_ns[k], SPIKE, spike - 1.0)
            s.left_out += 1
            note_spike(s, w_ib_b, f_b, k)
        else:
            for i in range(3):
                x[i] = w_ib_b[k, i]
                x[3 + i] = f_b[k, i]
            take(s, t_ns[k], x, k, edits, count)
        k += 1
    return k


@kernel(apart=True)
def write(edits: Edits, count: Int64, k: int, t_ns: int, kind: int, size: float) -> None:
    """Write a verdict on sample ``k`` down."""
    edit = edits[count[0]]
    edit.sample = k
    edit.kind = kind
    edit.t_ns = t_ns
    edit.amount = size
    edit.axes = 0
    for i in range(3):
        edit.w[i] = 0.0
        edit.f[i] = 0.0
    edit.unknown[0] = 0.0
    edit.unknown[1] = 0.0
    count[0] += 1


@kernel(inline=True)
def repeats_decided(s: ScreenRecord, w: Float64, f: Float64, k: int) -> bool:
    """Find out whether an axis is out from sample ``k`` on, as far as the samples tell; return whether they do.

    A sensor that keeps its last value is out from the first repeat on; one that gives zeros from the first of them on:
    20 ms of a zero in place of the weight are 0.2 m/s.
    """
    if s.test_outages == 0 or s.n == 0:
        return True
    for axis in range(6):
        value = w[k, axis] if axis < 3 else f[k, axis - 3]
        held = value == s.x[axis]
        x = w if axis < 3 else f
        if s.out[axis] != 0 and not held:
            s.out[axis] = 0
        if abs(value) >= AT_RANGE * s.range[axis // 3]:
            s.out[axis] = SATURATED
        elif s.out[axis] == 0 and (held or is_silent(x, k)):
            status = held_for_long(s, x, k, axis)
            if status < 0:
                return False
            if status > 0:
                s.out[axis] = status
    return True


@kernel(inline=True)
def is_silent(x: Float64, k: int) -> bool:
    """Return whether a sensor gives zero in all axes at sample ``k`` of ``x`` (n, 3)."""
    return bool(x[k, 0] == 0.0 and x[k, 1] == 0.0 and x[k, 2] == 0.0)


@kernel(apart=True)
def take(s: ScreenRecord, t_ns: int, x: Float64, k: int, edits: Edits, count: Int64) -> None:
    """Accept a valid sample: add verdicts on the gap before it and on sensors that are out."""
    dt = (t_ns - s.t_ns) * 1e-9
    even = False
    if s.n > 0:
        gap = is_gap(s, dt)
        even = not gap
        if gap:
            bridge(s, t_ns, dt, x, k, edits, count)
        if s.n > 0:
            note_step(s, dt)
    if not is_all_well(s):
        judge_sensors(s, t_ns, dt, x, k, edits, count)
    if s.n > 0:
        note_repeats(s, x)
    if even:
        note_motion(s, dt, x)
    else:
        s.even = 0
        s.n_parts = 0
        clear_mean(s)
    s.even += 1
    s.calm += 1
    note_recent_mean(s, x, dt)
    for i in range(6):
        s.before[i] = s.x[i]
        s.x[i] = x[i]
    s.t_ns = t_ns
    s.n += 1
    s.left_out = 0
    if s.spike > 0:
        end_spike(s)


@kernel(inline=True)
def is_gap(s: ScreenRecord, dt: float) -> bool:
    """Return whether a step of ``dt`` [s] lacks samples."""
    limit: float = s.restart_s  # nothing says yet what a step is
    if s.n_steps > 0:
        limit = s.longest_step if s.longest_step > 0.0 and s.left_out == 0 else GAP_STEPS * s.step
    longer: bool = dt > limit and dt > 1.2 * s.step
    return longer


@kernel(inline=True)
def note_step(s: ScreenRecord, dt: float) -> None:
    """Let the typical step follow; gaps count as a few steps, so that a slower log is soon its own measure."""
    s.n_steps += 1
    if s.left_out > 0:
        dt = dt / (1 + s.left_out)
    if s.n_steps == 1:
        s.step = dt
    else:
        share = 1.0 / STEPS_MEMORY if s.n_steps >= STEPS_MEMORY else 1.0 / s.n_steps
        s.step += (min(dt, TOLD_STEPS * s.step) - s.step) * share


@kernel(apart=True)
def bridge(s: ScreenRecord, t_ns: int, dt: float, x: Float64, k: int, edits: Edits, count: Int64) -> None:
    """Write the bridging of the time without samples; where it is too long for the filter, it is a cut.

    Equation: the rate is a random walk of density q that is known at both ends: its integral over the gap T is
    T (w_0 + w_1) / 2 with the variance q T^3 / 12; the ends' own noise sigma^2 adds sigma^2 T^2 / 2. The same holds for
    the specific force. q is from the log, at least from the change over the gap itself.
    """
    step = s.step if s.n_steps > 0 else 0.5 * dt
    length = dt - step
    kind = BRIDGE
    if dt > max(TOLD_STEPS * step, TOLD_S) or (0.0 < s.longest_step < dt):
        kind = BRIDGE_TOLD
    write(edits, count, k, t_ns - int(step * 1e9 + 0.5), kind, dt)
    edit = edits[count[0] - 1]
    edit.axes = s.t_ns  # the gap's beginning, for the event
    for sensor in range(2):
        change2 = 0.0
        for i in range(3):
            change2 = max(change2, (x[3 * sensor + i] - s.x[3 * sensor + i]) ** 2)
        density = max(s.least_change[sensor], ABOVE_AVERAGE * s.most_change[sensor])
        density = max(density, change2 / length)
        variance = density * length**3 / 12.0 + 0.5 * s.wiggle2[sensor] / 1.5 * length**2
        spike2 = 0.0
        for i in range(3):
            spike2 = max(spike2, taken_of_spike(s, 3 * sensor + i) ** 2)
        variance += spike2
        edit.unknown[sensor] = variance / length
    for i in range(3):
        edit.w[i] = 0.5 * (s.x[i] + x[i]) + taken_of_spike(s, i) / length
        edit.f[i] = 0.5 * (s.x[3 + i] + x[3 + i]) + taken_of_spike(s, 3 + i) / length
    rotation = edit.unknown[GYRO] * length
    if dt > s.restart_s or rotation > s.restart_variance:
        edit.kind = CUT
        begin_anew(s)


@kernel(inline=True)
def begin_anew(s: ScreenRecord) -> None:
    """Forget what does not hold across a cut."""
    s.n = 0
    s.out_variance = 0.0
    s.hidden[0], s.hidden[1] = 0.0, 0.0
    for i in range(6):
        s.run[i] = 0


@kernel(apart=True)
def judge_sensors(
    s: ScreenRecord, t_ns: int, dt: float, x: Float64, k: int, edits: Edits, count: Int64
) -> None:
    """Write which sensor fails or recovers, and the substitute values of the sample while one is out."""
    density = (0.0, 0.0)
    for sensor in range(2):
        axes = 0
        saturated = False
        for i in range(3):
            axes += (1 << i) if s.out[3 * sensor + i] != 0 else 0
            if s.out[3 * sensor + i] == SATURATED:
                saturated = True
                note_slope(s, x, 3 * sensor + i)
        if axes == 0:
            if s.out_s[sensor] > 0.0:
                come_back(s, sensor, t_ns, k, edits, count)
            continue
        missed = 0.0
        if s.out_s[sensor] == 0.0:
            write(edits, count, k, t_ns, OUT_BEGINS, float(sensor))
            edits[count[0] - 1].axes = axes + (8 if saturated else 0)
            for i in range(3):  # a value that is repeated was taken for good when it came first
                a = 3 * sensor + i
                if s.out[a] != 0 and x[a] == s.x[a]:
                    missed += (s.run[a] + 1) ** 2 * (x[a] - s.fresh[a]) ** 2 * dt
        s.out_s[sensor] += dt
        sigma2 = unknown_variance(s, sensor, saturated)
        added = unknown_density(s, sensor, sigma2) + missed
        if saturated:
            added += density_beyond_range(s, sensor, dt)
            sigma2 = max(sigma2, beyond_range(s, sensor) ** 2)
        if sensor == GYRO:
            s.out_variance += added * dt
            density = (added, sigma2 * s.lever2 / MOTION_TIME_S)
        else:
            density = (density[0], density[1] + added)
    if density[0] > 0.0 or density[1] > 0.0:
        write(edits, count, k, t_ns, REPLACED, 0.0)
        edit = edits[count[0] - 1]
        edit.unknown[0], edit.unknown[1] = density
        for i in range(3):
            edit.w[i] = x[i] if s.out[i] == 0 else stand_in(s, i, x[i])
            edit.f[i] = x[3 + i] if s.out[3 + i] == 0 else stand_in(s, 3 + i, x[3 + i])


@kernel(inline=True)
def come_back(s: ScreenRecord, sensor: int, t_ns: int, k: int, edits: Edits, count: Int64) -> None:
    """Write down that a sensor is back; restart if the attitude is lost by then.

    Accelerometers that have never measured before leave an attitude that was levelled with nothing.
    """
    write(edits, count, k, t_ns, OUT_ENDS, s.out_s[sensor])
    edits[count[0] - 1].axes = sensor
    s.out_s[sensor], s.beyond_s[sensor] = 0.0, 0.0
    s.slope[sensor], s.hidden[sensor] = 0.0, 0.0
    lost2 = s.out_variance if sensor == GYRO else 0.0
    if sensor == ACCEL and is_unseen(s, ACCEL):
        lost2 = math.pi**2
    if lost2 > s.restart_variance:
        write(edits, count, k, t_ns, CUT, 0.0)
        edits[count[0] - 1].unknown[0] = lost2
        edits[count[0] - 1].axes = sensor
        begin_anew(s)
    if sensor == GYRO:
        s.out_variance = 0.0


@kernel(inline=True)
def note_motion(s: ScreenRecord, dt: float, x: Float64) -> None:
    """Let noise and motion of the log follow with a sample that has the one before it."""
    if s.even >= 2:
        s.n_wiggles += 1
        share = min(0.2, s.step * (1.0 / WIGGLE_TIME_S))
        if share * s.n_wiggles < 1.0:  # the mean of all so far
            share = 1.0 / s.n_wiggles
        for sensor in range(2):
            if s.out_s[sensor] > 0.0:
                continue
            off2 = 0.0
            for i in range(3):
                a = 3 * sensor + i
                off2 = max(off2, (s.x[a] - 0.5 * (s.before[a] + x[a])) ** 2)
            least2 = (least_spike(s, sensor) * (1.0 / 15.0)) ** 2
            off2 = min(off2, max(25.0 * s.wiggle2[sensor], least2))
            s.wiggle2[sensor] += share * (off2 - s.wiggle2[sensor])
    s.part_s += dt
    for i in range(6):
        s.part_sum[i] += dt * x[i]
    if s.part_s > MEAN_S - 1e-6:
        note_mean(s)


@kernel(apart=True)
def note_mean(s: ScreenRecord) -> None:
    """Let the change of the means and their spread follow with the mean that is complete; one that is out is not."""
    share = min(s.part_s / USUAL_TIME_S, 1.0)
    s.n_changes += 1
    late = max(s.part_s / CHANGE_TIME_S, 1.0 / s.n_changes)
    forgets = math.exp(-s.part_s / CALM_TIME_S)
    for sensor in range(2):
        change2, spread2 = 0.0, 0.0
        for i in range(3):
            a = 3 * sensor + i
            mean = s.part_sum[a] / s.part_s
            if s.n_changes == 1 and sensor == ACCEL:
                s.usual[a] = mean
            change2 = max(change2, (mean - s.part_mean[a]) ** 2)
            spread2 = max(spread2, (mean - s.usual[a]) ** 2)
            if sensor == ACCEL and s.out_s[ACCEL] == 0.0:
                s.usual[a] += share * (mean - s.usual[a])
            s.part_mean[a] = mean
        if s.out_s[sensor] > 0.0:
            continue
        if s.n_parts > 0:
            s.change[sensor] += late * (change2 / s.part_s - s.change[sensor])
        s.spread2[sensor] += late * (spread2 - s.spread2[sensor])
        s.most_change[sensor] = max(s.change[sensor], forgets * s.most_change[sensor])
        s.most_spread2[sensor] = max(s.spread2[sensor], forgets * s.most_spread2[sensor])
    s.n_parts += 1
    clear_mean(s)


@kernel(inline=True)
def clear_mean(s: ScreenRecord) -> None:
    """Begin a new mean."""
    s.part_s = 0.0
    for i in range(6):
        s.part_sum[i] = 0.0
