"""Angular rates and specific forces that were sampled at different times become the rows of one inertial table."""

from __future__ import annotations

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.log.events import counted
from insgnss.tables import Event, Float64, ImuTable, Int64

# Gap of the accelerometer across which it is interpolated: phones sample every 2.5 to 20 ms; of slower ones (200 ms is
# Android's ordinary rate) one sample may be missing
LONGEST_GAP_S, MOST_STEPS, LONGEST_OF_ALL_S = 0.1, 2.5, 0.6


def paired(
    gyro_ns: Int64, w: Float64, accel_ns: Int64, f: Float64, source: str
) -> tuple[ImuTable | None, list[Event]]:
    """Return one row for each gyro sample, the specific force interpolated linearly to its time.

    Interpolation averages the noise of two neighbours: the variance of the specific force falls by up to one half.
    A gyro sample outside of the accelerometer's span, or in a gap of it longer than 0.1 s and 2.5 of its steps, is left
    out and reported; so are repeated and falling times, and samples that are not finite.

    Parameters
    ----------
    gyro_ns, w : (n,), (n, 3) times and angular rates [rad/s]
    accel_ns, f : (m,), (m, 3) times and specific forces [m/s^2]
    source : what the events name

    Returns
    -------
    None when no row is left.
    """
    events: list[Event] = []
    gyro_ns, w = _rising(gyro_ns, w, f"{source}: angular rate", events)
    accel_ns, f = _rising(accel_ns, f, f"{source}: specific force", events)
    if not len(gyro_ns) or not len(accel_ns):
        if len(gyro_ns) or len(accel_ns):
            which = "specific forces" if len(gyro_ns) else "angular rates"
            events.append(Event(None, "imu_incomplete", f"{source}: no {which}: no inertial table"))
        return None, events
    after = np.searchsorted(accel_ns, gyro_ns)
    inside = (after < len(accel_ns)) & ((after > 0) | (accel_ns[0] == gyro_ns))
    right = np.minimum(after, len(accel_ns) - 1)
    left = np.where(accel_ns[right] == gyro_ns, right, np.maximum(right - 1, 0))
    span_ns = accel_ns[right] - accel_ns[left]
    step_s = float(np.median(np.diff(accel_ns))) / NS_PER_S if len(accel_ns) > 1 else 0.0
    longest_s = max(LONGEST_GAP_S, min(MOST_STEPS * step_s, LONGEST_OF_ALL_S))
    kept = inside & (span_ns <= longest_s * NS_PER_S)
    what = "angular rate(s) without a specific force near enough in time left out"
    events += counted("imu_unpaired", ~kept, what, source)
    if not kept.any():
        return None, events
    share = np.where(span_ns > 0, (gyro_ns - accel_ns[left]) / np.maximum(span_ns, 1), 0.0)[kept, None]
    force = f[left[kept]] * (1.0 - share) + f[right[kept]] * share
    return ImuTable(gyro_ns[kept], w[kept], force), events


def _rising(t_ns: Int64, values: Float64, what: str, events: list[Event]) -> tuple[Int64, Float64]:
    """Return the finite samples in the order of time, of those with the same time the first."""
    finite = np.isfinite(values).all(axis=1)
    events += counted("imu_not_finite", ~finite, "sample(s) that are not a number", what)
    t_ns, values = t_ns[finite], values[finite]
    if not len(t_ns) or (np.diff(t_ns) > 0).all():
        return t_ns, values
    unique, first = np.unique(t_ns, return_index=True)
    falls, repeated = int((np.diff(t_ns) < 0).sum()), len(t_ns) - len(unique)
    detail = f"{what}: time falls back at {falls} sample(s), {repeated} repeated sample(s) left out"
    events.append(Event(None, "imu_time_order", detail))
    return unique, values[first]
