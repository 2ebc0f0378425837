"""Settings that change a few keys: ``--set``, ``settings=``, and filter files that say what they are based on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insgnss.config.changes import as_tables, assignments, merged
from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.errors import ConfigError, MissingFileError

TIGHT = filter_config("tight")


def written(folder: Path, text: str, name: str = "mine.toml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def differing(config: FilterConfig, other: FilterConfig) -> dict[str, Any]:
    """Return the leaves of a filter that are not those of another, by dotted key."""

    def leaves(table: dict[str, Any], prefix: str = "") -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in table.items():
            is_table = isinstance(value, dict)
            found |= leaves(value, f"{prefix}{key}.") if is_table else {f"{prefix}{key}": value}
        return found

    before, after = leaves(other.model_dump()), leaves(config.model_dump())
    return {key: value for key, value in after.items() if before.get(key) != value}


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        ("gates.pseudorange_sigma=4", "gates.pseudorange_sigma", 4.0),
        ("adaptation.on = false", "adaptation.on", False),
        ("faults.weights=huber", "faults.weights", "huber"),
        ('faults.weights="huber"', "faults.weights", "huber"),
        ("measurements.variance_scale.R=2", "measurements.variance_scale.R", 2.0),
        ('measurements.constellations=["G", "E"]', "measurements.constellations", ("G", "E")),
    ],
)
def test_option_sets_one_key_and_no_other(text: str, key: str, value: object) -> None:
    assert differing(filter_config("tight", assignments([text])), TIGHT) == {key: value}


@pytest.mark.parametrize(
    "settings",
    [
        {"gates.pseudorange_sigma": np.float32(4.0), "start.min_satellites": np.int64(6)},
        {"gates": {"pseudorange_sigma": 4.0}, "start": {"min_satellites": 6}},
        {"gates": {"pseudorange_sigma": 4.0}, "start.min_satellites": 6},
    ],
)
def test_settings_are_dotted_or_tables(settings: dict[str, Any]) -> None:
    wanted = {"gates.pseudorange_sigma": 4.0, "start.min_satellites": 6}

    assert differing(filter_config("tight", settings), TIGHT) == wanted


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gates.pseudorange_sgma=4", "'gates.pseudorange_sigma'"),
        ("gate.pseudorange_sigma=4", "nearest valid key: 'gates'"),
        ("foo=1", r"-> valid here: name, .*; every key with its meaning: docs/filter-file.md$"),
        ("pseudorange_sgma=4", "or 'gates.pseudorange_sigma'"),
        ("gates.pseudorange_sigma=four", "expected a number"),
        ("gates.pseudorange_sigma=-4", "greater than 0"),
        ("gates=4", "expected a table of keys"),
        ("name.of=4", "expected a text"),
        ("based_on=tight", "name that filter instead"),
        ("gates.pseudorange_sigma", "KEY=VALUE"),
        ("=4", "KEY=VALUE"),
        ("gates.pseudorange_sigma=", "KEY=VALUE"),
    ],
)
def test_wrong_setting_is_named_with_what_to_do(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        filter_config("tight", assignments([text]))


def test_setting_given_twice_is_an_error() -> None:
    with pytest.raises(ConfigError, match="set twice"):
        assignments(["gates.carrier_sigma=4", "gates.carrier_sigma=5"])


def test_tables_are_merged_and_arrays_replaced() -> None:
    assert as_tables({"a.b": 1, "a": {"c": 2}}) == {"a": {"b": 1, "c": 2}}
    assert merged({"a": {"b": 1, "c": [1, 2]}}, {"a": {"c": [3]}}) == {"a": {"b": 1, "c": [3]}}


def test_partial_file_changes_what_it_says_and_keeps_the_rest(tmp_path: Path) -> None:
    path = written(tmp_path, 'based_on = "tight"\n[gates]\npseudorange_sigma = 4\n')

    changes = {"name": "mine", "based_on": "tight", "gates.pseudorange_sigma": 4.0}
    assert differing(filter_config(path), TIGHT) == changes


def test_partial_file_without_its_base_is_told_so_for_each_key_that_it_lacks(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match="range_rate_noise_mps: noise of range rates; not required if based_on"
    ) as refused:
        filter_config(written(tmp_path, "[gates]\npseudorange_sigma = 4\n"))
    assert 'begin with based_on = "tight"' in refused.value.advice


def test_partial_file_may_be_based_on_a_file_beside_it(tmp_path: Path) -> None:
    written(tmp_path, 'based_on = "tight"\n[gates]\npseudorange_sigma = 4\ncarrier_sigma = 6\n', "first.toml")
    path = written(tmp_path, 'based_on = "first.toml"\nname = "second"\n[gates]\ncarrier_sigma = 7\n')

    found = filter_config(path)
    assert (found.gates.pseudorange_sigma, found.gates.carrier_sigma, found.name) == (4.0, 7.0, "second")


def test_files_based_on_each_other_are_refused(tmp_path: Path) -> None:
    written(tmp_path, 'based_on = "mine.toml"\n', "other.toml")
    with pytest.raises(ConfigError, match="based on itself"):
        filter_config(written(tmp_path, 'based_on = "other.toml"\n'))


def test_error_in_a_partial_file_names_its_line(tmp_path: Path) -> None:
    path = written(tmp_path, 'based_on = "tight"\n[gates]\npseudorange_sgma = 4\n')
    with pytest.raises(ConfigError, match=r"mine\.toml:3, key 'gates\.pseudorange_sgma'"):
        filter_config(path)


def test_base_that_is_missing_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError):
        filter_config(written(tmp_path, 'based_on = "nothing.toml"\n'))
    with pytest.raises(ConfigError, match="expected a text"):
        filter_config(written(tmp_path, "based_on = 3\n"))


def test_whole_file_without_the_noise_is_told_of_based_on(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="based_on"):
        filter_config(written(tmp_path, "[gates]\npseudorange_sigma = 4\n"))


def test_former_name_of_the_filter_still_finds_it() -> None:
    assert filter_config("tight17") == TIGHT
