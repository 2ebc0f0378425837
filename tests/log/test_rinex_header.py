"""Header lines out of their columns cost at most themselves."""

from __future__ import annotations

from pathlib import Path

import pytest

from insgnss.errors import InputError
from insgnss.log.detect import detect_format
from insgnss.log.rinex.observations import read_rinex_obs
from tests.log.test_rinex_observations import HEADER, epoch, rows, write

INTERVAL = " one second".ljust(60) + "INTERVAL\n"
FIRST = next(line for line in HEADER.splitlines() if "TIME OF FIRST OBS" in line)


@pytest.mark.parametrize(
    "spoilt, told",
    [
        (HEADER.replace(FIRST, (" " + FIRST[:59]).ljust(60) + FIRST[60:]), "TIME OF FIRST OBS: rewritten"),
        (HEADER.replace(FIRST, INTERVAL + FIRST), "INTERVAL: left out: one second"),
        # the reader itself passes over this one
        (
            HEADER.replace(FIRST, "   X01     5".ljust(60) + "PRN / # OF OBS\n" + FIRST),
            "4: PRN / # OF OBS: left out",
        ),
    ],
)
def test_line_out_of_its_columns_is_mended_or_left_out(tmp_path: Path, spoilt: str, told: str) -> None:
    sound, _ = read_rinex_obs([write(tmp_path, HEADER + epoch())])
    table, events = read_rinex_obs([write(tmp_path, spoilt + epoch())])
    assert str(rows(table)) == str(rows(sound))  # not-a-numbers are alike
    assert [told in event.detail for event in events if event.kind == "rinex_header_mended"] == [True]


def test_line_that_names_the_observations_is_not_left_out(tmp_path: Path) -> None:
    spoilt = HEADER.replace("G   ", "G  x", 1)
    with pytest.raises(InputError):
        read_rinex_obs([write(tmp_path, spoilt + epoch())])


@pytest.mark.parametrize(
    "body, unread",
    [
        ("  3 R03  5 R11 -5 R23 -6", ""),
        # as Android's GnssLogger writes it
        (" 3 R03  5 R11 -5 R23 -6", ""),
        ("   3 R03  5 R11 -5 R23 -6", ""),
        ("  3 R03  5R11 -5R23 -6", ""),
        ("  4 R03  5 R11 -5 R23 -6 R24  x", "R24 x"),
        ("  3 R 3 +5  R11 -5 U04  2 R23 -6", "U04 2"),
    ],
)
def test_glonass_channels_are_read_in_any_columns(tmp_path: Path, body: str, unread: str) -> None:
    line = body.ljust(60) + "GLONASS SLOT / FRQ #\n"
    later = f"> 2023 06 29 11 11 42.5000000  4 1\n{line.replace('R11', 'R12')}"
    table, events = read_rinex_obs([write(tmp_path, HEADER.replace(FIRST, line + FIRST) + epoch() + later)])
    assert table.glonass_channels == {"R03": 5, "R11": -5, "R12": -5, "R23": -6}
    told = [event.detail.partition("log.rnx:")[2] for event in events if event.kind == "rinex_header_mended"]
    assert told == ([f"{k}: GLONASS SLOT / FRQ #: left out: {unread}" for k in (4, 12)] if unread else [])
    assert "rinex_record_skipped" not in [event.kind for event in events]


def test_first_label_out_of_its_column_is_moved(tmp_path: Path) -> None:
    sound, _ = read_rinex_obs([write(tmp_path, HEADER + epoch())])
    path = write(tmp_path, HEADER.replace("M: MIXED            ", "M (Mixed)       ", 1) + epoch())
    assert detect_format(path) == "rinex_observation"
    table, events = read_rinex_obs([path])
    assert str(rows(table)) == str(rows(sound))
    assert [event.detail.partition("log.rnx:")[2] for event in events] == [
        "1: RINEX VERSION / TYPE: moved from column 56 to 60"
    ]


@pytest.mark.parametrize(("writer", "code"), [("GnssLogger", "C5P"), ("Trimble", "C7Q")])
def test_beidou_signal_that_a_phone_calls_7q_is_b2a(tmp_path: Path, writer: str, code: str) -> None:
    maker = f"Unknown             {writer:<20}v3".ljust(60) + "REC # / TYPE / VERS\n"
    types = "C    4 C2I D2I C7Q D7Q".ljust(60) + "SYS / # / OBS TYPES\nE    2 C7Q D7Q".ljust(60)
    header = HEADER.replace("E    2 C1X D1X".ljust(60), types).replace(FIRST, maker + FIRST)
    cells = "".join(f"{value:14.3f}  " for value in (22e6, 1561.098, 22e6, 1176.45))
    body = f"> 2023 06 29 11 11 43.0000000  0 2\nC19{cells}\nE11{cells[:32]}\n"
    table, events = read_rinex_obs([write(tmp_path, header + body)])
    found = {(sv, signal): values[1] for (_, sv, signal), values in rows(table).items()}
    assert found == {("C19", "C2I"): 1561.098, ("C19", code): 1176.45, ("E11", "C7Q"): 1561.098}
    assert len(events) == (writer == "GnssLogger")
