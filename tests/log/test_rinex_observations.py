"""RINEX observation files, value by value against the text, in all versions, compressed and damaged."""

from __future__ import annotations

import datetime as dt
import gzip
from pathlib import Path

import numpy as np
import pytest
import sidereon

from insgnss.errors import InputError
from insgnss.gpstime import datetime_to_ns
from insgnss.log.gnss_csv import read_gnss
from insgnss.log.rinex import read_rinex_obs
from insgnss.tables import GnssTable
from tests.log.rinex_oracle import observations
from tests.log.writing import WEEK, gnss_config

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


@pytest.mark.parametrize("damage", ["value", "epoch_line", "truncated", "cut_in_epoch_line"])
def test_damaged_epoch_is_told_and_the_others_stay(tmp_path: Path, damage: str) -> None:
    epochs = [epoch(f"{42 + k}.0000000") for k in range(9)]
    if damage == "value":
        epochs[4] = epochs[4].replace("1234.500", "12x4.500")
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


@pytest.mark.parametrize("text", ["", "x", "time_s,sv\n1,G05\n", HEADER, HEADER + "garbage\n", HEADER[:100]])
def test_file_without_observations_is_a_typed_error(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError):
        read_rinex_obs([write(tmp_path, text)])


def test_damaged_hatanaka_file_is_a_typed_error(tmp_path: Path) -> None:
    packed = sidereon.encode_crinex(HEADER + epoch() + epoch("43.0000000", shift=5.0))
    with pytest.raises(InputError):
        read_rinex_obs([write(tmp_path, packed[:400], "log.crx")])


def test_flight_files_time_settings_are_told_to_be_without_use(tmp_path: Path) -> None:
    path = write(tmp_path, HEADER + epoch())
    plain, none = read_gnss(gnss_config(path, format="rinex", time={"offset_s": 0.5}), WEEK)
    same, told = read_gnss(gnss_config(path, format="rinex", time={"offset_s": 0.5, "scale": "utc"}), WEEK)
    assert np.array_equal(plain.t_ns, same.t_ns) and none == []
    assert [event.kind for event in told] == ["time_settings_not_used"]
