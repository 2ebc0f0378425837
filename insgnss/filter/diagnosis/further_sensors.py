"""Further sensors as suspects: the last minute with readings that are late, or less accurate than they say.

A sensor that is late, slips, or is mounted otherwise than declared passes the gate as long as it is wrong by a few
sigmas. It pulls the filter away from the satellites then, and a bias of the accelerometers or the gyros that has jumped
would explain that, too. So each sensor is tried beside them, with errors 2, 5 and 10 times as large as its sigma and
with tags up to 2 s late or early; the mean of these likelihoods counts. The sensor that they explain is left out: until
it agrees, or for good where late tags explain it far better than large errors.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.hindsight import Hindsight, Verdict, log_likelihood_of
from insgnss.filter.diagnosis.supposed_faults import FURTHER_SENSOR, SURE
from insgnss.filter.own_rows.contradiction import contradicting
from insgnss.filter.own_rows.rows import NOT_CARRYING, NOT_WATCHED, Kind, OwnMeasurements

_LARGER2: Final = (4.0, 25.0, 100.0)
_LATE_S: Final = (-2.0, -1.0, -0.5, -0.2, 0.2, 0.5, 1.0, 2.0)
_SOUND: Final = 2.0 * SURE
_LATEST_NS: Final = int(max(_LATE_S) * NS_PER_S)


def sensors_in_question(again: Hindsight) -> list[Kind]:
    """Return the kinds of own rows that are in use and may be left out."""
    kinds = () if again.setup.own is None else again.setup.own.kinds
    unused = contradicting(again.before[-1].head[0], kinds)
    return [
        kind
        for kind in kinds
        if kind.watch != NOT_WATCHED and kind.carrying == NOT_CARRYING and kind.name not in unused
    ]


def wrong_sensor(again: Hindsight, kind: Kind) -> Iterator[Verdict]:
    """Yield the results for a kind whose errors are larger, or whose tags are late.

    A kind whose rows are far likelier at their own sigma than at twice it is sound: nothing more of it is tried.
    """
    own = again.setup.own
    assert own is not None
    for larger2 in _LARGER2:
        for verdict in _supposed(again, kind, own.widened(kind, larger2)):
            yield verdict
            if larger2 == _LARGER2[0] and verdict.log_likelihood < again.as_it_was - _SOUND:
                return
    if not kind.period_ns:
        yield from _late(again, own, kind)


def _late(again: Hindsight, own: OwnMeasurements, kind: Kind) -> Iterator[Verdict]:
    """Yield the results for tags of a kind that are late.

    All are judged by the same readings: those that stay inside the minute under every shift.
    """
    within = int(again.before[0].head[0].now_ns) + _LATEST_NS, again.end_ns - _LATEST_NS
    for sound in _supposed(again, kind, own.late(kind, 0, *within)):
        for late_s in _LATE_S:
            for verdict in _supposed(again, kind, own.late(kind, int(late_s * NS_PER_S), *within)):
                gain = verdict.log_likelihood - sound.log_likelihood
                yield verdict._replace(log_likelihood=again.as_it_was + gain, size=late_s)


def _supposed(again: Hindsight, kind: Kind, own: OwnMeasurements) -> Iterator[Verdict]:
    """Yield the result of the last minute with other own rows, nothing if that run fails."""
    verdict = _with_rows(again, own).verdict(FURTHER_SENSOR, again.oldest(), again.stretches)
    if verdict is not None:
        yield verdict._replace(kinds=(kind.name,))


def without_sensor(again: Hindsight, verdicts: Sequence[Verdict]) -> Verdict | None:
    """Return the verdict on a sensor with a filter that has not used it in the last minute, at the last epoch.

    Its ``size`` is how late the sensor is, 0 where that is not far likelier than large errors.
    """
    own, bank = again.setup.own, again.oldest()
    late, verdict = (
        max((v for v in verdicts if is_late == (v.size != 0.0)), key=log_likelihood_of, default=None)
        for is_late in (True, False)
    )
    if late is not None and (verdict is None or late.log_likelihood > verdict.log_likelihood + SURE):
        verdict = late
    assert verdict is not None
    assert own is not None
    rest = own.without(kind for kind in own.kinds if kind.name in verdict.kinds)
    done = _with_rows(again, rest).until(bank, again.now_ns)
    return None if done is None else verdict._replace(bank=bank)


def _with_rows(again: Hindsight, own: OwnMeasurements) -> Hindsight:
    """Return the same minute with other own rows."""
    other = copy.copy(again)
    other.setup = replace(again.setup, own=own)
    return other
