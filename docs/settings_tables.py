"""The tables of the pages on settings, from the schemas: ``python docs/settings_tables.py`` writes them anew.

A page holds its own text and, below the line ``MARK``, one table for each table of the file. A test compares the pages
with the schemas.
"""

from __future__ import annotations

import json
import types
from collections.abc import Iterator
from pathlib import Path, PurePath
from typing import Annotated, Any, Final, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from insgnss.config.filter import FilterConfig
from insgnss.config.interference import InterferenceConfig
from insgnss.config.scenario import ScenarioConfig
from insgnss.config.simulation import SimulationConfig
from insgnss.studies.campaign.study import CampaignConfig

DOCS: Final = Path(__file__).parent
# of keys that mean the same wherever they stand, and whose schema says nothing more
USUAL: Final = {
    "name": "as shown in results",
    "source": "where the numbers are from",
    "file": "path, from the folder of this file",
    "files": "paths, from the folder of this file",
    "lat_deg": "geodetic latitude",
    "lon_deg": "longitude, east positive",
    "h_m": "height above the ellipsoid",
    "heading_deg": "clockwise from north",
    "sv": "satellite, as G07, or several",
    "azimuth_deg": "at the start and at the end, clockwise from north",
    "elevation_deg": "at the start and at the end",
    "duration_s": "how long it lasts",
    "from_s": "start, from the beginning of the run",
    "until_s": "end, from the beginning of the run",
    "at_s": "time, from the beginning of the run",
    "rate_hz": "how often a row is written",
    "imu_rate_hz": "inertial samples per second",
    "reference_rate_hz": "rows of the true trajectory per second",
    "gps_week": "week of the start",
    "ramp_s": "over which it sets in and ends",
    "rate_mps": "how fast",
    "size_m": "of the error",
    "bank_deg": "roll angle of the turn",
    "roll_in_deg_per_s": "largest roll rate into the turn",
    "roll_out_deg_per_s": "largest roll rate out of the turn",
    "by_deg": "change of course, clockwise positive",
    "by_m": "change of height",
    "to_mps": "speed afterwards",
    "speed_mps": "horizontal speed",
    "clock_bias_m": "receiver clock at the start",
    "clock_drift_mps": "its rate at the start",
    "elevation_mask_deg": "satellites below it are not used",
    "horizon_mask_deg": "satellites below it are not received",
    "imu": "name of a sensor's grade, see `insgnss models`",
    "oscillator": "name of a clock, see `insgnss models`",
    "pattern": "name of an antenna, see `insgnss models`",
    "threshold_gain_dbic": "a satellite is hidden where the antenna has less gain",
    "hysteresis_db": "a hidden satellite returns this far above the threshold",
    "sensor": "name of the sensor",
    "lever_arm_m": "from the IMU: forward, right, down",
    "correlation_time_s": "correlation time of a Gauss-Markov process",
    "gyro_correlation_time_s": "correlation time of the in-run bias",
    "accel_correlation_time_s": "correlation time of the in-run bias",
    "gyro_bias_deg_per_h": "switch-on bias",
    "accel_bias_mg": "switch-on bias",
    "gyro_bias_instability_deg_per_h": "in-run bias",
    "accel_bias_instability_mg": "in-run bias",
    "gyro_arw_deg_per_sqrt_h": "angle random walk",
    "accel_vrw_mps_per_sqrt_h": "velocity random walk",
    "gyro_scale_factor_ppm": "scale factor error",
    "accel_scale_factor_ppm": "scale factor error",
    "gyro_range_deg_per_s": "beyond it the sensor is saturated",
    "accel_range_g": "beyond it the sensor is saturated",
    "gyro_g_sensitivity_deg_per_h_per_g": "effect of specific force on the gyros",
    "gyro_bandwidth_hz": "bandwidth of the sensor's low-pass filter",
    "accel_bandwidth_hz": "bandwidth of the sensor's low-pass filter",
    "floor": "constant part of the sigma",
    "elevation": "part that grows with 1 / sin el, at the zenith",
    "cn0_at_45_dbhz": "thermal part, at 45 dBHz",
    "sd_position_m": "sigma along each axis",
    "sd_velocity_mps": "sigma along each axis",
    "sd_roll_pitch_deg": "sigma of roll and of pitch",
    "sd_heading_deg": "sigma of the heading",
    "sd_clock_m": "sigma of the clock",
    "sd_clock_drift_mps": "sigma of the clock drift",
    "values": "mean rates since the previous row, or increments",
    "unit": "unit of the time column",
    "seeds": "number of seeds, from 0 on, or the seeds themselves",
    "seeds_per_task": "seeds of a case that make one task",
    "fixed": "parameters that are the same in every case",
    "grid": "parameters with their values; each combination is one case",
}
MARK: Final = "<!-- The tables below come from the code: python docs/settings_tables.py -->"
# page: heading and schema of each file that it describes; a page of one file has no heading
PAGES: Final[dict[str, dict[str, type[BaseModel]]]] = {
    "filter-file.md": {"": FilterConfig},
    "scenario-file.md": {
        "Scenarios of simulate": SimulationConfig,
        "Scenarios of the masking study": ScenarioConfig,
    },
    "campaign-file.md": {"": CampaignConfig},
    "emitters-file.md": {"": InterferenceConfig},
}
_LIMITS: Final = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
_WORDS: Final = {float: "number", int: "whole number", str: "text", bool: "true, false", Path: "file"}


