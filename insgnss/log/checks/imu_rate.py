"""Whether an inertial log keeps its rate: if the rate falls, samples are missing although no single step is a gap."""

from __future__ import annotations

from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.gpstime import ns_to_week_seconds
from insgnss.log.checks.report import Finding
from insgnss.log.checks.stretches import SHORTEST_STRETCH_S
from insgnss.tables import ImuTable, Int64

BLOCK: Final = 32  # steps whose mean counts: those of a logger that sends packets are uneven
CHANGED: Final = 1.5  # times the step: jitter and a lost sample change the mean of a block by less
LASTS_S: Final = 5.0  # a shorter change is a gap or a burst of lost samples ...
LASTS_BLOCKS: Final = 4  # ... as is one of fewer blocks


class _RatePart(NamedTuple):
    """Samples of a log that have one rate."""

    first: int
    end: int
    step_s: float

    @property
    def lasts_s(self) -> float:
        return (self.end - self.first) * self.step_s


def rate_change_findings(imu: ImuTable, week: int) -> list[Finding]:
    """Return a warning if the rate changes and stays changed, with the first time of it and both rates."""
    parts = _parts(imu.t_ns)
    if len(parts) < 2:
        return []
    before, after = parts[:2]
    at_s = float(ns_to_week_seconds(imu.t_ns[[after.first]], week)[0])
    text = f"the rate changes from {1.0 / before.step_s:.3g} to {1.0 / after.step_s:.3g} Hz at about {at_s:.1f} s"
    if len(parts) > 2:
        text += f" (and {len(parts) - 2} more time(s))"
    advice = (
        "where samples were left out, the motion between them is lost: log at one rate; axes, times and lever arm are"
        f" judged by the part at {1.0 / _full_step_s(parts):.3g} Hz"
    )
    return [Finding("warning", "imu", text, advice)]


def at_full_rate(imu: ImuTable) -> ImuTable:
    """Return the log without the parts at a lower rate than that of its others, the log itself if there are none."""
    parts = _parts(imu.t_ns)
    if len(parts) < 2:
        return imu
    full_s = _full_step_s(parts)
    kept = np.zeros(len(imu.t_ns), np.bool_)
    for part in parts:
        kept[part.first : part.end] = not _differ(part.step_s, full_s)
    return ImuTable(imu.t_ns[kept], imu.w_ib_b[kept], imu.f_b[kept])


def _full_step_s(parts: list[_RatePart]) -> float:
    """Return the step of the highest rate that lasts for long enough to see the motion in it."""
    lasting = [part.step_s for part in parts if part.lasts_s >= SHORTEST_STRETCH_S]
    return min(lasting or [max(parts, key=lambda part: part.lasts_s).step_s])


def _parts(t_ns: Int64) -> list[_RatePart]:
    """Return the parts of a log that keep their rate; blocks of steps that belong to none are left out."""
    n = len(t_ns) // BLOCK
    blocks = np.diff(t_ns[: n * BLOCK + 1 : BLOCK]) / (BLOCK * NS_PER_S)
    changes = [0]
    for k in range(1, len(blocks)):
        if _differ(blocks[k], blocks[changes[-1]]):
            changes.append(k)
    parts: list[_RatePart] = []
    for first, end in pairwise([*changes, len(blocks)]):
        if end - first < LASTS_BLOCKS:
            continue
        part = _RatePart(BLOCK * first, BLOCK * end, float(np.median(blocks[first:end])))
        if part.lasts_s < LASTS_S:
            continue
        if parts and not _differ(part.step_s, parts[-1].step_s):
            parts[-1] = parts[-1]._replace(end=part.end)
        else:
            parts.append(part)
    return parts


def _differ(one_s: float, other_s: float) -> bool:
    return max(one_s, other_s) > CHANGED * min(one_s, other_s)
