"""Inertial time tags as suspects: the last minute with tags that are off."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.hindsight import Hindsight, Verdict
from insgnss.filter.diagnosis.supposed_faults import IMU_TAGS
from insgnss.filter.diagnosis.tag_shifts import at_other_tags, earlier, summit
from insgnss.filter.state import copy_bank

_TAGS_S: Final = (-0.1, -0.05, -0.02, 0.02, 0.05, 0.1)
_SMALLEST_SHIFT_NS: Final = 10_000_000  # noise alone estimates some milliseconds
_LONGEST_SHIFT_NS: Final = 110_000_000


def other_imu_tags(again: Hindsight) -> Iterator[Verdict]:
    """Yield the results for inertial time tags that are off from the start, then between the best of these."""
    log_likelihoods = {0.0: again.as_it_was}
    for shift_s in _TAGS_S:
        verdict = _shifted(again, shift_s)
        if verdict is not None:
            log_likelihoods[shift_s] = verdict.log_likelihood
            yield verdict
    verdict = _shifted(again, summit(log_likelihoods))
    if verdict is not None:
        yield verdict


def _shifted(again: Hindsight, shift_s: float) -> Verdict | None:
    """Return the result for tags that are late by ``shift_s``.

    Epochs that a shift could bring before the oldest filter, or back behind it, count as they did: all shifts are
    judged by the same rows.
    """
    shift_ns, sound = int(shift_s * NS_PER_S), again.oldest()
    if not _SMALLEST_SHIFT_NS < abs(shift_ns) < _LONGEST_SHIFT_NS:
        return None
    bank, first_ns = copy_bank(sound), int(sound.head[0].now_ns) + _LONGEST_SHIFT_NS
    if again.until(sound, first_ns) is None:
        return None
    for name in ("log_likelihood", "epoch_ns"):
        bank.head[name] = sound.head[name]
    first = [int(np.searchsorted(e.rows.epoch_ns, first_ns, side="right")) for e in again.stretches]
    begun = tuple(e._replace(first=k) for e, k in zip(again.stretches, first, strict=True))
    verdict = again.verdict(IMU_TAGS, at_other_tags(bank, shift_ns), begun, earlier(again.imu, shift_ns))
    return None if verdict is None else verdict._replace(size=shift_s)
