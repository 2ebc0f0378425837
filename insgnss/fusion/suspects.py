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
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.fusion.creeping import LEFT_OUT_S, RATE, RATE_S, RATE_SINCE_S
from insgnss.fusion.loop import DONE, new_workspace, run_epochs
from insgnss.fusion.output import Table, new_output
from insgnss.fusion.past import Past, Stretch
from insgnss.fusion.prediction import Imu
from insgnss.fusion.setup import FilterSetup
from insgnss.fusion.state import BA, BG, Bank, copy_bank
from insgnss.gnss.observation_rows import CARRIER, N_BANDS, RANGE_RATE, Rows, some_epochs
from insgnss.inertial.sensor_model import sensor_model
from insgnss.status import DRIFTING, GATED, INCONSISTENT, USED
from insgnss.tables import Int64

ACCELEROMETER, GYRO, EITHER = "accelerometer", "gyro", "accelerometer or gyro"
SATELLITES, IMU_TAGS, GNSS_TAGS = "satellites", "imu tags", "gnss tags"
SENSORS: Final = (ACCELEROMETER, GYRO, EITHER)

_SURE: Final = 20.0  # logarithm of the likelihood ratio at which a fault is believed
_APART: Final = 10.0  # the same between two suspects
_PATIENCE_NS: Final = 40 * NS_PER_S  # for that: two sensors look alike until the vehicle turns
_ONSETS_S: Final = (
    3.0,
    5.0,
    7.0,
    9.0,
    12.0,
    15.0,
    18.0,
    22.0,
    26.0,
    32.0,
    40.0,
    50.0,
)  # how long ago the fault may have begun
_SIZE: Final = 20.0  # sigmas of the grade's bias by which it may have jumped
_WITHOUT_S: Final = 30.0  # for which satellites are left out
_MOST_SATELLITES: Final = 3
_HELD_S: Final = 120.0  # that long a satellite that was found stays out, unless it is shown innocent before
_TELLING_S: Final = 5.0  # over which the means of the range rates say which satellites run away
_MOST_CANDIDATES: Final = 9
_LEAST_AGREEING: Final = 5
_RATE_FLOOR2: Final = 0.03**2  # of such a mean, see ``creeping`` [m^2/s^2]
_A_SATELLITE: Final = 5.0  # what leaving one out costs beside its rows: its own unknown error
_TAGS_S: Final = (-0.1, -0.05, -0.02, 0.02, 0.05, 0.1)
_GNSS_TAGS_BACK: Final = 4  # onsets before the end at which those of GNSS may have begun
_TAGS_EVERY_NS: Final = 120 * NS_PER_S
_LONGEST_SHIFT_NS: Final = 110_000_000
_STORMY: Final = 4.0  # by what a noise level rises when most rows of an epoch are noise
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


