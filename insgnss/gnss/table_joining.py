"""Several tables of observations as one, with one list of satellites and one of signals."""

from __future__ import annotations

import numpy as np

from insgnss.tables import Float64, GnssTable, Int8, Int16


def joined(parts: list[GnssTable]) -> GnssTable:
    """Return the rows of all parts, one after the other, with one list of satellites and one of signals."""
    if len(parts) == 1:
        return parts[0]
    sv_names = tuple(dict.fromkeys(name for part in parts for name in part.sv_names))
    signal_names = tuple(dict.fromkeys(name for part in parts for name in part.signal_names))
    starts = np.cumsum([0] + [len(part.t_ns) for part in parts])
    return GnssTable(
        np.concatenate([part.t_ns for part in parts]),
        np.concatenate([_renumbered(part.sv, part.sv_names, sv_names) for part in parts]),
        np.concatenate([_renumbered(part.signal, part.signal_names, signal_names) for part in parts]),
        np.concatenate([part.pseudorange_m for part in parts]),
        np.concatenate([part.doppler_hz for part in parts]),
        np.concatenate([part.range_rate_mps for part in parts]),
        np.concatenate([part.cn0_dbhz for part in parts]),
        sv_names,
        signal_names,
        _stacked([part.sat for part in parts], parts, 8),
        _stacked([part.sigma_pseudorange_m for part in parts], parts, None),
        _stacked([part.sigma_range_rate_mps for part in parts], parts, None),
        np.concatenate([part.bad_cells + start for part, start in zip(parts, starts, strict=False)]),
        _stacked([part.carrier_cycles for part in parts], parts, None),
        _stacked_flags(parts),
        {name: channel for part in parts for name, channel in part.glonass_channels.items()},
    )


def _stacked_flags(parts: list[GnssTable]) -> Int8 | None:
    """Return the loss-of-lock indicators joined, zero where a part has none; None when no part has them."""
    if all(part.lli is None for part in parts):
        return None
    return np.concatenate([np.zeros(len(p.t_ns), np.int8) if p.lli is None else p.lli for p in parts])


def _renumbered(index: Int16, old: tuple[str, ...], new: tuple[str, ...]) -> Int16:
    return np.array([new.index(name) for name in old] + [-1], dtype=np.int16)[index]


def _stacked(columns: list[Float64 | None], parts: list[GnssTable], width: int | None) -> Float64 | None:
    """Return the columns joined, NaN where a part lacks them; None when no part has them."""
    if all(column is None for column in columns):
        return None
    filled = []
    for column, part in zip(columns, parts, strict=True):
        shape = (len(part.t_ns),) if width is None else (len(part.t_ns), width)
        filled.append(np.full(shape, np.nan) if column is None else column)
    return np.concatenate(filled)
