"""Finds and reads what lies in the model library: sensor grades, oscillators, filters, antenna patterns, scenarios.

A name is looked for in the user's folders, then in ``INSGNSS_MODELS`` (several folders like a search path), then in
the repository's ``models/``, then in the copy that the wheel carries. A user's folder may hold the kinds in folders of
their own (``imus/mine.toml``) or the files directly.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

from insgnss.config.filter import FilterConfig
from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.config.scenario import ScenarioConfig
from insgnss.config.strict import StrictModel, load_toml
from insgnss.config.vehicle import Vehicle
from insgnss.errors import ModelError

Model = TypeVar("Model", bound=StrictModel)

KINDS = {
    "imus": "IMU grade",
    "oscillators": "oscillator",
    "filters": "filter",
    "antennas": "antenna pattern",
    "scenarios": "scenario",
    "campaigns": "campaign",
    "vehicles": "vehicle",
}
_TABLES = ("antennas",)  # kinds whose files are tables (.csv); the others are settings (.toml)
_PACKAGE = Path(__file__).parent


def search_folders(kind: str, extra_paths: Sequence[Path] = ()) -> list[Path]:
    """Return the folders in which a kind of model is looked for, the first hit wins."""
    named = [Path(part) for part in os.environ.get("INSGNSS_MODELS", "").split(os.pathsep) if part]
    roots = [*(Path(path) for path in extra_paths), *named]
    own = [_PACKAGE.parent / "models", _PACKAGE / "_models"]
    return [folder for root in roots for folder in (root / kind, root)] + [root / kind for root in own]


def names(kind: str, extra_paths: Sequence[Path] = ()) -> list[str]:
    """Return the names of all models of a kind that can be found in folders of that kind."""
    folders = [folder for folder in search_folders(kind, extra_paths) if folder.name == kind]
    return sorted(
        {path.stem for folder in folders if folder.is_dir() for path in folder.glob(f"*{_suffix(kind)}")}
    )


def find(kind: str, name: str, extra_paths: Sequence[Path] = ()) -> Path:
    """Return the file of the model ``name`` of a kind ("imus", "oscillators", "filters", "antennas", "scenarios").

    Raises
    ------
    ModelError : no folder holds it; the advice lists the nearest names
    """
    if name == Path(name).name and name:
        for folder in search_folders(kind, extra_paths):
            path = folder / f"{name}{_suffix(kind)}"
            if path.is_file():
                return path
    known = names(kind, extra_paths)
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.4)
    raise ModelError(
        f"there is no {KINDS.get(kind, kind)} named '{name}'",
        advice=f"nearest: {', '.join(near)}" if near else f"known: {', '.join(known) or 'none'}",
    )


def _suffix(kind: str) -> str:
    return ".csv" if kind in _TABLES else ".toml"


def load(kind: str, name: str, model: type[Model], extra_paths: Sequence[Path] = ()) -> Model:
    """Return the model ``name`` read into its schema.

    Raises
    ------
    ModelError : no such name
    ConfigError : the file does not fit the schema
    """
    return load_toml(find(kind, name, extra_paths), model)


def imu_grade(name: str, extra_paths: Sequence[Path] = ()) -> ImuGrade:
    """Return an inertial sensor's grade by name, from ``models/imus``."""
    return load("imus", name, ImuGrade, extra_paths)


def oscillator(name: str, extra_paths: Sequence[Path] = ()) -> Oscillator:
    """Return an oscillator by name, from ``models/oscillators``."""
    return load("oscillators", name, Oscillator, extra_paths)


def antenna_file(name: str, extra_paths: Sequence[Path] = ()) -> Path:
    """Return the file of a gain pattern: by name from ``models/antennas``, or a path ending in .csv.

    A relative path starts at the first of ``extra_paths``, the folder of the flight file.
    """
    if name.endswith(".csv"):
        return Path(*extra_paths[:1], name)
    return find("antennas", name, extra_paths)


def filter_config(filter: str | Path | FilterConfig) -> FilterConfig:
    """Return the settings of a filter: as they are, from a file (a path ending in .toml), or by name."""
    if isinstance(filter, FilterConfig):
        return filter
    if str(filter).endswith(".toml"):
        return load_toml(Path(filter), FilterConfig)
    return load("filters", str(filter), FilterConfig)


def scenario_config(scenario: str | Path | ScenarioConfig) -> ScenarioConfig:
    """Return a scenario: as it is, from a file (a path ending in .toml), or by name from ``models/scenarios``."""
    if isinstance(scenario, ScenarioConfig):
        return scenario
    if str(scenario).endswith(".toml"):
        return load_toml(Path(scenario), ScenarioConfig)
    return load("scenarios", str(scenario), ScenarioConfig)


def vehicle(vehicle: str | Path | Vehicle, extra_paths: Sequence[Path] = ()) -> Vehicle:
    """Return a vehicle: as it is, from a file (a path ending in .toml), or by name from ``models/vehicles``.

    A relative path starts at the first of ``extra_paths``, the folder of the flight file.
    """
    if isinstance(vehicle, Vehicle):
        return vehicle
    if str(vehicle).endswith(".toml"):
        return load_toml(Path(*extra_paths[:1], vehicle), Vehicle)
    return load("vehicles", str(vehicle), Vehicle, extra_paths)
