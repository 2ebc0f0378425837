"""RINEX observation files, value by value against the text, in all versions, compressed and damaged."""

from __future__ import annotations

import datetime as dt
import gzip
from pathlib import Path

import numpy as np
import pytest
import sidereon

from insgnss.errors import InputError
from insgnss.gnss.observation_rows import prepare_rows
from insgnss.gpstime import datetime_to_ns
from insgnss.log.gnss_csv import read_gnss
from insgnss.log.rinex.observations import read_rinex_obs
from insgnss.log.rinex.text import epoch_starts
from insgnss.runs.result_tables import KINDS
from insgnss.status import BAD_VALUE
from insgnss.tables import GnssTable
from tests.log.rinex_oracle import indicators, observations
from tests.log.writing import WEEK, gnss_config, tabbed

HEADER = """\
     3.04           OBSERVATION DATA    M: MIXED            RINEX VERSION / TYPE
G    6 C1C L1C D1C S1C C5Q D5Q                              SYS / # / OBS TYPES
E    2 C1X D1X                                              SYS / # / OBS TYPES
  2023     6    29    11    11   42.0000000     GPS         TIME OF FIRST OBS
                                                            END OF HEADER
"""


def cells(*values: float | None) -> str:
    return "".join(" " * 16 if value is None else f"{value:14.3f}  " for value in values).rstrip()


def epoch(second: str = "42.0000000", flag: int = 0, shift: float = 0.0) -> str:
    lines = [
        f"> 2023 06 29 11 11 {second:>10}  {flag} 3",
        "G05" + cells(22e6 + shift, 1e8, 1234.5, 45.0, 22e6 + shift + 1, 900.0),
        "G07" + cells(23e6 + shift, None, -50.0, None, None, None),
        "E11" + cells(None, 77.0),
    ]
    return "\n".join(lines) + "\n"


def write(folder: Path, text: str, name: str = "log.rnx") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def rows(table: GnssTable) -> dict[tuple[int, str, str], tuple[float, float, float]]:
    values = zip(
        table.pseudorange_m.tolist(), table.doppler_hz.tolist(), table.cn0_dbhz.tolist(), strict=True
    )
    keys = zip(table.t_ns.tolist(), table.sv.tolist(), table.signal.tolist(), strict=True)
    return {
        (t, table.sv_names[s], table.signal_names[c]): v for (t, s, c), v in zip(keys, values, strict=True)
    }


def phases(table: GnssTable) -> dict[tuple[int, str, str], tuple[float, int]]:
    assert table.carrier_cycles is not None and table.lli is not None
    columns = (table.t_ns, table.sv, table.signal, table.carrier_cycles, table.lli)
    return {
        (t, table.sv_names[s], table.signal_names[c]): (cycles, flag)
        for t, s, c, cycles, flag in zip(*(column.tolist() for column in columns), strict=True)
    }


def test_one_row_for_each_epoch_satellite_and_signal(tmp_path: Path) -> None:
    table, events = read_rinex_obs([write(tmp_path, HEADER + epoch() + epoch("43.0050001", shift=100.0))])
    first = datetime_to_ns(dt.datetime(2023, 6, 29, 11, 11, 42))
    found = rows(table)
    assert events == [] and len(found) == 8
    assert found[first, "G05", "C1C"] == (22e6, 1234.5, 45.0)
    assert found[first, "G05", "C5Q"][:2] == (22e6 + 1, 900.0)
    assert found[first, "G07", "C1C"][:2] == (23e6, -50.0)
    assert np.isnan(found[first, "E11", "C1X"][0]) and found[first, "E11", "C1X"][1] == 77.0
    assert (first + 1_005_000_100, "G05", "C1C") in found


@pytest.mark.real_data
def test_every_value_of_a_real_file_is_that_of_the_text(data_root: Path) -> None:
    path = data_root / "instinct_static_20230629" / "reach_m2_static_10min.23O.gz"
    table, events = read_rinex_obs([path])
    expected = observations(gzip.decompress(path.read_bytes()).decode())
    assert events == []
    found = rows(table)
    keys = {(t, sv, "C" + code[1:]) for (t, sv, code) in expected if code[0] in "CD"}
    assert len(found) == len(table.t_ns) == len(keys)
    for when, sv, code in keys:
        values = [expected.get((when, sv, kind + code[1:]), np.nan) for kind in "CDS"]
        assert np.array_equal(found[datetime_to_ns(when), sv, code], values, equal_nan=True)


