"""Whose fault it is: the last minute once more, with one thing or another taken for wrong.

When all satellites together contradict the filter's own prediction (``integrity``), the filter of about a minute ago
runs over the samples and epochs since once more: as it was; with the accelerometers' or the gyros' biases unknown from
some instant on; without satellites that may run away; with time tags that are off. What is wrong explains what nothing
else does. The likelihoods tell whether there was a fault, whose and since when, and the filter that knew of it in time
takes the place of the one that did not: with its honest covariance, and with all else as it was.
                                                                 [Willsky & Jones 1976: generalised likelihood ratio]
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.hindsight import (
    ACCELEROMETER,
    GYRO,
    IMU_TAGS,
    LAPSE,
    NOISE,
    SATELLITES,
    SENSORS,
    WITHOUT_S,
    Hindsight,
    Verdict,
)
from insgnss.filter.diagnosis.past import Past
from insgnss.filter.diagnosis.witnesses import MOST_SATELLITES
from insgnss.filter.prediction import Imu
from insgnss.filter.setup import FilterSetup
from insgnss.filter.state import Bank
from insgnss.filter.update.creeping import LEFT_OUT_S
from insgnss.gnss.observation_rows import N_BANDS

_SURE: Final = 20.0  # logarithm of the likelihood ratio at which a fault is believed
_SURE_AT_ONCE: Final = 40.0  # satellites in a street are alike for seconds: less than this must be seen twice
_SURE_OF_A_LAPSE: Final = (
    100.0  # a state that is unknown explains anything: the lie must have been a large one
)
_SAME_TAGS_S: Final = 0.02
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
    verdict, _ = again.leaving_out(again.before[0], satellites) or (None, [])
    if verdict is None or not verdict.fits or verdict.log_likelihood - again.as_it_was < _SURE:
        return None, past
    return again.to_the_end(verdict), past.after_verdict(True)


def is_rival(other: Verdict, best: Verdict) -> bool:
    """Return whether another suspect explains nearly as much as the best.

    Where a sensor is to be accused, whatever explains as much is a rival, if it fits or not.
    """
    near = best.log_likelihood - other.log_likelihood < _APART
    return near and other.suspect != best.suspect and (other.fits or best.suspect != SATELLITES)


def with_fewest(best: Verdict, found: list[Verdict]) -> Verdict:
    """Return the verdict on the fewest of the best's satellites that explain as much: each must be worth its place."""
    fewer = [
        v for v in found if v.fits and 0 < len(v.satellites) and set(v.satellites) < set(best.satellites)
    ]
    near = [v for v in fewer if best.log_likelihood - v.log_likelihood < _APART]
    return min(near, key=lambda v: (len(v.satellites), -v.log_likelihood), default=best)


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
    accused = any(v.suspect in SENSORS and v.log_likelihood - again.as_it_was > _SURE for v in found)
    if accused or past.tags_are_due(_TAGS_EVERY_NS):
        found += again.other_imu_tags()
        past = replace(past, tags_ns=span[1])
    found.sort(key=lambda v: -v.log_likelihood)
    if found[0].log_likelihood - again.as_it_was > _SURE and found[0].suspect in (*SENSORS, SATELLITES):
        past = past.soon()
    sure = [v for v in found if v.suspect != LAPSE or v.log_likelihood - again.as_it_was > _SURE_OF_A_LAPSE]
    best = next((v for v in sure if v.fits), None)
    waits = past.unclear_ns != 0 and span[1] - past.unclear_ns < _PATIENCE_NS
    if best is None or best.log_likelihood - again.as_it_was < _SURE:
        return None, past if waits else replace(past, unclear_ns=0, opened=False)
    explains_less = sure[0].log_likelihood - best.log_likelihood > _APART
    if explains_less and (best.suspect in SENSORS or again.stormy):
        return None, past  # what explains most does not explain it all
    if best.suspect == NOISE or (again.stormy and best.suspect in (*SENSORS, IMU_TAGS)):
        return None, past  # rows that contradict each other are no sensor's fault
    if best.suspect in SENSORS and past.tags_were_off(_TAGS_EVERY_NS):
        return None, past  # late tags have disturbed the filter, not a failed sensor
    if best.suspect == SATELLITES:
        best = with_fewest(best, sure)
        if best.log_likelihood - again.as_it_was < _SURE_AT_ONCE and best.satellites != past.suspected:
            return None, replace(past, suspected=best.satellites)
    if best.suspect == IMU_TAGS and abs(best.size - past.tag_error_s) > _SAME_TAGS_S:
        return None, replace(
            past, tag_error_s=best.size, tags_ns=0, in_vain=0
        )  # what is off from the start stays so
    others = {v.suspect for v in found if is_rival(v, best)}
    since_ns = past.unclear_ns or span[1]
    patient = span[1] - since_ns < _PATIENCE_NS
    if not others or (not patient and (best.suspect not in SENSORS or others <= {ACCELEROMETER, GYRO})):
        return again.to_the_end(best), past.after_verdict(best.suspect in (*SENSORS, SATELLITES))
    past = replace(past, unclear_ns=since_ns, in_vain=0)
    among = {best.suspect, *others}
    if past.opened or not among <= {ACCELEROMETER, GYRO, LAPSE} or not among <= {v.suspect for v in sure}:
        return None, past
    return again.either(LAPSE in among), replace(past, opened=True)
