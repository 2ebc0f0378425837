"""Between two epochs: the filter's state at any time with its covariance, and its correction by later epochs.

From one epoch to the next there is no measurement, so an error at the time t only follows the transition. With x^-, P^-
the filter's prediction for the next epoch and x^s, P^s the smoothed estimate of it,

    x^s(t) = x(t) + C (x^s - x^-),  P^s(t) = P(t) + C (P^s - P^-) C^T,  C = P(t) Phi(k+1, t)^T (P^-)^-1

which is a step of Rauch, Tung and Striebel from k+1 to an epoch without measurements, however many there are between.
Phi is read off a prediction that carries a unit matrix along, in pieces of about a second, over which it has a harmless
inverse: of a minute without measurements it would not.

At the end of such a minute P^s is 1e-4 of P, so P(t) and P^- have to be of one and the same way: the filter's, whose
covariance goes in steps. The equations hold so for the end t' of the last whole step. From there to t, with F and Q of
the step's part and D = P^s - P^-,

    C = F C' + K,  K = Q Phi(k+1, t)^T (P^-)^-1
    P^s(t) = F P^s(t') F^T + Q + F C' D K^T + K D C'^T F^T + K D K^T
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.filter.output.gps_time import covariances_at_gps_time
from insgnss.filter.output.writing import COUNT_DTYPE, N_USED, Table, write_nav
from insgnss.filter.prediction import ImuSamples, Scratch, carry_bank, new_scratch, predict_covariance
from insgnss.filter.state import (
    STATE_DTYPE,
    Bank,
    StateArray,
    copy_matrix,
    copy_state,
    no_slow_errors,
)
from insgnss.filter.update.closed_loop import close_loop
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int64

_PIECE_NS: Final = NS_PER_S
_AT_ONCE: Final = 1000  # times, whose matrices are then some megabytes
_NO_UPDATES: Final = (np.zeros((1, 0), np.int8), np.zeros((1, 0, 3)), no_slow_errors(0))


class NextEpoch(NamedTuple):
    """The smoothed estimate at the next epoch."""

    t_ns: int
    prior: Float64  # (q, q) predicted for it
    step: Float64  # (q,) smoothed state minus the predicted one
    change: Float64  # (q, q) smoothed covariance minus the predicted one
    imu: ImuSamples  # the samples on the way to it, with what is not known of them


class Nodes(NamedTuple):
    """The filter at some times after the beginning of a piece, and at the end of its last whole step before each."""

    state: StateArray  # (m,) of STATE_DTYPE
    P: Float64  # (m, q, q)
    Phi: Float64  # (m, q, q) from the beginning of the piece
    P_step: Float64  # (m, q, q)
    Phi_step: Float64  # (m, q, q)


class InterpolatedStates(NamedTuple):
    """Smoothed states at some of the output times, in their order."""

    rows: slice  # of the times asked for
    state: StateArray  # (m,) the filter's
    correction: Float64  # (m, n) to be added to it
    P: Float64  # (m, n, n)


def one_hypothesis(state: StateArray, P: Float64, head: StateArray) -> Bank:
    """Return a copy of a bank without the data that only updates need."""
    return Bank(state.copy(), P.copy(), head.copy(), *_NO_UPDATES)


def filtered(
    bank: Bank, times_ns: Int64, imu: ImuSamples, parameters: npt.NDArray[Any]
) -> Iterator[tuple[slice, Float64]]:
    """Yield the covariances (m, q, q) of a bank of one hypothesis at times not before its own, some at a time.

    They are those of its rows, at GPS time.
    """
    carried = _with_unit_matrix(bank)
    for first in range(0, len(times_ns), _AT_ONCE):
        some = slice(first, min(first + _AT_ONCE, len(times_ns)))
        nodes = _nodes(carried, times_ns[some], imu, parameters)
        covariances_at_gps_time(nodes.state, parameters, nodes.P)
        yield some, nodes.P


def smoothed(
    bank: Bank, times_ns: Int64, onward: NextEpoch, parameters: npt.NDArray[Any], n: int
) -> Iterator[InterpolatedStates]:
    """Yield the smoothed states at times between an epoch and the next, the last piece of time first.

    Parameters
    ----------
    bank : the filter of one hypothesis after the earlier epoch
    times_ns : (m,) increasing, after that epoch and before the next
    onward : the smoothed estimate at the next
    n : error states that are written, without the clone
    """
    begun: list[Bank] = []
    while int(bank.head[0].now_ns) < onward.t_ns:
        begun.append(_with_unit_matrix(bank))
        bank = _after_a_piece(bank, onward, parameters)
    way, end_ns = np.eye(len(onward.step)), onward.t_ns  # Phi from the end of the piece to the next epoch
    for piece in reversed(begun):
        begin_ns = int(piece.head[0].now_ns)
        first, last = map(int, np.searchsorted(times_ns, [begin_ns, end_ns], side="right"))
        nodes = _nodes(piece, np.append(times_ns[first:last], end_ns), onward.imu, parameters)
        way = way @ nodes.Phi[-1]
        if last > first:
            some = Nodes(*(column[:-1] for column in nodes))
            yield InterpolatedStates(slice(first, last), some.state, *_told_of(some, way, onward, n))
        end_ns = begin_ns


def _told_of(nodes: Nodes, way: Float64, onward: NextEpoch, n: int) -> tuple[Float64, Float64]:
    """Return correction (m, n) and covariance (m, n, n); ``way`` is Phi from the piece's beginning to the epoch."""
    first, step = _distinct_steps(nodes)
    P_step, back = nodes.P_step[first], np.linalg.inv(nodes.Phi_step[first])
    gain = _gain(P_step, way @ back, onward)
    change_at_step = P_step + gain @ onward.change @ gain.transpose(0, 2, 1)
    whole_F = nodes.Phi @ back[step]
    F = whole_F[:, :n]
    Q = nodes.P[:, :n] - F @ P_step[step] @ whole_F.transpose(0, 2, 1)
    of_noise = _gain(Q, way @ np.linalg.inv(nodes.Phi), onward)
    carried = F @ gain[step]
    crossed = carried @ onward.change @ of_noise.transpose(0, 2, 1)
    smoothed = F @ change_at_step[step] @ F.transpose(0, 2, 1)
    smoothed += Q[:, :, :n] + crossed + crossed.transpose(0, 2, 1)
    smoothed += of_noise @ onward.change @ of_noise.transpose(0, 2, 1)
    return (carried + of_noise) @ onward.step, smoothed