@pytest.mark.real_data
def test_every_phase_and_indicator_of_a_real_file_is_that_of_the_text(data_root: Path) -> None:
    path = data_root / "instinct_static_20230629" / "reach_m2_static_10min.23O.gz"
    text = gzip.decompress(path.read_bytes()).decode()
    table, _ = read_rinex_obs([path])
    expected, flags = observations(text), indicators(text)
    found = phases(table)
    keys = {(t, sv, "C" + code[1:]) for (t, sv, code) in expected if code[0] in "CD"}
    assert len(found) == len(keys) and sum(flag != 0 for _, flag in found.values()) > 5
    for when, sv, code in keys:
        cycles, flag = found[datetime_to_ns(when), sv, code]
        name = when, sv, "L" + code[1:]
        assert np.array_equal(cycles, expected.get(name, np.nan), equal_nan=True)
        assert flag == (flags.get(name, 0) if name in expected else 0)


@pytest.mark.real_data
def test_hatanaka_and_plain_give_the_same_table(data_root: Path, tmp_path: Path) -> None:
    packed = data_root / "instinct_static_20230629" / "reach_m2_static_10min.23O.gz"
    text = gzip.decompress(packed.read_bytes()).decode()
    path = tmp_path / "log.crx.gz"
    path.write_bytes(gzip.compress(sidereon.encode_crinex(text).encode()))
    a, b = read_rinex_obs([packed])[0], read_rinex_obs([path])[0]
    assert np.array_equal(a.t_ns, b.t_ns) and np.array_equal(a.pseudorange_m, b.pseudorange_m, equal_nan=True)
    assert np.array_equal(a.doppler_hz, b.doppler_hz, equal_nan=True)


RINEX_2 = """\
     2.11           OBSERVATION DATA    G (GPS)             RINEX VERSION / TYPE
     5    C1    P1    D1    S1    P2                        # / TYPES OF OBSERV
  2023     6    29    11    11   42.0000000     GPS         TIME OF FIRST OBS
                                                            END OF HEADER
 23  6 29 11 11 42.0000000  0  2G05G07
  22000000.000    22000001.000        1234.500          45.000    22000005.000
  23000000.000           0.000         -50.000
"""


def test_rinex_2_codes_become_those_of_rinex_3_and_share_their_bands_doppler(tmp_path: Path) -> None:
    table, _ = read_rinex_obs([write(tmp_path, RINEX_2)])
    found = {key[1:]: value for key, value in rows(table).items()}
    assert set(found) == {("G05", "C1C"), ("G05", "C1W"), ("G05", "C2W"), ("G07", "C1C")}
    assert found["G05", "C1C"] == (22e6, 1234.5, 45.0)
    assert found["G05", "C1W"] == (22e6 + 1, 1234.5, 45.0)
    assert found["G05", "C2W"][0] == 22e6 + 5 and np.isnan(found["G05", "C2W"][1])


@pytest.mark.parametrize("version", [2, 3])
def test_tabs_of_an_editor_are_read_as_the_blanks_that_they_stand_for(tmp_path: Path, version: int) -> None:
    text = RINEX_2_MANY if version == 2 else HEADER + epoch() + epoch("43.0000000", shift=100.0)
    plain, events = read_rinex_obs([write(tmp_path, text)])
    assert events == [] and "\t" in tabbed(text)

    table, events = read_rinex_obs([write(tmp_path, tabbed(text), "tabs.rnx")])

    assert list(rows(table)) == list(rows(plain))
    np.testing.assert_array_equal(list(rows(table).values()), list(rows(plain).values()))
    assert [event.kind for event in events] == ["rinex_tabs"]
    assert "tabs.rnx:1: tabs in" in events[0].detail


def test_tab_that_hides_the_columns_of_a_line_costs_that_line_and_says_so(tmp_path: Path) -> None:
    text = HEADER + epoch().replace("G05  2", "G05\t2")
    table, events = read_rinex_obs([write(tmp_path, text)])

    assert set(table.sv_names[s] for s in table.sv) == {"G07", "E11"}
    assert (
        len(events) == 1
        and "log.rnx:7: tabs" in events[0].detail
        and "refused: line(s) 7" in events[0].detail
    )


