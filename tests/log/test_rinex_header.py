"""Header lines out of their columns cost at most themselves."""

from __future__ import annotations

from pathlib import Path

import pytest

from insgnss.errors import InputError
from insgnss.log.rinex.observations import read_rinex_obs
from tests.log.test_rinex_observations import HEADER, epoch, rows, write

SLOTS = "  3 R11 -5R19 +3R23 -6".ljust(60) + "GLONASS SLOT / FRQ #\n"
FIRST = next(line for line in HEADER.splitlines() if "TIME OF FIRST OBS" in line)


@pytest.mark.parametrize(
    "spoilt, told",
    [
        (HEADER.replace(FIRST, (" " + FIRST[:59]).ljust(60) + FIRST[60:]), "TIME OF FIRST OBS: rewritten"),
        (HEADER.replace(FIRST, SLOTS + FIRST), "GLONASS SLOT / FRQ #: left out: 3 R11"),
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