def _distinct_steps(nodes: Nodes) -> tuple[Int64, Int64]:
    """Return the first time of each step of the covariance, and the number of its step for each time.

    At a hundred times the rate of the steps, a hundred times share one inverse and one gain.
    """
    other = [(matrix[1:] != matrix[:-1]).any(axis=(1, 2)) for matrix in (nodes.P_step, nodes.Phi_step)]
    new = np.append(True, other[0] | other[1])
    return np.flatnonzero(new), np.cumsum(new) - 1


def _gain(P: Float64, way: Float64, onward: NextEpoch) -> Float64:
    """Return P Phi(k+1, t)^T (P^-)^-1 of covariances (m, n, q) and ways (m, q, q) to the next epoch."""
    crosses = P @ way.transpose(0, 2, 1)
    return regression(crosses.reshape(-1, way.shape[-1]), onward.prior).reshape(P.shape)


def regression(cross: Float64, P: Float64) -> Float64:
    """Return ``cross @ P^-1`` of a covariance whose states differ in size by ten powers of ten.

    States without variance, such as the clone at an epoch of a start, carry no information.
    """
    known = np.flatnonzero(np.diagonal(P) > 0.0)
    scale = 1.0 / np.sqrt(np.diagonal(P)[known])
    unit = P[np.ix_(known, known)] * np.outer(scale, scale)
    scaled = (cross[:, known] * scale).T
    try:
        solved = np.linalg.solve(unit, scaled)
    except np.linalg.LinAlgError:
        solved = np.linalg.lstsq(unit, scaled, rcond=None)[0]
    gain = np.zeros(cross.shape)
    gain[:, known] = solved.T * scale
    return gain


def write_smoothed(
    out_nav: Table, optional: Float64, first: int, states: InterpolatedStates, parameters: npt.NDArray[Any]
) -> None:
    """Rewrite navigation rows from ``first`` on from the smoothed states."""
    count = len(states.state)
    rows = slice(first, first + count)
    write_corrected(
        out_nav[rows],
        optional[rows],
        states.state,
        np.ascontiguousarray(states.correction),
        states.P,
        parameters,
        np.zeros(1, COUNT_DTYPE),
    )


def _with_unit_matrix(bank: Bank) -> Bank:
    """Return a copy of a bank of one hypothesis whose covariance is augmented by the unit matrix (1, 2 q, 2 q)."""
    q = bank.P.shape[1]
    P = np.zeros((1, 2 * q, 2 * q))
    P[0, :q, :q] = bank.P[0]
    P[0, :q, q:] = P[0, q:, :q] = np.eye(q)
    return Bank(bank.state.copy(), P, bank.head.copy(), *_NO_UPDATES)


