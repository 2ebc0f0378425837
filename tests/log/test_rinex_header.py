"""Header lines out of their columns cost at most themselves."""

from __future__ import annotations

from pathlib import Path

import pytest

from insgnss.errors import InputError
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