def test_surplus_line_of_a_rinex_2_epoch_costs_the_epoch_and_says_how_many_lines_it_needs(
    tmp_path: Path,
) -> None:
    second = RINEX_2[RINEX_2.index(" 23  6 29") :].replace("42.0", "43.0")
    table, events = read_rinex_obs([write(tmp_path, RINEX_2 + "   1111111.000\n" + second)])

    assert len(np.unique(table.t_ns)) == 1
    told = "log.rnx:5: the epoch has 4 line(s), 2 satellite(s) of 5 observation(s) need 3; epoch refused"
    assert [event.detail.endswith(told) for event in events] == [True]


def test_damaged_epoch_under_an_impossible_number_of_codes_ends_in_an_error(tmp_path: Path) -> None:
    # the number of lines per satellite follows from it: what walks over them must end with the file
    text = RINEX_2.replace("     5    C1", f"     {2**63 - 1}    C1").replace(
        "22000000.000 ", "2200x000.000 "
    )
    with pytest.raises(InputError, match="TYPES OF OBSERV"):
        read_rinex_obs([write(tmp_path, text)])


SATELLITES_2 = "G05G07R01R02R03E11E12S20G08G09G10G11G12 13"  # a blank system is the file's own: here GPS
RINEX_2_MANY = """\
     2.11           OBSERVATION DATA    M (MIXED)           RINEX VERSION / TYPE
     6    C1    L1    D1    S1    P2    L2                  # / TYPES OF OBSERV
  2023     6    29    11    11   42.0000000     GPS         TIME OF FIRST OBS
                                                            END OF HEADER
""" + "".join(
    f" 23  6 29 11 11 {second:2d}.0000000  0 14{SATELLITES_2[:36]}       .000000123\n{' ' * 32}{SATELLITES_2[36:]}\n"
    + "".join(
        f"{2e7 + 1000 * k:14.3f}  {1e8 + second + k:14.3f}1{k % 3} {1.0 * k:13.3f}  {40.0 + k:14.3f}  "
        f"{2e7 + 1000 * k + 1:14.3f}  \n{9e7 + k:14.3f} 7\n"
        for k in range(14)
    )
    for second in (42, 43)
)


def test_rinex_2_epoch_of_more_than_twelve_satellites_of_all_systems_is_read(tmp_path: Path) -> None:
    table, events = read_rinex_obs([write(tmp_path, RINEX_2_MANY)])
    start = datetime_to_ns(dt.datetime(2023, 6, 29, 11, 11, 42))
    assert events == [] and np.unique(table.t_ns).tolist() == [start, start + 10**9]
    names = [SATELLITES_2[3 * k : 3 * k + 3].replace(" ", "G") for k in range(14)]
    assert set(table.sv_names) == set(names)
    found, carrier = rows(table), phases(table)
    for k, name in enumerate(names):
        code = "C1X" if name[0] == "E" else "C1C"
        assert found[start, name, code] == (2e7 + 1000 * k, k, 40 + k)
        assert carrier[start + 10**9, name, code] == (1e8 + 43 + k, 1)
    second_band = next(key for key in carrier if key[1] == "G07" and key[2].startswith("C2"))
    assert carrier[second_band][0] == 9e7 + 1


def test_half_cycle_and_slip_flags_stay_with_their_phase(tmp_path: Path) -> None:
    cell = f"{1e8:14.3f}"
    for flag in range(8):
        text = HEADER + epoch().replace(f"{cell}  ", f"{cell}{flag}7", 1)
        table, _ = read_rinex_obs([write(tmp_path, text)])
        assert phases(table)[int(table.t_ns[0]), "G05", "C1C"] == (1e8, flag)
        assert table.lli is not None and int(table.lli.sum()) == flag


def test_file_without_phases_has_no_carrier_column(tmp_path: Path) -> None:
    text = HEADER.replace(" L1C", " X1C") + epoch()
    table, _ = read_rinex_obs([write(tmp_path, text)])
    assert table.carrier_cycles is None and table.lli is None and len(table.t_ns) == 4


def test_phase_without_range_and_doppler_is_left_out_and_told(tmp_path: Path) -> None:
    text = HEADER + epoch().replace("G07" + cells(23e6, None, -50.0), "G07" + cells(None, 1e8))
    table, events = read_rinex_obs([write(tmp_path, text)])
    assert len(table.t_ns) == 3 and [event.kind for event in events] == ["rinex_phase_alone"]


