"""A rerun of the last minute: the filter of a minute ago over the epochs since, under each supposed fault.

The filter runs as it was, and under each fault that ``suspects`` lists. Its likelihood says how well each explains what
was seen.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable
from concurrent.futures import Executor
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.axes import of_axes
from insgnss.filter.diagnosis.jumps import (
    ACCELEROMETER,
    GYRO,
    Widths,
    bias_of,
    estimated_widths,
    largest_jump,
)
from insgnss.filter.diagnosis.past import EpochRanges, FilterHistory, in_one_piece
from insgnss.filter.diagnosis.ramps import WrittenRows, of_wrong_rates, ramp_evidence, ramps
from insgnss.filter.diagnosis.supposed_faults import (
    CLEAR,
    EARLIEST_S,
    EITHER,
    EITHER_OR_LAPSE,
    EITHER_OR_SHOCK,
    INSTALLATION,
    LAPSE,
    RATES,
    RISEN2,
    SATELLITES,
    SENSORS,
    SHOCK,
    SURE,
    quiet,
    together,
    with_errors_that_last,
    with_fault,
    without,
)
from insgnss.filter.diagnosis.witnesses import (
    MOST_SATELLITES,
    EpochLog,
    fits,
    most_satellites,
    run_away_sets,
    singles,
)
from insgnss.filter.loop import DONE
from insgnss.filter.output.writing import new_output
from insgnss.filter.own_update import run_beside
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.setup import FilterSetup, WorkOfThread
from insgnss.filter.state import Bank, copy_bank
from insgnss.filter.update.creeping import KEPT_OUT_S
from insgnss.filter.update.satellite_memory import LEFT_OUT_S, RATE, RATE_S, RATE_SINCE_S
from insgnss.filter.update.wrong_rates import RATES_OUT_NS
from insgnss.gnss.observation_rows import CARRIER, N_BANDS, PSEUDORANGE, some_epochs

# how long ago the fault may have begun
_ONSETS_S: Final = (*range(2, 11), 12, 15, 18, 22, 26, 32, 40, 50)
_APART_S: Final = 1.0  # from an onset to the next
_YOUNG_S: Final = 10.0  # of younger faults every onset is tried at first: a jump of a force fits at one only
_HALVINGS: Final = 3  # so often the distance from the likeliest onset to its neighbours: 18 s become 2 s
_NEXT: Final = (0, 12, 2)  # so many satellites are tried with the likeliest one and two
WITHOUT_S: Final = 30.0  # for which satellites are left out
_LARGEST: Final = 6.0  # times the largest jump's sigma: no bias, the sensor gives anything
NOISY: Final = 4.0  # times what it was, or is assumed to be: a variance that shows most rows to be noise


class Verdict(NamedTuple):
    """What has failed, the likelihood of the epochs if that is so, and the filter that allows for it."""

    suspect: str
    log_likelihood: float
    bank: Bank
    fits: bool
    satellites: tuple[int, ...] = ()  # slots
    rates_mps: tuple[float, ...] = ()  # at which these run away
    size: float = 0.0  # of the inertial tags' error, of a further sensor's lateness [s]
    onset_ns: int = 0  # of a sensor's fault
    later_s: float = 0.0  # by which it may be at most
    axes: tuple[int, ...] = ()  # of the sensor
    moved: tuple[float, ...] = ()  # (3,) by which its biases jumped [rad/s] or [m/s^2]
    kinds: tuple[str, ...] = ()  # of own rows
    setup: FilterSetup | None = None  # of a filter with further states


class Hindsight:
    """The filter of a minute ago and its inputs since then."""

    def __init__(
        self,
        past: FilterHistory,
        setup: FilterSetup,
        imu: ImuSamples,
        parameters: npt.NDArray[Any],
        span: tuple[int, int],
    ) -> None:
        """Run it as it was; ``span`` is where the judgement ends and the time of the last epoch."""
        self.setup, self.imu, self.work = setup, imu, WorkOfThread()
        self.past, self.stretches = past, in_one_piece(past.epochs)
        self.end_ns, self.now_ns = span
        self.parameters = with_errors_that_last(quiet(parameters), past.banks[0])
        self.most_rows = max(int(np.diff(e.rows.first[e.first : e.last + 1]).max()) for e in past.epochs)
        oldest_ns = int(past.banks[0].head[0].now_ns)
        onsets_ns = [self.end_ns - onset_s * NS_PER_S for onset_s in reversed(_ONSETS_S)]
        bank = self.oldest()
        self.before: list[Bank] = []
        self.known: dict[int, Bank | None] = {}  # filters of other times, as they are asked for
        self.base: list[EpochLog] = []
        self.since: dict[int, WrittenRows] = {}  # of the base, what was written after a time
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
        bank.head["heading_open"], bank.head["log_likelihood"] = 0, 0.0
        return bank

    @property
    def stormy(self) -> bool:
        """Whether the noise between satellites has risen suddenly."""
        first, last = (bank.state["noise_factor"][0, :CARRIER] for bank in (self.before[0], self.before[-1]))
        return bool(np.any(last > NOISY * first))

    @property
    def noisy_ranges(self) -> bool:
        """Whether the pseudoranges' noise was far above the assumed level."""
        return any(bank.state["noise_factor"][0, PSEUDORANGE] > NOISY for bank in self.before)

    def sensor(self, suspect: str, widths: Widths | None = None) -> list[Verdict]:
        """Return the results for a sensor's fault at many onsets, then refined around the best of these.

        A bias may have jumped between those that were tried. That takes what has moved by then for unknown, which
        explains much: it must be clearly likelier, or late time tags would pass for it. Without a fault it is not
        tried. ``widths`` of the jumps: by default the largest.
        """
        verdicts = self._over_onsets(suspect, widths, 0.0)
        best = max(map(log_likelihood_of, verdicts), default=-math.inf)
        jumps = not {ACCELEROMETER, GYRO}.isdisjoint(together(suspect))
        if not jumps or best < self.as_it_was + CLEAR:
            return verdicts
        between = self._over_onsets(suspect, widths, _APART_S)
        return between if max(map(log_likelihood_of, between), default=best) > best + CLEAR else verdicts

    def _over_onsets(self, suspect: str, widths: Widths | None, later_s: float) -> list[Verdict]:
        """Return the results for a fault up to ``later_s`` after each onset; the distance to the next if that is less.

        Of the older ones every other is tried. A force that jumps shows at once: an onset that is some seconds wrong
        costs an accelerometer more likelihood than a gyro, whose fault shows with the square of time.
        """
        by_onset: dict[int, list[Verdict]] = {}
        tried: set[int] = set()

        def look(onsets_ns: Iterable[int], within_s: float) -> None:
            for onset_ns in onsets_ns:
                bank = self.at(onset_ns)
                if bank is None or _now_ns(bank) in tried:
                    continue
                onset_ns = _now_ns(bank)
                tried.add(onset_ns)
                largest = self.largest_jumps(onset_ns)
                verdict = self.from_onset(suspect, bank, widths or largest, within_s)
                if verdict is not None:
                    fits = verdict.fits and self.plausible(verdict.bank, largest)
                    verdict = verdict._replace(fits=fits, onset_ns=onset_ns, later_s=within_s)
                    by_onset[onset_ns] = self.of_axes(verdict, largest)

        onsets_ns = [_now_ns(bank) for bank in self.before[:-1]]
        young_ns = self.end_ns - _YOUNG_S * NS_PER_S
        look((*onsets_ns[::2], *(t_ns for t_ns in onsets_ns if t_ns > young_ns)), later_s)
        for _ in range(_HALVINGS):
            if by_onset:
                best_ns = max(by_onset, key=lambda t: by_onset[t][0].log_likelihood)
                for onset_ns in _halfway(best_ns, sorted(tried)):
                    look((onset_ns,), min(abs(onset_ns - best_ns) / NS_PER_S, later_s))
        return [verdict for verdicts in by_onset.values() for verdict in verdicts]

    def largest_jumps(self, onset_ns: int) -> Widths:
        """Return the widths of the largest jumps that began at ``onset_ns``."""
        since_s = (self.end_ns - onset_ns) / NS_PER_S
        if onset_ns == _now_ns(self.before[0]):
            since_s += EARLIEST_S
        return {
            sensor: np.full(3, largest_jump(sensor, self.setup, since_s)) for sensor in (ACCELEROMETER, GYRO)
        }

    def from_onset(self, suspect: str, bank: Bank, widths: Widths, later_s: float) -> Verdict | None:
        """Return the result for a fault that begins with ``bank``; for noise the mean over its levels."""
        levels = RISEN2.get(suspect, (1.0,))
        each: list[Verdict] = []
        earlier = _now_ns(bank) == _now_ns(self.before[0])
        for risen2 in levels:
            faulty = bank
            for part in together(suspect):
                faulty = with_fault(faulty, self.setup, part, widths.get(part), earlier, later_s, risen2)
            verdict = self.verdict(suspect, faulty, self.stretches)
            if verdict is None:
                continue
            before, fitted = (each[-1].log_likelihood, each[-1].fits) if each else (self.as_it_was, True)
            each.append(verdict)
            if fitted and verdict.log_likelihood < before - SURE:
                break  # a variance that is larger still only costs
        if not each:
            return None
        mean = float(np.logaddexp.reduce([v.log_likelihood for v in each])) - math.log(len(levels))
        return max(each, key=lambda verdict: (verdict.fits, verdict.log_likelihood))._replace(
            log_likelihood=mean
        )

    def of_axes(self, verdict: Verdict, largest: Widths) -> list[Verdict]:
        """Return a verdict on a sensor for each set of axes that may have jumped, the likeliest first."""
        if verdict.suspect not in (ACCELEROMETER, GYRO):
            return [verdict]
        at, name, bias = bias_of(verdict.suspect, self.setup)
        b = slice(at, at + 3)
        sound = self.before[-1]
        moved = verdict.bank.state[name][0] - sound.state[name][0]
        covariance = verdict.bank.P[0, b, b] - sound.P[0, b, b]
        gains = of_axes(moved, covariance, bias.sigma, float(largest[verdict.suspect][0]))
        verdict = verdict._replace(moved=tuple(moved.tolist()))
        each = [
            verdict._replace(log_likelihood=verdict.log_likelihood + gains[axes], axes=axes) for axes in gains
        ]
        return sorted(each, key=lambda v: -v.log_likelihood)

    def with_sound_axes(self, verdict: Verdict) -> Verdict:
        """Return a verdict on a sensor whose filter knows the axes that have not jumped as a sound one does."""
        widths = estimated_widths(verdict.suspect, self.setup, [(verdict.axes, verdict.moved)])
        if np.array_equal(widths, self.largest_jumps(verdict.onset_ns)[verdict.suspect]):
            return verdict
        bank = self.at(verdict.onset_ns)
        known = {verdict.suspect: widths}
        again = None if bank is None else self.from_onset(verdict.suspect, bank, known, verdict.later_s)
        return verdict if again is None else verdict._replace(bank=again.bank)

    def at(self, t_ns: int) -> Bank | None:
        """Return the filter as it was at the last epoch up to a time, to be copied; None where it came to nothing."""
        if t_ns not in self.known:
            bank = copy_bank(self.before[bisect_right(self.before, t_ns, key=_now_ns) - 1])
            self.known[t_ns] = None if self.until(bank, t_ns) is None else bank
        return self.known[t_ns]

    def plausible(self, bank: Bank, largest: Widths) -> bool:
        """Return whether the biases are still plausible: a faulty or stuck sensor has no bias."""
        before, after = self.past.banks[0].state[0], bank.state[0]
        names = {sensor: bias_of(sensor, self.setup)[1] for sensor in largest}
        return all(
            bool(np.abs(after[name] - before[name]).max() <= _LARGEST * largest[sensor][0])
            for sensor, name in names.items()
        )

    def verdict(
        self,
        suspect: str,
        bank: Bank,
        stretches: EpochRanges,
        imu: ImuSamples | None = None,
    ) -> Verdict | None:
        """Return the result for a suspicion; the samples ``imu`` may be those of other tags."""
        written = self.until(bank, self.end_ns, stretches, imu)
        if written is None:
            return None
        total = float(bank.head[0].log_likelihood)
        if suspect == RATES:
            total += of_wrong_rates(written, self.parameters[0])
        return Verdict(suspect, total, bank, fits(written, suspect in SENSORS))

    def without_satellites(self, pool: Executor) -> list[Verdict]:
        """Return the results without each satellite, and without sets of two and three that drift away from the others.

        Candidate sets come from the range rates of the last seconds. Others add to the likeliest set the satellites
        that still look like a ramp in the filter without it.
        """
        starts = [b for b in self.before[:-1] if self.end_ns - _now_ns(b) <= WITHOUT_S * NS_PER_S]
        most = most_satellites(self.base)
        if not starts or most < 1:
            return []
        heard: dict[tuple[int, ...], tuple[Verdict, WrittenRows]] = {}

        def hear(sets: Iterable[tuple[int, ...]]) -> None:
            new = [each for each in dict.fromkeys(sets) if each not in heard and len(each) <= most]
            results = pool.map(partial(self.leaving_out, starts[0]), new)
            heard.update(
                {each: result for each, result in zip(new, results, strict=True) if result is not None}
            )

        alone = singles(self.base, _now_ns(starts[0]))
        hear((*alone, *run_away_sets(self.base, self.end_ns)))
        for size in range(1, MOST_SATELLITES):
            of_size = [entry for satellites, entry in heard.items() if len(satellites) == size]
            if of_size:
                verdict, written = max(of_size, key=lambda entry: entry[0].log_likelihood)
                rest = [each for (each,) in alone if each not in verdict.satellites]
                rest.sort(key=lambda each: -ramp_evidence(written, each, self.parameters[0]))
                hear(tuple(sorted((*verdict.satellites, each))) for each in rest[: _NEXT[size]])
        return [verdict for verdict, _ in heard.values()]

    def leaving_out(self, start: Bank, satellites: tuple[int, ...]) -> tuple[Verdict, WrittenRows] | None:
        """Return the result without some satellites, their rows charged as those of ramps, and the output written."""
        bank = copy_bank(start)
        written = self.until(bank, self.end_ns, self.stretches_without(satellites))
        if written is None:
            return None
        rows, since_ns = WrittenRows(written), _now_ns(start)
        if since_ns not in self.since:
            self.since[since_ns] = WrittenRows([w for w in self.base if w.t_ns > since_ns])
        satellite_ramps = ramps(self.since[since_ns], rows, satellites, self.parameters[0])
        total = float(bank.head[0].log_likelihood) + sum(each.log_likelihood for each in satellite_ramps)
        rates = tuple(each.rate_mps for each in satellite_ramps)
        return Verdict(SATELLITES, total, bank, fits(written, False), satellites, rates), rows

    def stretches_without(self, satellites: tuple[int, ...]) -> EpochRanges:
        """Return the last minute's rows without those of some satellites."""
        return tuple(each._replace(rows=without(each.rows, satellites)) for each in self.stretches)

    def until(
        self, bank: Bank, stop_ns: int, stretches: EpochRanges | None = None, imu: ImuSamples | None = None
    ) -> list[EpochLog] | None:
        """Carry a filter on over the epochs up to ``stop_ns``; return what it wrote, None if it came to nothing."""
        epochs: list[EpochLog] = []
        work = self.work.space(self.setup, self.most_rows)
        for stretch in self.stretches if stretches is None else stretches:
            times_ns = stretch.rows.epoch_ns[stretch.first : stretch.last]
            first, last = stretch.first + np.searchsorted(times_ns, [_now_ns(bank), stop_ns], side="right")
            if last <= first:
                continue
            rows = some_epochs(stretch.rows, int(first), int(last))
            out = new_output(rows, len(rows.epoch_ns), 64, np.zeros(0, np.int64), self.setup.layout.n_shown)
            code = run_beside(bank, rows, imu or self.imu, self.parameters, out, work, self.setup)
            if code != DONE:
                return None
            slot = rows.observation["slot"]
            for t_ns, i, j in zip(rows.epoch_ns, rows.first[:-1], rows.first[1:], strict=True):
                epochs.append(EpochLog(int(t_ns), slot[i:j], out.ledger[i:j], out.carrier[i:j]))
        return epochs

    def either(self, likely: Iterable[Verdict]) -> list[Verdict]:
        """Return the results where both sensors are suspect, for as long as it is not clear which one it is.

        Their jumps may be those of the ``likely`` verdicts; that one lied for a moment is possible if one says so.
        """
        jumps = [(v.suspect, v.axes, v.moved) for v in likely]
        widths = {
            sensor: estimated_widths(sensor, self.setup, [(a, m) for of, a, m in jumps if of == sensor])
            for sensor in (ACCELEROMETER, GYRO)
        }
        named = {of for of, _, _ in jumps}
        suspect = EITHER_OR_LAPSE if LAPSE in named else EITHER_OR_SHOCK if SHOCK in named else EITHER
        return [verdict._replace(suspect=EITHER) for verdict in self.sensor(suspect, widths)]

    def to_the_end(self, verdict: Verdict) -> Verdict | None:
        """Return a verdict whose filter is at the last epoch."""
        if verdict.suspect in INSTALLATION:
            return verdict
        if self.until(verdict.bank, self.now_ns, self.stretches_without(verdict.satellites)) is None:
            return None
        if verdict.suspect == RATES:
            verdict.bank.state["rates_out_ns"] = self.now_ns + RATES_OUT_NS
        for satellite, rate in zip(verdict.satellites, verdict.rates_mps, strict=True):
            of_it = verdict.bank.memory[0, satellite * N_BANDS : (satellite + 1) * N_BANDS]
            of_it[:, RATE] = rate
            of_it[:, RATE_S] = self.now_ns * 1e-9
            of_it[:, RATE_SINCE_S] = self.now_ns * 1e-9 - KEPT_OUT_S
            of_it[:, LEFT_OUT_S] = self.now_ns * 1e-9 + KEPT_OUT_S
        return verdict


def _now_ns(bank: Bank) -> int:
    return int(bank.head["now_ns"][0])


def log_likelihood_of(verdict: Verdict) -> float:
    """Return a verdict's log-likelihood, by which they are compared."""
    return verdict.log_likelihood


def _halfway(best_ns: int, tried_ns: list[int]) -> tuple[int, ...]:
    """Return the times halfway from the best onset to those tried before and after it."""
    at = tried_ns.index(best_ns)
    return tuple((best_ns + t) // 2 for t in tried_ns[max(at - 1, 0) : at + 2] if t != best_ns)
