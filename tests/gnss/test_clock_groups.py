"""Which signals share a receiver clock: the groups' names, their order, and the rows of each."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.config.filter import DEFAULT_SIGNALS, Measurements
from insgnss.filter.state import MAX_OPTIONAL, N_CLONE
from insgnss.gnss.clock_groups import clock_groups, group_of_rows, pairs_of, tied_clocks
from insgnss.gnss.observation_rows import prepare_rows
from insgnss.status import CONSTELLATION_NOT_USED, SIGNAL_NOT_USED, USED
from insgnss.tables import GnssTable

USE = Measurements()
SIGNALS = USE.signals_of()


def groups(
    *pairs: str, constellations: tuple[str, ...] = USE.constellations, every_band: bool = True
) -> tuple[str, ...]:
    """Return the groups of a log with signals written as "G C1C"."""
    present = {(pair[0], pair[2:]) for pair in pairs}
    return clock_groups(constellations, SIGNALS, present, every_band=every_band)


def log(*pairs: str) -> GnssTable:
    """Return an epoch with a row for each "G05 C1C"."""
    n = len(pairs)
    names, codes = (tuple(dict.fromkeys(p.split()[k] for p in pairs)) for k in (0, 1))
    empty = np.full(n, np.nan)
    return GnssTable(
        t_ns=np.full(n, 10**18, np.int64),
        sv=np.array([names.index(p.split()[0]) for p in pairs], np.int16),
        signal=np.array([codes.index(p.split()[1]) for p in pairs], np.int16),
        pseudorange_m=np.full(n, 2.2e7),
        doppler_hz=empty,
        range_rate_mps=empty,
        cn0_dbhz=empty,
        sv_names=names,
        signal_names=codes,
        sat=np.tile([2.6e7, 0.0, 0.0, 0.0, 3e3, 0.0, 50.0, 0.0], (n, 1)),
    )


def test_first_constellation_of_the_settings_that_is_there_keeps_the_clock() -> None:
    assert groups("E C1C", "G C1C", "R C1C") == ("G", "E", "R")
    assert groups("E C1C", "C C2I") == ("E", "C")
    assert groups("G C1C", "E C1C", constellations=("E", "G")) == ("E", "G")


def test_further_carrier_has_a_group_named_by_its_band() -> None:
    assert groups("G C1C", "G C5Q", "E C1C", "E C5Q", "E C7Q") == ("G", "G:L5", "E", "E:L5", "E:E5b")
    assert groups("C C2I", "C C1P", "C C5P") == ("C", "C:L1", "C:L5")
    assert groups("R C1C", "R C2C") == ("R", "R:L2")


def test_only_carrier_of_a_constellation_keeps_its_clock_whichever_it_is() -> None:
    assert groups("G C5Q", "E C5Q") == ("G", "E")


def test_codes_of_one_band_share_a_group() -> None:
    assert groups("G C1C", "G C1L", "C C1P", "C C1X") == ("G", "C")


def test_one_band_alone_needs_no_further_groups() -> None:
    assert groups("G C1C", "G C5Q", "E C1C", "E C5Q", every_band=False) == ("G", "E")


def homes(*names: str) -> list[int]:
    """Return to which group each of these is tied."""
    return tied_clocks(names, 3.0).home.tolist()


def test_each_band_of_qzss_is_tied_to_the_same_band_of_gps() -> None:
    both = groups("G C1C", "J C1C", "J C5Q", "G C5Q")
    assert both == ("G", "G:L5", "J", "J:L5") and homes(*both) == [-1, -1, 0, 1]
    assert groups("J C1C", "G C1C", constellations=("J", "G")) == ("J", "G") and homes("J", "G") == [-1, 0]
    assert tied_clocks(both, 2.0).weight == 0.25


def test_qzss_without_gps_or_with_a_band_of_its_own_is_free() -> None:
    assert groups("J C1C", "E C1C") == ("E", "J") and homes("E", "J") == [-1, -1]
    assert groups("G C1C", "J C1C", constellations=("J",)) == ("J",) and homes("J") == [-1]
    # what bears GPS's band alone is not tied to another band of GPS's
    assert groups("G C1C", "J C5Q") == groups("G C1C", "J C5Q", every_band=False) == ("G", "J:L5")
    assert homes("G", "J:L5") == [-1, -1]


def test_log_without_a_signal_in_use_still_has_a_clock() -> None:
    assert groups("G C1W") == ("G",) == groups()


def test_all_groups_of_all_systems_fit_the_state() -> None:
    everything = {(letter, code) for letter, codes in DEFAULT_SIGNALS.items() for code in codes}
    letters = tuple(DEFAULT_SIGNALS)
    widest = clock_groups(letters, dict(DEFAULT_SIGNALS), everything, every_band=True)
    # and channel bias, zenith delay, the epoch before
    assert len(widest) - 1 + 2 + N_CLONE <= MAX_OPTIONAL
    assert len(set(widest)) == len(widest)


def test_pairs_are_those_of_the_rows_not_of_the_names() -> None:
    table = log("G05 C1C", "G05 C5Q", "E07 C1C")
    assert pairs_of(table) == {("G", "C1C"), ("G", "C5Q"), ("E", "C1C")}
    assert pairs_of(table.take(np.array([2]))) == {("E", "C1C")}
    assert pairs_of(table.take(np.array([], np.intp))) == set()


def test_each_row_finds_its_group() -> None:
    table = log("G05 C1C", "G05 C5Q", "E07 C1C", "J02 C1C", "J02 C5Q", "R03 C1C", "S23 C1C")
    names = ("G", "G:L5", "E", "J", "J:L5")
    assert group_of_rows(table, names, SIGNALS).tolist() == [0, 1, 2, 3, 4, -1, -1]


def statuses(table: GnssTable, use: Measurements) -> list[int]:
    """Return how each pseudorange starts."""
    names = clock_groups(use.constellations, use.signals_of(), pairs_of(table), every_band=use.every_band)
    rows = prepare_rows(
        table, None, None, clock_groups=names, signals=use.signals_of(), every_band=use.every_band
    )
    return [int(status) for status in rows.observation["status"][:, 0]]


def test_constellation_left_out_of_the_settings_is_not_used_qzss_neither() -> None:
    table = log("G05 C1C", "J02 C1C", "E07 C1C")
    assert statuses(table, Measurements(constellations=("G", "J"))) == [USED, USED, CONSTELLATION_NOT_USED]
    assert statuses(table, Measurements(constellations=("G",))) == [
        USED,
        CONSTELLATION_NOT_USED,
        CONSTELLATION_NOT_USED,
    ]


def test_unknown_signals_are_named_and_left_out() -> None:
    table = log("G05 C1C", "G05 C9Z", "G05 C1W", "S23 C1C")
    assert statuses(table, USE) == [USED, SIGNAL_NOT_USED, SIGNAL_NOT_USED, CONSTELLATION_NOT_USED]


@pytest.mark.parametrize("every_band", [True, False])
def test_one_signal_of_each_band_of_a_satellite_is_used(every_band: bool) -> None:
    table = log("G05 C1L", "G05 C1C", "G05 C5X", "G05 C5Q", "G07 C5Q")
    first, second = USED if every_band else SIGNAL_NOT_USED, SIGNAL_NOT_USED
    assert statuses(table, Measurements(every_band=every_band)) == [second, USED, second, first, USED]
