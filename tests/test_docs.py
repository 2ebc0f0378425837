"""The documentation: a short README, links that lead somewhere, a map of every room, and examples that run."""

from __future__ import annotations

import importlib.util
import re
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace

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


def test_first_result_and_numbers_of_the_readme_are_those_of_the_sample_flight() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```text\n(sample flight: .*?)```", readme, re.DOTALL)
    shown = re.findall(r"^  (n|e|d|yaw), (m|deg)((?: +-?[\d.]+){5})$", block, re.MULTILINE)
    used = re.findall(r"^  used +(\d+) +(\d+)$", block, re.MULTILINE)
    (row,) = re.findall(
        r"^\| sample flight, 20 minutes.* position ([\d., ]+) m rms .*NIS (\S+) and (\S+)\)",
        readme,
        re.MULTILINE,
    )

    run = insgnss.replay(ROOT / "data" / "sample_flight" / "flight.toml")

    errors = run.error_summary()[["mean", "rms", "p95", "max", "mean_sigma"]]
    nis = run.nis_summary()["mean_nis"]
    assert len(shown) == 4
    for name, unit, numbers in shown:
        # to a centimetre and a hundredth of a degree: machines differ below that
        assert [float(n) for n in numbers.split()] == pytest.approx(
            errors.loc[f"{name}_{unit}"].tolist(), abs=0.01
        )
    assert [float(n) for n in row[0].split(", ")] == pytest.approx(
        errors.loc[["n_m", "e_m", "d_m"], "rms"].tolist(), abs=0.01
    )
    assert [float(n) for n in row[1:]] == pytest.approx(
        nis.loc[["pseudorange", "range_rate"]].tolist(), abs=0.01
    )
    assert [int(n) for n in used[0]] == pytest.approx(
        run.status_counts().loc["used"].loc[["pseudorange", "range_rate"]].tolist(), abs=20
    )


def test_every_issue_template_has_a_name_and_a_purpose() -> None:
    templates = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.md"))
    heads = [path.read_text(encoding="utf-8").split("---\n")[1] for path in templates]

    assert len(templates) >= 3
    assert [head for head in heads if not re.fullmatch(r"name: .+\nabout: .+\nlabels: \w+\n", head)] == []


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


WITH_EXAMPLE = [ROOT / "README.md", DOCS / "python.md", *sorted((DOCS / "how-to").glob("*.md"))]


@pytest.mark.parametrize("path", WITH_EXAMPLE, ids=named(WITH_EXAMPLE))
def test_first_example_of_a_page_runs(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = path.read_text(encoding="utf-8")
    example, *others = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)

    exec(compile(example, path.name, "exec"), {"__name__": path.stem})

    assert not others or path.parent.name != "how-to"
    assert capsys.readouterr().out.strip()


def site_helper(name: str) -> ModuleType:
    """Return a file of ``docs/`` that the site is built with."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("page", "src_uri", "link", "on_site"),
    [
        ("README.md", "index.md", "docs/how-to/study-an-outage.md#x", "how-to/study-an-outage.md#x"),
        ("README.md", "index.md", "COLUMNS.md", "columns.md"),
        ("docs/how-to/study-an-outage.md", "how-to/study-an-outage.md", "../../README.md", "../index.md"),
        ("docs/notebooks.md", "notebooks.md", "../LICENSE", "LICENSE"),
        ("docs/notebooks.md", "notebooks.md", "filter.md", "filter.md"),
    ],
)
def test_links_of_the_repository_become_links_of_the_site(
    page: str, src_uri: str, link: str, on_site: str
) -> None:
    file = SimpleNamespace(abs_src_path=str(ROOT / page), src_uri=src_uri)
    hook = site_helper("site_hook")

    text = hook.on_page_markdown(f"[a]({link})", page=SimpleNamespace(file=file), config=None, files=None)

    assert hook.PAGES == {name: page for page, name in MADE_OF.items()}
    assert text == f"[a]({on_site})"


def test_site_needs_no_network() -> None:
    settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")

    assert "font: false" in settings
    assert not re.search(r"https?://|cdn", settings)
