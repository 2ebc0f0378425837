"""Damaged files, and those of the field trial: a result or an error of ours, soon and in little memory.

What one file in three thousand shows is found here with 96 %; ``python -m tests.benchmarks.fuzz`` reads a million.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from insgnss.errors import InsGnssError
from tests.fuzz.cases import failures, target_of
from tests.fuzz.targets import MINIMISED, targets

CASES = 10_000
FEWEST = 60  # of one reader
PARTS = 2  # for as many processes


def test_each_reader_has_enough_cases(tmp_path: Path) -> None:
    everything = targets(tmp_path)
    cases = Counter(target_of(everything, number).name for number in range(CASES))

    assert len(cases) == len(everything)
    assert min(cases.values()) >= FEWEST


@pytest.mark.slow
@pytest.mark.parametrize("part", range(PARTS))
def test_damaged_files_end_in_a_result_or_an_error_of_ours(tmp_path: Path, part: int) -> None:
    numbers = range(part * CASES // PARTS, (part + 1) * CASES // PARTS)
    found = list(failures(targets(tmp_path), 20_251, numbers, tmp_path))

    assert [f"{f.target}, case {f.number}: {f.told}" for f in found] == []


@pytest.mark.parametrize("path", sorted(MINIMISED.glob("*.min")), ids=lambda path: path.stem)
def test_input_of_the_field_trial_is_read_or_refused(tmp_path: Path, path: Path) -> None:
    names = {"nav": "rinex navigation", "obs": "rinex observations", "imu": "imu csv"}
    kind = path.name.split("_")[0]
    [target] = [one for one in targets(tmp_path) if one.name == names.get(kind, kind)]
    copy = tmp_path / "file"
    copy.write_bytes(path.read_bytes())
    told = ""
    try:
        target.read(copy)
    except InsGnssError as error:
        told = str(error)
    assert told == "" or str(copy) in told
