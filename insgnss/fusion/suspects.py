"""Whose fault it is: the last minute once more, with one thing or another taken for wrong.

When all satellites together contradict the filter's own prediction (``integrity``), the filter of about a minute ago
runs over the samples and epochs since once more: as it was; with the accelerometers' or the gyros' biases unknown from
some instant on; without satellites that may run away; with time tags that are off. What is wrong explains what nothing
else does. The likelihoods tell whether there was a fault, whose and since when, and the filter that knew of it in time
takes the place of the one that did not: with its honest covariance, and with all else as it was.
                                                                 [Willsky & Jones 1976: generalised likelihood ratio]
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.fusion.creeping import LEFT_OUT_S
from insgnss.fusion.hindsight import (
    ACCELEROMETER,
    GYRO,
    LAPSE,
    SATELLITES,
    SENSORS,
    WITHOUT_S,
    Hindsight,
    Verdict,
)
from insgnss.fusion.past import Past
from insgnss.fusion.prediction import Imu
from insgnss.fusion.setup import FilterSetup
from insgnss.fusion.state import Bank
from insgnss.fusion.witnesses import MOST_SATELLITES
from insgnss.gnss.observation_rows import N_BANDS

_SURE: Final = 20.0  # logarithm of the likelihood ratio at which a fault is believed
_SURE_OF_A_LAPSE: Final = (
    100.0  # a state that is unknown explains anything: the lie must have been a large one
)
_APART: Final = 20.0  # the same between two suspects
_PATIENCE_NS: Final = 40 * NS_PER_S  # for that: two sensors look alike until the vehicle turns
_TAGS_EVERY_NS: Final = 120 * NS_PER_S


def run_away(
    past: Past, bank: Bank, setup: FilterSetup, imu: Imu, parameters: npt.NDArray[Any]
) -> tuple[Verdict | None, Past]:
    """Return the filter that has left out from the start the satellites which ``bank`` has just found to creep."""
    past, span = past.judged()
    until_s = bank.memory[0, :, LEFT_OUT_S]
    if span is None:
        return None, past
    satellites = tuple(int(n) for n in np.unique(np.flatnonzero(until_s > span[1] * 1e-9) // N_BANDS))
    again = Hindsight(past.of_late(int(WITHOUT_S * NS_PER_S)), setup, imu, parameters, span)
    if not again.came_through or not 0 < len(satellites) <= MOST_SATELLITES:
        return None, past
    verdict = again.leaving_out(again.before[0], satellites)
    if verdict is None or not verdict.fits or verdict.log_likelihood - again.as_it_was < _SURE:
        return None, past
    return again.to_the_end(verdict), past.after_verdict(True)


def judge(
    past: Past, setup: FilterSetup, imu: Imu, parameters: npt.NDArray[Any]
) -> tuple[Verdict | None, Past]:
    """Return what has failed, if that is clear, and the past with what is not."""
    past, span = past.judged()
    if span is None:
        return None, past
    again = Hindsight(past, setup, imu, parameters, span)
    if not again.came_through:
        return None, past
    found = list(again.suspects())
    if past.tags_are_due(_TAGS_EVERY_NS):
        found += again.other_imu_tags()
        past = replace(past, tags_ns=span[1])
    found = [v for v in found if v.suspect != LAPSE or v.log_likelihood - again.as_it_was > _SURE_OF_A_LAPSE]
    found.sort(key=lambda v: -v.log_likelihood)
    best = next((v for v in found if v.fits), None)
    if best is None or best.log_likelihood - again.as_it_was < _SURE:
        return None, replace(past, unclear_ns=0)
    if found[0].log_likelihood - best.log_likelihood > _APART and best.suspect in SENSORS:
        return None, past  # what explains most does not explain it all
    if again.stormy and best.suspect in SENSORS:
        return None, past  # rows that contradict each other are no sensor's fault
    others = [v.log_likelihood for v in found if v.suspect != best.suspect and v.fits]
    if best.log_likelihood - max(others, default=-math.inf) < _APART:
        since_ns = past.unclear_ns or span[1]
        if span[1] - since_ns < _PATIENCE_NS:
            first = past.unclear_ns == 0
            past = replace(past, unclear_ns=since_ns, in_vain=0)
            among = {v.suspect for v in found if best.log_likelihood - v.log_likelihood < _APART}
            if not first or not among <= {ACCELEROMETER, GYRO, LAPSE}:
                return None, past
            return again.either(LAPSE in among), past
    return again.to_the_end(best), past.after_verdict(best.suspect in (*SENSORS, SATELLITES))
