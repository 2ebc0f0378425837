"""The update with a user's own rows, between epochs or at one, before it.

Each time of such rows is a small epoch of its own: the bank is carried to it, every hypothesis is asked for its rows,
all are gated on the prior, each corrects as a scalar, and the correction is fed back with the reset of an epoch.

The rows weigh several open headings by the same principle as an epoch does (``headings``): a row that a turn of the
vehicle about the vertical through its antenna would change, such as a heading, says itself which one it fits and counts
in full. Any other row counts only as far as the motion that was shown: at rest the hypotheses' positions and
velocities differ by noise alone.

A sensor that is wrong is wrong for longer than a reading: one that is late, for as long as the speed changes. The odds
e that an epoch is wrong altogether therefore hold for its correlation time. A reading whose variance has grown s times,
as it is one of s in that time, takes from a heading at most -ln(e) / s. Without this limit ten readings a second of a
wheel speed that was 0.2 s late outvoted the range rates.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.errors import MeasurementError
from insgnss.filter.headings.headings import WRONG_EPOCH, turn_about, weigh_headings
from insgnss.filter.headings.motion import place_turning
from insgnss.filter.layout_names import StateLayout
from insgnss.filter.loop import DONE, current_sample, run_epochs
from insgnss.filter.output.writing import Output, Table
from insgnss.filter.own_rows.carrying import doubt_filter
from insgnss.filter.own_rows.checked_rows import CheckedRow
from insgnss.filter.own_rows.contradiction import changes, contradicting, watch
from insgnss.filter.own_rows.ledger import OwnEntry
from insgnss.filter.own_rows.rows import NOT_CARRYING, Kind
from insgnss.filter.own_rows.state_estimate import StateEstimate, state_estimate
from insgnss.filter.own_rows.steps import open_steps
from insgnss.filter.parameters import Parameters
from insgnss.filter.prediction import ImuSamples, Scratch, carry_bank, predict_covariance
from insgnss.filter.receiver_time import rows_at_their_time
from insgnss.filter.rows.lines import ANTENNA_DTYPE, AntennaState
from insgnss.filter.sensor_errors import whole_errors_of
from insgnss.filter.setup import FilterSetup
from insgnss.filter.soundness import is_sound
from insgnss.filter.state import CLONE_CLOCK, DR, DV, N_CLONE, PSI, Bank, StateRecord
from insgnss.filter.update.closed_loop import close_loop, turn_attitude_errors, turn_force_errors
from insgnss.filter.update.epoch_space import FilterWorkspace
from insgnss.filter.update.epoch_update import charge
from insgnss.filter.update.prior_rows import place_antenna
from insgnss.filter.update.scalar_update import predicted_variance, scalar_update
from insgnss.filter.update.shown_motion import follow_motion
from insgnss.filter.update.slow_errors import correct_by_row_without
from insgnss.geodesy.local_level import up_direction
from insgnss.gnss.observation_rows import GnssRows
from insgnss.status import BAD_VALUE, CONTRADICTS, GATED, USED
from insgnss.tables import Bool, Event, Float64


class OwnUpdate(NamedTuple):
    """The effect of the rows of one time."""

    entries: list[OwnEntry]  # of the hypothesis that led before
    correction: Float64  # (n,) what was added to its state
    stepped: tuple[int, ...] = ()  # places of the sensors' own errors that have stepped
    events: tuple[Event, ...] = ()


class _Member(NamedTuple):
    """One hypothesis and its rows."""

    rows: list[tuple[Kind, CheckedRow]]
    variance: Float64  # (k,) of the innovations at the prior, as gate and ledger take them
    antenna: AntennaState

    @property
    def predicted(self) -> Float64:
        """The part of ``variance`` (k,) that is the prediction's."""
        own = np.array([row.single_variance for _, row in self.rows])
        return np.asarray(self.variance - own)

    @property
    def most_charge(self) -> Float64:
        """By how much each row (k,) may lower the logarithm of a heading's weight; fixes that carry are epochs."""
        carry = np.array([kind.carrying != NOT_CARRYING for kind, _ in self.rows])
        spread = np.array([row.variance / row.single_variance for _, row in self.rows])
        return np.asarray(-math.log(WRONG_EPOCH) / np.where(carry, 1.0, spread))


