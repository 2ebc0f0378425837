"""Further sensors as suspects: the last minute with readings that are late, or less accurate than they say.

A sensor that is late, slips, or is mounted otherwise than declared passes the gate as long as it is wrong by a few
sigmas. It pulls the filter away from the satellites then, and a bias of the accelerometers or the gyros that has jumped
would explain that, too. So each sensor is tried beside them, with errors 2, 5 and 10 times as large as its sigma and
with tags up to 2 s late or early; the mean of these likelihoods counts. The sensor they explain is left out.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.hindsight import Hindsight, Verdict
from insgnss.filter.diagnosis.supposed_faults import FURTHER_SENSOR
from insgnss.filter.own_rows.contradiction import contradicting
from insgnss.filter.own_rows.rows import NOT_CARRYING, NOT_WATCHED, Kind, OwnMeasurements

_LARGER2: Final = (4.0, 25.0, 100.0)
_LATE_S: Final = (-2.0, -1.0, -0.5, -0.2, 0.2, 0.5, 1.0, 2.0)
_LATEST_NS: Final = int(max(_LATE_S) * NS_PER_S)


def wrong_sensors(again: Hindsight) -> Iterator[Verdict]:
    """Yield the results for each kind of own rows that may be left out."""
    own = again.setup.own
    if own is None:
        return
    unused = contradicting(again.before[-1].head[0], own.kinds)
    for kind in own.kinds:
        if kind.watch == NOT_WATCHED or kind.carrying != NOT_CARRYING or kind.name in unused:
            continue
        for larger2 in _LARGER2:
            yield from _supposed(again, kind, own.widened(kind, larger2))
        if not kind.period_ns:
            yield from _late(again, own, kind)


def _late(again: Hindsight, own: OwnMeasurements, kind: Kind) -> Iterator[Verdict]:
    """Yield the results for tags of a kind that are late.

    All are judged by the same readings: those that none of the tags brings before the minute or behind it.
    """
    within = int(again.before[0].head[0].now_ns) + _LATEST_NS, again.end_ns - _LATEST_NS
    for sound in _supposed(again, kind, own.late(kind, 0, *within)):
        for late_s in _LATE_S:
            for verdict in _supposed(again, kind, own.late(kind, int(late_s * NS_PER_S), *within)):
                gain = verdict.log_likelihood - sound.log_likelihood
                yield verdict._replace(log_likelihood=again.as_it_was + gain, size=late_s)


def _supposed(again: Hindsight, kind: Kind, own: OwnMeasurements) -> Iterator[Verdict]:
    """Yield the result of the last minute with other own rows, none if it came to nothing."""
    verdict = _with_rows(again, own).verdict(FURTHER_SENSOR, again.oldest(), again.stretches)
    if verdict is not None:
        yield verdict._replace(kinds=(kind.name,))


def without_sensor(again: Hindsight, verdict: Verdict) -> Verdict | None:
    """Return a verdict with a filter that has not used the sensor in the last minute, at the last epoch."""
    own, bank = again.setup.own, again.oldest()
    assert own is not None
    rest = own.without(kind for kind in own.kinds if kind.name in verdict.kinds)
    done = _with_rows(again, rest).until(bank, again.now_ns)
    return None if done is None else verdict._replace(bank=bank)


def _with_rows(again: Hindsight, own: OwnMeasurements) -> Hindsight:
    """Return the same minute with other own rows."""
    other = copy.copy(again)
    other.setup = replace(again.setup, own=own)
    return other
