"""Recovery: a fix on trial beside a filter that may be lost, and which kind of measurement contradicts all else.

A filter that is thought lost is not touched. Copies of it are set to a fix, with its attitude and with that in doubt,
and take the same epochs. One of them takes the filter's place when its likelihood is far above the filter's, although
it had to begin with a small prior weight, and when most rows of each kind fit it, with no more noise than the filter's
own: decided by consistency, not by count.
States that the fix does not give are kept: noise levels and biases with their covariances. Where the filter itself
still fits some rows, half a minute has to pass until then: a street's reflections last for a while, and a vehicle does
not jump.
                                                                            [Bar-Shalom, Li & Kirubarajan 2001, 11]
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.resetting import inflate_bias_covariance, reinitialise_position
from insgnss.filter.diagnosis.witnesses import FEW, judged
from insgnss.filter.output.writing import Output
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.rows.clock_offsets import tie_offsets
from insgnss.filter.rows.lines import Lines
from insgnss.filter.setup import FilterSetup
from insgnss.filter.start.beside import clear_failures, copy_filter, roomy, update_beside
from insgnss.filter.start.fix import Fix
from insgnss.filter.state import DR, DV, Bank, copy_bank, joined_banks, select_members
from insgnss.filter.update.epoch_space import FilterWorkspace
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE, GnssRows, one_epoch
from insgnss.inertial.sensor_model import sensor_model
from insgnss.status import USED
from insgnss.tables import Event, Float64, Int64

_GROUPS: Final = 3
# Logarithm of the likelihood ratio, prior weights included, at which a copy is taken
_SURE_LOG_RATIO: Final = 20.0
_LOG_PRIOR: Final = -10.0
_LEAST_S: Final = 3.0  # while a copy settles, its likelihood does not count
_LONGEST_TEST_S: Final = 45.0
_HOPELESS: Final = 30.0
_CONFIRM_S: Final = 30.0  # a reflection in a street seldom lasts as long
_SIGMAS: Final = 4.0
_CONTRADICTS2: Final = _SIGMAS**2  # of both
_PLACE_M: Final = 5.0  # least sigma of a place that many pseudoranges have shown
_ELSEWHERE2: Final = 400.0  # twenty: reflections do not agree on another place and on another velocity
_LOST: Final = 0.25  # share of the rows that still fit a filter which is lost
_LATE: Final = 3  # epochs in a row that say so
_LOST_RANGES: Final = 0.34  # the same of the pseudoranges alone, while the range rates still fit
_FITTING_RANGES: Final = 0.9  # and how many must fit the copy then
_WITNESSES: Final = 6  # pseudoranges, below which their noise says little
_ENOUGH_RANGES: Final = 7  # that fit the copy instead: a street has no so many reflections that agree
_LOST_RANGES_S: Final = 10.0
_FITS: Final = 0.75  # share of the rows of each kind that must fit a copy
_MOST: Final = 2.0 / 3.0
_LEAST_ROWS: Final = 4


@dataclass
class RecoveryTest:
    """The copies of a filter that were set to a fix, and their likelihoods."""

    setup: FilterSetup
    bank: Bank  # copies of the filter's hypotheses first, then as many with the attitude kept, then with it in doubt
    since_ns: int
    fix: Fix
    reason: str
    over: bool = False
    # share of its rows, of its pseudoranges
    filter_fits: list[tuple[float, float]] = field(default_factory=list)
    filter_ranges: int = 0  # that it used last
    # the share that fits a leader, and how many
    ranges: dict[int, tuple[float, int]] = field(default_factory=dict)
    fits: dict[int, list[bool]] = field(default_factory=dict)  # whether most rows fit a member that leads
    _work: FilterWorkspace | None = None

    @property
    def n(self) -> int:
        """Number of the filter's own hypotheses."""
        return len(self.bank.state) // _GROUPS

    def copied(self) -> RecoveryTest:
        """Return a copy that shares nothing that changes."""
        twin = copy.copy(self)
        twin.bank = copy_bank(self.bank)
        twin.ranges, twin.filter_fits = dict(self.ranges), list(self.filter_fits)
        twin.fits = {member: list(ranges) for member, ranges in self.fits.items()}
        return twin

    def take(
        self,
        filter_bank: Bank,
        imu: ImuSamples,
        rows: GnssRows,
        epoch: int,
        parameters: Float64,
        written: Output,
    ) -> Bank | None:
        """Take in an epoch after the filter did; return the bank that is to take its place, if any."""
        if len(filter_bank.state) != self.n:
            self.over = True
            return None
        t_ns = int(rows.epoch_ns[epoch])
        leader = int(self.bank.head[0].leader)
        alone = one_epoch(rows, epoch)
        out = self._update(alone, imu, parameters)
        if self.over:
            return None
        copy_filter(filter_bank, self.bank)
        status = written.ledger["status"][rows.first[epoch] : rows.first[epoch + 1]]
        self.filter_fits.append((_share(status.ravel()), _share(status[:, PSEUDORANGE])))
        self.filter_ranges = int(np.sum(status[:, PSEUDORANGE] == USED))
        ranges = out.ledger["status"][:, PSEUDORANGE]
        self.ranges[leader] = _share(ranges), int(np.sum(ranges == USED))
        self.fits.setdefault(leader, []).append(_fit(out.ledger["status"]))
        return self._verdict(t_ns, filter_bank)

    def _update(self, alone: GnssRows, imu: ImuSamples, parameters: Float64) -> Output:
        """Carry all of them to an epoch and update them with it; return their output."""
        setup = self.setup
        self._work = roomy(self._work, alone, setup.layout, setup.installation, setup.visibility_limits)
        out, self.over = update_beside(self.bank, alone, imu, parameters, self._work, setup)
        return out

    def _weights(self) -> Float64:
        """Return the logarithm of the filter's weight and of both groups of copies, (3,)."""
        weight = self.bank.state["log_weight"].reshape(_GROUPS, -1)
        top = weight.max(axis=1)
        log_weights: Float64 = top + np.log(np.exp(weight - top[:, None]).sum(axis=1))
        return log_weights

    def _verdict(self, t_ns: int, filter_bank: Bank) -> Bank | None:
        elapsed_s = (t_ns - self.since_ns) / NS_PER_S
        weight = self._weights()
        best = int(np.argmax(weight[1:]))
        gain = float(weight[1 + best] - weight[0])
        self.over = elapsed_s > _LONGEST_TEST_S or (elapsed_s > _LEAST_S and gain < -_HOPELESS)
        members = np.arange(self.n, dtype=np.int64) + (1 + best) * self.n
        if gain < _SURE_LOG_RATIO or elapsed_s < _LEAST_S:
            return None
        # of a filter that is lost a copy is better even where it does not fit: the sensors may still fail
        lost = max(share for share, _ in self.filter_fits[-_LATE:]) < _LOST
        away = self._fits(members) and self._is_away(elapsed_s, members, filter_bank)
        if not (lost or (away and not self._is_noisier(members, filter_bank))):
            self.over = self.over or self._fails(members)
            return None
        self.over = True
        return self._taken(filter_bank, members)

    def _fits(self, members: Int64) -> bool:
        """Return whether most rows of the last two epochs in which a member led fit it."""
        return any(
            all(self.fits.get(int(i), [])[-2:]) and len(self.fits.get(int(i), [])) > 1 for i in members
        )

    def at_once(self, filter_bank: Bank, doubtful: bool) -> Bank:
        """Return the filter set to the fix, its attitude doubted or not."""
        return self._taken(filter_bank, np.arange(self.n, dtype=np.int64) + (1 + doubtful) * self.n)

    def _fails(self, members: Int64) -> bool:
        """Return whether the copies do not fit either: a newer fix is needed."""
        return any(
            len(ranges) >= _LATE and not any(ranges[-_LATE:])
            for ranges in (self.fits.get(int(i), []) for i in members)
        )

    def _is_away(self, elapsed_s: float, members: Int64, filter_bank: Bank) -> bool:
        """Return whether the filter is at another place: no pseudorange fits it, or a copy contradicts it for long."""
        ranges = [self.ranges[int(i)] for i in members if int(i) in self.ranges]
        enough = any(share >= _FITTING_RANGES and count >= _ENOUGH_RANGES for share, count in ranges)
        ranges_fit = max(share for _, share in self.filter_fits[-_LATE:])
        nowhere = elapsed_s >= _LOST_RANGES_S and ranges_fit < _LOST_RANGES and enough
        return nowhere or self._confirmed(elapsed_s, members, filter_bank)

    def _is_noisier(self, members: Int64, filter_bank: Bank) -> bool:
        """Return whether the rows that fit a copy agree less than those which still fit the filter.

        Both begin with the same noise level and learn it from what their own rows leave. Where a few pseudoranges jump
        together and stay, some of the others fit a wrong place in the end, with more and more noise.
        """
        if self.filter_ranges < _WITNESSES:
            return False
        level = self.bank.state["noise_factor"][self._likeliest(members), PSEUDORANGE]
        own = filter_bank.state["noise_factor"][int(filter_bank.head[0].leader), PSEUDORANGE]
        return bool(level > own)

    def _likeliest(self, members: Int64) -> int:
        return int(members[np.argmax(self.bank.state["log_weight"][members])])

    def _confirmed(self, elapsed_s: float, members: Int64, filter_bank: Bank) -> bool:
        """Return whether a copy still contradicts the filter, half a minute after its fix did, and may be right."""
        if elapsed_s < _CONFIRM_S:
            return False
        lead, likeliest = int(filter_bank.head[0].leader), self._likeliest(members)
        if contradiction2(filter_bank, lead, self.bank, likeliest) <= _CONTRADICTS2:
            return False
        return not is_ruled_out(filter_bank, lead, self.bank, likeliest)

    def _taken(self, filter_bank: Bank, members: Int64) -> Bank:
        """Return a group of copies as a bank of its own, at the filter's time."""
        bank = select_members(self.bank, members)
        lead = int(bank.head[0].leader)
        bank.head[:] = filter_bank.head
        bank.head["leader"] = lead
        return bank