def use_own_rows(
    bank: Bank, t_ns: int, setup: FilterSetup, imu: ImuSamples, parameters: npt.NDArray[Any], scratch: Scratch
) -> OwnUpdate:
    """Update a bank at ``t_ns`` with the own rows of that time.

    Parameters
    ----------
    scratch : with which the bank was carried to that time; it holds the gravity there

    Raises
    ------
    MeasurementError : a row cannot be used, or the hypotheses were given different numbers of rows
    """
    assert setup.own is not None
    par, n, lead = parameters[0], bank.P.shape[1], int(bank.head[0].leader)
    for m, P in zip(bank.state, bank.P, strict=True):
        predict_covariance(m, P, par, scratch)
        if par.at_imu_time >= 0:
            follow_motion(m, P, par)
            m.v_corrected[:] = m.v_e
    sound = [is_sound(m, P) for m, P in zip(bank.state, bank.P, strict=True)]
    if not sound[lead]:
        return OwnUpdate([], np.zeros(n))
    k = current_sample(bank, imu)
    kinds, asked, layout = setup.own.at(t_ns), np.flatnonzero(sound), setup.named_states
    estimates = {int(i): _estimate(bank.state[i], t_ns, setup, imu, k) for i in asked}
    members, kinds = _members(bank, estimates, kinds, layout, imu, k, par)
    _require_alike(members, lead, t_ns)
    unused = contradicting(bank.head[0], kinds)
    count = len(members[lead].rows)
    if count == 0 and len(sound) == 1:
        return OwnUpdate([], np.zeros(n))
    direct = _moved_by_heading(bank, lead, members[lead])
    log_likelihood = np.full((len(sound), count), -math.inf)
    information = np.zeros((len(sound), count))
    updates: dict[int, OwnUpdate] = {}
    for i, member in members.items():
        updates[i] = _updated(
            *(bank.state[i], bank.P[i], member, t_ns, par, log_likelihood[i], information[i]),
            followed=bank if i == lead else None,
            gate2=setup.config.gates.pseudorange_sigma**2,
            several=len(sound) > 1,
            unused=unused,
        )
    _weigh(bank, log_likelihood, information, direct, members[lead], par)
    if len(sound) > 1:
        _charge_unlikely(bank, estimates, setup.own.at(t_ns), t_ns, par)
    entries, leader, several = updates[lead].entries, members[lead], len(sound) > 1
    watch(bank.head[0], kinds, entries, leader.predicted, t_ns, headings_open=several)
    doubt_filter(bank, kinds, {i: update.entries for i, update in updates.items()}, t_ns)
    rows = {i: member.rows for i, member in members.items()}
    steps = open_steps(bank, entries, rows, layout, t_ns)
    events = (*changes(unused, bank.head[0], kinds, t_ns), *(step.event for step in steps))
    return updates[lead]._replace(stepped=tuple(step.place for step in steps), events=events)


def _estimate(m: StateRecord, t_ns: int, setup: FilterSetup, imu: ImuSamples, k: int) -> StateEstimate:
    """Return a hypothesis as its rows see it, in sample ``k``."""
    accel, gyro = whole_errors_of(m, setup.layout)
    return state_estimate(m, t_ns, imu.w_ib_b[k] - gyro, imu.f_b[k] - accel, setup.named_states, imu)


def _members(
    bank: Bank,
    estimates: dict[int, StateEstimate],
    kinds: list[Kind],
    layout: StateLayout,
    imu: ImuSamples,
    k: int,
    par: Parameters,
) -> tuple[dict[int, _Member], list[Kind]]:
    """Return the hypotheses with their rows and antennas, and the kinds of which all of them were given rows."""
    given, antennas = {}, {}
    for i, estimate in estimates.items():
        m, P = bank.state[i], bank.P[i]
        antenna = antennas[i] = np.zeros(1, ANTENNA_DTYPE)[0]
        place_antenna(m, par, imu.w_ib_b[k], imu.f_b[k], antenna)
        place_turning(m, P, par, antenna)
        given[i] = rows_at_their_time(kinds, estimate, layout, m, P, par, antenna)
    common = [j for j in range(len(kinds)) if all(rows[j] for rows in given.values())]
    members = {}
    for i, member_rows in given.items():
        P = bank.P[i]
        rows = [(kinds[j], _bent(row, P)) for j in common for row in member_rows[j]]
        variance = np.array(
            [row.single_variance + predicted_variance(P, row.h, row.columns) for _, row in rows]
        )
        members[i] = _Member(rows, variance, antennas[i])
    return members, [kinds[j] for j in common]


def _bent(row: CheckedRow, P: Float64) -> CheckedRow:
    """Return a row with mean and variance of its second-order terms at the prior."""
    for term in row.second:
        mean, variance = term.moments(P)
        row = row._replace(
            innovation=row.innovation - mean,
            variance=row.variance + variance,
            single_variance=row.single_variance + variance,
        )
    return row


