"""Nothing of the package serves tests alone: another file of it, a notebook or a page uses each of its names."""

from __future__ import annotations

import ast
import re
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted((ROOT / "insgnss").rglob("*.py"))
READ = [
    *(ROOT / "notebooks").glob("*.py"),
    *(ROOT / "docs").rglob("*.md"),
    *(ROOT / name for name in ("README.md", "COLUMNS.md", "CONTRIBUTING.md", "pyproject.toml")),
]
# kernels for arrays of what the package does one by one: the tests look at thousands of draws
FOR_TESTS = {"observe_channels"}
# methods that importlib and Numba call
CALLED_BY_LIBRARIES = {"exec_module", "get_call_type", "get_call_signatures", "get_impl_key", "invoke"}
# methods that a user expects beside those that the package calls itself: another form of an attitude, the share of
# channels beside that of runs
FOR_USERS = {"from_quaternion", "lost_channels"}


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


def methods_that_only_tests_use(sources: dict[str, ast.Module], read: str) -> list[str]:
    """Return the methods whose names neither the sources, outside of the method itself, nor the texts use."""
    everywhere: Counter[str] = Counter()
    for tree in sources.values():
        everywhere.update(used_in(tree))
    outside = set(re.findall(r"\w+", read)) | CALLED_BY_LIBRARIES | FOR_USERS
    return [
        f"{place}: {owner.name}.{method.name}"
        for place, tree in sources.items()
        for owner in ast.walk(tree)
        if isinstance(owner, ast.ClassDef)
        for method in owner.body
        if isinstance(method, ast.FunctionDef) and not method.name.startswith("_")
        if method.name not in outside and everywhere[method.name] <= used_in(method)[method.name]
    ]


@pytest.fixture(scope="module")
def sources() -> dict[str, ast.Module]:
    return {str(path.relative_to(ROOT)): ast.parse(path.read_text(encoding="utf-8")) for path in SOURCES}


@pytest.fixture(scope="module")
def read() -> str:
    return "\n".join(path.read_text(encoding="utf-8") for path in READ)


def test_every_name_of_the_package_is_used_or_named_outside_of_the_tests(
    sources: dict[str, ast.Module], read: str
) -> None:
    assert only_tests_use(sources, read) == []


def test_every_method_of_the_package_is_used_or_named_outside_of_the_tests(
    sources: dict[str, ast.Module], read: str
) -> None:
    assert methods_that_only_tests_use(sources, read) == []


def test_name_that_nothing_but_its_own_definition_uses_is_found() -> None:
    one = ast.parse(
        "def lone(n): return lone(n - 1)\ndef met(): return 1\nA, B = 1, 2\nC = met() + A\n__all__ = ['C']"
    )

    assert only_tests_use({"one.py": one}, "") == ["one.py: lone"]
    assert only_tests_use({"one.py": one}, "see `lone`") == []


def test_method_that_nothing_but_itself_uses_is_found() -> None:
    one = ast.parse(
        "class A:\n def lone(self): return self.lone()\n def met(self): return 1\n def _own(self): pass\nA().met()"
    )

    assert methods_that_only_tests_use({"one.py": one}, "") == ["one.py: A.lone"]
    assert methods_that_only_tests_use({"one.py": one}, "call `lone`") == []
