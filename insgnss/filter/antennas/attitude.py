"""Attitude from several antennas inside the filter: phase differences as scalar rows beside an epoch's other rows.

After the epoch's own rows each difference between two antennas enters as a scalar of its own, per baseline and
satellite. Whole cycles are resolved outside of the state vector: at first by a search over all attitudes that the
filter leaves (``attitude.cycle_search``), accepted once several epochs agree on them; then, satellite by
satellite, by rounding where the predicted difference is certain enough. What is not certain is not used, and a
difference that contradicts the prediction by whole cycles is refused, reported, and resolved again.

Neglects: a difference's error correlated over neighbouring epochs, except for the settings' multipath, which counts as
many epochs more as it lasts; the flexing of the body between its antennas.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from insgnss.attitude.cycle_search import CycleFix, DifferenceRows, find_cycles
from insgnss.constants import C_MPS, NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.filter.antennas.data import AntennaData
from insgnss.filter.antennas.memory import CycleMemory, Key
from insgnss.filter.antennas.phase_log import DifferenceLedger, PhaseLog
from insgnss.filter.antennas.rows import (
    Differences,
    attitude_rows,
    baselines,
    directions,
    form_differences,
    predicted,
    rows_by_states,
    whitened,
    without_clocks,
)
from insgnss.filter.antennas.seeding import priors_of, seeded, wound_up
from insgnss.filter.antennas.visibility import hidden_reasons
from insgnss.filter.parameters import Parameters
from insgnss.filter.receiver_time import turn_to_gps_time
from insgnss.filter.state import CLONE_CLOCK, N_CLONE, Bank, StateRecord
from insgnss.filter.update.closed_loop import close_loop
from insgnss.filter.update.scalar_update import scalar_update
from insgnss.geodesy.local_level import level_axes
from insgnss.gnss.antenna_phases import AntennaPhases
from insgnss.status import (
    CYCLES_OPEN,
    CYCLES_WRONG,
    GATED,
    MASKED_CN0,
    MASKED_ELEVATION,
    NO_DIFFERENCE,
    USED,
)
from insgnss.tables import Bool, Event, Float64, Int64

_LONGEST_GAP_S: Final = 1.5  # whole cycles of a phase that was away for longer are not the same for certain
# half a cycle has to be that many of the prediction's sigma: 6e-7 are rounded wrongly
_ROUNDING_SIGMAS: Final = 5.0
_REFUSED_EPOCHS: Final = 8  # a difference refused for so long, but not by whole cycles, is resolved again
_STRAINED_EPOCHS: Final = 5  # with most differences refused: the attitude or all whole cycles are wrong
_MISFITS: Final = 5  # epochs in which no whole cycles fit, before other orders of the cables are tried
# a search that fails takes some tens of milliseconds: after so many in a row it pauses, longer and longer
_FAILURES_AT_ONCE: Final = 10
_SHORTEST_PAUSE_S: Final = 0.5
_LONGEST_PAUSE_S: Final = 20.0
_MOST_PERMUTED: Final = 5  # antennas


@dataclass
class AttitudeAid:
    """The stage: its inputs, its work space, and its memory."""

    data: AntennaData
    remarks: tuple[Event, ...] = ()
    log: PhaseLog | None = None
    memory: CycleMemory = field(default_factory=CycleMemory)
    events: list[Event] = field(default_factory=list)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the antennas, the main one first."""
        return self.data.antennas.names

    def copied(self, log: PhaseLog | None = None) -> AttitudeAid:
        """Return a copy with a memory of its own that looks into ``log``."""
        return AttitudeAid(self.data, self.remarks, log, self.memory.copied(), list(self.events))

    def take_events(self) -> list[Event]:
        """Return the events since the last call."""
        taken, self.events = self.events, []
        return taken

    def use(self, bank: Bank, t_ns: int, w_ib_b: Float64, par: Parameters) -> tuple[Bank, int]:
        """Update a bank at an epoch with its phase differences.

        Returns the bank (one member of it, once the heading has been found) and how many differences were used.
        """
        if self.log is None:
            return bank, 0
        phases, ledger, memory = self.log.phases, self.log.ledger, self.memory
        epoch = int(np.searchsorted(phases.epoch_ns, t_ns))
        if epoch == len(phases.epoch_ns) or phases.epoch_ns[epoch] != t_ns:
            return bank, 0
        rows = np.arange(phases.first[epoch], phases.first[epoch + 1])
        m, P = bank.state[bank.head[0].leader], bank.P[bank.head[0].leader]
        usable, doubt = self._usable(self.log, rows, m, P, par)
        d = form_differences(phases, usable, self.data.antennas, m.r_e, m.v_e, doubt)
        self._forget(phases, d, rows, t_ns)
        if not len(d.b):
            return bank, 0
        ledger.status[d.row] = CYCLES_OPEN
        if len(bank.state) > 1:
            memory.cycles.clear()
        late_s = float(m.clock[0]) / C_MPS
        w_eb_b = w_ib_b - m.b_g - WGS84_OMEGA_RADPS * m.C_eb[2]
        l_b = baselines(d, self.data.antennas, w_eb_b, late_s)
        if par.at_imu_time >= 0:
            l_b = l_b @ turn_to_gps_time(m, par).T
        if not any(key in memory.cycles for key in d.keys):
            if t_ns < memory.next_search_ns:
                return bank, 0
            fix = self._search(bank, d, l_b, t_ns)
            if fix is None:
                return bank, 0
            bank = seeded(bank, fix.C_nb, level_axes(m.r_e), par.lever_b, w_eb_b)
        lead = bank.head[0].leader
        return bank, self._update(
            bank.state[lead], bank.P[lead], d, l_b, ledger, self._spread(bank), par, t_ns
        )

    def _spread(self, bank: Bank) -> float:
        """Return by how much reflections count more than one epoch's own."""
        step_s = max(float(bank.head[0].epoch_step_ns) / NS_PER_S, 1e-3)
        return max(1.0, self.data.multipath_time_s / step_s)

    def _usable(
        self, log: PhaseLog, rows: Int64, m: StateRecord, P: Float64, par: Parameters
    ) -> tuple[Int64, Float64 | None]:
        """Return the rows of an epoch that pass every mask, and the doubt of each; others are marked in the ledger."""
        phases = log.phases
        status = phases.status[rows].copy()
        C_ne = level_axes(m.r_e)
        u_n = directions(phases.sat[rows], m.r_e) @ C_ne.T
        good = status == USED
        status[good & ~(-u_n[:, 2] >= par.sine_mask)] = MASKED_ELEVATION
        status[(status == USED) & (phases.cn0_dbhz[rows] < par.cn0_mask)] = MASKED_CN0
        doubt = None
        if self.data.hiding is not None:
            reason, doubt = hidden_reasons(
                self.data.hiding, phases.antenna[rows], u_n, C_ne @ m.C_eb, m.C_eb, P
            )
            status = np.where(status == USED, reason, status).astype(np.int8)
        log.ledger.status[rows] = np.where(status == USED, NO_DIFFERENCE, status)
        return np.asarray(rows[status == USED]), None if doubt is None else doubt[status == USED]

    def _forget(self, phases: AntennaPhases, d: Differences, rows: Int64, t_ns: int) -> None:
        """Forget whole cycles that a slip or a gap may have changed."""
        memory = self.memory
        slipped = rows[phases.has_slipped[rows]]
        marks = {(int(phases.antenna[i]), phases.names[phases.channel[i]]) for i in slipped}
        for known in (memory.cycles, memory.candidate) if marks else ():
            for key in [k for k in known if marks & {(k[0], k[2]), (k[1], k[2])}]:
                del known[key]
                if known is memory.cycles:
                    self._tell(
                        t_ns, "attitude_slip", f"{self._named(key)}: the receiver reports a cycle slip"
                    )
        for key in [
            k for k in memory.cycles if t_ns - memory.seen_ns.get(k, t_ns) > _LONGEST_GAP_S * NS_PER_S
        ]:
            del memory.cycles[key]
        memory.seen_ns.update(dict.fromkeys(d.keys, t_ns))

    def _search(self, bank: Bank, d: Differences, l_b: Float64, t_ns: int) -> CycleFix | None:
        """Look for the whole cycles of all differences at once; return them when they are certain."""
        memory = self.memory
        priors, C_ne = priors_of(bank, anywhere=memory.is_lost)
        priors = wound_up(priors, d, self.data.antennas, C_ne)
        rows = DifferenceRows(l_b, d.u_e @ C_ne.T, d.value_m, d.wavelength_m, d.white + d.slow, d.clock)
        fix = find_cycles(rows, priors, self.data.ratio)
        if not fix.is_valid:
            memory.candidate, memory.confirmed = {}, 0
            memory.failures += 1
            pause_s = min(_SHORTEST_PAUSE_S * 2.0 ** (memory.failures - _FAILURES_AT_ONCE), _LONGEST_PAUSE_S)
            if memory.failures > _FAILURES_AT_ONCE:
                memory.next_search_ns = t_ns + int(pause_s * NS_PER_S)
            memory.misfits = 0 if fix.fits else memory.misfits + 1
            if memory.misfits == _MISFITS and math.isfinite(fix.loss):
                self._try_other_orders(rows, d, bank, t_ns)
            self._wait(t_ns, fix.reason)
            return None
        memory.misfits, memory.failures = 0, 0
        now = dict(zip(d.keys, fix.cycles.tolist(), strict=True))
        alike = bool(memory.candidate) and _agree(memory.candidate, now, d)
        memory.confirmed = memory.confirmed + 1 if alike else 1
        memory.candidate = now
        if memory.confirmed < self.data.confirmations:
            return None
        memory.cycles, memory.candidate, memory.confirmed, memory.is_lost = now, {}, 0, False
        memory.waits_for = ""
        self._tell_found(fix, d, t_ns)
        return fix

    def _tell_found(self, fix: CycleFix, d: Differences, t_ns: int) -> None:
        yaw = math.degrees(math.atan2(fix.C_nb[1, 0], fix.C_nb[0, 0])) % 360.0
        satellites = len({sv for _, _, (sv, _) in d.keys})
        self._tell(
            t_ns,
            "attitude_found",
            f"whole cycles of {len(d.b)} differences of {satellites} satellites: heading {yaw:.2f} deg, loss"
            f" {fix.loss:.1f}, the second-best solution's loss is {fix.ratio:.1f} times as large",
        )

    def _try_other_orders(self, rows: DifferenceRows, d: Differences, bank: Bank, t_ns: int) -> None:
        """Report whether the differences fit if the logs are assigned to other antennas."""
        antennas = self.data.antennas
        count = len(antennas.names)
        if count > _MOST_PERMUTED:
            return
        anywhere, C_ne = priors_of(bank, anywhere=True)
        for order in itertools.islice(itertools.permutations(range(count)), 1, None):
            other = antennas.reordered(order)
            swapped = DifferenceRows(
                baselines(d, other), rows.u_n, rows.value_m, rows.wavelength_m, rows.covariance, rows.clock
            )
            if find_cycles(swapped, wound_up(anywhere, d, other, C_ne), self.data.ratio).is_valid:
                logs = ", ".join(
                    f"the log of '{mine}' fits the position of '{theirs}'"
                    for mine, theirs in zip(antennas.names, other.names, strict=True)
                    if mine != theirs
                )
                self._tell(
                    t_ns, "attitude_antennas_swapped", f"{logs}: the cables are swapped; nothing is used"
                )
                return

    def _wait(self, t_ns: int, reason: str) -> None:
        """Report once why there is no attitude yet, and again when the reason changes its kind."""
        kind = reason.split(":")[0]
        if kind != self.memory.waits_for:
            self.memory.waits_for = kind
            self._tell(t_ns, "attitude_waits", reason)

    def _update(
        self,
        m: StateRecord,
        P: Float64,
        d: Differences,
        l_b: Float64,
        ledger: DifferenceLedger,
        spread: float,
        par: Parameters,
        t_ns: int,
    ) -> int:
        """Gate the differences on the prior, resolve open ones, and update with those that are certain."""
        H, columns, P_h = rows_by_states(attitude_rows(d, l_b, m.C_eb), m, P, par)
        y = d.value_m - predicted(d, l_b, m.C_eb, self.data.antennas)
        known = np.array([key in self.memory.cycles for key in d.keys])
        self._anchor_clocks(d, y, known)
        y = y - d.wavelength_m * np.array([self.memory.cycles.get(key, 0) for key in d.keys])
        trusted = self._gated(d, H, y, known, P_h)
        v, S = _innovations(d, H, y, trusted, P_h)
        whole, fits, misfits = self._rounded(d, v, S, known, trusted)
        agree = int(np.count_nonzero(trusted | fits))
        refused = known & ~trusted
        ledger.innovation[d.row[refused]], ledger.variance[d.row[refused]] = v[refused], S[refused]
        ledger.status[d.row[refused]] = GATED
        wrong, strained = self._judge(d, v, S, refused, t_ns, agree, int(np.count_nonzero(misfits)))
        ledger.status[d.row[wrong]] = CYCLES_WRONG
        if strained:
            return 0
        for i in np.flatnonzero(fits):
            self.memory.cycles[d.keys[i]] = int(whole[i])
        y, trusted = y - np.where(fits, whole * d.wavelength_m, 0.0), trusted | fits
        for key in itertools.compress(d.keys, trusted if self.memory.refused else ()):
            self.memory.refused.pop(key, None)
        v, S = _innovations(d, H, y, trusted, P_h)
        alone = (d.clock >= 0) & (np.sum(trusted & (d.clock[:, None] == d.clock), axis=1) < 2)
        trusted &= ~alone
        ledger.innovation[d.row[trusted]], ledger.variance[d.row[trusted]] = v[trusted], S[trusted]
        ledger.status[d.row[trusted]] = USED
        ledger.status[d.row[alone & known]] = NO_DIFFERENCE
        if trusted.any():
            _correct(m, P, columns, *whitened(d.only(trusted), H[trusted], y[trusted], spread), par)
        return int(np.count_nonzero(trusted))

    def _anchor_clocks(self, d: Differences, y: Float64, known: Bool) -> None:
        """Fix a clock that no known difference fixes by one whole cycle: the clock absorbs it."""
        for clock in np.unique(d.clock[d.clock >= 0]):
            own = np.flatnonzero(d.clock == clock)
            if not known[own].any():
                best = own[np.argmin(np.diag(d.white)[own])]
                self.memory.cycles[d.keys[best]] = round(float(y[best] / d.wavelength_m[best]))
                known[best] = True

    def _gated(self, d: Differences, H: Float64, y: Float64, known: Bool, P_h: Float64) -> Bool:
        """Return which known differences agree with the prior; with clocks to estimate, the worst goes first."""
        gate2, trusted = self.data.gate_sigma**2, known.copy()
        while trusted.any():
            v, S = _innovations(d, H, y, trusted, P_h)
            nis = np.where(trusted, v**2 / S, 0.0)
            if not (nis > gate2).any():
                break
            if d.clock[0] < 0:
                trusted &= nis <= gate2
                break
            trusted[np.argmax(nis)] = False
        return trusted

    def _rounded(
        self, d: Differences, v: Float64, S: Float64, known: Bool, trusted: Bool
    ) -> tuple[Float64, Bool, Bool]:
        """Return the whole cycles of open differences, whether the prediction makes them certain, or contradicts."""
        whole, sigma = np.rint(v / d.wavelength_m), np.sqrt(S)
        certain = _ROUNDING_SIGMAS * sigma < 0.5 * d.wavelength_m
        is_known = (d.clock < 0) | np.isin(d.clock, d.clock[trusted])  # its clock is known
        near = np.abs(v - whole * d.wavelength_m) < self.data.gate_sigma * sigma
        certain = ~known & certain & is_known
        return whole, certain & near, certain & ~near

    def _judge(
        self, d: Differences, v: Float64, S: Float64, refused: Bool, t_ns: int, agree: int, misfits: int
    ) -> tuple[list[int], bool]:
        """Report wrong cycles, drop impossible ones; return which differences have wrong cycles.

        Also returns whether most contradict the prediction: then the others may agree by chance, and none is
        used.
        """
        memory, wrong = self.memory, []
        for i in np.flatnonzero(refused):
            key, wave, sigma = d.keys[i], d.wavelength_m[i], math.sqrt(S[i])
            whole = round(float(v[i] / wave))
            memory.refused[key] = memory.refused.get(key, 0) + 1
            if whole and abs(v[i] - whole * wave) < self.data.gate_sigma * sigma < 0.5 * wave:
                wrong.append(int(i))
                wrong_by = f"{whole:+d} cycle(s) against the attitude; not used, resolved again"
                self._tell(t_ns, "attitude_cycles_wrong", f"{self._named(key)}: {wrong_by}")
                del memory.cycles[key]
            elif memory.refused[key] >= _REFUSED_EPOCHS:
                del memory.cycles[key]
        against = int(np.count_nonzero(refused)) + misfits
        strained = against > agree and against >= 3
        memory.strained = memory.strained + 1 if strained else 0
        if memory.strained >= _STRAINED_EPOCHS:
            memory.strained, memory.is_lost = 0, True
            memory.cycles.clear()
            memory.refused.clear()
            detail = (
                f"most differences refused for {_STRAINED_EPOCHS} epochs: all whole cycles are searched again"
            )
            self._tell(t_ns, "attitude_lost", detail)
        return wrong, strained

    def _named(self, key: Key) -> str:
        names, (sv, code) = self.names, key[2]
        return f"{sv} {code}, antenna {names[key[1]]} against {names[key[0]]}"

    def _tell(self, t_ns: int, kind: str, detail: str) -> None:
        self.events.append(Event(t_ns, kind, detail))


