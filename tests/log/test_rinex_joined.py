"""RINEX files joined in one, lists of observations that change among the epochs, lines that belong to no epoch."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insgnss.errors import InputError
from insgnss.log.rinex.navigation import read_navigation
from insgnss.log.rinex.observations import read_rinex_obs

ROOT = Path(__file__).resolve().parents[2]


def line(text: str, label: str) -> str:
    return f"{text:<60}{label}\n"


def header(version: str, types: str) -> str:
    return (
        line(f"     {version}", "RINEX VERSION / TYPE")
        + types
        + line("  2024     5    17     0     0    0.0000000     GPS", "TIME OF FIRST OBS")
        + line("", "END OF HEADER")
    )


def header_3(codes: str = "C1C L1C D1C") -> str:
    types = line(f"G    3 {codes}", "SYS / # / OBS TYPES") + line("E    1 C1X", "SYS / # / OBS TYPES")
    return header("3.04           OBSERVATION DATA    M", types)


def header_2(codes: str = "C1    L1    D1") -> str:
    types = line(f"     3    {codes}", "# / TYPES OF OBSERV")
    return header("2.11           OBSERVATION DATA    G (GPS)", types)


def cells(*values: float) -> str:
    return "".join(f"{value:14.3f}  " for value in values) + "\n"


def epoch_3(second: int, *values: float) -> str:
    return f"> 2024 05 17 00 00 {second:2d}.0000000  0  1\nG05" + cells(*values)


def epoch_2(second: int, *values: float) -> str:
    return f" 24  5 17  0  0 {second:2d}.0000000  0  1G05\n" + cells(*values)


RANGE, PHASE, DOPPLER = 2e7 + 5, 1e5 + 5, -5.5
JOINED = {
    3: header_3()
    + epoch_3(0, RANGE, PHASE, DOPPLER)
    + header_3("L1C D1C C1C")
    + epoch_3(1, PHASE, DOPPLER, RANGE),
    2: header_2()
    + epoch_2(0, RANGE, PHASE, DOPPLER)
    + header_2("L1    D1    C1")
    + epoch_2(1, PHASE, DOPPLER, RANGE),
}
CHANGE_3 = ">" + " " * 30 + "4  1\n" + line("G    3 L1C D1C C1C", "SYS / # / OBS TYPES")
CHANGE_2 = " " * 28 + "4  1\n" + line("     3    L1    D1    C1", "# / TYPES OF OBSERV")


def write(folder: Path, text: str) -> Path:
    path = folder / "day.rnx"
    path.write_text(text)
    return path


@pytest.mark.parametrize("version", (2, 3))
def test_each_joined_file_is_read_by_its_own_header(tmp_path: Path, version: int) -> None:
    path = write(tmp_path, JOINED[version])
    table, events = read_rinex_obs([path])
    assert table.pseudorange_m.tolist() == [RANGE, RANGE] and table.doppler_hz.tolist() == [DOPPLER, DOPPLER]
    assert np.diff(table.t_ns).tolist() == [1_000_000_000]
    assert [event.kind for event in events] == ["rinex_joined"]
    assert events[0].detail.endswith(f"at line(s) {5 + version}")


def test_a_joined_file_without_epochs_costs_nothing_but_itself(tmp_path: Path) -> None:
    empty = header_3().replace("2024     5    17", "2024     5    16")
    table, events = read_rinex_obs([write(tmp_path, empty + JOINED[3] + empty)])
    assert table.pseudorange_m.tolist() == [RANGE, RANGE]
    assert [event.kind for event in events] == ["rinex_joined", "rinex_part_not_read", "rinex_part_not_read"]
    with pytest.raises(InputError, match="no observation"):
        read_rinex_obs([write(tmp_path, empty + empty)])


@pytest.mark.parametrize(
    "text",
    (
        header_3() + epoch_3(0, RANGE, PHASE, DOPPLER) + CHANGE_3 + epoch_3(1, PHASE, DOPPLER, RANGE),
        header_2() + epoch_2(0, RANGE, PHASE, DOPPLER) + CHANGE_2 + epoch_2(1, PHASE, DOPPLER, RANGE),
    ),
)
@pytest.mark.parametrize("damaged", (False, True))
def test_a_list_of_observations_that_changes_holds_from_there_on(
    tmp_path: Path, text: str, damaged: bool
) -> None:
    more = (
        epoch_3(2, PHASE, DOPPLER, RANGE) if text.startswith("     3") else epoch_2(2, PHASE, DOPPLER, RANGE)
    )
    damage = more.replace(f"{DOPPLER:14.3f}", f"{'-5.x00':>14}") if damaged else ""
    table, events = read_rinex_obs([write(tmp_path, text + damage + more.replace(" 2.0", " 3.0"))])
    sound = np.isfinite(table.doppler_hz)
    assert set(table.pseudorange_m.tolist()) == {RANGE} and set(table.doppler_hz[sound].tolist()) == {DOPPLER}
    assert len(table.t_ns) == 3 + damaged
    assert ("rinex_value_damaged" in {event.kind for event in events}) == damaged


def test_lines_that_no_epoch_counts_are_told(tmp_path: Path) -> None:
    sound = header_3() + epoch_3(0, RANGE, PHASE, DOPPLER)
    further = "G07" + cells(RANGE + 2, PHASE, DOPPLER)
    table, events = read_rinex_obs([write(tmp_path, sound + further + epoch_3(1, RANGE, PHASE, DOPPLER))])
    assert len(table.t_ns) == 2 and [event.kind for event in events] == ["rinex_lines_not_read"]
    assert ": 1 line(s) belong to no epoch" in events[0].detail
    twice = sound.replace("  0  1\n", "  0  2\n") + "G05" + cells(RANGE, PHASE, DOPPLER)
    table, events = read_rinex_obs([write(tmp_path, twice)])
    assert len(table.t_ns) == 1 and ": 1 line(s) name a satellite a second time" in events[0].detail
    assert read_rinex_obs([write(tmp_path, sound + "\n\x1a\n")])[1] == []


@pytest.mark.parametrize("end", ("\n", "\r\n", "\r"))
def test_navigation_files_joined_or_of_another_line_end(tmp_path: Path, end: str) -> None:
    version_3 = (ROOT / "data/sample_flight/nav.rnx").read_text()
    version_2 = (
        line("     2              NAVIGATION DATA", "RINEX VERSION / TYPE")
        + line("", "END OF HEADER")
        + " 5 25  9 24  8  0  0.0 1.000000000000D-04 0.000000000000D+00 0.000000000000D+00\n"
        + "    1.000000000000D+00 1.000000000000D+00 4.000000000000D-09 1.000000000000D+00\n"
        + "    1.000000000000D-06 1.000000000000D-02 1.000000000000D-06 5.153600000000D+03\n"
        + "    2.880000000000D+05 1.000000000000D-08 1.000000000000D+00 1.000000000000D-08\n"
        + "    9.600000000000D-01 2.000000000000D+02 5.000000000000D-01-8.000000000000D-09\n"
        + "    1.000000000000D-10 1.000000000000D+00 2.385000000000D+03 0.000000000000D+00\n"
        + "    2.000000000000D+00 0.000000000000D+00-1.000000000000D-08 1.000000000000D+00\n"
        + "    2.880000000000D+05 4.000000000000D+00\n"
    )
    path = tmp_path / "nav"
    path.write_bytes((version_3 + version_2).replace("\n", end).encode())
    alone, _ = read_navigation([ROOT / "data/sample_flight/nav.rnx"])
    both, events = read_navigation([path])
    assert len(both.ephemerides.toe_ns) == len(alone.ephemerides.toe_ns) + 1
    assert [event.kind for event in events] == ["rinex_joined"]