class KeyTable(NamedTuple):
    """The tables of a file that have one schema: where they stand, and what they hold."""

    names: tuple[str, ...]  # "[measurements.weather]", "[[manoeuvre]]"; "" for the keys at the top of a file
    schemas: tuple[type[BaseModel], ...]  # several where the keys depend on the table's ``kind``


def page_of(name: str) -> str:
    """Return a page with its tables as the schemas are now."""
    text = (DOCS / name).read_text(encoding="utf-8").split(MARK)[0]
    return f"{text}{MARK}\n" + "".join(
        (f"\n## {head}\n" if head else "") + tables_of(schema, "###" if head else "##")
        for head, schema in PAGES[name].items()
    )


def tables_of(schema: type[BaseModel], level: str = "##") -> str:
    """Return the Markdown of all tables of a file."""
    return "".join(f"\n{level} {_head(table)}\n\n{_text(table)}" for table in key_tables(schema))


def key_tables(schema: type[BaseModel]) -> list[KeyTable]:
    """Return a file's tables: the keys at its top, then the tables inside, each before its own."""
    found: dict[tuple[type[BaseModel], ...], list[str]] = {}
    for name, schemas in _places(schema, ""):
        found.setdefault(schemas, []).append(name)
    return [KeyTable(tuple(names), schemas) for schemas, names in {(schema,): [""], **found}.items()]


def _places(schema: type[BaseModel], path: str) -> Iterator[tuple[str, tuple[type[BaseModel], ...]]]:
    for name, field in schema.model_fields.items():
        schemas = tuple(schemas_in(field.annotation))
        if schemas:
            inside = f"{path}.{name}".lstrip(".")
            yield f"[[{inside}]]" if _holds_several(field.annotation) else f"[{inside}]", schemas
            for one in schemas:
                yield from _places(one, inside)


def schemas_in(annotation: Any) -> list[type[BaseModel]]:
    """Return the schemas of the tables that a key may hold."""
    if isinstance(annotation, type) and not get_args(annotation):
        return [annotation] if issubclass(annotation, BaseModel) else []
    return [schema for part in get_args(annotation) for schema in schemas_in(part)]


def _holds_several(annotation: Any) -> bool:
    if get_origin(annotation) is tuple:
        return True
    return any(_holds_several(part) for part in get_args(annotation) if get_origin(part) is not None)


