"""A rerun of the last minute: the filter of a minute ago over the epochs since, under each supposed fault.

The filter runs as it was; with the accelerometers' or the gyros' biases unknown from some instant on; without
satellites that may run away; with time tags that are off. Its likelihood says how well each explains what was seen.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.axes import of_axes
from insgnss.filter.diagnosis.past import EpochRanges, FilterHistory, rows_at
from insgnss.filter.diagnosis.ramps import of_wrong_rates, ramp_evidence, ramps
from insgnss.filter.diagnosis.supposed_faults import (
    ACCELEROMETER,
    ANY,
    EITHER,
    GNSS_TAGS,
    GYRO,
    IMU_TAGS,
    LAPSE,
    NOISE,
    NOISE2,
    RATES,
    SATELLITES,
    SENSORS,
    WIDEST,
    bias_of,
    quiet,
    with_errors_that_last,
    with_fault,
    without,
)
from insgnss.filter.diagnosis.tag_shifts import at_other_tags, earlier, later, summit
from insgnss.filter.diagnosis.witnesses import (
    MOST_SATELLITES,
    EpochLog,
    fits,
    most_satellites,
    run_away_sets,
    singles,
    tag_error_s,
)
from insgnss.filter.loop import DONE
from insgnss.filter.output.writing import new_output
from insgnss.filter.own_update import run_beside
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.setup import FilterSetup
from insgnss.filter.state import Bank, copy_bank
from insgnss.filter.update.creeping import KEPT_OUT_S
from insgnss.filter.update.epoch_space import new_workspace
from insgnss.filter.update.satellite_memory import LEFT_OUT_S, RATE, RATE_S, RATE_SINCE_S
from insgnss.filter.update.wrong_rates import RATES_OUT_NS
from insgnss.gnss.observation_rows import CARRIER, N_BANDS, PSEUDORANGE, some_epochs

_TOGETHER: Final = {EITHER: (ACCELEROMETER, GYRO), ANY: (ACCELEROMETER, GYRO, LAPSE)}
# how long ago the fault may have begun
_ONSETS_S: Final = (3.0, 5.0, 7.0, 9.0, 12.0, 15.0, 18.0, 22.0, 26.0, 32.0, 40.0, 50.0)
_HALVINGS: Final = 3  # so often the distance from the likeliest onset to its neighbours: 18 s become 2 s
_NEXT: Final = (0, 12, 2)  # so many satellites are tried with the likeliest one and two
WITHOUT_S: Final = 30.0  # for which satellites are left out
_LARGEST: Final = 6.0 * WIDEST  # by so many a bias does not jump: the sensor itself has failed
_TAGS_S: Final = (-0.1, -0.05, -0.02, 0.02, 0.05, 0.1)
_GNSS_TAGS_BACK: Final = 3  # so many onsets back those of GNSS may have begun
_SMALLEST_SHIFT_NS: Final = 10_000_000  # noise alone estimates some milliseconds
_LONGEST_SHIFT_NS: Final = 110_000_000
NOISY: Final = 4.0  # times what it was, or is assumed to be: a variance that shows most rows to be noise
_TAGS_EPOCHS: Final = 3


class Verdict(NamedTuple):
    """What has failed, the likelihood of the epochs if that is so, and the filter that allows for it."""

    suspect: str
    log_likelihood: float
    bank: Bank
    fits: bool
    satellites: tuple[int, ...] = ()  # slots
    rates_mps: tuple[float, ...] = ()  # at which these run away
    size: float = 0.0  # of the time tags' error [s]
    onset_ns: int = 0  # of a sensor's fault
    axes: tuple[int, ...] = ()  # of the sensor


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
        self.setup, self.imu = setup, imu
        self.past, self.stretches = past, tuple(e.alone() for e in past.epochs)
        self.end_ns, self.now_ns = span
        self.parameters = with_errors_that_last(quiet(parameters), past.banks[0])
        largest = max(int(np.diff(e.rows.first[e.first : e.last + 1]).max()) for e in past.epochs)
        self.work = new_workspace(largest, setup.layout, setup.installation, setup.visibility_limits)
        oldest_ns = int(past.banks[0].head[0].now_ns)
        onsets_ns = [self.end_ns - int(onset_s * NS_PER_S) for onset_s in reversed(_ONSETS_S)]
        bank = self.oldest()
        self.before: list[Bank] = []
        self.base: list[EpochLog] = []
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
        """Whether the noise between satellites has risen suddenly."""
        first, last = (bank.state["noise_factor"][0, :CARRIER] for bank in (self.before[0], self.before[-1]))
        return bool(np.any(last > NOISY * first))

    @property
    def noisy_ranges(self) -> bool:
        """Whether the pseudoranges' noise was far above the assumed level."""
        return any(bank.state["noise_factor"][0, PSEUDORANGE] > NOISY for bank in self.before)

    def suspects(self) -> Iterator[Verdict]:
        """Yield every supposed fault."""
        for suspect in (ACCELEROMETER, GYRO, LAPSE, NOISE, RATES):
            if suspect not in (ACCELEROMETER, GYRO) or bias_of(suspect, self.setup)[2].sigma > 0.0:
                # a sensor that is said to have no bias cannot have one that jumps
                yield from self.sensor(suspect)
        yield from self.without_satellites()
        yield from self.other_tags()
        yield from self.other_imu_tags()

    def sensor(self, suspect: str) -> list[Verdict]:
        """Return the results for a sensor's fault at every other onset, then refined around the best of these.

        A force that jumps shows at once: an onset that is some seconds wrong costs an accelerometer more likelihood
        than a gyro, whose fault shows with the square of time.
        """
        first_ns = _now_ns(self.before[0])
        found: dict[int, list[Verdict]] = {}
        tried: set[int] = set()

        def look(onsets_ns: Iterable[int]) -> None:
            for onset_ns in onsets_ns:
                bank = self.at(onset_ns)
                if bank is None or _now_ns(bank) in tried:
                    continue
                onset_ns = _now_ns(bank)
                tried.add(onset_ns)
                verdict = self.from_onset(suspect, bank, earlier=onset_ns == first_ns)
                if verdict is not None:
                    fits = verdict.fits and self.plausible(verdict.bank)
                    found[onset_ns] = self.of_axes(verdict._replace(fits=fits, onset_ns=onset_ns))

        look([_now_ns(bank) for bank in self.before[:-1]][::2])
        for _ in range(_HALVINGS):
            if found:
                look(_halfway(max(found, key=lambda t: found[t][0].log_likelihood), sorted(tried)))
        return [verdict for verdicts in found.values() for verdict in verdicts]

    def from_onset(self, suspect: str, bank: Bank, earlier: bool) -> Verdict | None:
        """Return the result for a fault that begins with ``bank``; for noise the mean over its rise."""
        each = []
        for risen2 in NOISE2 if suspect == NOISE else (1.0,):
            faulty = bank
            for part in _TOGETHER.get(suspect, (suspect,)):
                faulty = with_fault(faulty, self.setup, part, earlier, risen2)
            verdict = self.verdict(suspect, faulty, self.stretches)
            if verdict is not None:
                each.append(verdict)
        if not each:
            return None
        mean = float(np.logaddexp.reduce([verdict.log_likelihood for verdict in each])) - math.log(len(each))
        return max(each, key=lambda verdict: verdict.log_likelihood)._replace(log_likelihood=mean)

    def of_axes(self, verdict: Verdict) -> list[Verdict]:
        """Return a verdict on a sensor for each set of axes that may have jumped, the likeliest first."""
        if verdict.suspect not in (ACCELEROMETER, GYRO):
            return [verdict]
        at, name, bias = bias_of(verdict.suspect, self.setup)
        b = slice(at, at + 3)
        sound = self.before[-1]
        moved = verdict.bank.state[name][0] - sound.state[name][0]
        covariance = verdict.bank.P[0, b, b] - sound.P[0, b, b]
        gains = of_axes(moved, covariance, bias.sigma, WIDEST * bias.sigma)
        each = [
            verdict._replace(log_likelihood=verdict.log_likelihood + gains[axes], axes=axes) for axes in gains
        ]
        return sorted(each, key=lambda v: -v.log_likelihood)

    def at(self, t_ns: int) -> Bank | None:
        """Return the filter as it was at the last epoch up to a time; None where it came to nothing."""
        bank = copy_bank(max((b for b in self.before if _now_ns(b) <= t_ns), key=_now_ns))
        return None if self.until(bank, t_ns) is None else bank

    def plausible(self, bank: Bank) -> bool:
        """Return whether the biases are still plausible: a faulty or stuck sensor has no bias."""
        before, after = self.past.banks[0].state[0], bank.state[0]
        biases = (bias_of(sensor, self.setup) for sensor in (ACCELEROMETER, GYRO))
        return all(
            bool(np.abs(after[name] - before[name]).max() <= _LARGEST * bias.sigma)
            for _, name, bias in biases
        )

    def other_tags(self) -> Iterator[Verdict]:
        """Yield the results for GNSS time tags that are off since a few seconds."""
        rows = tuple((w, rows_at(self.stretches, w.t_ns)) for w in self.base[-_TAGS_EPOCHS:])
        for start in self.before[-1 - _GNSS_TAGS_BACK : -1]:
            found = self.shifted(GNSS_TAGS, start, -tag_error_s(rows))
            if found is not None:
                yield found

    def other_imu_tags(self) -> Iterator[Verdict]:
        """Yield the results for inertial time tags that are off from the start, then between the best of these."""
        found = {0.0: self.as_it_was}
        for shift_s in _TAGS_S:
            verdict = self.shifted(IMU_TAGS, self.oldest(), shift_s)
            if verdict is not None:
                found[shift_s] = verdict.log_likelihood
                yield verdict
        top_s = summit(found)
        verdict = self.shifted(IMU_TAGS, self.oldest(), top_s)
        if verdict is not None:
            yield verdict

    def shifted(self, suspect: str, start: Bank, shift_s: float) -> Verdict | None:
        """Return the result for time tags that are off by ``shift_s``; those of GNSS move the satellites.

        Epochs that a shift could bring before ``start``, or back behind it, count as they did: all shifts are judged by
        the same rows.
        """
        shift_ns = int(shift_s * NS_PER_S)
        if not _SMALLEST_SHIFT_NS < abs(shift_ns) < _LONGEST_SHIFT_NS:
            return None
        sound, bank, first_ns = copy_bank(start), copy_bank(start), _now_ns(start) + _LONGEST_SHIFT_NS
        if self.until(sound, first_ns) is None:
            return None
        for name in ("log_likelihood", "epoch_ns"):
            bank.head[name] = sound.head[name]
        first = [int(np.searchsorted(e.rows.epoch_ns, first_ns, side="right")) for e in self.stretches]
        begun = tuple(e._replace(first=k) for e, k in zip(self.stretches, first, strict=True))
        if suspect == IMU_TAGS:
            found = self.verdict(
                suspect, at_other_tags(bank, shift_ns), begun, imu=earlier(self.imu, shift_ns)
            )
        else:
            bank.head["epoch_ns"] += shift_ns
            bank.state["clone_ns"] += shift_ns * (bank.state["clone_ns"] != 0)
            begun = tuple(e._replace(rows=later(e.rows, shift_ns)) for e in begun)
            found = self.verdict(suspect, bank, begun, shift_ns)
        return None if found is None else found._replace(size=shift_s)

    def verdict(
        self,
        suspect: str,
        bank: Bank,
        stretches: EpochRanges,
        shift_ns: int = 0,
        imu: ImuSamples | None = None,
    ) -> Verdict | None:
        """Return the result for a suspicion; rows and samples ``imu`` may be those of other tags."""
        written = self.until(bank, self.end_ns + shift_ns, stretches, imu)
        if written is None:
            return None
        total = float(bank.head[0].log_likelihood)
        if suspect == RATES:
            total += of_wrong_rates(written, self.parameters[0])
        return Verdict(suspect, total, bank, fits(written, suspect in SENSORS))

    def without_satellites(self) -> Iterator[Verdict]:
        """Yield the results without each satellite, and without sets of two and three that drift away from the others.

        Candidate sets come from the range rates of the last seconds. Others add to the likeliest set the satellites
        that still look like a ramp in the filter without it.
        """
        starts = [b for b in self.before[:-1] if self.end_ns - int(b.head[0].now_ns) <= WITHOUT_S * NS_PER_S]
        most = most_satellites(self.base)
        if not starts or most < 1:
            return
        heard: dict[tuple[int, ...], tuple[Verdict, list[EpochLog]]] = {}

        def hear(sets: Iterable[tuple[int, ...]]) -> None:
            for satellites in sets:
                found = (
                    None
                    if satellites in heard or len(satellites) > most
                    else self.leaving_out(starts[0], satellites)
                )
                if found is not None:
                    heard[satellites] = found

        alone = singles(self.base, int(starts[0].head[0].now_ns))
        hear((*alone, *run_away_sets(self.base, self.end_ns)))
        for size in range(1, MOST_SATELLITES):
            of_size = [found for satellites, found in heard.items() if len(satellites) == size]
            if of_size:
                verdict, written = max(of_size, key=lambda found: found[0].log_likelihood)
                rest = [each for (each,) in alone if each not in verdict.satellites]
                rest.sort(key=lambda each: -ramp_evidence(written, each, self.parameters[0]))
                hear(tuple(sorted((*verdict.satellites, each))) for each in rest[: _NEXT[size]])
        for verdict, _ in heard.values():
            yield verdict

    def leaving_out(self, start: Bank, satellites: tuple[int, ...]) -> tuple[Verdict, list[EpochLog]] | None:
        """Return the result without some satellites, their rows charged as those of ramps, and the output written."""
        bank = copy_bank(start)
        written = self.until(bank, self.end_ns, self.stretches_without(satellites))
        if written is None:
            return None
        since = [w for w in self.base if w.t_ns > int(start.head[0].now_ns)]
        found = ramps(since, written, satellites, self.parameters[0])
        total = float(bank.head[0].log_likelihood) + sum(each.log_likelihood for each in found)
        rates = tuple(each.rate_mps for each in found)
        return Verdict(SATELLITES, total, bank, fits(written, False), satellites, rates), written

    def stretches_without(self, satellites: tuple[int, ...]) -> EpochRanges:
        """Return the last minute's rows without those of some satellites."""
        return tuple(each._replace(rows=without(each.rows, satellites)) for each in self.stretches)

    def until(
        self, bank: Bank, stop_ns: int, stretches: EpochRanges | None = None, imu: ImuSamples | None = None
    ) -> list[EpochLog] | None:
        """Carry a filter on over the epochs up to ``stop_ns``; return what it wrote, None if it came to nothing."""
        told: list[EpochLog] = []
        for stretch in self.stretches if stretches is None else stretches:
            times_ns = stretch.rows.epoch_ns[stretch.first : stretch.last]
            now_ns = int(bank.head[0].now_ns)
            first, last = stretch.first + np.searchsorted(times_ns, [now_ns, stop_ns], side="right")
            if last <= first:
                continue
            rows = some_epochs(stretch.rows, int(first), int(last))
            out = new_output(rows, len(rows.epoch_ns), 64, np.zeros(0, np.int64), self.setup.layout.n_shown)
            code = run_beside(bank, rows, imu or self.imu, self.parameters, out, self.work, self.setup)
            if code != DONE:
                return None
            slot = rows.observation["slot"]
            for t_ns, i, j in zip(rows.epoch_ns, rows.first[:-1], rows.first[1:], strict=True):
                told.append(EpochLog(int(t_ns), slot[i:j], out.ledger[i:j], out.carrier[i:j]))
        return told

    def either(self, lapse: bool) -> list[Verdict]:
        """Return the results where both sensors are suspect, for as long as it is not clear which one it is.

        ``lapse`` says whether one may have lied for a moment, too.
        """
        return [verdict._replace(suspect=EITHER) for verdict in self.sensor(ANY if lapse else EITHER)]

    def to_the_end(self, verdict: Verdict) -> Verdict | None:
        """Return a verdict whose filter is at the last epoch."""
        if verdict.suspect in (IMU_TAGS, GNSS_TAGS):
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
    return int(bank.head[0].now_ns)


def _halfway(best_ns: int, tried_ns: list[int]) -> tuple[int, ...]:
    """Return the times halfway from the best onset to those tried before and after it."""
    at = tried_ns.index(best_ns)
    return tuple((best_ns + t) // 2 for t in tried_ns[max(at - 1, 0) : at + 2] if t != best_ns)