def test_glonass_channels_of_the_header_are_kept(tmp_path: Path) -> None:
    line = "  3 R01  1 R07 -4 R24  2                                    GLONASS SLOT / FRQ #\n"
    text = HEADER.replace("E    2", line + "E    2", 1) + epoch()
    table, _ = read_rinex_obs([write(tmp_path, text)])
    assert table.glonass_channels == {"R01": 1, "R07": -4, "R24": 2}


def test_receiver_clock_offset_changes_nothing(tmp_path: Path) -> None:
    text = HEADER + epoch().replace("  0 3\n", "  0 3      0.000123456789\n")
    table, events = read_rinex_obs([write(tmp_path, text)])
    plain, _ = read_rinex_obs([write(tmp_path, HEADER + epoch())])
    assert "0.000123456789" in text and events == []
    assert np.array_equal(table.t_ns, plain.t_ns) and np.array_equal(
        table.pseudorange_m, plain.pseudorange_m, equal_nan=True
    )


@pytest.mark.parametrize("end", ["\r\n", "\r", "mixed"])
def test_line_ends_of_any_kind_give_the_same_table(tmp_path: Path, end: str) -> None:
    text = HEADER + "".join(epoch(f"{42 + k}.0000000") for k in range(4))
    ends = ["\n", "\r\n", "\r\r\n", "\r"] if end == "mixed" else [end]
    path = tmp_path / "ends.rnx"
    path.write_bytes("".join(x + ends[k % len(ends)] for k, x in enumerate(text.splitlines())).encode())
    table, events = read_rinex_obs([path])
    assert events == [] and rows(table).keys() == rows(read_rinex_obs([write(tmp_path, text)])[0]).keys()


def test_header_in_mid_file_changes_the_codes_from_there_on(tmp_path: Path) -> None:
    change = (
        "> 2023 06 29 11 11 42.5000000  4 1\n"
        "G    6 D1C C1C L1C S1C C5Q D5Q                              SYS / # / OBS TYPES\n"
    )
    later = (
        epoch("43.0000000")
        .replace(cells(22e6, 1e8, 1234.5, 45.0), cells(1234.5, 22e6, 1e8, 45.0))
        .replace(cells(23e6, None, -50.0), cells(-50.0, 23e6))
    )
    table, events = read_rinex_obs([write(tmp_path, HEADER + epoch() + change + later)])
    found = rows(table)
    first = datetime_to_ns(dt.datetime(2023, 6, 29, 11, 11, 42))
    assert [event.kind for event in events] == ["rinex_event"]
    for key in (("G05", "C1C"), ("G07", "C1C"), ("G05", "C5Q")):
        assert np.array_equal(found[first, *key], found[first + 10**9, *key], equal_nan=True)


def test_header_in_mid_file_with_as_many_other_codes_names_the_values_anew(tmp_path: Path) -> None:
    head = HEADER.replace("G    6 C1C L1C D1C S1C C5Q D5Q", "G    2 C1C D1C                ")
    change = (
        "> 2023 06 29 11 11 42.5000000  4 1\n"
        "G    2 C5Q D5Q                                              SYS / # / OBS TYPES\n"
    )
    body = "> 2023 06 29 11 11 42.0000000  0 1\nG05" + cells(22e6, 500.0) + "\n"
    later = body.replace("42.0000000", "43.0000000")
    table, _ = read_rinex_obs([write(tmp_path, head + body + change + later)])
    first = datetime_to_ns(dt.datetime(2023, 6, 29, 11, 11, 42))
    assert {key: value[:2] for key, value in rows(table).items()} == {
        (first, "G05", "C1C"): (22e6, 500.0),
        (first + 10**9, "G05", "C5Q"): (22e6, 500.0),
    }


def test_epoch_that_stands_twice_is_kept_twice(tmp_path: Path) -> None:
    table, _ = read_rinex_obs([write(tmp_path, HEADER + epoch() + epoch())])
    assert len(table.t_ns) == 8 and len(np.unique(table.t_ns)) == 1


