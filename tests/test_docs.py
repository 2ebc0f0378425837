"""The documentation: a short README, links that lead somewhere, a map of every room, and examples that run."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

import insgnss

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
LINKING = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "COLUMNS.md", *PAGES]
README_LINES = 250
NAVIGATION = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")[1]
MADE_OF = {"index.md": "README.md", "columns.md": "COLUMNS.md", "contributing.md": "CONTRIBUTING.md"}
FENCED = re.compile(r"^```.*?^```$|^(?: {4}[^\n]*\n)+", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]*?)(?:#([^)\s]*))?\)")


def prose(path: Path) -> str:
    """Return a page without its code."""
    return re.sub(r"`[^`\n]+`", "code", FENCED.sub("", path.read_text(encoding="utf-8")))


@cache
def anchors(path: Path) -> set[str]:
    """Return the fragments of a page's headings, and of the names that its reference documents."""
    text = path.read_text(encoding="utf-8")
    heads = re.findall(r"^#{1,6} (.+)$", FENCED.sub("", text), re.MULTILINE)
    slugs = {re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-") for head in heads}
    return slugs | set(re.findall(r"^::: (\S+)$", text, re.MULTILINE))


def dead_links(path: Path) -> list[str]:
    """Return the relative links of a page to a file, or to a heading of a page, that does not exist."""
    dead = []
    for link, fragment in LINK.findall(prose(path)):
        if re.match(r"[a-z]+:", link):
            continue
        target = (path.parent / link).resolve() if link else path
        if not target.exists() or (fragment and fragment not in anchors(target)):
            dead.append(f"{link}#{fragment}" if fragment else link)
    return dead


def named(paths: list[Path]) -> list[str]:
    return [path.relative_to(ROOT).as_posix() for path in paths]


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= README_LINES


@pytest.mark.parametrize("path", LINKING, ids=named(LINKING))
def test_every_relative_link_leads_to_a_file_and_a_heading(path: Path) -> None:
    assert dead_links(path) == []


def test_a_dead_link_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# One head\n[a](page.md#one-head) [b](gone.md) [c](#two) [d](https://example.org/x)\n")

    assert dead_links(page) == ["gone.md", "#two"]


def test_readme_links_every_page() -> None:
    linked = {(ROOT / link).resolve() for link, _ in LINK.findall(prose(ROOT / "README.md"))}

    assert named([page for page in PAGES if page not in linked]) == []


def test_every_page_has_its_place_on_the_site() -> None:
    placed = re.findall(r": (\S+\.md)$", NAVIGATION, re.MULTILINE)

    assert len(placed) == len(set(placed))
    assert set(placed) == {page.relative_to(DOCS).as_posix() for page in PAGES} | set(MADE_OF)
    assert [name for name in MADE_OF.values() if not (ROOT / name).exists()] == []


def test_map_names_every_room() -> None:
    rooms = {path.parent.name for path in (ROOT / "insgnss").glob("*/__init__.py")}
    told = re.findall(r"^\| `insgnss/(\w+)/` \|", (DOCS / "map.md").read_text(encoding="utf-8"), re.MULTILINE)

    assert sorted(told) == sorted(rooms)


def test_reference_documents_every_public_name() -> None:
    told = re.findall(r"^::: insgnss\.(\w+)$", (DOCS / "api.md").read_text(encoding="utf-8"), re.MULTILINE)

    assert sorted(told) == sorted(set(insgnss.__all__) - {"__version__"})


@pytest.mark.parametrize(
    "name", ["replay-your-log", "write-a-measurement", "study-an-outage", "add-a-receiver-format"]
)
def test_example_of_a_how_to_page_runs(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (DOCS / "how-to" / f"{name}.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)

    exec(compile(example, name, "exec"), {"__name__": name})

    assert capsys.readouterr().out.strip()
