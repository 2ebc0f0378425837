"""Runs the tests with the lowest versions that ``pyproject.toml`` declares: ``make test-lowest``, by hand.

An environment of its own is made in ``build/``, with each dependency at the version that its lower bound names. The test
tools are the newest. With ``--newest`` everything is: that is for another interpreter, for which the lowest versions have no wheels::

    python tests/lowest_versions.py                             # the suite without what is marked slow
    python tests/lowest_versions.py tests/log tests/config      # a part of it
    /path/to/python3.13 tests/lowest_versions.py --newest       # another interpreter
"""  # noqa: E501 - lines of prose

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BOUND = re.compile(r"^(?P<name>[A-Za-z0-9._-]+)>=(?P<version>[0-9.]+)")
NOT_FOR_TESTS = {"import-linter", "mypy", "pandas-stubs", "ruff"}  # they look at the text alone
EXTRAS = ("campaign", "mcap", "novatel", "ulog")  # whose lower bounds count
# what an old library calls may be deprecated in the newest of those below it, as click is to typer
WARNINGS = ("-W", "default::DeprecationWarning")


def lowest(project: dict[str, list[str] | dict[str, list[str]]]) -> list[str]:
    """Return 'name==version' of each run-time dependency, at its lower bound."""
    declared = [*project["dependencies"]]
    optional = project["optional-dependencies"]
    assert isinstance(optional, dict)
    for extra in EXTRAS:
        declared += optional[extra]
    found = [BOUND.match(entry) for entry in declared]
    assert all(found), f"a dependency without a lower bound: {declared}"
    return [f"{match['name']}=={match['version']}" for match in found if match is not None]


def tools(project: dict[str, list[str] | dict[str, list[str]]]) -> list[str]:
    """Return the test tools that run tests."""
    optional = project["optional-dependencies"]
    assert isinstance(optional, dict)
    return [entry for entry in optional["test"] if re.split(r"[<>=]", entry)[0] not in NOT_FOR_TESTS]


def main(arguments: list[str]) -> int:
    """Make the environment, print its versions, run pytest in it."""
    newest = "--newest" in arguments
    chosen = [argument for argument in arguments if argument != "--newest"] or ["-m", "not slow"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    tag = f"{sys.version_info.major}.{sys.version_info.minor}"
    folder = ROOT / "build" / f"{'newest' if newest else 'lowest'}-{tag}"
    python = folder / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    pinned = [*project["dependencies"]] if newest else lowest(project)
    install = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*install, *pinned, *tools(project)], check=True, cwd=ROOT)
    listed = subprocess.run(
        [str(python), "-m", "pip", "freeze"], check=True, capture_output=True, text=True, cwd=ROOT
    )
    names = {re.split(r"[<>=]", entry)[0].lower().replace("-", "_") for entry in pinned}
    print(f"Python {sys.version.split()[0]}")
    print(
        "\n".join(
            line for line in listed.stdout.split() if line.split("==")[0].lower().replace("-", "_") in names
        )
    )
    sys.stdout.flush()
    return subprocess.run(
        [str(python), "-m", "pytest", "-q", *WARNINGS, *chosen], check=False, cwd=ROOT
    ).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
