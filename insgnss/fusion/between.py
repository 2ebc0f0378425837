"""Between two epochs: the filter's state at any time with its covariance, and what the later epochs tell of it.

From one epoch to the next there is no measurement, so an error at the time t only follows the transition. With lambda
and Lambda what the smoother knows at the next epoch, of its prediction (x^-, P^-),

    lambda_k+1 = (P^-)^-1 (x^s - x^-),         Lambda_k+1 = (P^-)^-1 (P^- - P^s) (P^-)^-1
    lambda(t) = Phi(k+1, t)^T lambda_k+1,      Lambda(t) = Phi(k+1, t)^T Lambda_k+1 Phi(k+1, t)
    x^s(t) = x(t) + P(t) lambda(t),            P^s(t) = P(t) - P(t) Lambda(t) P(t)

which is the same as x(t) + C (x^s - x^-), C = P(t) Phi^T (P^-)^-1, and needs one inverse a step, whatever the number of
times.                                                                       [Bryson & Frazier 1963; Bierman 1973]
Phi is read off a prediction that carries a unit matrix along, in pieces of at most a second, over which it has a
harmless inverse: of a minute without measurements it would not.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.fusion.closed_loop import close_loop
from insgnss.fusion.loop import newest_sample
from insgnss.fusion.output import COUNT_DTYPE, N_USED, Table, write_nav
from insgnss.fusion.prediction import Imu, Scratch, carry_bank, new_scratch, predict_covariance
from insgnss.fusion.state import STATE_DTYPE, Bank, StateArray, copy_state
from insgnss.fusion.tracing import copy_matrix
from insgnss.jit import borrowing, kernel
from insgnss.tables import Float64, Int64

_PIECE_NS: Final = NS_PER_S
_AT_ONCE: Final = 1000  # times, whose matrices are then some megabytes


class Costate(NamedTuple):
    """What the smoother knows at an epoch, of the prediction for it."""

    t_ns: int
    value: Float64  # (q,) lambda
    information: Float64  # (q, q) Lambda
    imu: Imu  # the samples on the way to it, with what is not known of them


class Nodes(NamedTuple):
    """The filter at some times after an epoch."""

    state: StateArray  # (m,) of STATE_DTYPE
    P: Float64  # (m, q, q)
    Phi: Float64  # (m, q, q) from the beginning of the piece


class Between(NamedTuple):
    """Smoothed states at some of the output times, in their order."""

    rows: slice  # of the times asked for
    state: StateArray  # (m,) the filter's
    correction: Float64  # (m, n) to be added to it
    P: Float64  # (m, n, n)


def one_hypothesis(state: StateArray, P: Float64, head: StateArray) -> Bank:
    """Return a copy of a bank without what only updates need."""
    return Bank(state.copy(), P.copy(), head.copy(), np.zeros((1, 0), np.int8), np.zeros((1, 0, 3)))


def filtered(
    bank: Bank, times_ns: Int64, imu: Imu, parameters: npt.NDArray[Any]
) -> Iterator[tuple[slice, Float64]]:
    """Yield the covariances (m, q, q) of a bank of one hypothesis at times not before its own, some at a time."""
    carried = _with_unit_matrix(bank)
    for first in range(0, len(times_ns), _AT_ONCE):
        some = slice(first, min(first + _AT_ONCE, len(times_ns)))
        yield some, _nodes(carried, times_ns[some], imu, parameters).P


def smoothed(
    bank: Bank, times_ns: Int64, onward: Costate, parameters: npt.NDArray[Any], n: int
) -> Iterator[Between]:
    """Yield the smoothed states at times between an epoch and the next, the last piece of time first.

    Parameters
    ----------
    bank : the filter of one hypothesis after the earlier epoch
    times_ns : (m,) increasing, after that epoch and before the next
    onward : what is known at the next
    n : error states that are written, without the clone
    """
    imu = onward.imu
    begun: list[Bank] = []
    for end_ns in _pieces(int(bank.head[0].now_ns), onward.t_ns, imu):
        piece = _with_unit_matrix(bank)
        begun.append(one_hypothesis(*piece[:3]))
        bank = _flushed(piece, end_ns, imu, parameters)
    value, information, end_ns = onward.value, onward.information, onward.t_ns
    for piece in reversed(begun):
        begin_ns = int(piece.head[0].now_ns)
        first, last = np.searchsorted(times_ns, [begin_ns, end_ns], side="right")
        last = min(int(last), len(times_ns))
        nodes = _nodes(piece, np.append(times_ns[first:last], end_ns), imu, parameters)
        value, information = nodes.Phi[-1].T @ value, nodes.Phi[-1].T @ information @ nodes.Phi[-1]
        if last > first:
            back = np.linalg.inv(nodes.Phi[:-1])
            own = np.einsum("kji,j->ki", back, value)
            P = nodes.P[:-1]
            gain = P @ back.transpose(0, 2, 1)
            shrunk = P - gain @ information @ gain.transpose(0, 2, 1)
            correction = np.einsum("kij,kj->ki", P, own)
            yield Between(slice(first, last), nodes.state[:-1], correction[:, :n], shrunk[:, :n, :n])
        end_ns = begin_ns


def write_smoothed(out_nav: Table, optional: Float64, first: int, found: Between) -> None:
    """Write navigation rows from ``first`` on anew, as the smoothed states have them."""
    count = len(found.state)
    rows = slice(first, first + count)
    write_corrected(
        out_nav[rows],
        optional[rows],
        found.state,
        np.ascontiguousarray(found.correction),
        np.ascontiguousarray(found.P),
        np.zeros(1, COUNT_DTYPE),
    )


def _pieces(begin_ns: int, end_ns: int, imu: Imu) -> list[int]:
    """Return where the pieces of a way end: at samples, the last at ``end_ns``."""
    wanted = np.arange(begin_ns + _PIECE_NS, end_ns, _PIECE_NS)
    at = np.minimum(np.searchsorted(imu.t_ns, wanted), len(imu.t_ns) - 1)
    found = np.unique(imu.t_ns[at])
    return [*found[(found > begin_ns) & (found < end_ns)].tolist(), end_ns]


def _with_unit_matrix(bank: Bank) -> Bank:
    """Return a copy of a bank of one hypothesis whose covariance has the unit matrix beside it (1, 2 q, 2 q)."""
    q = bank.P.shape[1]
    P = np.zeros((1, 2 * q, 2 * q))
    P[0, :q, :q] = bank.P[0]
    P[0, :q, q:] = P[0, q:, :q] = np.eye(q)
    return Bank(bank.state.copy(), P, bank.head.copy(), np.zeros((1, 0), np.int8), np.zeros((1, 0, 3)))


def _flushed(piece: Bank, end_ns: int, imu: Imu, parameters: npt.NDArray[Any]) -> Bank:
    """Return the bank (1, q, q) at the end of a piece, its covariance carried all the way."""
    scratch, q = new_scratch(piece.P.shape[1]), piece.P.shape[1] // 2
    carry_bank(piece, end_ns, imu, parameters[0], scratch)
    predict_covariance(piece.state[0], piece.P[0], parameters[0], scratch)
    return piece._replace(P=np.ascontiguousarray(piece.P[:, :q, :q]))


def _nodes(piece: Bank, times_ns: Int64, imu: Imu, parameters: npt.NDArray[Any]) -> Nodes:
    """Return the filter at times after the beginning of a piece."""
    m, q = len(times_ns), piece.P.shape[1] // 2
    nodes = Nodes(np.zeros(m, STATE_DTYPE), np.empty((m, q, q)), np.empty((m, q, q)))
    spare = one_hypothesis(*piece[:3])
    carry_through(piece, spare, times_ns, imu, parameters, nodes, new_scratch(2 * q))
    return nodes


@borrowing
def carry_through(
    bank: Bank,
    spare: Bank,
    times_ns: Int64,
    imu: Imu,
    parameters: Table,
    nodes: Nodes,
    scratch: Scratch,
) -> None:
    """Carry a bank of one hypothesis by way of increasing times, and write what it is at each.

    Its covariance (2 q, 2 q) has the unit matrix beside it. It is carried from sample to sample, as in the filter's
    loop; what lies between samples, or within a step of the covariance, is made on ``spare``.
    """
    par, head, q = parameters[0], bank.head[0], nodes.P.shape[1]
    for i in range(times_ns.shape[0]):
        carry_bank(bank, newest_sample(head, imu, times_ns[i]), imu, par, scratch)
        copy_state(bank.state[0], spare.state[0])
        copy_matrix(bank.P[0], spare.P[0])
        spare.head[0].now_ns, spare.head[0].next = head.now_ns, head.next
        carry_bank(spare, times_ns[i], imu, par, scratch)
        predict_covariance(spare.state[0], spare.P[0], par, scratch)
        copy_state(spare.state[0], nodes.state[i])
        for a in range(q):
            for b in range(q):
                nodes.P[i, a, b] = spare.P[0, a, b]
                nodes.Phi[i, a, b] = spare.P[0, a, q + b]


@kernel
def write_corrected(
    nav: Table, optional: Float64, state: StateArray, correction: Float64, P: Float64, count: Table
) -> None:
    """Write navigation rows anew from states (m,), corrections (m, n) and covariances (m, n, n), of one heading."""
    for i in range(state.shape[0]):
        close_loop(state[i], correction[i], correction.shape[1])
        count[0].nav = i
        used = int(nav[i].value[N_USED])
        t_ns = nav[i].t_ns
        write_nav(nav, optional, count[0], t_ns, state[i], P[i], used, 1)