def _require_alike(members: dict[int, _Member], lead: int, t_ns: int) -> None:
    """Refuse rows that differ in kind or number between the headings: their likelihoods could not be compared."""
    wanted = [kind.name for kind, _ in members[lead].rows]
    for member in members.values():
        given = [kind.name for kind, _ in member.rows]
        if given != wanted:
            raise MeasurementError(
                f"rows() returned {wanted} for one heading hypothesis and {given} for another, at {t_ns} ns",
                advice="give each state as many rows as the others; a row with the innovation NaN is refused",
            )


def _moved_by_heading(bank: Bank, lead: int, member: _Member) -> Bool:
    """Return of each row whether a turn about the vertical through the antenna moves it by more than a sigma.

    The turn is that to the farthest of the open headings. The antenna's position and velocity stay: what GNSS shows of
    all headings is the same. Only a rotation that was shown moves the antenna about the IMU.
    """
    if len(bank.state) == 1:
        return np.ones(len(member.rows), np.bool_)
    m, antenna = bank.state[lead], member.antenna
    turn = max(abs(turn_about(m, other)) for other in bank.state)
    up = np.array(up_direction(m.r_e))
    d = np.zeros(bank.P.shape[1])
    d[PSI : PSI + 3] = turn * up
    d[DR : DR + 3], d[DV : DV + 3] = (
        -np.cross(turn * up, antenna.l_e),
        -np.cross(turn * up, antenna.turning_e),
    )
    moved = np.array([row.h @ d[row.columns] for _, row in member.rows])
    return np.asarray(moved**2 > member.variance)


def _updated(
    m: StateRecord,
    P: Float64,
    member: _Member,
    t_ns: int,
    par: Parameters,
    log_likelihood: Float64,
    information: Float64,
    *,
    followed: Bank | None,
    gate2: float,
    several: bool,
    unused: frozenset[str] = frozenset(),
) -> OwnUpdate:
    """Correct one hypothesis; fill the logarithm of each row's likelihood, NaN of a refused value, and information.

    Kinds that are ``unused`` have entries in the ledger and no effect.
    """
    n = len(P)
    vectors, response, entries = np.zeros((3, n)), m.motion_response[:n], []
    refused = _refused(member, gate2)
    for j, (kind, row) in enumerate(member.rows):
        S, status = float(member.variance[j]), USED
        gate = gate2 if kind.gate2 is None else kind.gate2
        log_likelihood[j] = math.nan
        if not math.isfinite(row.innovation):
            status = BAD_VALUE
        elif kind.name in unused:
            status = CONTRADICTS
        elif refused[j]:
            status = GATED
        else:
            y, given = scalar_update(P, row.h, row.columns, row.innovation, row.variance, vectors)
            if 0.0 < given < math.inf and math.isfinite(y):
                log_likelihood[j] = -0.5 * _charge(y * y / given, given, row)
                if followed is not None:
                    held, n_slow = par.held[: par.n_held], followed.head[0].n_slow
                    correct_by_row_without(
                        followed.slow, n_slow, row.h, row.columns, held, vectors[1], vectors[2]
                    )
            else:
                status = GATED
        if status == USED and several:  # as in ``epoch_update.respond``
            moved = float(row.h @ response[row.columns])
            response -= vectors[1] * moved
            information[j] = moved**2 / given
        if status == GATED:  # a hypothesis must not gain by leaving out what contradicts it
            counted = S - row.single_variance + row.variance
            sound = 0.0 < counted < math.inf
            charged = min(gate, row.innovation**2 / counted) if sound else gate
            log_likelihood[j] = -0.5 * (_charge(charged, counted, row) if sound else charged)
        entries.append(OwnEntry(t_ns, kind.name, row.innovation, S, status))
    correction = vectors[0]
    if correction.any():
        if par.motion_gate2 > 0.0:
            turn_attitude_errors(m, P, par, correction, member.antenna)
            turn_force_errors(m, P, par, correction)
        _feed_back(m, correction, int(par.at_clone))
    return OwnUpdate(entries, correction)


def _charge(squares: float, S: float, row: CheckedRow) -> float:
    """Return a row's charge on the likelihood, as in ``use_rows``."""
    r, spread = row.single_variance, row.variance / row.single_variance
    return float(charge(squares, S, r, spread))


