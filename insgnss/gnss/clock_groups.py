"""Clock groups: which signals share one receiver clock, and which need an offset of their own against it.

Each constellation keeps its own time and takes its own way through the receiver; so does each carrier. A group is
named by its constellation ("E"), a further carrier of the constellation by its band too ("G:L5"). Within a group the
signals of a band differ by less than a metre. QZSS keeps GPS time and sends GPS's signals, yet receivers show it off by
metres: each of its groups is tied to GPS's of the same band, by a difference of zero with a sigma.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from insgnss.gnss.least_squares import Ties
from insgnss.gnss.signals import signal_of
from insgnss.tables import GnssTable, Int64

Pair = tuple[str, str]  # constellation letter and RINEX code: ("G", "C1C")


def pairs_of(gnss: GnssTable) -> set[Pair]:
    """Return the constellations and codes in a log."""
    n = max(len(gnss.signal_names), 1)
    seen = np.unique(gnss.sv.astype(np.int64) * n + gnss.signal)
    return {(gnss.sv_names[k // n][0], gnss.signal_names[k % n]) for k in seen.tolist()}


def clock_groups(
    constellations: tuple[str, ...],
    signals: Mapping[str, tuple[str, ...]],
    present: Iterable[Pair],
    *,
    every_band: bool,
) -> tuple[str, ...]:
    """Return the groups in use, in the order of the settings; the first keeps the receiver clock.

    Parameters
    ----------
    constellations : letters that the filter uses, in order of preference
    signals : per letter the codes that may be used, in order of preference
    present : constellations and codes of the log
    every_band : one signal of each band is used, not the most preferred one alone
    """
    present = set(present)
    with_gps = "G" in {letter for letter, _ in present} and "G" in constellations
    groups: list[str] = []
    for letter in constellations:
        own = _first_band(letter, signals, present)
        # QZSS's groups bear the names of GPS's, whichever of its signals the log has
        first = _first_band("G", signals, present) if letter == "J" and with_gps else own
        for code in signals.get(letter, ()):
            if (letter, code) not in present:
                continue
            band = _band(letter, code)
            name = _group(letter, band, first)
            if name not in groups and (every_band or band == own):
                groups.append(name)
    return tuple(groups) or constellations[:1]


def tied_clocks(groups: tuple[str, ...], sigma_m: float) -> Ties:
    """Return which groups are tied: QZSS's and GPS's of the same band, the later one to the earlier.

    Parameters
    ----------
    groups : as ``clock_groups`` returns them
    sigma_m : of the difference of two tied clocks
    """
    home = np.full(len(groups), -1, np.int64)
    for i, name in enumerate(groups):
        other = "G" + name[1:]
        if name[0] == "J" and other in groups:
            j = groups.index(other)
            home[max(i, j)] = min(i, j)
    return Ties(home, 1.0 / sigma_m**2)


def group_of_rows(gnss: GnssTable, groups: tuple[str, ...], signals: Mapping[str, tuple[str, ...]]) -> Int64:
    """Return the index of each row's group, -1 where its constellation has none or is not in ``signals``."""
    return np.asarray(group_table(gnss.sv_names, gnss.signal_names, groups, signals)[gnss.sv, gnss.signal])


def group_table(
    sv_names: tuple[str, ...],
    signal_names: tuple[str, ...],
    groups: tuple[str, ...],
    signals: Mapping[str, tuple[str, ...]],
) -> Int64:
    """Return the index of the group of each satellite and signal of a log, as ``group_of_rows`` has them."""
    index = {name: i for i, name in enumerate(groups)}
    table = np.full((max(len(sv_names), 1), max(len(signal_names), 1)), -1, np.int64)
    for i, sv in enumerate(sv_names):
        letter = sv[0]
        if letter not in signals:
            continue
        for j, code in enumerate(signal_names):
            further = index.get(f"{letter}:{_band(letter, code)}")
            table[i, j] = index.get(letter, -1) if further is None else further
    return table


def _band(letter: str, code: str) -> str:
    signal = signal_of(letter, code)
    return "" if signal is None else signal.band


def _first_band(letter: str, signals: Mapping[str, tuple[str, ...]], present: set[Pair]) -> str:
    """Return the band of the most preferred signal of a constellation that the log has."""
    for code in signals.get(letter, ()):
        if (letter, code) in present:
            return _band(letter, code)
    return ""


def _group(letter: str, band: str, first: str) -> str:
    return letter if band == first or not first else f"{letter}:{band}"
