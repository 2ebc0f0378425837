"""Time tags as suspects: the last minute with GNSS or inertial tags that are off."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.hindsight import Hindsight, Verdict
from insgnss.filter.diagnosis.past import rows_at
from insgnss.filter.diagnosis.supposed_faults import GNSS_TAGS, IMU_TAGS
from insgnss.filter.diagnosis.tag_shifts import at_other_tags, earlier, later, summit
from insgnss.filter.diagnosis.witnesses import tag_error_s
from insgnss.filter.state import Bank, copy_bank

_TAGS_S: Final = (-0.1, -0.05, -0.02, 0.02, 0.05, 0.1)
_GNSS_TAGS_BACK_S: Final = 8.0  # so long ago those of GNSS may have begun
_TELLING_S: Final = 3.0  # so long at least
_SMALLEST_SHIFT_NS: Final = 10_000_000  # noise alone estimates some milliseconds
_LONGEST_SHIFT_NS: Final = 110_000_000
_TAGS_EPOCHS: Final = 3


def other_tags(again: Hindsight) -> Iterator[Verdict]:
    """Yield the results for GNSS time tags that are off since a few seconds."""
    rows = tuple((w, rows_at(again.stretches, w.t_ns)) for w in again.base[-_TAGS_EPOCHS:])
    for start in again.before:
        since_s = (again.end_ns - int(start.head[0].now_ns)) / NS_PER_S
        if not _TELLING_S <= since_s <= _GNSS_TAGS_BACK_S:
            continue
        verdict = _shifted(again, GNSS_TAGS, start, -tag_error_s(rows))
        if verdict is not None:
            yield verdict


def other_imu_tags(again: Hindsight) -> Iterator[Verdict]:
    """Yield the results for inertial time tags that are off from the start, then between the best of these."""
    log_likelihoods = {0.0: again.as_it_was}
    for shift_s in _TAGS_S:
        verdict = _shifted(again, IMU_TAGS, again.oldest(), shift_s)
        if verdict is not None:
            log_likelihoods[shift_s] = verdict.log_likelihood
            yield verdict
    top_s = summit(log_likelihoods)
    verdict = _shifted(again, IMU_TAGS, again.oldest(), top_s)
    if verdict is not None:
        yield verdict


def _shifted(again: Hindsight, suspect: str, start: Bank, shift_s: float) -> Verdict | None:
    """Return the result for time tags that are off by ``shift_s``; those of GNSS move the satellites.

    Epochs that a shift could bring before ``start``, or back behind it, count as they did: all shifts are judged by
    the same rows.
    """
    shift_ns = int(shift_s * NS_PER_S)
    if not _SMALLEST_SHIFT_NS < abs(shift_ns) < _LONGEST_SHIFT_NS:
        return None
    sound, bank, first_ns = copy_bank(start), copy_bank(start), int(start.head[0].now_ns) + _LONGEST_SHIFT_NS
    if again.until(sound, first_ns) is None:
        return None
    for name in ("log_likelihood", "epoch_ns"):
        bank.head[name] = sound.head[name]
    first = [int(np.searchsorted(e.rows.epoch_ns, first_ns, side="right")) for e in again.stretches]
    begun = tuple(e._replace(first=k) for e, k in zip(again.stretches, first, strict=True))
    if suspect == IMU_TAGS:
        verdict = again.verdict(
            suspect, at_other_tags(bank, shift_ns), begun, imu=earlier(again.imu, shift_ns)
        )
    else:
        bank.head["epoch_ns"] += shift_ns
        bank.state["clone_ns"] += shift_ns * (bank.state["clone_ns"] != 0)
        begun = tuple(e._replace(rows=later(e.rows, shift_ns)) for e in begun)
        verdict = again.verdict(suspect, bank, begun, shift_ns)
    return None if verdict is None else verdict._replace(size=shift_s)
