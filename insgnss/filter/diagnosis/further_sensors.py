"""Further sensors as suspects: the last minute with readings that are far less accurate than they say.

A sensor that is late, slips, or is mounted otherwise than declared passes the gate as long as it is wrong by a few
sigmas. It pulls the filter away from the satellites then, and a bias of the accelerometers or the gyros that has jumped
would explain that, too. So the sensor is tried beside them: errors 2, 5 and 10 times as large as its sigma. A kind
whose rows these explain is left out of the last minute.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from insgnss.filter.diagnosis.hindsight import Hindsight, Verdict
from insgnss.filter.diagnosis.supposed_faults import FURTHER_SENSOR
from insgnss.filter.own_rows.contradiction import contradicting
from insgnss.filter.own_rows.rows import NOT_WATCHED, OwnMeasurements

_LARGER2: Final = (4.0, 25.0, 100.0)


def inaccurate_sensors(again: Hindsight) -> Iterator[Verdict]:
    """Yield the results for each kind of own rows that may be left out, with each size of its errors."""
    own = again.setup.own
    if own is None:
        return
    unused = contradicting(again.before[-1].head[0], own.kinds)
    for kind in own.kinds:
        if kind.watch == NOT_WATCHED or kind.name in unused:
            continue
        for larger2 in _LARGER2:
            bank = again.oldest()
            supposed = _with_rows(again, own.widened(kind, larger2))
            verdict = supposed.verdict(FURTHER_SENSOR, bank, again.stretches)
            if verdict is not None:
                yield verdict._replace(kinds=(kind.name,), size=larger2)


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
