"""A receiver on samples beside its tight filter: search, channels, observables, filter, aiding back into the loops.

Everything is done in the order in which it would be known: an inertial sample, the aiding that the filter computes
from it,
the epoch that ends there with what the replicas showed at that moment, then the integrations that begin before the next
inertial sample, steered by that aiding. The receiver's clock tags samples and epochs; inertial samples are tagged by
GPS time. Neglects: the clock's error between the two, 5 mHz of Doppler for 20 us and 5 g.

The start is warm: position, velocity, attitude, messages and a time good to ``time_sigma_s`` are given: they say
which code period and data bit arrives. Nothing is read from the data bits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from insgnss.aiding.table import AidingTable
from insgnss.config.sample_receiver import SampleReceiver
from insgnss.constants import C_MPS, NS_PER_S
from insgnss.errors import InputError
from insgnss.filter.setup import FilterSetup
from insgnss.receiver.detection import detector
from insgnss.receiver.search_window import search_window, signal_scale
from insgnss.runs.engine import Engine
from insgnss.studies.samples.design import RecordingBuffer, loop_designs, loop_sigmas
from insgnss.studies.samples.search import (
    SearchOutcome,
    SignalPrediction,
    expected_by_aiding,
    search_for,
    seeded_span,
    unseeded_span,
)
from insgnss.tables import Bool, GnssTable, ImuTable
from insgnss.tracking.acquisition import SILENT, SILENT_ADVICE
from insgnss.tracking.channel_kernel import RATE
from insgnss.tracking.codes import GPS_BIT_S, RangingCode
from insgnss.tracking.lock_and_cn0 import moment_cn0_dbhz, phase_lock
from insgnss.tracking.sample_channel import LoopAiding, SampleChannels
from insgnss.tracking.signal import Sampling, SignalSamples

SEARCHING: Final = ("control_detection", "search")  # states of the supervisor in which a receiver looks
_JUDGED_S: Final = 1.0  # over which lock and C/N0 are estimated
_CN0_MEMORY: Final = 0.8  # share of an estimate that stays at the next one
_CN0_SPAN_DBHZ: Final = (20.0, 55.0)
_LATE_S: Final = 0.05  # samples beyond an interval that its integrations may need


@dataclass(frozen=True)
class SampleEquipment:
    """Equipment common to both receivers."""

    settings: SampleReceiver
    sv_names: tuple[str, ...]
    codes: tuple[RangingCode, ...]
    start_ns: int  # receiver time of the first sample
    setup: FilterSetup
    imu: ImuTable
    at_start: SignalPrediction  # by the given start
    cn0_dbhz: float  # given: of the link budget

    @property
    def sampling(self) -> Sampling:
        """Return how the signal is sampled."""
        return sampling_of(self.settings)


def sampling_of(settings: SampleReceiver) -> Sampling:
    """Return how the front end samples the signal."""
    return Sampling(settings.rate_hz, settings.intermediate_hz, settings.is_complex)


class SampleLoop:
    """One receiver on samples.

    Parameters
    ----------
    aided : whether the filter's aiding goes into the loops, and its supervisor seeds the searches
    """

    def __init__(self, equipment: SampleEquipment, *, aided: bool) -> None:
        e, s = equipment, equipment.settings
        self.equipment, self.aided = e, aided
        self._m = m = len(e.codes)
        loops = s.aided if aided else s.unaided
        self._design, self._wide = loop_designs(s, loops, e.codes[0], e.cn0_dbhz)
        self.channels: SampleChannels
        self.searches: list[tuple[int, SearchOutcome]] = []
        self.epochs: list[dict[str, float]] = []
        self.tracking: list[dict[str, Any]] = []
        aiding = e.setup.config.aiding.model_copy(update={"rate_hz": s.aiding_rate_hz})
        self.engine = Engine(e.setup, aiding=aiding, on_aiding=self, supervise=aided)
        self._table: AidingTable | None = None  # not taken over yet
        self._expected = e.at_start
        self._week = 0
        self._scale = signal_scale(s.search.grid)
        self._need = detector(s.search.detection)
        self._aiding = LoopAiding(np.zeros(m), np.zeros(m), np.zeros(m))
        self._has_aid, self._locked = np.zeros(m, np.bool_), np.zeros(m, np.bool_)
        self._cn0 = np.full(m, e.cn0_dbhz)
        self._opened = np.zeros(m)  # sample
        self._lost = np.full(m, np.nan)  # sample since which there is no lock
        self._tried = np.full(m, -np.inf)  # sample of the last search
        self._sigma_of: dict[int, tuple[float, float]] = {}

    def send(self, table: AidingTable, week: int) -> None:
        """Take the filter's aiding of one instant."""
        self._table, self._week = table, week

    def run(self, blocks: Iterator[SignalSamples]) -> None:
        """Run over a recording, from its first sample to the last inertial sample inside.

        Raises
        ------
        InputError : the recording is shorter than an acquisition, or ends before the first epoch after it
        """
        e, s = self.equipment, self.equipment.settings
        rate, t_ns = s.rate_hz, e.imu.t_ns
        dwell = round(s.looks * s.look_s * rate)
        buffer = RecordingBuffer(blocks, dwell + round(_LATE_S * rate))
        if not buffer.reach(dwell):
            message = f"the recording is shorter than an acquisition of {s.looks * s.look_s:g} s"
            raise InputError(message, advice="take a longer one, or fewer looks")
        head = buffer.cut(e.sampling, 0, dwell)
        rows = math.ceil((t_ns[-1] - e.start_ns) / NS_PER_S / s.integration_s) + 100
        variance = float(np.mean(head.in_phase**2))
        if variance == 0.0:
            raise InputError(SILENT, advice=SILENT_ADVICE)
        self.channels = SampleChannels(e.sampling, list(e.codes), self._design, variance, rows, self._wide)
        self._search(buffer, dwell, np.ones(self._m, np.bool_))
        at = np.rint((t_ns - e.start_ns) * (rate / NS_PER_S)).astype(np.int64)
        every = max(1, round(NS_PER_S / s.epoch_rate_hz / (t_ns[1] - t_ns[0])))
        for k in range(len(at) - 1):
            self.engine.imu(int(t_ns[k]), e.imu.w_ib_b[k], e.imu.f_b[k])
            self._steer(int(at[k]))
            if not buffer.reach(int(at[k + 1]) + round(_LATE_S * rate)):
                break
            if at[k] > dwell and (k + 1) % every == 0:
                self._epoch(int(t_ns[k]), int(at[k]), buffer)
            self.channels.run(buffer.in_phase, buffer.quadrature, buffer.first, int(at[k + 1]), self._aiding)
        if not self.epochs:
            advice = f"take {1.0 / s.epoch_rate_hz:g} s more, or a higher epoch_rate_hz"
            raise InputError("the recording ends before the first epoch after its acquisition", advice=advice)

    def _steer(self, sample: int) -> None:
        """Take over the newest aiding; a channel that gets it for the first time keeps its frequency."""
        if self._table is None:
            return
        expected = expected_by_aiding(self._table, self.equipment.sv_names, self._week, sample)
        self._table, self._expected = None, expected
        if not self.aided:
            return
        # a channel that the filter does not know any more keeps the aiding that it had last
        known = np.isfinite(expected.doppler_hz)
        rate = 2.0 * math.pi * expected.doppler_hz[known]
        new = known & ~self._has_aid
        self.channels.state[new, RATE] -= 2.0 * math.pi * expected.doppler_hz[new]
        self._aiding.rate_radps[known] = rate
        self._aiding.acceleration_radps2[known] = 2.0 * math.pi * expected.doppler_rate_hz_per_s[known]
        self._aiding.at_sample[known] = sample
        self._has_aid |= known

    def _epoch(self, t_ns: int, sample: int, buffer: RecordingBuffer) -> None:
        """Judge the channels, hand their readings to the filter, and search for satellites that are not tracked."""
        self._judge(sample)
        table = self._observables(t_ns, sample)
        if table is not None:
            self.engine.gnss(table)
        state = self.engine.state
        read = 0 if table is None else int(np.isfinite(table.pseudorange_m).sum())
        self.epochs.append({"t_ns": t_ns, "n_channels": read} | (state.values if state.started else {}))
        states = self._supervised()
        is_open = self.channels.is_open
        for c, name in enumerate(self.equipment.sv_names):
            marks = {"open": bool(is_open[c]), "locked": bool(self._locked[c]), "supervisor": states[c]}
            cn0 = self._cn0[c] if is_open[c] else math.nan
            self.tracking.append({"t_ns": t_ns, "sv": name, **marks, "cn0_dbhz": cn0})
        s = self.equipment.settings
        if self.aided and self._expected is not self.equipment.at_start:
            wanted = np.isin(states, SEARCHING)
        else:  # no supervisor, or nothing for it before the filter has started
            wanted = sample - self._tried >= s.unseeded_retry_s * s.rate_hz
        wanted &= ~is_open
        if np.any(wanted):
            self._search(buffer, sample, wanted)

    def _supervised(self) -> list[str]:
        """Return the supervisor's state of each satellite at the newest epoch; "none" where it decides nothing."""
        if not self.aided:
            return ["none"] * self._m
        table = self.engine.take_supervision().supervision
        states = dict(zip(table["sv"].astype("str"), table["state"].astype("str"), strict=True))
        return [states.get(name, "none") for name in self.equipment.sv_names]

    def _judge(self, sample: int) -> None:
        """Estimate C/N0 and lock of each open channel over the last second; close those that stay without lock."""
        s = self.equipment.settings
        per_bit = round(GPS_BIT_S / s.integration_s)
        count = round(_JUDGED_S / GPS_BIT_S)
        for c in np.flatnonzero(self.channels.is_open):
            Z = self.channels.prompts(int(c), count * per_bit, per_bit)
            if sample - self._opened[c] < s.pull_in_s * s.rate_hz or len(Z) < count * per_bit:
                continue
            cn0 = float(moment_cn0_dbhz(Z, s.integration_s, len(Z))[0])
            if math.isfinite(cn0):
                mixed = _CN0_MEMORY * self._cn0[c] + (1.0 - _CN0_MEMORY) * cn0
                self._cn0[c] = min(max(mixed, _CN0_SPAN_DBHZ[0]), _CN0_SPAN_DBHZ[1])
                self.channels.set_cn0(int(c), float(self._cn0[c]))
            indicator = float(phase_lock(Z, per_bit, count, unbiased=False)[0])
            limit = s.leave_lock if self._locked[c] else s.enter_lock
            self._locked[c] = indicator >= limit
            if self._locked[c]:
                self._lost[c] = np.nan
            elif math.isnan(self._lost[c]):
                self._lost[c] = sample
            elif sample - self._lost[c] > s.drop_after_s * s.rate_hz:
                self.channels.close_channel(int(c))
                self._lost[c] = np.nan

    def _observables(self, t_ns: int, sample: int) -> GnssTable | None:
        """Return what the replicas of the locked channels show at a sample, a row without numbers for the others.

        None where there is none and the filter has not started.
        """
        rows = np.full((self._m, 4), np.nan)
        for c in np.flatnonzero(self._locked & self.channels.is_open):
            reading = self.channels.reading(int(c), sample)
            if reading is not None:
                doppler_hz = reading.rate_radps / (2.0 * math.pi)
                rows[c] = C_MPS * reading.pseudorange_s, doppler_hz, *self._sigmas(int(c))
        if not (np.isfinite(rows).any() or self.engine.state.started):
            return None
        pseudorange, doppler, sd_m, sd_mps = np.ascontiguousarray(rows.T)
        n = self._m
        return GnssTable(
            t_ns=np.full(n, t_ns, np.int64),
            sv=np.arange(n, dtype=np.int16),
            signal=np.zeros(n, np.int16),
            pseudorange_m=pseudorange,
            doppler_hz=doppler,
            range_rate_mps=np.full(n, np.nan),
            cn0_dbhz=self._cn0.copy(),
            sv_names=self.equipment.sv_names,
            signal_names=("C1C",),
            sigma_pseudorange_m=sd_m,
            sigma_range_rate_mps=sd_mps,
        )

    def _sigmas(self, channel: int) -> tuple[float, float]:
        """Return one sigma of pseudorange [m] and range rate [m/s] by linear theory at the estimated C/N0."""
        key = round(2.0 * float(self._cn0[channel]))
        if key not in self._sigma_of:
            self._sigma_of[key] = loop_sigmas(self._design, 0.5 * key)
        return self._sigma_of[key]

    def _search(self, buffer: RecordingBuffer, sample: int, wanted: Bool) -> None:
        """Search for satellites in the samples before ``sample`` and open the channels of those that are found."""
        s, e = self.equipment.settings, self.equipment
        first = sample - round(s.looks * s.look_s * s.rate_hz)
        samples = buffer.cut(e.sampling, first, sample)
        numbers = np.flatnonzero(wanted)
        self._tried[numbers] = sample
        if self.aided:
            expected = self._expected
            window = search_window(
                e.cn0_dbhz, expected.sd_delay_m**2, expected.sd_rate_mps**2, s.search, self._need, self._scale
            )
            numbers = numbers[np.isfinite(expected.delay_m[numbers])]
            spans = {int(c): seeded_span(expected, int(c), window, s, first, sample) for c in numbers}
            by_satellite = {
                c: search_for(samples, [e.codes[c]], span, s.pfa, first, [self._expected_m(c, first)])[0]
                for c, span in spans.items()
            }
        else:
            codes = [e.codes[c] for c in numbers]
            delays_m = [self._expected_m(int(c), first) for c in numbers]
            searches = search_for(samples, codes, unseeded_span(s), s.pfa, first, delays_m)
            by_satellite = {int(c): search for c, search in zip(numbers, searches, strict=True)}
        for c, search in by_satellite.items():
            self.searches.append((c, search))
            if search.found:
                self._open(c, search, sample)

    def _open(self, channel: int, search: SearchOutcome, sample: int) -> None:
        """Open a channel where its satellite was found."""
        rate = self.equipment.settings.rate_hz
        expected_m = self._expected_m(channel, sample)
        if not math.isfinite(expected_m):
            return  # nothing says which code period this is
        pseudorange_s, doppler_hz = search.at_end(expected_m, rate)
        aid = self._aiding.rate_radps[channel]
        aid += self._aiding.acceleration_radps2[channel] * (sample - self._aiding.at_sample[channel]) / rate
        own = 2.0 * math.pi * doppler_hz - aid
        pull_in_s = self.equipment.settings.pull_in_s
        self.channels.open_channel(channel, sample, pseudorange_s, own, pull_in_s)
        self._opened[channel], self._locked[channel], self._lost[channel] = sample, False, np.nan
        self._cn0[channel] = self.equipment.cn0_dbhz
        self.channels.set_cn0(channel, self.equipment.cn0_dbhz)

    def _expected_m(self, channel: int, sample: int) -> float:
        """Return the pseudorange that filter or start expects at a sample [m], NaN where neither does."""
        rate = self.equipment.settings.rate_hz
        expected_m = self._expected.delay_at(channel, sample, rate)
        return (
            expected_m
            if math.isfinite(expected_m)
            else self.equipment.at_start.delay_at(channel, sample, rate)
        )
