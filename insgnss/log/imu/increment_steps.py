"""The time of each increment of an inertial log: the step of its tags, less where samples were lost.

The tags say what the steps are; no nominal rate does. One case differs: where samples were lost, the increment after
the longer step holds the last usual step only. The specific force separates the two.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.tables import Bool, Event, Float64, Int64

LONG_STEP: Final = 1.5  # so many usual steps: shorter ones are jitter, which the tags carry
STEP_BLOCK: Final = 64  # samples that share a usual step: half of it is known after half a block
NEIGHBOURS: Final = 5  # samples on either side that say what the specific force is
MIN_NEIGHBOURS: Final = 3
# Scatter of the neighbours, in distances from one reading to the middle between both, that still lets them decide
MAX_SCATTER: Final = 0.5
# Of the samples around: more long steps than that are a pattern of the sensor, and no losses. One loss is 1 of 11.
PATTERN_SHARE: Final = 0.2


def increment_intervals(
    t_ns: Int64, step: Int64, dv: tuple[Float64, Float64, Float64], file: str
) -> tuple[Float64, list[Event]]:
    """Return the time [ns] that each increment covers, and how increments after long steps were treated.

    Of two readings of a long step T with the usual step U, ``|dv| / T`` and ``|dv| / U``, the one whose logarithm is
    nearer to that of the specific force around holds. Where the force around is too small or too restless to decide,
    many long steps near each other are the sensor's own, few are lost samples.

    Parameters
    ----------
    t_ns : (n,) increasing time tags
    step : (n - 1,) their differences [ns]
    dv : velocity increments along three axes, (n,) each, in any unit
    file : for the events
    """
    usual = usual_steps(step)
    usual = np.concatenate((usual[:1], usual))
    interval = np.concatenate((usual[:1], step.astype(np.float64)))
    is_long = interval > LONG_STEP * usual
    if not is_long.any():
        return interval, []
    long = np.flatnonzero(is_long)
    by_tags = _covers_its_step(interval, usual, is_long, dv)
    lost = long[~by_tags]
    events = _events(t_ns, interval, usual, long[by_tags], lost, file)
    interval[lost] = usual[lost]
    return interval, events


def usual_steps(step: Int64) -> Float64:
    """Return the median step around each of (n,) steps, block by block: a log may change its rate.

    Next to a block of longer steps it is theirs.
    """
    whole = len(step) // STEP_BLOCK * STEP_BLOCK
    medians = np.median(step[:whole].reshape(-1, STEP_BLOCK), axis=1)
    last = np.median(step[-STEP_BLOCK:])
    usual = np.concatenate((np.repeat(medians, STEP_BLOCK), np.full(len(step) - whole, last)))
    wide = np.pad(usual, NEIGHBOURS, mode="edge")
    return np.asarray(np.maximum(usual, np.maximum(wide[: len(usual)], wide[2 * NEIGHBOURS :])))


def _covers_its_step(
    interval: Float64, usual: Float64, is_long: Bool, dv: tuple[Float64, Float64, Float64]
) -> Bool:
    """Return for each long step whether its increment was gathered over all of it."""
    long = np.flatnonzero(is_long)
    near = _MovingSums(long, len(interval))
    count = near.sums(~is_long)
    known = np.maximum(count, 1.0)
    rates = [np.where(is_long, 0.0, axis / interval) for axis in dv]
    means = [near.sums(rate) / known for rate in rates]
    squares = sum(near.sums(rate * rate) for rate in rates) / known
    force = np.sqrt(sum(mean * mean for mean in means))
    scatter = np.sqrt(np.maximum(squares - force * force, 0.0))
    along = sum(axis[long] * mean for axis, mean in zip(dv, means, strict=True))
    # q = increment / (force of the neighbours over a usual step): 1 after a loss, T / U of a true long step
    with np.errstate(divide="ignore", invalid="ignore"):
        q = along / (force * force * usual[long])
    middle = np.sqrt(interval[long] / usual[long])
    tells = (count >= MIN_NEIGHBOURS) & (scatter < MAX_SCATTER * (middle - 1.0) * force)
    pattern = near.sums(is_long) > PATTERN_SHARE * near.width
    return np.asarray(np.where(tells, q > middle, pattern))


class _MovingSums:
    """Sums over the samples around each of some samples, themselves included."""

    def __init__(self, centres: npt.NDArray[np.intp], n: int) -> None:
        self.first = np.maximum(centres - NEIGHBOURS, 0)
        self.end = np.minimum(centres + NEIGHBOURS + 1, n)
        self.width = self.end - self.first

    def sums(self, values: Float64 | Bool) -> Float64:
        total = np.concatenate(([0.0], np.cumsum(values, dtype=np.float64)))
        return np.asarray(total[self.end] - total[self.first])


def _events(
    t_ns: Int64,
    interval: Float64,
    usual: Float64,
    by_tags: npt.NDArray[np.intp],
    lost: npt.NDArray[np.intp],
    file: str,
) -> list[Event]:
    events = []
    for kind, which, how in (
        ("imu_increment_after_gap", lost, "taken to cover one usual step: samples were lost before them"),
        ("imu_increment_over_long_step", by_tags, "taken to cover the whole step between their tags"),
    ):
        if len(which):
            k = which[0]
            first = (
                f"the first after {interval[k] / NS_PER_S:.6g} s where {usual[k] / NS_PER_S:.6g} s are usual"
            )
            detail = f"{file}: {len(which)} increment(s) after a longer step {how}; {first}"
            events.append(Event(int(t_ns[k]), kind, detail))
    return events
