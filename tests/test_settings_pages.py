"""The pages on settings list the keys that the code knows, and no others; their examples are files that load."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest
from pydantic import BaseModel

from insgnss.config.filter import FilterConfig
from insgnss.config.interference import InterferenceConfig
from insgnss.config.library import filter_config
from insgnss.config.scenario import ScenarioConfig
from insgnss.config.simulation import SimulationConfig
from insgnss.config.strict import load_toml
from insgnss.errors import ConfigError
from insgnss.studies import ReceiverOptions
from insgnss.studies.campaign.cases import CASES
from insgnss.studies.campaign.study import CampaignConfig, load_campaign
from tests.test_docs import DOCS, site_helper

FILES = {
    "filter-file.md": (FilterConfig,),
    "scenario-file.md": (SimulationConfig, ScenarioConfig),
    "campaign-file.md": (CampaignConfig,),
    "emitters-file.md": (InterferenceConfig,),
}


def keys_of(schema: type[BaseModel]) -> Iterator[str]:
    """Yield the keys of a schema and of those inside it, by another way than the pages' own."""
    found = schema.model_json_schema()
    for table in (found, *found.get("$defs", {}).values()):
        yield from table.get("properties", {})


def keys_on(page: str) -> set[str]:
    """Return the keys that a page's tables list: one a row, or all of a kind of table in its last cell."""
    text = page.split("<!--")[1]
    rows = re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)
    cells = re.findall(r'^\| `"\w+"` \| .* \| (.*) \|$', text, re.MULTILINE)
    return set(rows) | {key for cell in cells for key in re.findall(r"`(\w+)(?: = [^`]*)?`", cell)}


@pytest.mark.parametrize("name", FILES)
def test_page_is_what_the_schemas_give(name: str) -> None:
    made = site_helper("settings_tables").page_of(name)

    assert (DOCS / name).read_text(encoding="utf-8") == made, "run: python docs/settings_tables.py"


@pytest.mark.parametrize("name", FILES)
def test_page_lists_every_key_of_the_code_and_no_other(name: str) -> None:
    known = {key for schema in FILES[name] for key in keys_of(schema)}
    by_kind = {"kind"} & known  # of tables that differ by kind the kind has a column of its own

    assert keys_on((DOCS / name).read_text(encoding="utf-8")) | by_kind == known


def test_tables_follow_a_schema_that_changes() -> None:
    class Inner(BaseModel):
        """What is inside."""

        width_m: float = 2.0

    class Outer(BaseModel):
        """A file."""

        name: str
        part: tuple[Inner, ...] = ()

    text = site_helper("settings_tables").tables_of(Outer)

    assert "| `name` | required | text | as shown in results |" in text
    assert "| `part` | `[]` | array of table | What is inside |" in text
    assert "## `[[part]]`\n\nWhat is inside." in text
    assert "| `width_m` | `2.0` | number |  |" in text


@pytest.mark.parametrize("name", FILES)
def test_every_row_of_a_key_table_says_what_the_key_means(name: str) -> None:
    rows = [row for row in (DOCS / name).read_text(encoding="utf-8").split("\n") if row.startswith("| `")]

    assert rows
    assert [row for row in rows if re.search(r"(?<!\\)\|\s+\|$", row) and not row.startswith('| `"')] == []


def test_usual_meanings_are_of_keys_that_the_pages_list() -> None:
    known = {key for schemas in FILES.values() for schema in schemas for key in keys_of(schema)}

    assert site_helper("settings_tables").USUAL.keys() - known == set()


@pytest.mark.parametrize("name", FILES)
def test_example_of_a_page_loads(name: str, tmp_path: Path) -> None:
    (example,) = re.findall(
        r"^```toml\n(.*?)^```$", (DOCS / name).read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    file = tmp_path / "example.toml"
    file.write_text(example, encoding="utf-8")

    if name == "filter-file.md":
        assert filter_config(file).gates.pseudorange_sigma == 4.0
    elif name == "campaign-file.md":
        assert load_campaign(file).n_cases == 4
    else:
        load_toml(file, FILES[name][0])


@pytest.mark.parametrize("case", CASES)
def test_campaign_page_lists_the_keys_of_each_case(case: str) -> None:
    page = (DOCS / "campaign-file.md").read_text(encoding="utf-8")
    (row,) = re.findall(rf"^\| `{case}` \| (.*) \| .* \|$", page, re.MULTILINE)

    with pytest.raises(ConfigError) as refused:
        CASES[case]({"no such key": 1}, 0)

    known = set(str(refused.value.advice).removeprefix("the keys are ").split(", "))
    options = {field.name for field in fields(ReceiverOptions)} if case == "receiver" else set()
    assert set(re.findall(r"`(\w+)", row)) - {"insgnss"} == known - options
