"""Whose fault it is: the last minute once more, with one thing or another taken for wrong.

When all satellites together contradict the filter's own prediction (``integrity``), the filter of about a minute ago
runs over the samples and epochs since once more: as it was; with the accelerometers' or the gyros' biases unknown from
some instant on; without satellites that may run away; with time tags that are off. What is wrong explains what nothing
else does. The likelihoods tell whether there was a fault, whose and since when, and the filter that knew of it in time
takes the place of the one that did not: with its honest covariance, and with all else as it was.
                                                                 [Willsky & Jones 1976: generalised likelihood ratio]
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.fusion.creeping import RATE, RATE_S, RATE_SINCE_S
from insgnss.fusion.loop import DONE, new_workspace, run_epochs
from insgnss.fusion.output import Table, new_output
from insgnss.fusion.past import Past, Stretch
from insgnss.fusion.prediction import Imu
from insgnss.fusion.setup import FilterSetup
from insgnss.fusion.state import BA, BG, Bank, copy_bank
from insgnss.gnss.observation_rows import N_BANDS, RANGE_RATE, Rows, some_epochs
from insgnss.inertial.sensor_model import sensor_model
from insgnss.status import DRIFTING, GATED, INCONSISTENT, USED
from insgnss.tables import Int64

ACCELEROMETER, GYRO, EITHER = "accelerometer", "gyro", "accelerometer or gyro"
SATELLITES, IMU_TAGS, GNSS_TAGS = "satellites", "imu tags", "gnss tags"
SENSORS: Final = (ACCELEROMETER, GYRO, EITHER)

_SURE: Final = 20.0  # logarithm of the likelihood ratio at which a fault is believed
_APART: Final = 10.0  # the same between two suspects
_PATIENCE_NS: Final = 40 * NS_PER_S  # for that: two sensors look alike until the vehicle turns
_ONSETS_S: Final = (4.0, 7.0, 11.0, 16.0, 22.0, 30.0, 40.0, 55.0)  # how long ago the fault may have begun
_SIZES: Final = (6.0, 60.0)  # sigmas of the grade's bias by which it may have jumped
_WITHOUT_S: Final = 30.0  # for which satellites are left out
_MOST_SATELLITES: Final = 3
_MOST_CANDIDATES: Final = 5
_A_SATELLITE: Final = 5.0  # what leaving one out costs beside its rows: its own unknown error
_TAGS_S: Final = (-0.1, -0.05, -0.02, 0.02, 0.05, 0.1)
_LONGEST_SHIFT_NS: Final = 110_000_000
_FITS: Final = 0.75  # share of the rows of each kind that must fit what is believed
_FITTING_EPOCHS: Final = 5
_FEW: Final = 3
_LARGEST_NIS: Final = 2.5  # in the mean of the rows that fit


class Verdict(NamedTuple):
    """What has failed, the likelihood of the epochs if that is so, and the filter that knows of it."""

    suspect: str
    log_likelihood: float
    bank: Bank
    fits: bool
    satellites: tuple[int, ...] = ()  # slots
    size: float = 0.0  # of the time tags' error [s]


def judge(
    past: Past, setup: FilterSetup, imu: Imu, parameters: npt.NDArray[Any]
) -> tuple[Verdict | None, Past]:
    """Return what has failed, if that is clear, and the past with what is not."""
    past, span = past.judged()
    if span is None:
        return None, past
    again = _Again(past, setup, imu, parameters, span)
    if not again.came_through:
        return None, past
    found = sorted(again.suspects(), key=lambda v: -v.log_likelihood)
    best = next((v for v in found if v.fits), None)
    if best is None or best.log_likelihood - again.as_it_was < _SURE:
        return None, replace(past, unclear_ns=0)
    if found[0].log_likelihood - best.log_likelihood > _APART:
        return None, past  # what explains most does not explain it all
    others = [v.log_likelihood for v in found if v.suspect != best.suspect and v.fits]
    if best.log_likelihood - max(others, default=-math.inf) < _APART:
        since_ns = past.unclear_ns or span[1]
        if span[1] - since_ns < _PATIENCE_NS:
            first = past.unclear_ns == 0
            past = replace(past, unclear_ns=since_ns, in_vain=0)
            among = {v.suspect for v in found if best.log_likelihood - v.log_likelihood < _APART}
            if not first or not among <= set(SENSORS):
                return None, past
            return again.either(best), past
    return again.to_the_end(best), past.after_verdict(best.suspect in (*SENSORS, SATELLITES))


class _Again:
    """The filter of a minute ago and all that it could have known."""

    def __init__(
        self, past: Past, setup: FilterSetup, imu: Imu, parameters: npt.NDArray[Any], span: tuple[int, int]
    ) -> None:
        """Run it as it was; ``span`` is where the judgement ends and the time of the last epoch."""
        self.setup, self.imu = setup, imu
        self.past, self.stretches = past, past.epochs
        self.end_ns, self.now_ns = span
        self.parameters = quiet(parameters)
        largest = max(int(np.diff(e.rows.first[e.first : e.last + 1]).max()) for e in past.epochs)
        self.work = new_workspace(largest, setup.layout, setup.installation, setup.visibility_limits)
        oldest_ns = int(past.banks[0].head[0].now_ns)
        onsets_ns = [self.end_ns - int(onset_s * NS_PER_S) for onset_s in reversed(_ONSETS_S)]
        bank = self.oldest()
        self.before: list[Bank] = []
        self.base: list[_Written] = []
        self.came_through = True
        for stop_ns in [*(t for t in onsets_ns if t > oldest_ns), self.end_ns]:
            written = self.until(bank, stop_ns)
            if written is None:
                self.came_through = False
                return
            self.base += written
            self.before.append(copy_bank(bank))
        self.as_it_was = float(bank.head[0].log_likelihood)

    def oldest(self) -> Bank:
        """Return the oldest filter of the past."""
        bank = copy_bank(self.past.banks[0])
        bank.head["heading_open"] = 0
        bank.head["log_likelihood"] = 0.0
        return bank

    def suspects(self) -> Iterator[Verdict]:
        """Yield all that may have failed."""
        for suspect, size, start in itertools.product((ACCELEROMETER, GYRO), _SIZES, self.before[:-1]):
            found = self.verdict(suspect, with_fault(start, self.setup, suspect, size), self.stretches)
            if found is not None:
                yield found
        yield from self.without_satellites()
        for shift_s in _TAGS_S:
            shift_ns = int(shift_s * NS_PER_S)
            bank = self.oldest()
            bank.state["clone_ns"] += shift_ns * (bank.state["clone_ns"] != 0)
            shifted = tuple(e._replace(rows=_later(e.rows, shift_ns, 0.0)) for e in self.stretches)
            found = self.verdict(IMU_TAGS, bank, shifted, shift_ns)
            if found is not None:
                yield found._replace(size=shift_s)
            if len(self.before) > 1:
                bank = copy_bank(self.before[max(len(self.before) - 5, 0)])
                bank.state["clone_ns"] += shift_ns * (bank.state["clone_ns"] != 0)
                shifted = tuple(e._replace(rows=_later(e.rows, shift_ns, shift_s)) for e in self.stretches)
                found = self.verdict(GNSS_TAGS, bank, shifted, shift_ns)
                if found is not None:
                    yield found._replace(size=shift_s)

    def verdict(
        self, suspect: str, bank: Bank, stretches: tuple[Stretch, ...], shift_ns: int = 0
    ) -> Verdict | None:
        """Return what comes of a suspicion."""
        written = self.until(bank, self.end_ns + shift_ns, stretches)
        if written is None:
            return None
        return Verdict(suspect, float(bank.head[0].log_likelihood), bank, _fit(written))

    def without_satellites(self) -> Iterator[Verdict]:
        """Yield what comes of leaving out the satellites that run away, the one that explains most first, then more."""
        starts = [b for b in self.before[:-1] if self.end_ns - int(b.head[0].now_ns) <= _WITHOUT_S * NS_PER_S]
        if not starts:
            return
        start, left_out, least = starts[0], (), self.as_it_was
        since_ns = int(start.head[0].now_ns)
        candidates = self.candidates(since_ns)
        for _ in range(_MOST_SATELLITES):
            found = []
            for satellite in candidates:
                if satellite in left_out:
                    continue
                slots = (*left_out, satellite)
                stretches = tuple(e._replace(rows=_without(e.rows, slots)) for e in self.stretches)
                verdict = self.verdict(SATELLITES, copy_bank(start), stretches)
                if verdict is not None:
                    cost = sum(self.cost(slot, since_ns) + _A_SATELLITE for slot in slots)
                    total = verdict.log_likelihood - cost
                    found.append(verdict._replace(log_likelihood=total, satellites=slots))
            best = max(found, key=lambda v: v.log_likelihood, default=None)
            if best is None or best.log_likelihood < least + _APART:
                return
            yield best
            left_out, least = best.satellites, best.log_likelihood

    def candidates(self, since_ns: int) -> list[int]:
        """Return the satellites whose rows are off on one side since ``since_ns``, the farthest first."""
        sums: dict[int, Any] = {}
        for written in self.base:
            if written.t_ns <= since_ns:
                continue
            ledger, status = written.ledger, written.ledger["status"]
            for kind in range(2):
                told = np.flatnonzero((status[:, kind] == USED) | (status[:, kind] == GATED))
                sigmas = ledger["innovation"][told, kind] / np.sqrt(ledger["variance"][told, kind])
                for slot, value in zip(
                    written.slot[told] // N_BANDS, np.clip(sigmas, -5.0, 5.0), strict=True
                ):
                    total = sums.setdefault(int(slot), np.zeros((2, 2)))
                    total[kind] += value, 1.0
        far = {slot: max(s * s / n for s, n in total if n > 0.0) for slot, total in sums.items()}
        return sorted((s for s in far if far[s] > 4.0), key=lambda s: -far[s])[:_MOST_CANDIDATES]

    def cost(self, satellite: int, since_ns: int) -> float:
        """Return what the rows of a satellite cost that are left out: as much as rows that fit, or as refused ones did."""
        total = 0.0
        for written in self.base:
            if written.t_ns > since_ns:
                mine = written.slot // N_BANDS == satellite
                for kind, gate2 in ((0, self.parameters[0].range_gate2), (1, self.parameters[0].rate_gate2)):
                    status = written.ledger["status"][mine, kind]
                    variance = written.ledger["variance"][mine, kind]
                    for code, nis in ((USED, 1.0), (GATED, gate2), (INCONSISTENT, gate2)):
                        total += 0.5 * float(np.sum(nis + np.log(variance[status == code])))
        return total

    def until(
        self, bank: Bank, stop_ns: int, stretches: tuple[Stretch, ...] | None = None
    ) -> list[_Written] | None:
        """Carry a filter on over the epochs up to ``stop_ns``; return what it wrote, None if it did not come through."""
        told: list[_Written] = []
        for stretch in self.stretches if stretches is None else stretches:
            times_ns = stretch.rows.epoch_ns[stretch.first : stretch.last]
            now_ns = int(bank.head[0].now_ns)
            first, last = stretch.first + np.searchsorted(times_ns, [now_ns, stop_ns], side="right")
            if last <= first:
                continue
            rows = some_epochs(stretch.rows, int(first), int(last))
            out = new_output(rows, len(rows.epoch_ns), 64, np.zeros(0, np.int64), self.setup.layout.n_values)
            code, _ = run_epochs(
                bank, 0, len(rows.epoch_ns), rows, self.imu, self.parameters, -math.inf, out, self.work
            )
            if code != DONE:
                return None
            slot = rows.observation["slot"]
            for t_ns, i, j in zip(rows.epoch_ns, rows.first[:-1], rows.first[1:], strict=True):
                told.append(_Written(int(t_ns), slot[i:j], out.ledger[i:j]))
        return told

    def either(self, best: Verdict) -> Verdict | None:
        """Return the filter to which both sensors are suspect, for as long as it is not clear which one it is."""
        since_ns = [int(b.head[0].now_ns) for b in self.before[:-1]]
        found = []
        for start in self.before[:-1]:
            bank = with_fault(start, self.setup, ACCELEROMETER, _SIZES[1])
            verdict = self.verdict(EITHER, with_fault(bank, self.setup, GYRO, _SIZES[1]), self.stretches)
            if verdict is not None:
                found.append(verdict)
        assert since_ns
        if not found:
            return None
        return self.to_the_end(max(found, key=lambda v: v.log_likelihood))

    def to_the_end(self, verdict: Verdict) -> Verdict | None:
        """Return a verdict whose filter stands at the last epoch."""
        if verdict.suspect in (IMU_TAGS, GNSS_TAGS):
            return verdict
        stretches = tuple(e._replace(rows=_without(e.rows, verdict.satellites)) for e in self.stretches)
        if self.until(verdict.bank, self.now_ns, stretches) is None:
            return None
        for satellite in verdict.satellites:
            self.remember(verdict.bank, satellite)
        return verdict

    def remember(self, bank: Bank, satellite: int) -> None:
        """Let the filter know how fast a satellite that was left out runs away."""
        last = [w for w in self.base if self.end_ns - w.t_ns < 10 * NS_PER_S]
        now_s = self.now_ns * 1e-9
        for slot in range(satellite * N_BANDS, (satellite + 1) * N_BANDS):
            rates = np.concatenate([w.ledger["innovation"][w.slot == slot, RANGE_RATE] for w in last])
            rates = rates[np.isfinite(rates)]
            if len(rates):
                bank.memory[0, slot, RATE] = rates.mean()
                bank.memory[0, slot, RATE_S] = now_s
                bank.memory[0, slot, RATE_SINCE_S] = now_s - 60.0


class _Written(NamedTuple):
    """What the filter wrote of an epoch."""

    t_ns: int
    slot: Int64
    ledger: Table


def quiet(parameters: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the filter's numbers with nothing that stops the loop."""
    calm = parameters.copy()
    calm["suspicion_limit"] = 0.0
    calm["lockout_epochs"] = math.inf
    calm["strain_limit"] = math.inf
    return calm