def open_doubt(
    setup: FilterSetup, filter_bank: Bank, fix: Fix, w_ib_b: Float64, t_ns: int, reason: str
) -> RecoveryTest:
    """Return a fix on trial: copies of the filter with its attitude, and with attitude and biases in doubt.

    Parameters
    ----------
    w_ib_b : (3,) the gyros' rate at the fix [rad/s]
    """
    bank = copy_bank(filter_bank)
    lever_b, sigma_m = np.array(setup.lever_arm_m), setup.config.process.inter_system_sigma_m
    for doubtful in (False, True):
        alternative = copy_bank(filter_bank)
        for m, P in zip(alternative.state, alternative.P, strict=True):
            reinitialise_position(m, P, fix, lever_b, setup.layout, w_ib_b, sigma_m)
            tie_offsets(m, P, setup.layout.home, setup.config.process.qzss_offset_sigma_m)
            if doubtful:
                inflate_bias_covariance(m, P, sensor_model(setup.grade, setup.layout.names), setup.layout)
        alternative.memory[:] = -np.inf  # innovations about another position
        alternative.state["log_weight"] += _LOG_PRIOR
        alternative.state["explained"] = 0.0
        alternative.state["suspicion"] = 0.0
        bank = joined_banks(bank, alternative)
    bank.head["more_than_headings"] = 1
    clear_failures(bank)
    return RecoveryTest(setup, bank, t_ns, fix, reason)