def test_unknown_codes_and_high_satellite_numbers_stay_in_the_table(tmp_path: Path) -> None:
    text = HEADER.replace("C5Q D5Q", "C9Y D9Y").replace("E    2", "C    2") + epoch()
    text = text.replace("G05", "G33").replace("E11", "C62")
    table, events = read_rinex_obs([write(tmp_path, text)])
    assert events == [] and table.sv_names == ("C62", "G07", "G33") and "C9Y" in table.signal_names


def test_version_4_is_read_as_version_3(tmp_path: Path) -> None:
    four, _ = read_rinex_obs([write(tmp_path, HEADER.replace("3.04", "4.01") + epoch())])
    three, _ = read_rinex_obs([write(tmp_path, HEADER + epoch())])
    assert rows(four).keys() == rows(three).keys()


def test_scale_factor_of_the_header_is_applied(tmp_path: Path) -> None:
    line = "G  10   1 C1C                                               SYS / SCALE FACTOR\n"
    table, _ = read_rinex_obs([write(tmp_path, HEADER.replace("E    2", line + "E    2", 1) + epoch())])
    assert {key[1:]: value[0] for key, value in rows(table).items()}["G05", "C1C"] == 2.2e6


def test_event_epochs_are_passed_over_with_an_event(tmp_path: Path) -> None:
    event = "> 2023 06 29 11 11 42.5000000  4 1\nnothing new                                                 COMMENT\n"
    table, events = read_rinex_obs([write(tmp_path, HEADER + epoch() + event + epoch("43.0000000", flag=1))])
    assert len(np.unique(table.t_ns)) == 2
    assert [event.kind for event in events] == ["rinex_event", "rinex_event"]
    assert "power failure" in events[1].detail


@pytest.mark.parametrize(("scale", "shift_s"), [("GPS", 0), ("GAL", 0), ("QZS", 0), ("BDT", 14), ("GLO", 18)])
def test_time_scale_of_the_file_becomes_gps_time(tmp_path: Path, scale: str, shift_s: int) -> None:
    table, _ = read_rinex_obs([write(tmp_path, HEADER.replace("GPS  ", f"{scale}  ") + epoch())])
    assert table.t_ns[0] == datetime_to_ns(dt.datetime(2023, 6, 29, 11, 11, 42)) + shift_s * 10**9


def test_declared_offset_is_added(tmp_path: Path) -> None:
    table, _ = read_rinex_obs([write(tmp_path, HEADER + epoch())], offset_s=-0.25)
    assert table.t_ns[0] == datetime_to_ns(dt.datetime(2023, 6, 29, 11, 11, 41)) + 750_000_000


@pytest.mark.parametrize("damage", ["count", "epoch_line", "truncated", "cut_in_epoch_line"])
def test_damaged_epoch_is_told_and_the_others_stay(tmp_path: Path, damage: str) -> None:
    epochs = [epoch(f"{42 + k}.0000000") for k in range(9)]
    if damage == "count":
        epochs[4] = epochs[4].replace("  0 3", "  0 x")
    elif damage == "epoch_line":
        epochs[4] = epochs[4].replace("> 2023 06", "> 2023 xx")
    elif damage == "truncated":
        epochs[8] = epochs[8][:100]
    else:
        epochs[8] = epochs[8][:20]
    table, events = read_rinex_obs([write(tmp_path, HEADER + "".join(epochs))])
    assert len(np.unique(table.t_ns)) == 8
    assert [event.kind for event in events] == ["rinex_epoch_damaged"]
    line = 6 + 4 * (8 if damage in ("truncated", "cut_in_epoch_line") else 4)
    assert f"log.rnx:{line}:" in events[0].detail