def with_fault(bank: Bank, setup: FilterSetup, suspect: str, size: float) -> Bank:
    """Return a copy of a filter to which the biases of a sensor are unknown, ``size`` sigmas of the grade wide."""
    sensor = sensor_model(setup.grade)
    at, bias = (BA, sensor.accel_bias) if suspect == ACCELEROMETER else (BG, sensor.gyro_bias)
    found = copy_bank(bank)
    found.P[0, range(at, at + 3), range(at, at + 3)] += (size * bias.sigma) ** 2
    return found


def _later(rows: Rows, shift_ns: int, satellites_s: float) -> Rows:
    """Return rows with other time tags, the satellites carried on by ``satellites_s``."""
    sat = rows.sat
    if satellites_s != 0.0:
        sat = sat.copy()
        sat[:, :3] += satellites_s * sat[:, 3:6]
    before_ns = rows.before_ns + shift_ns * (rows.before_ns != 0)
    return rows._replace(epoch_ns=rows.epoch_ns + shift_ns, before_ns=before_ns, sat=sat)


def _without(rows: Rows, satellites: tuple[int, ...]) -> Rows:
    """Return rows without those of some satellites."""
    if not satellites:
        return rows
    gone = np.isin(rows.observation["slot"] // N_BANDS, satellites)
    observation = rows.observation.copy()
    status = observation["status"]
    status[gone[:, None] & (status == USED)] = DRIFTING
    carrier = rows.carrier
    if len(carrier):
        carrier = carrier.copy()
        carrier["status"][gone & (carrier["status"] == USED)] = DRIFTING
    return rows._replace(observation=observation, carrier=carrier)


def _fit(written: list[_Written]) -> bool:
    """Return whether most rows of each kind fit in the last epochs, and in the mean as well as they should."""
    if not written:
        return False
    ledger = np.concatenate([w.ledger for w in written[-_FITTING_EPOCHS:]])
    for kind in range(2):
        status = ledger["status"][:, kind]
        used = status == USED
        refused = np.sum((status == GATED) | (status == INCONSISTENT))
        if np.sum(used) + refused < _FEW:
            continue
        if np.sum(used) < _FITS * (np.sum(used) + refused):
            return False
        nis = ledger["innovation"][used, kind] ** 2 / ledger["variance"][used, kind]
        if float(nis.mean()) > _LARGEST_NIS:
            return False
    return True