def is_lost(lines: Lines, fix: Fix) -> bool:
    """Return whether hardly a row fits the filter although almost all fit the fix, with rows to spare."""
    return _almost_all_fit(fix) and _share(lines["status"][:, :2].ravel()) < _LOST


def is_elsewhere(doubt: RecoveryTest) -> bool:
    """Return whether almost all rows agree on a place and a velocity that the filter excludes.

    Some rows still fit a filter that is lost: three of ten fix its clock and two directions. Inertial samples that are
    wrong lead a copy astray as fast as the filter, so that a trial decides nothing.
    """
    if doubt.fix.v_a is None or not _almost_all_fit(doubt.fix):
        return False
    lead = int(doubt.bank.head[0].leader) % doubt.n
    other_velocity2 = contradiction2(doubt.bank, lead, doubt.bank, lead + doubt.n, "v_e", DV)
    return is_at_another_place(doubt) and other_velocity2 > _ELSEWHERE2


def is_at_another_place(doubt: RecoveryTest) -> bool:
    """Return whether the filter excludes the place of the fix."""
    lead = int(doubt.bank.head[0].leader) % doubt.n
    return contradiction2(doubt.bank, lead, doubt.bank, lead + doubt.n) > _ELSEWHERE2


def _almost_all_fit(fix: Fix, kinds: int | slice = slice(None)) -> bool:
    offered, used = fix.tried.sum(axis=1), fix.used.sum(axis=1)
    return bool(np.all((used >= _FITTING_RANGES * offered)[kinds])) and fix.n_used >= _ENOUGH_RANGES