def _refused(member: _Member, gate2: float) -> list[bool]:
    """Return of each row whether a gate refuses it: its own, or that of a row that it stands or falls with."""
    beyond = [
        not row.innovation**2 <= (gate2 if kind.gate2 is None else kind.gate2) * float(S)
        for (kind, row), S in zip(member.rows, member.variance, strict=True)
    ]
    fallen = {
        kind.name
        for (kind, row), out in zip(member.rows, beyond, strict=True)
        if out and kind.together and math.isfinite(row.innovation)
    }
    return [out or kind.name in fallen for (kind, _), out in zip(member.rows, beyond, strict=True)]


def _feed_back(m: StateRecord, correction: Float64, at_clone: int) -> None:
    """Close the loop; the epoch before is corrected too, as the next carrier differences are about it."""
    close_loop(m, correction, len(correction) - (N_CLONE if at_clone >= 0 else 0))
    if at_clone >= 0:
        m.r_clone += correction[at_clone : at_clone + 3]
        m.clock_clone += correction[at_clone + CLONE_CLOCK]


def _weigh(
    bank: Bank,
    log_likelihood: Float64,
    information: Float64,
    direct: Bool,
    leader: _Member,
    par: Parameters,
) -> None:
    """Weigh the hypotheses by the rows: those that depend on heading in full, the others by the shown motion."""
    if len(bank.state) == 1:
        bank.head[0].log_likelihood += float(np.nansum(log_likelihood))
        return
    judging = ~np.isnan(log_likelihood).any(axis=0)  # a value refused for one says nothing of the others
    for rows, in_full in ((judging & ~direct, False), (judging & direct, True)):
        if rows.any():
            likelihood = log_likelihood[:, rows].sum(axis=1)
            if not bank.head[0].more_than_headings:
                least = likelihood.max() - leader.most_charge[rows].max()
                likelihood = np.where(np.isneginf(likelihood), likelihood, np.maximum(likelihood, least))
            bank.state["log_likelihood"] = likelihood
            bank.state["motion_information"] = information[:, rows].sum(axis=1)
            weigh_headings(bank, par, in_full)


def _charge_unlikely(
    bank: Bank, estimates: dict[int, StateEstimate], kinds: list[Kind], t_ns: int, par: Parameters
) -> None:
    """Lower the weight of the headings under which the vehicle moves in an unusual way, once each."""
    log_likelihood, charged = bank.state["log_likelihood"], False
    log_likelihood[:] = 0.0
    for i, estimate in estimates.items():
        if bank.state[i].unlikely_ns:
            continue
        charge = sum(min(float(kind.unlikely(estimate)), 0.0) for kind in kinds if kind.unlikely is not None)
        if charge < 0.0:
            log_likelihood[i], bank.state[i].unlikely_ns, charged = charge, t_ns, True
    if charged:
        weigh_headings(bank, par, True)


def carry_through(
    bank: Bank,
    until_ns: int,
    setup: FilterSetup,
    imu: ImuSamples,
    parameters: npt.NDArray[Any],
    scratch: Scratch,
    take: Callable[[OwnUpdate], None] = lambda _: None,
) -> None:
    """Carry a bank that writes nothing by way of the own rows up to ``until_ns`` and use them; it stays at the last."""
    for t_ns in () if setup.own is None else setup.own.due(int(bank.head[0].now_ns), until_ns):
        carry_bank(bank, t_ns, imu, parameters[0], scratch)
        take(use_own_rows(bank, t_ns, setup, imu, parameters, scratch))


def run_beside(
    bank: Bank,
    rows: GnssRows,
    imu: ImuSamples,
    parameters: Table,
    out: Output,
    work: FilterWorkspace,
    setup: FilterSetup,
    take: Callable[[OwnUpdate], None] = lambda _: None,
) -> int:
    """Run a parallel bank through epochs and the own rows between them; return why the loop stopped."""
    first, last = 0, len(rows.epoch_ns)
    while first < last:
        stop = last
        if setup.own is not None:
            carry_through(bank, int(rows.epoch_ns[first]), setup, imu, parameters, work.scratch, take)
            stop = setup.own.epochs_before_next(rows.epoch_ns, first, last)
        code, first = run_epochs(bank, (first, stop), rows, imu, parameters, -math.inf, out, work)
        if code != DONE:
            return int(code)
    return DONE


def before(out: Output, t_ns: int) -> Output:
    """Return an output that is asked for nothing from ``t_ns`` on: a row at that time is written after its update."""
    return out._replace(times_ns=out.times_ns[: np.searchsorted(out.times_ns, t_ns)])
