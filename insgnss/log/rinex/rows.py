"""Observation values as RINEX lists them, one per code, become rows: all measurements of one signal.

Epochs that show the same satellites with the same codes share a layout: which value of the epoch goes into which row
and column is worked out once for a layout, and all its epochs are then placed at once.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from insgnss.tables import Float64, GnssTable, Int8, Int64

# RINEX 2 names one phase, one Doppler and one signal strength for each band, whatever the code
SHARED_BAND_BELOW_VERSION: Final = 3.0
UNREADABLE: Final = np.inf  # marks a value whose cell held no number
KINDS: Final = "CLDS"  # pseudorange, carrier phase, Doppler, signal strength
_CODE: Final = re.compile(r"[CLDS]\d[A-Z]?")
_LLI_BITS: Final = 7.0  # RINEX 3.05, table A3: bits 0 to 2


@dataclass(frozen=True)
class EpochLayout:
    """The rows of an epoch with these satellites and codes, sorted by satellite and signal."""

    satellites: tuple[str, ...]  # of each row
    signals: tuple[str, ...]  # of each row
    # for each kind, the place of each row's value in the epoch's values; past the end if none
    source: dict[str, Int64]
    size: int  # values of an epoch


@dataclass
class ObservationValues:
    """All observations of a file, in its order."""

    version: float = 3.0
    layouts: list[EpochLayout] = field(default_factory=list)
    t_ns: list[int] = field(default_factory=list)  # of each epoch
    layout_of: list[int] = field(default_factory=list)  # of each epoch
    values: list[Float64] = field(default_factory=list)  # of each epoch
    lli: list[Float64] = field(default_factory=list)  # of each epoch, NaN where blank
    phases_alone: int = 0  # carrier phases without pseudorange and Doppler
    lines: int = 0  # of the epochs as they state it, in RINEX 3 and 4
    repeated: int = 0  # satellites named a second time in their epoch

    def new_layout(self, satellites: Sequence[str], codes: Sequence[str]) -> int:
        """Return the number of a new layout for values of these satellites and codes."""
        self.layouts.append(_layout(satellites, codes, self.version < SHARED_BAND_BELOW_VERSION))
        return len(self.layouts) - 1

    def append(self, t_ns: int, layout: int, values: Float64, lli: Float64) -> None:
        """Add the observations of one epoch."""
        self.t_ns.append(t_ns)
        self.layout_of.append(layout)
        self.values.append(values)
        self.lli.append(lli)


def _layout(satellites: Sequence[str], codes: Sequence[str], shared: bool) -> EpochLayout:
    place: dict[tuple[str, str], int] = {}
    for index, (sv, code) in enumerate(zip(satellites, codes, strict=True)):
        if _CODE.fullmatch(code):
            place.setdefault((sv, code), index)
            if shared and code[0] != "C":
                place.setdefault((sv, code[:2]), index)
    makes_row = "C" if shared else "CDL"
    rows = sorted({(sv, "C" + code[1:]) for sv, code in place if code[0] in makes_row})
    missing = len(codes)

    def source(kind: str) -> Int64:
        end = 2 if shared and kind != "C" else 3
        return np.array([place.get((sv, kind + code[1:end]), missing) for sv, code in rows], dtype=np.int64)

    return EpochLayout(
        tuple(sv for sv, _ in rows), tuple(code for _, code in rows), {k: source(k) for k in KINDS}, missing
    )


def observation_rows(observed: ObservationValues, channels: dict[str, int]) -> GnssTable:
    """Return one row for each epoch, satellite and signal that has a pseudorange or a Doppler, be it unreadable.

    A pseudorange or a carrier phase of zero means "missing" (RINEX 2.11, 6.7; RINEX 3.05, 6.7).
    """
    layouts = observed.layouts
    sv_names = tuple(sorted({sv for layout in layouts for sv in layout.satellites}))
    signal_names = tuple(sorted({code for layout in layouts for code in layout.signals}))
    layout_of = np.array(observed.layout_of, dtype=np.int64)
    counts = np.array([len(layout.signals) for layout in layouts], dtype=np.int64)[layout_of]
    starts = np.concatenate(([0], np.cumsum(counts)))
    n = int(starts[-1])
    sv, signal = np.zeros(n, np.int16), np.zeros(n, np.int16)
    columns = {kind: np.full(n, np.nan) for kind in KINDS}
    lli = np.zeros(n)
    by_layout = np.argsort(layout_of, kind="stable")
    firsts = np.searchsorted(layout_of[by_layout], np.arange(1, len(layouts)))
    for epochs, layout in zip(np.split(by_layout, firsts), layouts, strict=False):
        rows = starts[epochs][:, None] + np.arange(len(layout.signals))
        sv[rows] = [sv_names.index(name) for name in layout.satellites]
        signal[rows] = [signal_names.index(name) for name in layout.signals]
        values = _matrix(observed.values, epochs, layout.size)
        for kind in KINDS:
            columns[kind][rows] = values[:, layout.source[kind]]
        lli[rows] = _matrix(observed.lli, epochs, layout.size)[:, layout.source["L"]]
    for kind in "CL":
        columns[kind][columns[kind] == 0.0] = np.nan
    measured = ~np.isnan(columns["C"])
    if observed.version >= SHARED_BAND_BELOW_VERSION:  # before, a Doppler names no code
        measured |= ~np.isnan(columns["D"])
    phase = ~np.isnan(columns["L"])
    observed.phases_alone = int(np.count_nonzero(phase & ~measured))
    measured_rows = np.flatnonzero(measured)
    unreadable = (columns["C"][measured_rows] == UNREADABLE) | (columns["D"][measured_rows] == UNREADABLE)
    for kind in KINDS:
        columns[kind][columns[kind] == UNREADABLE] = np.nan
    with_phase = bool(phase[measured_rows].any())
    return GnssTable(
        np.repeat(np.array(observed.t_ns, dtype=np.int64), counts)[measured_rows],
        sv[measured_rows],
        signal[measured_rows],
        columns["C"][measured_rows],
        columns["D"][measured_rows],
        np.full(len(measured_rows), np.nan),
        columns["S"][measured_rows],
        sv_names,
        signal_names,
        bad_cells=np.flatnonzero(unreadable).astype(np.int64),
        carrier_cycles=columns["L"][measured_rows] if with_phase else None,
        lli=_flags(lli[measured_rows], phase[measured_rows]) if with_phase else None,
        glonass_channels=channels,
    )


def _matrix(arrays: list[Float64], epochs: Int64, size: int) -> Float64:
    """Return (epochs, size + 1) the arrays of these epochs, NaN in the last column."""
    matrix = np.full((len(epochs), size + 1), np.nan)
    if len(epochs) and size:
        matrix[:, :size] = np.concatenate([arrays[k] for k in epochs]).reshape(len(epochs), size)
    return matrix


def _flags(lli: Float64, phase: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> Int8:
    """Return the indicators of the phases; blank, beyond RINEX's three bits, or without a phase is zero."""
    known = phase & (lli >= 0.0) & (lli <= _LLI_BITS)
    return np.where(known, lli, 0.0).astype(np.int8)