def _after_a_piece(bank: Bank, onward: NextEpoch, parameters: npt.NDArray[Any]) -> Bank:
    """Return the bank at the end of the piece that begins where it is."""
    carried = one_hypothesis(bank.state, bank.P, bank.head)
    least_ns, scratch = int(bank.head[0].now_ns) + _PIECE_NS, new_scratch(bank.P.shape[1])
    carry_whole_steps(carried, least_ns, onward.t_ns, onward.imu, parameters, scratch)
    return carried


def _nodes(piece: Bank, times_ns: Int64, imu: ImuSamples, parameters: npt.NDArray[Any]) -> Nodes:
    """Return the filter at times after the beginning of a piece, to the last of which the piece is carried."""
    m, q = len(times_ns), piece.P.shape[1] // 2
    nodes = Nodes(np.zeros(m, STATE_DTYPE), *(np.empty((m, q, q)) for _ in range(4)))
    spare, step = one_hypothesis(*piece[:3]), np.empty((2 * q, 2 * q))
    carry_through(piece, spare, step, times_ns, imu, parameters, nodes, new_scratch(2 * q))
    return nodes


@kernel
def carry_whole_steps(
    bank: Bank, least_ns: int, stop_ns: int, imu: ImuSamples, parameters: Table, scratch: Scratch
) -> None:
    """Carry a bank of one hypothesis to the end of a covariance's step from ``least_ns`` on, or to ``stop_ns``."""
    par, head = parameters[0], bank.head[0]
    while head.now_ns < stop_ns:
        goal_ns = stop_ns
        if head.next < imu.t_ns.shape[0] and imu.t_ns[head.next] < stop_ns:
            goal_ns = imu.t_ns[head.next]
        carry_bank(bank, goal_ns, imu, par, scratch)
        if head.now_ns >= least_ns and bank.state[0].sum_dt == 0.0:
            return
    predict_covariance(bank.state[0], bank.P[0], par, scratch)


@kernel
def carry_through(
    bank: Bank,
    spare: Bank,
    step: Float64,
    times_ns: Int64,
    imu: ImuSamples,
    parameters: Table,
    nodes: Nodes,
    scratch: Scratch,
) -> None:
    """Carry a bank of one hypothesis by way of increasing times, and write what it is at each.

    Its covariance (2 q, 2 q) is augmented by the unit matrix. It is carried from sample to sample, as in the filter's
    loop; what lies between samples, or within a step of the covariance, is made on ``spare``. ``step`` (2 q, 2 q) keeps
    the covariance at the end of the last step.
    """
    par, head, q = parameters[0], bank.head[0], nodes.P.shape[1]
    copy_matrix(bank.P[0], step)
    for i in range(times_ns.shape[0]):
        while head.next < imu.t_ns.shape[0] and imu.t_ns[head.next] <= times_ns[i]:
            carry_bank(bank, imu.t_ns[head.next], imu, par, scratch)
            if bank.state[0].sum_dt == 0.0:
                copy_matrix(bank.P[0], step)
        copy_state(bank.state[0], spare.state[0])
        copy_matrix(bank.P[0], spare.P[0])
        spare.head[0].now_ns, spare.head[0].next = head.now_ns, head.next
        carry_bank(spare, times_ns[i], imu, par, scratch)
        predict_covariance(spare.state[0], spare.P[0], par, scratch)
        copy_state(spare.state[0], nodes.state[i])
        for a in range(q):
            for b in range(q):
                nodes.P[i, a, b], nodes.Phi[i, a, b] = spare.P[0, a, b], spare.P[0, a, q + b]
                nodes.P_step[i, a, b], nodes.Phi_step[i, a, b] = step[a, b], step[a, q + b]


@kernel
def write_corrected(
    nav: Table,
    optional: Float64,
    state: StateArray,
    correction: Float64,
    P: Float64,
    parameters: Table,
    count: Table,
) -> None:
    """Rewrite navigation rows from states (m,), corrections (m, n) and covariances (m, n, n), of one heading."""
    for i in range(state.shape[0]):
        close_loop(state[i], correction[i], correction.shape[1])
        count[0].nav = i
        used = (int(nav[i].value[N_USED]), 1)
        write_nav(nav, optional, count[0], nav[i].t_ns, state[i], P[i], parameters[0], used)