def _head(table: KeyTable) -> str:
    return ", ".join(f"`{name}`" for name in table.names if name) or "Keys at the top of the file"


def _text(table: KeyTable) -> str:
    if len(table.schemas) == 1:
        schema = table.schemas[0]
        lines = [f"{_about(schema)}\n", "| key | default | value | meaning |", "|---|---|---|---|"]
        lines += [
            f"| `{name}` | {_default(field)} | {_value(field)} | {_meaning(name, field)} |"
            for name, field in schema.model_fields.items()
        ]
    else:
        lines = ["| kind | what it is | keys |", "|---|---|---|"]
        lines += [f"| {_kind(schema)} | {_about(schema)} | {_keys(schema)} |" for schema in table.schemas]
    return "\n".join(lines) + "\n"


def _about(schema: type[BaseModel]) -> str:
    return (
        (schema.__doc__ or "")
        .strip()
        .split("\n\n")[0]
        .replace("\n", " ")
        .replace("``", "`")
        .replace("    ", "")
    )


def _kind(schema: type[BaseModel]) -> str:
    return _words(schema.model_fields["kind"].annotation)


def _keys(schema: type[BaseModel]) -> str:
    """Return the keys of a kind of table in one cell: with their defaults and what they mean."""
    cells = []
    for name, field in schema.model_fields.items():
        default = "" if _default(field) in ("", "required") else f" = {_default(field).strip('`')}"
        meaning = _meaning(name, field)
        if name != "kind":
            cells.append(f"`{name}{default}`" + (f" ({meaning})" if meaning else ""))
    return ", ".join(cells)


def _meaning(name: str, field: FieldInfo) -> str:
    """Return a key's meaning: its description, that of the one table which it holds, or the usual one."""
    schemas = schemas_in(field.annotation)
    about = _about(schemas[0]).split(". ")[0].rstrip(".") if len(schemas) == 1 else ""
    return (field.description or about or USUAL.get(name, "")).replace("|", "\\|")


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    default = field.get_default(call_default_factory=True)
    if default is None:
        return ""
    if isinstance(default, BaseModel) and not default.model_fields_set:
        return ""  # those of its table
    return f"`{_toml(default)}`"


def _toml(value: Any) -> str:
    """Return a value as a TOML file has it."""
    if isinstance(value, BaseModel):
        value = value.model_dump(exclude_unset=True)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_toml(part)}" for key, part in value.items()) + "}"
    if isinstance(value, tuple | list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(str(value) if isinstance(value, PurePath) else value)


def _value(field: FieldInfo) -> str:
    limits = _limits(field.metadata)
    tightest = [
        limit for limit in limits if limit != "> 0" or not any(other.startswith(">=") for other in limits)
    ]
    return ", ".join(dict.fromkeys(filter(None, [_words(field.annotation), *tightest])))


def _words(annotation: Any) -> str:
    """Return what values an annotation allows."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return ", ".join([_words(parts[0]), *_limits(parts[1:])])
    if origin is Literal:
        return ", ".join(f"`{json.dumps(part)}`" for part in parts)
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_words(part) for part in parts if part is not type(None)))
    if origin is tuple:
        several = (
            f"array of {_words(parts[0])}" if parts[-1] is Ellipsis else f"{len(parts)} of {_words(parts[0])}"
        )
        return several if parts[-1] is Ellipsis or len(set(parts)) == 1 else f"array of {len(parts)}"
    if origin is dict:
        return f"table of {_words(parts[1])}"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "table"
    return _WORDS.get(annotation, "")


def _limits(metadata: Any) -> list[str]:
    """Return the limits among an annotation's metadata."""
    found = []
    for part in metadata:
        if isinstance(part, FieldInfo):
            found += _limits(part.metadata)
        found += [f"{sign} {getattr(part, name):g}" for name, sign in _LIMITS.items() if hasattr(part, name)]
    return found


if __name__ == "__main__":
    for page in PAGES:
        (DOCS / page).write_text(page_of(page), encoding="utf-8")