@pytest.mark.parametrize(
    "written", ["12x4.500", "*" * 14, "nan", "-inf", "1e400", "99999999999.999", "1 234.500"]
)
@pytest.mark.parametrize("place", [0, 1, 2, 3])
def test_bad_number_costs_only_itself(tmp_path: Path, place: int, written: str) -> None:
    numbers = [22e6, 1e8, 1234.5, 45.0]
    cell = f"{numbers[place]:14.3f}"
    damaged = epoch("43.0000000").replace(cell, f"{written[:14]:>14}", 1)
    path = write(tmp_path, HEADER + epoch() + damaged + epoch("44.0000000"))
    table, events = read_rinex_obs([path])
    whole, _ = read_rinex_obs(
        [write(tmp_path, HEADER + "".join(epoch(f"{42 + k}.0000000") for k in range(3)))]
    )
    assert [event.kind for event in events] == ["rinex_value_damaged"]
    assert f"log.rnx:11: G05: observation {place + 1}, '{written[:14]}'" in events[0].detail
    assert np.array_equal(table.t_ns, whole.t_ns)
    assert np.array_equal(table.signal, whole.signal)
    pairs = [
        (table.pseudorange_m, whole.pseudorange_m),
        (table.carrier_cycles, whole.carrier_cycles),
        (table.doppler_hz, whole.doppler_hz),
        (table.cn0_dbhz, whole.cn0_dbhz),
    ]
    for kind, (got, expected) in enumerate(pairs):
        assert got is not None and expected is not None
        differs = np.flatnonzero((got != expected) & ~(np.isnan(got) & np.isnan(expected)))
        assert differs.tolist() == ([5] if kind == place else []) and np.isnan(got[differs]).all()
    assert table.bad_cells.tolist() == ([5] if place in (0, 2) else [])


def test_bad_number_stands_in_the_ledger_as_such(tmp_path: Path) -> None:
    damaged = epoch().replace("1234.500", "12x4.500").replace(f"{23e6:14.3f}", "*" * 14)
    table, _ = read_rinex_obs([write(tmp_path, HEADER + damaged)])
    rows = prepare_rows(table, None, None, clock_groups=("G",), signals={"G": ("C1C",)})
    status = rows.observation["status"]
    bad = {(table.sv_names[table.sv[i]], KINDS[kind]) for i, kind in np.argwhere(status == BAD_VALUE)}
    assert bad == {("G05", "range_rate"), ("G07", "pseudorange")}


def test_lost_character_costs_all_of_its_line_and_no_other(tmp_path: Path) -> None:
    text = HEADER + epoch() + epoch("43.0000000").replace("G05  22", "G05  2", 1).replace("45.000", "4x.000")
    table, events = read_rinex_obs([write(tmp_path, text)])
    assert {event.kind for event in events} == {"rinex_value_damaged"}
    bad = table.t_ns > table.t_ns[0]
    bad &= table.sv == table.sv_names.index("G05")
    assert np.flatnonzero(bad).tolist() == table.bad_cells.tolist() == [5, 6]
    assert np.isnan(table.pseudorange_m[bad]).all() and np.isnan(table.doppler_hz[bad]).all()


def test_bad_number_of_a_rinex_2_epoch_costs_only_itself(tmp_path: Path) -> None:
    text = RINEX_2_MANY.replace(f"{9e7 + 9:14.3f} 7", f"{'9000x':>14} 7").replace(
        f"{2e7 + 13000:14.3f}", "*" * 14
    )
    table, events = read_rinex_obs([write(tmp_path, text)])
    whole, _ = read_rinex_obs([write(tmp_path, RINEX_2_MANY)])
    assert len(events) == 4 and {event.kind for event in events} == {"rinex_value_damaged"}
    assert "log.rnx:26: G09: observation 6, '9000x'" in events[0].detail
    assert "log.rnx:33: G13: observation 1, '**************'" in events[1].detail
    assert np.array_equal(table.t_ns, whole.t_ns) and len(table.bad_cells) == 2
    bad = (table.sv == table.sv_names.index("G13")) & (table.signal == table.signal_names.index("C1C"))
    assert np.flatnonzero(bad).tolist() == table.bad_cells.tolist()
    assert np.array_equal(np.isnan(table.pseudorange_m), bad)
    assert whole.carrier_cycles is not None and table.carrier_cycles is not None
    lost = np.isnan(table.carrier_cycles) & ~np.isnan(whole.carrier_cycles)
    assert np.count_nonzero(lost) == 2 and {table.sv_names[k] for k in table.sv[lost]} == {"G09"}


def test_many_bad_numbers_are_told_shortly(tmp_path: Path) -> None:
    bad = "".join(epoch(f"{10 + k}.0000000").replace("1234.500", "12x4.500") for k in range(30))
    table, events = read_rinex_obs([write(tmp_path, HEADER + bad)])
    assert len(table.bad_cells) == 30 and len(events) == 21
    assert "30 in all; values refused" in events[-1].detail