def _agree(before: dict[Key, int], now: dict[Key, int], d: Differences) -> bool:
    """Return whether two epochs have the same whole cycles, up to a whole number that a clock takes up."""
    offsets: dict[int, set[int]] = {}
    for key, clock in zip(d.keys, d.clock.tolist(), strict=True):
        if key in before:
            offsets.setdefault(clock, set()).add(now[key] - before[key])
    if not offsets:
        return False
    return all(len(of_clock) == 1 and (clock >= 0 or of_clock == {0}) for clock, of_clock in offsets.items())


def _innovations(
    d: Differences, H: Float64, y: Float64, trusted: Bool, P_h: Float64
) -> tuple[Float64, Float64]:
    """Return the innovations less their clocks and their variances at the prior, both (R,)."""
    M = without_clocks(d, trusted)
    H = M @ H
    S = np.sum((H @ P_h) * H, axis=1) + np.sum((M @ (d.white + d.slow)) * M, axis=1)
    return M @ y, np.maximum(S, np.finfo(float).tiny)


def _correct(m: StateRecord, P: Float64, columns: Int64, H: Float64, y: Float64, par: Parameters) -> None:
    """Update with independent rows of variance one, each a scalar in turn, and close the loop.

    The clone of the epoch has been made before: it is an antenna position like the state's own and is corrected too.
    """
    n = P.shape[0]
    vectors = np.zeros((3, n))
    for h, innovation in zip(H, y, strict=True):
        scalar_update(P, h, columns, innovation, 1.0, vectors)
    correction, at = vectors[0], int(par.at_clone)
    close_loop(m, correction, n - (N_CLONE if at >= 0 else 0))
    if at >= 0:
        m.r_clone += correction[at : at + 3]
        m.clock_clone += correction[at + CLONE_CLOCK]
