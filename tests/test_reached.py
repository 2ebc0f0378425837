"""Nothing of the package serves tests alone: another file of it, a notebook or a page uses each of its names."""

from __future__ import annotations

import ast
import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted((ROOT / "insgnss").rglob("*.py"))
READ = [
    *(ROOT / "notebooks").glob("*.py"),
    *(ROOT / "docs").rglob("*.md"),
    *(ROOT / name for name in ("README.md", "COLUMNS.md", "CONTRIBUTING.md", "pyproject.toml")),
]
# kernels for arrays of what the package does one by one: the tests look at thousands of draws
FOR_TESTS = {"observe_channels"}


def names_of(node: ast.stmt) -> tuple[str, ...]:
    """Return the names that a statement defines: several for numbers of one list, which stand and fall together."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return (node.name,)
    if isinstance(node, ast.Assign | ast.AnnAssign):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        return tuple(part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name))
    return ()


def used_in(tree: ast.AST) -> Counter[str]:
    """Return how often a piece of code reads each name, names in texts that are identifiers included."""
    used: Counter[str] = Counter()
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            used[node.id] += 1
        elif isinstance(node, ast.Attribute):
            used[node.attr] += 1
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and len(node.value) < 200:
            used.update(re.findall(r"\w+", node.value) if re.fullmatch(r"[\w.:]+", node.value) else ())
    return used


def only_tests_use(sources: dict[str, ast.Module], read: str) -> list[str]:
    """Return the names that neither the sources, outside of their own definitions, nor the texts use."""
    statements = [
        (place, names_of(node), used_in(node)) for place, tree in sources.items() for node in tree.body
    ]
    everywhere: Counter[str] = Counter()
    for _, _, own in statements:
        everywhere.update(own)
    outside = set(re.findall(r"\w+", read)) | FOR_TESTS
    return [
        f"{place}: {', '.join(names)}"
        for place, names, own in statements
        if outside.isdisjoint(names) and names and not names[0].startswith("__")
        if all(everywhere[name] <= own[name] for name in names)
    ]


def test_every_name_of_the_package_is_used_or_named_outside_of_the_tests() -> None:
    sources = {str(path.relative_to(ROOT)): ast.parse(path.read_text(encoding="utf-8")) for path in SOURCES}

    assert only_tests_use(sources, "\n".join(path.read_text(encoding="utf-8") for path in READ)) == []


def test_name_that_nothing_but_its_own_definition_uses_is_found() -> None:
    one = ast.parse(
        "def lone(n): return lone(n - 1)\ndef met(): return 1\nA, B = 1, 2\nC = met() + A\n__all__ = ['C']"
    )

    assert only_tests_use({"one.py": one}, "") == ["one.py: lone"]
    assert only_tests_use({"one.py": one}, "see `lone`") == []