@pytest.mark.parametrize("text", ["", "x", "time_s,sv\n1,G05\n", HEADER, HEADER + "garbage\n", HEADER[:100]])
def test_file_without_observations_is_a_typed_error(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError):
        read_rinex_obs([write(tmp_path, text)])


def test_hatanaka_file_cut_in_its_first_epoch_is_a_typed_error(tmp_path: Path) -> None:
    packed = sidereon.encode_crinex(HEADER + epoch() + epoch("43.0000000", shift=5.0))
    with pytest.raises(InputError):
        read_rinex_obs([write(tmp_path, packed[: packed.index("> 2023") + 60], "log.crx")])


@pytest.mark.parametrize("version", [1, 3])
@pytest.mark.parametrize("damage", ["cut", "letters"])
def test_hatanaka_file_is_read_up_to_its_damage(tmp_path: Path, version: int, damage: str) -> None:
    plain = RINEX_2_MANY if version == 1 else HEADER + "".join(epoch(f"{42 + k}.0000000") for k in range(9))
    packed = sidereon.encode_crinex(plain)
    assert packed.startswith(f"{version}.0")
    per_epoch = 2 + (14 if version == 1 else 3)
    lines = packed.splitlines(keepends=True)
    first = next(k for k, line in enumerate(lines) if "END OF HEADER" in line) + 1
    whole = 1 if version == 1 else 5
    bad = first + whole * per_epoch + 3
    kept = [*lines[:bad], lines[bad][:1]] if damage == "cut" else [*lines[:bad], "1&12x\n", *lines[bad + 1 :]]
    path = write(tmp_path, "".join(kept), "log.crx")
    table, events = read_rinex_obs([path])
    expected, _ = read_rinex_obs([write(tmp_path, plain)])
    assert [event.kind for event in events] == ["rinex_hatanaka_damaged"]
    assert f"log.crx:{first + whole * per_epoch + 1}:" in events[0].detail
    n = len(table.t_ns)
    assert len(np.unique(table.t_ns)) == whole
    assert np.array_equal(table.pseudorange_m, expected.pseudorange_m[:n], equal_nan=True)


def test_hatanaka_epochs_are_found_past_events_and_falling_counts(tmp_path: Path) -> None:
    event = "> 2023 06 29 11 11 41.5000000  4 1\nnothing new                                                 COMMENT\n"
    one = "> 2023 06 29 11 11 40.0000000  0 1\nG05" + cells(22e6, 1e8) + "\n"
    many = "> 2023 06 29 11 11 41.0000000  0 12\n" + "".join(
        f"G{k:02d}{cells(22e6, 1e8)}\n" for k in range(1, 13)
    )
    body = [one, many, one.replace("40.0", "41.2"), event, epoch(), epoch("43.0000000")]
    packed = sidereon.encode_crinex(HEADER + "".join(body)).splitlines(keepends=True)
    # the third epoch as a difference to the second: twelve satellites become one, " 12" -> "  1"
    third = next(k for k, line in enumerate(packed) if "41.2000000" in line)
    assert packed[third][32:35].strip() == "1" and packed[third][0] == ">"
    packed[third] = " " * 20 + "2" + " " * 12 + "&1" + " " * 6 + "G05" + "&" * 33 + "\n"
    packed[third] = packed[third][:35] + " " * 6 + "G05\n"
    starts = epoch_starts(packed)
    assert [packed[k][:1] for k in starts[:-1]] == [">", ">", " ", ">", ">", ">"] and starts[-1] == len(
        packed
    )
    path = write(tmp_path, "".join(packed[:-1]), "log.crx")
    table, events = read_rinex_obs([path])
    assert events[0].kind == "rinex_hatanaka_damaged" and f":{starts[-2] + 1}:" in events[0].detail
    assert "G07" in table.sv_names


def test_flight_files_time_settings_are_told_to_be_without_use(tmp_path: Path) -> None:
    path = write(tmp_path, HEADER + epoch())
    plain, none = read_gnss(gnss_config(path, format="rinex", time={"offset_s": 0.5}), WEEK)
    same, told = read_gnss(gnss_config(path, format="rinex", time={"offset_s": 0.5, "scale": "utc"}), WEEK)
    assert np.array_equal(plain.t_ns, same.t_ns) and none == []
    assert [event.kind for event in told] == ["time_settings_not_used"]
