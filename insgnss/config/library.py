"""Finds and reads the models of the library: sensor grades, oscillators, filters, antenna patterns, scenarios.

A name is searched in the user's folders, then in ``INSGNSS_MODELS`` (several folders like a search path), then in
the repository's ``models/``, then in the copy that the wheel carries. A user's folder may hold the kinds in folders of
their own (``imus/mine.toml``) or the files directly.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from insgnss.config.filter import FilterConfig
from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.config.scenario import ScenarioConfig
from insgnss.config.strict import Model, changed, load_toml, read_toml
from insgnss.config.vehicle import Vehicle
from insgnss.errors import ConfigError, ModelError

KINDS = {
    "imus": "IMU grade",
    "oscillators": "oscillator",
    "filters": "filter",
    "antennas": "antenna pattern",
    "scenarios": "scenario",
    "campaigns": "campaign",
    "vehicles": "vehicle",
    "emitters": "file of emitters",
}
_TABLES = ("antennas",)  # kinds whose files are tables (.csv); the others are settings (.toml)
_FORMER_NAMES: Final = {("filters", "tight17"): "tight"}
_PACKAGE = Path(__file__).parents[1]


def search_folders(kind: str, extra_paths: Sequence[Path] = ()) -> list[Path]:
    """Return the folders in which a kind of model is searched, the first hit wins."""
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
    for candidate in (name, _FORMER_NAMES.get((kind, name), "")):
        if candidate == Path(candidate).name and candidate:
            for folder in search_folders(kind, extra_paths):
                path = folder / f"{candidate}{_suffix(kind)}"
                if path.is_file():
                    return path
    known = names(kind, extra_paths)
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.4)
    raise ModelError(
        f"there is no {KINDS.get(kind, kind)} named '{name}'",
        advice=f"nearest: {', '.join(near)}" if near else f"known: {', '.join(known) or 'none'}",
    )


def file_of(kind: str, named: str | Path, folder: Path = Path()) -> Path:
    """Return a model's file: a path with the ending of its kind, counted from ``folder``, or one by its name.

    Raises
    ------
    ModelError : the library has none of this name
    """
    return folder / named if str(named).endswith(_suffix(kind)) else find(kind, str(named))


def about(kind: str, name: str) -> str:
    """Return a model's description: its file's first comment, up to the first full stop that ends a line."""
    lines: list[str] = []
    for line in find(kind, name).read_text(encoding="utf-8").splitlines():
        if not line.startswith("#") or (lines and lines[-1].endswith((".", "?"))):
            break
        lines.append(line.removeprefix("#").strip())
    return " ".join(lines)


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


def filter_config(
    filter: str | Path | FilterConfig, settings: Mapping[str, Any] | None = None
) -> FilterConfig:
    """Return the settings of a filter: as they are, from a file (a path ending in .toml), or by name.

    Parameters
    ----------
    settings : changed settings, by dotted key or by tables: ``{"gates.pseudorange_sigma": 4.0}``

    Raises
    ------
    ModelError, MissingFileError : no such filter
    ConfigError : the file does not fit the schema, is based on itself, or a setting does not fit
    """
    config = filter if isinstance(filter, FilterConfig) else _filter_of_file(file_of("filters", filter))
    if settings and "based_on" in settings:
        raise ConfigError(
            "based_on cannot be changed by a setting", key="based_on", advice="name that filter instead"
        )
    return changed(config, settings) if settings else config


def _filter_of_file(path: Path, above: tuple[Path, ...] = ()) -> FilterConfig:
    """Return a file's settings; omitted settings come from the filter that it is based on."""
    based_on = read_toml(path).get("based_on")
    if not (isinstance(based_on, str) and based_on):
        return load_toml(path, FilterConfig)
    above = (*above, path.resolve())
    below = file_of("filters", based_on, path.parent)
    if below.resolve() in above:
        raise ConfigError(
            "the filter is based on itself",
            file=path,
            key="based_on",
            advice="name another filter: 'insgnss models filters' lists those of the library",
        )
    base = _filter_of_file(below, above).model_dump(mode="json")
    return load_toml(path, FilterConfig, {**base, "name": path.stem})


def scenario_config(scenario: str | Path | ScenarioConfig) -> ScenarioConfig:
    """Return a scenario: as it is, from a file (a path ending in .toml), or by name from ``models/scenarios``."""
    if isinstance(scenario, ScenarioConfig):
        return scenario
    return load_toml(file_of("scenarios", scenario), ScenarioConfig)


def vehicle(vehicle: str | Path | Vehicle, extra_paths: Sequence[Path] = ()) -> Vehicle:
    """Return a vehicle: as it is, from a file (a path ending in .toml), or by name from ``models/vehicles``.

    A relative path starts at the first of ``extra_paths``, the folder of the flight file.
    """
    if isinstance(vehicle, Vehicle):
        return vehicle
    if str(vehicle).endswith(".toml"):
        return load_toml(Path(*extra_paths[:1], vehicle), Vehicle)
    return load("vehicles", str(vehicle), Vehicle, extra_paths)
