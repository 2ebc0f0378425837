"""The states of slow errors by satellite: a new satellite takes a free state, or that of the one unseen for longest."""

from __future__ import annotations

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import Lines
from insgnss.filter.state import N_OF_SATELLITE, N_PATTERNS, OFFSETS, Bank, HeadRecord, SlowErrors
from insgnss.gnss.observation_rows import N_BANDS, GnssRows
from insgnss.kernels.jit import kernel
from insgnss.tables import Int64


@kernel(apart=True)
def place_range_biases(bank: Bank, par: Parameters, rows: GnssRows, epoch: int, lines: Lines) -> None:
    """Write into the lines of an epoch which slow error is that of each row's satellite.

    It is a state of the filter where the settings ask for that, else ``N_OF_SATELLITE`` rows of ``SlowErrors.S``. All
    hypotheses have the same, so it is decided once for the bank. First come the satellites that have a place; those
    that are then without one take places of satellites that this epoch does not have, as far as there are any.
    """
    states, n = par.at_range_biases >= 0, par.n_slow
    head, first, t_ns = bank.head[0], rows.first[epoch], rows.epoch_ns[epoch]
    if not states:
        head.n_slow = max(head.n_slow, N_PATTERNS)
    for new in range(2):
        for j in range(rows.first[epoch + 1] - first):
            row = rows.observation[first + j]
            if new == 0:
                lines[j].bias = 0
            if lines[j].bias != 0 or (row.bias_sigma <= 0.0 and (states or par.reflection_rate <= 0.0)):
                continue
            name = row.slot // N_BANDS + 1
            i = place_of(head, n, name)
            if i < 0 and new == 1:
                i = longest_unseen(head, n, t_ns)
                if i >= 0 and head.biased[i] != 0:
                    if states:
                        forget_state(bank, par.at_range_biases + i)
                    else:
                        for own in range(N_OF_SATELLITE):
                            forget_effect(bank.slow, error_at(i, own), par.held[: par.n_held])
            if i >= 0:
                head.biased[i], head.biased_ns[i] = name, t_ns
                lines[j].bias = i + 1
                if not states:
                    head.n_slow = max(head.n_slow, error_at(i + 1, 0))


@kernel(inline=True)
def error_at(place: int, own: int) -> int:
    """Return which slow error is number ``own`` of the satellite at a place."""
    return N_PATTERNS + N_OF_SATELLITE * place + own


@kernel(inline=True)
def place_of(head: HeadRecord, n: int, name: int) -> int:
    """Return which of ``n`` places is that of a satellite, -1 where it has none."""
    for i in range(n):
        if head.biased[i] == name:
            return i
    return -1


@kernel(inline=True)
def longest_unseen(head: HeadRecord, n: int, t_ns: int) -> int:
    """Return a free place, else that of the satellite unseen for longest; -1 if all are in the epoch ``t_ns``."""
    oldest = -1
    for i in range(n):
        if head.biased_ns[i] < t_ns and (oldest < 0 or head.biased_ns[i] < head.biased_ns[oldest]):
            oldest = i
    return oldest


@kernel(inline=True)
def forget_state(bank: Bank, at: int) -> None:
    """Let a state of unit variance be unknown again, in all hypotheses."""
    for member in range(bank.state.shape[0]):
        bank.state[member].optional[at - OFFSETS] = 0.0
        for i in range(bank.P.shape[1]):
            bank.P[member, at, i] = 0.0
            bank.P[member, i, at] = 0.0
        bank.P[member, at, at] = 1.0


@kernel(inline=True)
def forget_effect(slow: SlowErrors, i: int, held: Int64) -> None:
    """Free the place of an error without a state: what it has done to the filter's state stays, on its own."""
    for a in held:
        for b in held:
            slow.R[a, b] += slow.S[i, a] * slow.S[i, b]
    for a in held:
        slow.S[i, a] = 0.0
