"""Fixes that contradict a filter without raw GNSS data: the filter is doubted, not the fixes.

With raw GNSS data, fixes that contradict the filter are refused. Without, they are all that it has: if it refuses them,
it drifts away from them and is lost. The cause is the inertial navigation: the sensor is noisier than its grade, as on
a vibrating mount, or its time is wrong.

- The filter finds how noisy the inertial samples are. Their white noise is exp(w) times that of the grade, and

      w <- max(0, w + dt (mean[min(y^2 / S, 9)] - 1) / 30 s),

  dt the time since the fix before, up to a second, y the innovations of a fix and S their variances. So w rises until
  the normalised squared innovations are 1 on average. If all errors are as stated and those of the fixes last 5 s, the
  sigmas become up to a tenth larger.
- From a fix that is 5 sigma away to the next that the gate takes, each fix widens the sigmas of position, velocity,
  attitude and biases by a factor exp(dt / 2 s), and adds dt / 2 s to w. Fixes that stay 10 sigma away are used after
  some two seconds, and by the covariance they correct attitude and biases too: the bias of a gyro that warms up is not
  what it was at the start. Normal errors are 5 sigma away once in two million.

A fix that repeats the one before to the bit while the vehicle moves is not evidence against the filter: the receiver
has lost its satellites, or the log has stopped. The gate judges it as any other.

While several headings are open, each is widened by itself: at rest no fix tells them apart, and one that drifts away
alone would keep its weight. All share one sensor: its noise is found from the heading that fits the fixes best. An
event reports noise of three times that of the grade.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.filter.own_rows.ledger import OwnEntry
from insgnss.filter.own_rows.rows import NOT_CARRYING, Kind
from insgnss.filter.state import BA, BG, DR, DV, PSI, Bank, HeadRecord, StateRecord
from insgnss.status import GATED, USED
from insgnss.tables import Event, Float64

_FAR2: Final = 25.0  # squared sigmas
_TIME_S: Final = 2.0  # in which refused fixes make the sigmas e times as large
_MOST_STEP_S: Final = 1.0  # fixes seconds apart: as if they were one second apart
_NOISE_TIME_S: Final = 30.0
_MOST: Final = 9.0  # that one squared innovation counts, over its variance
_MOST_NOISE: Final = math.log(300.0)
_TOLD: Final = math.log(3.0)
_OVER: Final = math.log(1.5)
_LINEAR2: Final = 0.1  # [rad^2] a wider attitude, sigmas of 18 deg, is not widened: its errors are not linear


def doubt_filter(bank: Bank, kinds: Iterable[Kind], members: Mapping[int, list[OwnEntry]], t_ns: int) -> None:
    """Find the noise of the inertial samples by the fixes of a time, and widen the hypotheses that contradict them.

    Parameters
    ----------
    members : the entries of each hypothesis, by its place in the bank
    """
    carrying = [kind for kind in kinds if kind.carrying != NOT_CARRYING and not kind.repeats(t_ns)]
    head = bank.head[0]
    for kind in carrying:
        at = kind.carrying
        before_ns = int(head.carried_ns[at])
        step_s = min((t_ns - before_ns) / NS_PER_S, _MOST_STEP_S) if before_ns else 0.0
        head.carried_ns[at] = t_ns
        of_members = {i: _against(entries, kind.name) for i, entries in members.items()}
        for i, each in of_members.items():
            m: StateRecord = bank.state[i]
            m.doubted_by[at] = int(each.refused and (each.largest > _FAR2 or m.doubted_by[at]))
            if m.doubted_by[at]:
                _widen(bank.P[i], math.exp(step_s / _TIME_S))
        risen = step_s * (min(each.mean for each in of_members.values()) - 1.0) / _NOISE_TIME_S
        if all(bank.state[i].doubted_by[at] for i in of_members):
            risen += step_s / _TIME_S
        head.inertial_noise[at] = min(max(head.inertial_noise[at] + risen, 0.0), _MOST_NOISE)
    if carrying:
        bank.state["noise_excess"] = math.expm1(2.0 * float(head.inertial_noise.max()))


class _Against(NamedTuple):
    """How a fix stands against a hypothesis: its normalised squared innovations."""

    refused: bool  # all of its rows, by the gate
    mean: float = 1.0
    largest: float = 0.0


def _against(entries: Iterable[OwnEntry], name: str) -> _Against:
    of_kind = [entry for entry in entries if entry.kind == name and entry.status in (USED, GATED)]
    nis = [entry.nis for entry in of_kind if math.isfinite(entry.nis)]
    if not nis:
        return _Against(refused=False)
    mean = sum(min(each, _MOST) for each in nis) / len(nis)
    return _Against(all(entry.status == GATED for entry in of_kind), mean, max(nis))


def _widen(P: Float64, factor: float) -> None:
    """Multiply the sigmas of position, velocity, attitude and biases; all correlations stay."""
    scale = np.ones(len(P))
    for at in (DR, DV, BA, BG):
        scale[at : at + 3] = factor
    if np.diagonal(P)[PSI : PSI + 3].max() < _LINEAR2:
        scale[PSI : PSI + 3] = factor
    P *= np.outer(scale, scale)


def doubt_events(head: HeadRecord, kinds: Iterable[Kind], t_ns: int) -> list[Event]:
    """Return an event for each kind by which the inertial noise is far above its grade, or near it again."""
    events = []
    for kind in kinds:
        at = kind.carrying
        if at == NOT_CARRYING:
            continue
        is_told, noise = bool(head.noise_told[at]), float(head.inertial_noise[at])
        if is_told == (noise > (_OVER if is_told else _TOLD)):
            continue
        head.noise_told[at] = int(not is_told)
        events.append(Event(t_ns, *_in_words(kind, told=not is_told)))
    return events


def _in_words(kind: Kind, *, told: bool) -> tuple[str, str]:
    if not told:
        return "filter_agrees", f"the filter agrees with '{kind.name}' again"
    detail = (
        f"'{kind.name}' disagrees with the filter, which has no raw GNSS data: now more than three times the inertial"
        f" noise of the grade is assumed; look for: grade of the inertial sensor (a vibrating mount is noisier), its"
        f" axes and time; of '{kind.name}': {kind.hint}"
    )
    return "filter_doubted", detail
