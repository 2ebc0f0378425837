"""Installs the wheel without extras, away from the repository, and runs its commands: ``make test-wheel``, by hand.

The source archive is built and unpacked elsewhere, and the wheel is built from what was unpacked: this shows if the archive
lacks a file. An environment of its own in ``build/wheel`` takes the run-time dependencies from the package index and nothing
else. ``tests/test_wheel.py`` does the same in the suite with the libraries that are installed already.
"""  # noqa: E501 - lines of prose

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FLIGHT_S = 3  # the filter starts after two of them
# what an installation without extras must not bring: a library of each extra, and of the tests
NOT_WANTED = (
    "coverage",
    "distributed",
    "hypothesis",
    "mcap",
    "mkdocs",
    "novatel_edie",
    "pytest",
    "pyulog",
)


def built(folder: Path) -> tuple[Path, Path]:
    """Return the wheel and the source archive, the one made from the other outside of the repository."""
    _hatchling("sdist", ROOT, folder)
    (archive,) = folder.glob("*.tar.gz")
    with tarfile.open(archive) as packed:
        packed.extractall(folder / "unpacked", filter="data")
    (sources,) = (folder / "unpacked").iterdir()
    _hatchling("wheel", sources, folder)
    (wheel,) = folder.glob("*.whl")
    return wheel, archive


def _hatchling(target: str, sources: Path, folder: Path) -> None:
    command = [sys.executable, "-m", "hatchling", "build", "--target", target, "--directory", str(folder)]
    subprocess.run(command, check=True, cwd=sources, capture_output=True)


def clean_environment(**more: str) -> dict[str, str]:
    """Return the environment of this process without what shows Python the repository."""
    kept = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "INSGNSS_MODELS")}
    return {**kept, "COLUMNS": "100", **more}


def found_libraries(python: Path, folder: Path) -> dict[str, str]:
    """Return where an environment finds the package and each library it should be without ('' if nowhere)."""
    code = (
        "import importlib.util as u, json, sys\n"
        "specs = {name: u.find_spec(name) for name in sys.argv[1:]}\n"
        "print(json.dumps({name: s.origin or '?' if s else '' for name, s in specs.items()}))"
    )
    command = [str(python), "-c", code, "insgnss", "tests", *NOT_WANTED]
    done = subprocess.run(
        command, check=True, cwd=folder, env=clean_environment(), capture_output=True, text=True
    )
    found: dict[str, str] = json.loads(done.stdout)
    return found


def run_commands(program: Path, folder: Path, **environment: str) -> dict[str, str]:
    """Return what each of the first commands of a user printed; a command that fails ends the series."""
    commands = {
        "version": ["--version"],
        "models": ["models"],
        "simulate": ["simulate", "turning_flight", "--duration", str(FLIGHT_S), "--output", "flight"],
        "check": ["check", "flight/flight.toml"],
        "replay": ["replay", "flight/flight.toml", "--output", "run", "--report", "page.html", "--json"],
        "export": ["export", "run", "--output", "run.nc"],
    }
    printed = {}
    for name, options in commands.items():
        done = subprocess.run(
            [str(program), *options],
            check=False,
            cwd=folder,
            env=clean_environment(**environment),
            capture_output=True,
            text=True,
        )
        if done.returncode:
            raise RuntimeError(f"insgnss {' '.join(options)} ended with {done.returncode}:\n{done.stderr}")
        printed[name] = done.stdout
    return printed


def main() -> int:
    """Build, install from the package index, run; return 0 when the environment holds nothing but what is declared."""
    environment = ROOT / "build" / "wheel"
    shutil.rmtree(environment, ignore_errors=True)
    python = environment / "bin" / "python"
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        wheel, archive = built(folder)
        for path in (wheel, archive):
            print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB")
        subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
        pip = [str(python), "-m", "pip", "--quiet", "--disable-pip-version-check", "--no-input"]
        subprocess.run([*pip, "install", str(wheel)], check=True, cwd=folder)
        subprocess.run([*pip, "check"], check=True, cwd=folder)
        found = found_libraries(python, folder)
        foreign = [name for name in ("tests", *NOT_WANTED) if found[name]]
        print(f"insgnss from {found['insgnss']}; not declared but there: {', '.join(foreign) or 'nothing'}")
        began = time.perf_counter()
        printed = run_commands(environment / "bin" / "insgnss", folder, INSGNSS_CACHE=str(folder / "cache"))
        print(printed["version"].strip(), f"- {len(printed)} commands in {time.perf_counter() - began:.0f} s")
        print("replay:", json.loads(printed["replay"])["nis"])
    return 1 if foreign or not found["insgnss"].startswith(str(environment)) else 0


if __name__ == "__main__":
    sys.exit(main())
