"""Observation values as RINEX lists them, one per code, become rows: pseudorange, Doppler and C/N0 of one signal."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from insgnss.tables import Float64, GnssTable, Int64

# RINEX 2 names one Doppler and one signal strength for each band, whatever the code
SHARED_BAND_BELOW_VERSION: Final = 3.0
_CODE: Final = re.compile(r"[CDS]\d[A-Z]?")


@dataclass
class ObservationValues:
    """All observations of a file, in the order they stand in it."""

    version: float = 3.0
    t_ns: list[int] = field(default_factory=list)  # of each epoch
    counts: list[int] = field(default_factory=list)  # values of each epoch
    satellites: list[str] = field(default_factory=list)  # of each value
    codes: list[str] = field(default_factory=list)  # "C1C", "L1C", "D1C", "S1C"
    values: list[Float64] = field(default_factory=list)  # one array for each epoch

    def append(self, t_ns: int, satellites: Sequence[str], codes: Sequence[str], values: Float64) -> None:
        """Add the observations of one epoch."""
        self.t_ns.append(t_ns)
        self.counts.append(len(codes))
        self.satellites += satellites
        self.codes += codes
        self.values.append(values)


def observation_rows(observed: ObservationValues) -> GnssTable:
    """Return one row for each epoch, satellite and signal that has a pseudorange or a Doppler.

    A pseudorange of zero means "missing" (RINEX 2.11, 6.7; RINEX 3.05, 6.7).
    """
    sv, sv_names = _encoded(observed.satellites)
    code, codes = _encoded(observed.codes)
    epoch = np.repeat(np.arange(len(observed.t_ns)), observed.counts)
    value = np.concatenate(observed.values) if observed.values else np.zeros(0)
    shared = observed.version < SHARED_BAND_BELOW_VERSION
    kinds_of_rows = "C" if shared else "CD"
    measured = [name for name in codes if _CODE.fullmatch(name)]
    signal_names = tuple(sorted({"C" + name[1:] for name in measured if name[0] in kinds_of_rows}))
    kinds = {"C": _Kind(), "D": _Kind(), "S": _Kind()}
    present = ~np.isnan(value)
    for index, name in enumerate(codes):
        if name not in measured:
            continue
        rows = np.flatnonzero((code == index) & present & ((value != 0.0) | (name[0] != "C")))
        for target in _signals_of(name, signal_names, shared):
            key = (epoch[rows] * len(sv_names) + sv[rows]) * len(signal_names) + target
            kinds[name[0]].add(key, value[rows])
    return _table(kinds, np.array(observed.t_ns, dtype=np.int64), sv_names, signal_names, shared)


class _Kind:
    """Values of one kind by row key; of two values with one key the first counts."""

    def __init__(self) -> None:
        self._keys: list[Int64] = []
        self._values: list[Float64] = []

    def add(self, keys: Int64, values: Float64) -> None:
        self._keys.append(keys)
        self._values.append(values)

    def keys(self) -> Int64:
        return np.concatenate([np.zeros(0, np.int64), *self._keys])

    def at(self, wanted: Int64) -> Float64:
        """Return the value of each wanted key (ascending), NaN where there is none."""
        keys, first = np.unique(self.keys(), return_index=True)
        values = np.concatenate([np.zeros(0), *self._values])[first]
        result = np.full(len(wanted), np.nan)
        if len(keys):
            place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
            found = keys[place] == wanted
            result[found] = values[place[found]]
        return result


def _encoded(words: list[str]) -> tuple[npt.NDArray[np.int64], tuple[str, ...]]:
    """Return the index of each word into the sorted distinct words."""
    encoded = pa.array(words, pa.string()).dictionary_encode()
    names = encoded.dictionary.to_pylist()
    order = np.argsort(np.array(names)) if names else np.zeros(0, np.int64)
    rank = np.empty(len(names), np.int64)
    rank[order] = np.arange(len(names))
    return rank[encoded.indices.to_numpy(zero_copy_only=False)], tuple(names[i] for i in order)


def _signals_of(code: str, signal_names: tuple[str, ...], shared: bool) -> list[int]:
    """Return the signals that a code's value belongs to."""
    same_band = [i for i, name in enumerate(signal_names) if name[1] == code[1]]
    if shared and code[0] != "C":
        return same_band
    return [i for i in same_band if signal_names[i][1:] == code[1:]]


def _table(
    kinds: dict[str, _Kind],
    t_ns: Int64,
    sv_names: tuple[str, ...],
    signal_names: tuple[str, ...],
    shared: bool,
) -> GnssTable:
    keys = np.unique(kinds["C"].keys() if shared else np.concatenate([kinds["C"].keys(), kinds["D"].keys()]))
    per_epoch = max(1, len(sv_names) * len(signal_names))
    n_signals = max(1, len(signal_names))
    return GnssTable(
        t_ns[keys // per_epoch] if len(t_ns) else np.zeros(0, np.int64),
        (keys % per_epoch // n_signals).astype(np.int16),
        (keys % n_signals).astype(np.int16),
        kinds["C"].at(keys),
        kinds["D"].at(keys),
        np.full(len(keys), np.nan),
        kinds["S"].at(keys),
        sv_names,
        signal_names,
    )