def run_away(
    past: Past, bank: Bank, setup: FilterSetup, imu: Imu, parameters: npt.NDArray[Any]
) -> tuple[Verdict | None, Past]:
    """Return the filter that has left out from the start the satellites which ``bank`` has just found to creep."""
    past, span = past.judged()
    until_s = bank.memory[0, :, LEFT_OUT_S]
    if span is None:
        return None, past
    satellites = tuple(int(n) for n in np.unique(np.flatnonzero(until_s > span[1] * 1e-9) // N_BANDS))
    again = _Again(past.of_late(int(_WITHOUT_S * NS_PER_S)), setup, imu, parameters, span)
    if not again.came_through or not 0 < len(satellites) <= _MOST_SATELLITES:
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
    again = _Again(past, setup, imu, parameters, span)
    if not again.came_through:
        return None, past
    found = list(again.suspects())
    if past.tags_are_due(_TAGS_EVERY_NS):
        found += again.other_tags()
        past = replace(past, tags_ns=span[1])
    found.sort(key=lambda v: -v.log_likelihood)
    best = next((v for v in found if v.fits), None)
    if best is None or best.log_likelihood - again.as_it_was < _SURE:
        return None, replace(past, unclear_ns=0)
    if found[0].log_likelihood - best.log_likelihood > _APART:
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

    @property
    def stormy(self) -> bool:
        """Whether the noise of what the satellites show against each other has risen at a stroke."""
        first, last = (bank.state["noise_factor"][0, :CARRIER] for bank in (self.before[0], self.before[-1]))
        return bool(np.any(last > _STORMY * first))

    def suspects(self) -> Iterator[Verdict]:
        """Yield all that may have failed."""
        for suspect in (ACCELEROMETER, GYRO):
            yield from self.sensor(suspect)
        yield from self.without_satellites()

    def sensor(self, suspect: str) -> list[Verdict]:
        """Return what comes of a sensor's fault that began at every other onset, then beside the best of these."""
        found: dict[int, Verdict] = {}

        def look(indices: Iterable[int]) -> None:
            for i in indices:
                if i in found or not 0 <= i < len(self.before) - 1:
                    continue
                bank = self.before[i]
                for each in (ACCELEROMETER, GYRO) if suspect == EITHER else (suspect,):
                    bank = with_fault(bank, self.setup, each)
                verdict = self.verdict(suspect, bank, self.stretches)
                if verdict is not None:
                    found[i] = verdict

        look(range(0, len(self.before) - 1, 2))
        if found:
            best = max(found, key=lambda i: found[i].log_likelihood)
            look((best - 1, best + 1))
        return list(found.values())

    def other_tags(self) -> Iterator[Verdict]:
        """Yield what comes of other time tags: inertial ones from the start on, those of GNSS since a while."""
        for shift_s in _TAGS_S:
            found = self.shifted(IMU_TAGS, self.oldest(), shift_s)
            if found is not None:
                yield found
        if len(self.before) > _GNSS_TAGS_BACK:
            start = copy_bank(self.before[-_GNSS_TAGS_BACK])
            rows = tuple((w, self.rows_at(w.t_ns)) for w in self.base[-_FITTING_EPOCHS:])
            found = self.shifted(GNSS_TAGS, start, tag_error_s(rows))
            if found is not None:
                yield found

    def shifted(self, suspect: str, bank: Bank, shift_s: float) -> Verdict | None:
        """Return what comes of time tags that are off by ``shift_s``; those of GNSS tell where the satellites were."""
        shift_ns = int(shift_s * NS_PER_S)
        if abs(shift_ns) > _LONGEST_SHIFT_NS:
            return None
        bank.state["clone_ns"] += shift_ns * (bank.state["clone_ns"] != 0)
        satellites_s = shift_s if suspect == GNSS_TAGS else 0.0
        shifted = tuple(e._replace(rows=_later(e.rows, shift_ns, satellites_s)) for e in self.stretches)
        found = self.verdict(suspect, bank, shifted, shift_ns)
        return None if found is None else found._replace(size=shift_s)

    def rows_at(self, t_ns: int) -> Rows:
        """Return the rows of one epoch of the past."""
        for stretch in self.stretches:
            k = (
                int(np.searchsorted(stretch.rows.epoch_ns[stretch.first : stretch.last], t_ns))
                + stretch.first
            )
            if k < stretch.last and int(stretch.rows.epoch_ns[k]) == t_ns:
                return some_epochs(stretch.rows, k, k + 1)
        raise AssertionError("an epoch that was written is in the past")

    def verdict(
        self, suspect: str, bank: Bank, stretches: tuple[Stretch, ...], shift_ns: int = 0
    ) -> Verdict | None:
        """Return what comes of a suspicion."""
        written = self.until(bank, self.end_ns + shift_ns, stretches)
        if written is None:
            return None
        return Verdict(suspect, float(bank.head[0].log_likelihood), bank, _fit(written))

    def without_satellites(self) -> Iterator[Verdict]:
        """Yield what comes of leaving out one, two and three satellites that run away from the others."""
        starts = [b for b in self.before[:-1] if self.end_ns - int(b.head[0].now_ns) <= _WITHOUT_S * NS_PER_S]
        for satellites in run_away_sets(self.base, self.end_ns) if starts else ():
            verdict = self.leaving_out(starts[0], satellites)
            if verdict is not None:
                yield verdict

    def leaving_out(self, start: Bank, satellites: tuple[int, ...]) -> Verdict | None:
        """Return what comes of leaving satellites out, their rows charged as if they fitted."""
        stretches = tuple(e._replace(rows=_without(e.rows, satellites)) for e in self.stretches)
        verdict = self.verdict(SATELLITES, copy_bank(start), stretches)
        if verdict is None:
            return None
        cost = sum(self.cost(each, int(start.head[0].now_ns)) + _A_SATELLITE for each in satellites)
        return verdict._replace(log_likelihood=verdict.log_likelihood - cost, satellites=satellites)

    def cost(self, satellite: int, since_ns: int) -> float:
        """Return what a satellite's rows cost that are left out: as much as rows that fit, or as refused ones did."""
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
        """Carry a filter on over the epochs up to ``stop_ns``; return what it wrote, None if it came to nothing."""
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
        found = self.sensor(EITHER)
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
                bank.memory[0, slot, RATE_SINCE_S] = now_s - _HELD_S
                bank.memory[0, slot, LEFT_OUT_S] = now_s + _HELD_S


class _Written(NamedTuple):
    """What the filter wrote of an epoch."""

    t_ns: int
    slot: Int64
    ledger: Table


def run_away_sets(written: list[_Written], end_ns: int) -> list[tuple[int, ...]]:
    """Return the one, two and three satellites without which the last seconds' range rates agree best.

    Equation: the set without which the weighted sum of squares of the means' parity part is least, see ``integrity``
    """
    sums: dict[int, Any] = {}
    for epoch in written:
        if end_ns - epoch.t_ns > _TELLING_S * NS_PER_S:
            continue
        status = epoch.ledger["status"][:, RANGE_RATE]
        for k in np.flatnonzero((status == USED) | (status == GATED)):
            entry = epoch.ledger[k]
            r = float(entry.variance[RANGE_RATE] - entry.predicted[RANGE_RATE])
            row = np.array([1.0, entry.innovation[RANGE_RATE], r, *(-entry.u_n), 1.0])
            total = sums.setdefault(int(epoch.slot[k]) // N_BANDS, np.zeros(7))
            total += row
    names = [number for number, total in sums.items() if total[0] >= _FEW]
    if len(names) <= _LEAST_AGREEING:
        return []
    table = np.array([sums[number] / sums[number][0] for number in names])
    count = np.array([sums[number][0] for number in names])
    weight = 1.0 / np.sqrt(table[:, 2] / count + _RATE_FLOOR2)
    y, G = table[:, 1] * weight, table[:, 3:] * weight[:, None]

    def left(out: tuple[int, ...]) -> float:
        keep = np.delete(np.arange(len(names)), out)
        x = np.linalg.lstsq(G[keep], y[keep], rcond=None)[0]
        return float(np.sum((y[keep] - G[keep] @ x) ** 2))

    likely = sorted(range(len(names)), key=lambda i: left((i,)))[:_MOST_CANDIDATES]
    sizes = range(1, min(_MOST_SATELLITES, len(names) - _LEAST_AGREEING) + 1)
    best = [min(itertools.combinations(likely, size), key=left) for size in sizes]
    return [tuple(names[i] for i in chosen) for chosen in best]


def tag_error_s(epochs: tuple[tuple[_Written, Rows], ...]) -> float:
    """Return by how much the GNSS tags seem to be late: their error moves each satellite by its own range rate.

    Equation: y = -dt (rate - mean rate) + common, by least squares over the last epochs
    """
    above = below = 0.0
    for written, rows in epochs:
        status = written.ledger["status"][:, 0]
        told = (status == USED) | (status == GATED)
        rate = (rows.observation["value"][:, RANGE_RATE] + rows.sat[:, 7])[told]
        y = written.ledger["innovation"][told, 0]
        told = np.isfinite(rate) & np.isfinite(y)
        if np.sum(told) > _LEAST_AGREEING:
            apart = rate[told] - rate[told].mean()
            above -= float(apart @ y[told])
            below += float(apart @ apart)
    return above / below if below > 0.0 else 0.0


def quiet(parameters: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the filter's numbers with nothing that stops the loop."""
    calm = parameters.copy()
    calm["suspicion_limit"] = 0.0
    calm["lockout_epochs"] = math.inf
    calm["strain_limit"] = math.inf
    return calm


def with_fault(bank: Bank, setup: FilterSetup, suspect: str) -> Bank:
    """Return a copy of a filter to which the biases of a sensor are unknown, twenty sigmas of the grade wide."""
    sensor = sensor_model(setup.grade)
    at, bias = (BA, sensor.accel_bias) if suspect == ACCELEROMETER else (BG, sensor.gyro_bias)
    found = copy_bank(bank)
    found.P[0, range(at, at + 3), range(at, at + 3)] += (_SIZE * bias.sigma) ** 2
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