def contradiction2(one: Bank, i: int, other: Bank, j: int, name: str = "r_e", at: int = DR) -> float:
    """Return the squared distance of two hypotheses' positions, or velocities, over the covariance of both."""
    d = other.state[name][j] - one.state[name][i]
    block = slice(at, at + 3)
    return float(d @ np.linalg.solve(one.P[i, block, block] + other.P[j, block, block], d))


def is_ruled_out(one: Bank, i: int, other: Bank, j: int) -> bool:
    """Return whether a vehicle cannot be at another hypothesis' place: its way from this one's was measured.

    Nearly all of many pseudoranges agreed with the place at some time, and range rates have measured the velocity ever
    since. In that time it can have moved away by the difference of the velocities plus four sigmas.
    """
    head = one.head[0]
    if head.placed_ns == 0:
        return False
    seconds = (head.now_ns - head.placed_ns) / NS_PER_S
    apart_m = np.linalg.norm(other.state["r_e"][j] - one.state["r_e"][i])
    apart_mps = np.linalg.norm(other.state["v_e"][j] - one.state["v_e"][i])
    block = slice(DV, DV + 3)
    sigma_mps = math.sqrt(np.trace(one.P[i, block, block] + other.P[j, block, block]))
    sigma_m = max(math.sqrt(np.trace(one.P[i, DR : DR + 3, DR : DR + 3])), _PLACE_M)
    return bool(apart_m > (apart_mps + _SIGMAS * sigma_mps) * seconds + _SIGMAS * sigma_m)


def _share(status: Int64) -> float:
    """Return the share of the rows that fit, of those that were judged; 1 where none was."""
    used, refused = judged(status)
    return used / (used + refused) if used + refused >= FEW else 1.0


def _fit(status: Int64) -> bool:
    """Return whether most rows of each kind fit."""
    return all(_share(status[:, kind]) >= _FITS for kind in range(2))


def contradicted_kind(lines: Lines) -> int | None:
    """Return the kind of which the gate refuses most rows while most of the other fit."""
    share = [_refused(lines, kind) for kind in (PSEUDORANGE, RANGE_RATE)]
    for kind, other in ((RANGE_RATE, PSEUDORANGE), (PSEUDORANGE, RANGE_RATE)):
        if share[kind] > _MOST and 0.0 <= share[other] < 1.0 - _MOST:
            return kind
    return None


def rates_disagree(fix: Fix) -> bool:
    """Return whether an epoch's pseudoranges agree on a place, with rows to spare, and its range rates on no velocity.

    For example a wrong wavelength: the filter drifts with the rates and refuses the good pseudoranges.
    """
    no_velocity = fix.v_a is None and fix.tried[RANGE_RATE].sum() >= _WITNESSES
    return bool(no_velocity and _almost_all_fit(fix, PSEUDORANGE))


def _refused(lines: Lines, kind: int) -> float:
    """Return the share of refused rows of a kind, -1 where there are too few."""
    used, refused = judged(lines["status"][:, kind])
    return refused / (refused + used) if refused + used >= _LEAST_ROWS else -1.0


def in_words(t_ns: int, was: Bank, now: Bank, doubt: RecoveryTest) -> Event:
    """Return the event of a filter that was set to a fix."""
    before, after = was.state[was.head[0].leader], now.state[now.head[0].leader]
    velocity = (
        f"moved by {np.linalg.norm(after.v_e - before.v_e):.2f} m/s" if doubt.fix.v_a is not None else "kept"
    )
    detail = (
        f"{doubt.reason}: position moved by {np.linalg.norm(after.r_e - before.r_e):.1f} m, velocity {velocity},"
        f" clock moved by {after.clock[0] - before.clock[0]:.1f} m; {doubt.fix.n_used} pseudoranges"
    )
    return Event(t_ns, "reset", detail)
