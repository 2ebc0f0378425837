"""Wheel and source archive: what they hold, and that the wheel works without extras and without the repository.

Nothing is fetched: the environment is empty but for the run-time dependencies that this one has, linked into it one by one,
and the kernels run as plain Python, so nothing is compiled. ``make test-wheel`` installs from the package index and compiles.
"""  # noqa: E501 - lines of prose

from __future__ import annotations

import json
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from insgnss.version import __version__
from tests.conftest import REPOSITORY
from tests.installed_wheel import FLIGHT_S, NOT_WANTED, built, found_libraries, run_commands

PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("wheel")


@pytest.fixture(scope="module")
def packages(folder: Path) -> tuple[Path, Path]:
    pytest.importorskip("hatchling", reason="the tool that builds the package is not installed")
    return built(folder)


@pytest.fixture(scope="module")
def in_wheel(packages: tuple[Path, Path]) -> set[str]:
    with zipfile.ZipFile(packages[0]) as wheel:
        return set(wheel.namelist())


@pytest.fixture(scope="module")
def in_archive(packages: tuple[Path, Path]) -> set[str]:
    with tarfile.open(packages[1]) as archive:
        return {member.name.partition("/")[2] for member in archive.getmembers()}


def files_below(name: str) -> set[str]:
    """Return the files of a folder of the repository that a package should carry, relative to it."""
    found = (path for path in (REPOSITORY / name).rglob("*") if path.is_file())
    inside = (path.relative_to(REPOSITORY / name) for path in found)
    return {path.as_posix() for path in inside if "__pycache__" not in path.parts}


def needed_by(names: list[str]) -> set[str]:
    """Return the distributions that requirements ask for, and those that these ask for: no extra of the package."""
    found: set[str] = set()
    waiting = [Requirement(name) for name in names]
    while waiting:
        requirement = waiting.pop()
        name = canonicalize_name(requirement.name)
        if name in found:
            continue
        found.add(name)
        for needed in map(Requirement, metadata.requires(name) or []):
            extras = requirement.extras or {""}
            if needed.marker is None or any(needed.marker.evaluate({"extra": extra}) for extra in extras):
                waiting.append(needed)
    return found


def link_libraries(site: Path, names: set[str]) -> None:
    """Link what distributions installed here into another environment's folder of packages."""
    for name in names:
        distribution = metadata.distribution(name)
        for top in {
            file.parts[0] for file in distribution.files or [] if file.parts[0] not in ("..", "__pycache__")
        }:
            if not (site / top).exists():
                (site / top).symlink_to(distribution.locate_file(top))


@pytest.fixture(scope="module")
def python(packages: tuple[Path, Path], folder: Path) -> Path:
    """Return the Python of an environment with the wheel and its run-time dependencies alone."""
    environment = folder / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)
    (site,) = environment.glob("lib/python*/site-packages")
    link_libraries(site, needed_by(PROJECT["dependencies"]))
    python = environment / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", python, "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "install", "--no-deps", "--no-index", packages[0]], check=True)
    return python


def test_wheel_holds_the_package_the_models_and_the_licence(in_wheel: set[str]) -> None:
    about = f"insgnss-{__version__}.dist-info/"
    expected = {f"insgnss/{file}" for file in files_below("insgnss")}
    expected |= {f"insgnss/_models/{file}" for file in files_below("models")}

    assert {name for name in in_wheel if not name.startswith(about)} == expected
    assert f"{about}licenses/LICENSE" in in_wheel


def test_wheel_declares_what_the_project_declares(packages: tuple[Path, Path]) -> None:
    with zipfile.ZipFile(packages[0]) as wheel:
        text = wheel.read(f"insgnss-{__version__}.dist-info/METADATA").decode()
    required = re.findall(r"^Requires-Dist: (.+)$", text, re.MULTILINE)

    assert re.findall(r"^Version: (.+)$", text, re.MULTILINE) == [__version__]
    assert re.findall(r"^License-Expression: (.+)$", text, re.MULTILINE) == [PROJECT["license"]]
    without = {canonicalize_name(Requirement(entry).name) for entry in required if "extra ==" not in entry}
    assert without == {canonicalize_name(Requirement(entry).name) for entry in PROJECT["dependencies"]}


def test_source_archive_holds_what_builds_tests_and_documents_the_package(in_archive: set[str]) -> None:
    for name in ("insgnss", "models", "tests", "docs", "notebooks", "data"):
        assert {f"{name}/{file}" for file in files_below(name)} - in_archive == set()
    named = {
        ".github/SECURITY.md",
        "CHANGELOG.md",
        "CITATION.cff",
        "LICENSE",
        "Makefile",
        "README.md",
        "pyproject.toml",
    }
    assert named <= in_archive


def test_source_archive_holds_no_result_and_no_real_log(in_archive: set[str]) -> None:
    tops = {name.partition("/")[0] for name in in_archive}

    assert tops & {"out", "build", "dist", "shared", ".git", ".venv", ".ci"} == set()
    assert [name for name in in_archive if name.endswith((".ubx", ".sbf", ".parquet", ".pyc"))] == []


@pytest.mark.slow
def test_installed_wheel_replays_a_flight_without_extras_and_repository(python: Path, folder: Path) -> None:
    away = folder / "away"
    away.mkdir()
    found = found_libraries(python, away)
    printed = run_commands(python.with_name("insgnss"), away, NUMBA_DISABLE_JIT="1")

    assert found.pop("insgnss").startswith(str(python.parents[1]))
    assert found == dict.fromkeys(("tests", *NOT_WANTED), "")
    assert printed["version"].split() == ["insgnss", __version__]
    assert {path.stem for path in (REPOSITORY / "models" / "imus").glob("*.toml")} <= set(
        printed["models"].split()
    )
    replayed = json.loads(printed["replay"])
    # 11 satellites a second once the filter has started, after two seconds of rest
    assert replayed["nis"]["pseudorange"]["used"] == 11 * (FLIGHT_S - 2)
    assert (away / "page.html").stat().st_size > 1e6  # the page carries its script
