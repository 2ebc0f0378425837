"""Strict settings: an unknown key is an error that names the nearest valid key; each value has its unit in its name."""

from __future__ import annotations

import difflib
import functools
import json
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Any, ClassVar, Final, TypeVar, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator
from pydantic_core import ErrorDetails

from insgnss.config.changes import as_tables, merged
from insgnss.config.files import existing_file
from insgnss.config.key_errors import KeyValueError
from insgnss.config.toml_lines import key_lines, line_of
from insgnss.errors import ConfigError

# What a value should have been, in words, by pydantic's type of the error
_EXPECTED: Final = {
    "string_type": "a text in quotes",
    "path_type": "a file name in quotes",
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "tuple_type": "an array, [...]",
    "list_type": "an array, [...]",
    "dict_type": "a table of keys",
    "model_type": "a table of keys",
    "model_attributes_type": "a table of keys",
}
_WHOLE_FILE: Final = "the file"  # in place of a key
_SCALAR_BRANCHES: Final = ("string_type", "literal_error")
_TABLE_BRANCHES: Final = ("model_type", "model_attributes_type", "dict_type")


# Larger than any setting, in SI units or those in its name: the square of a larger number leaves the range
# in which sums of squares still are numbers; a smaller one is zero with a slip of the keyboard. A component of a vector
# may be as small as it likes: a velocity of 1e-68 m/s comes out of a computation.
_LARGEST_NUMBER: Final = 1e15
# Of settings whose schema gives no upper limit, by the unit at the end of their names: a power of ten of 1000 dB is
# a number, as is its square
_LARGEST_BY_UNIT: Final = {"db": 1e3, "dbhz": 1e3, "dbic": 1e3, "hz": 1e12}
_LARGEST_OF_OTHERS: Final = 1e9
# Least likeness (difflib) of a key that is named as the nearest; more of one in another table, where there are hundreds
# of keys: 'foo' is like 'floor' by 0.75
_NEAR_HERE: Final = 0.5
_NEAR_ELSEWHERE: Final = 0.8
_SMALLEST_NUMBER: Final = 1e-40  # a thousandth of a thousandth of the quietest clock's h_-2


class StrictModel(BaseModel):
    """A frozen model that refuses unknown keys, numbers that are not finite, and impossible numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=False, allow_inf_nan=False)
    lists_keys: ClassVar[str] = ""  # what lists every key with its meaning
    needs: ClassVar[str] = ""  # what a file without a known key lacks

    @field_validator("*", mode="after")
    @classmethod
    def _is_no_wild_number(cls, value: Any, info: ValidationInfo) -> Any:
        least = 0.0 if isinstance(value, tuple | list) else _SMALLEST_NUMBER
        most = largest_size(cls, str(info.field_name)) or _LARGEST_NUMBER
        for number in _numbers(value):
            if abs(number) > most or 0.0 < abs(number) < least:
                raise ValueError(f"{number!r:.24} is too large or too small for any setting")
        return value


@functools.cache
def largest_size(model: type[BaseModel], name: str) -> float | None:
    """Return the largest size of a setting whose schema gives no upper limit, None where it gives one."""
    field = model.model_fields[name]
    if _has_upper_limit((field.annotation, *field.metadata)):
        return None
    return _LARGEST_BY_UNIT.get(name.rpartition("_")[2], _LARGEST_OF_OTHERS)


def _has_upper_limit(parts: Iterable[Any]) -> bool:
    """Return whether an annotation or its metadata hold an upper limit, at any depth."""
    for part in parts:
        limits = (getattr(part, "le", None), getattr(part, "lt", None))
        if limits != (None, None) or _has_upper_limit((*get_args(part), *getattr(part, "metadata", ()))):
            return True
    return False


def _numbers(value: Any) -> Iterator[float]:
    """Yield the numbers of a value, those in arrays and tables too."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield value
    elif isinstance(value, Mapping):
        for part in value.values():
            yield from _numbers(part)
    elif isinstance(value, tuple | list):
        for part in value:
            yield from _numbers(part)


Model = TypeVar("Model", bound=StrictModel)


def load_toml(path: str | Path, model: type[Model], base: Mapping[str, Any] | None = None) -> Model:
    """Return the settings of a TOML file, checked against their schema.

    Parameters
    ----------
    base : defaults for what the file omits, table by table

    Raises
    ------
    MissingFileError : there is no such file
    ConfigError : the file is not TOML, or a key is unknown, missing, of the wrong type or out of range. All errors are
        listed; line and key are those of the first
    """
    path = existing_file(Path(path))
    text, data = _parse(path)
    return _checked(merged(base or {}, data), model, path, text)


def read_toml(path: str | Path) -> dict[str, Any]:
    """Return the content of a TOML file, not checked against any schema.

    Raises
    ------
    MissingFileError : there is no such file
    ConfigError : the file is not TOML
    """
    return _parse(existing_file(Path(path)))[1]


def changed(settings: Model, changes: Mapping[str, Any]) -> Model:
    """Return settings with some of them changed, by dotted key or by tables, checked as those of a file are.

    Raises
    ------
    ConfigError : a key is unknown, or its value of the wrong type or out of range
    """
    data = merged(settings.model_dump(mode="json"), as_tables(changes))
    return _checked(data, type(settings), None, "")


def _checked(data: dict[str, Any], model: type[Model], path: Path | None, text: str) -> Model:
    try:
        return model.model_validate_json(json.dumps(data, default=_plain), strict=True)
    except ValidationError as error:
        problems = _without_other_branches(error.errors(include_url=False), data)
        lines = key_lines(text)
        raise _config_error(path, [_describe(problem, data, model, lines) for problem in problems]) from None
    except RecursionError:
        raise _too_deep(path) from None


def _plain(value: Any) -> Any:
    """Return a value that JSON does not know as one that it does: NumPy's numbers as numbers, a date as text."""
    return value.item() if isinstance(value, np.generic) else str(value)


def _parse(path: Path) -> tuple[str, dict[str, Any]]:
    try:
        text = path.read_bytes().decode("utf-8-sig")
        data = tomllib.loads(text)
        if (key := _key_with_nul(data)) is not None:
            advice = "remove the \\u0000: no path or name can hold it"
            raise ConfigError("the text holds a NUL character", file=path, key=key, advice=advice)
        return text, data
    except UnicodeDecodeError as error:
        raise ConfigError("the file is not UTF-8 text", file=path, advice="save the file in UTF-8") from error
    except RecursionError:
        raise _too_deep(path) from None
    except tomllib.TOMLDecodeError as error:
        found = re.search(r"line (\d+)", str(error))
        raise ConfigError(
            f"invalid TOML: {error}",
            file=path,
            line=int(found[1]) if found else None,
            advice="texts need quotes, tables look like [imu], arrays like [1, 2, 3]",
        ) from error


def _key_with_nul(value: Any, key: str = "") -> str | None:
    """Return the dotted key of the first text with a NUL character, None without any."""
    if isinstance(value, dict):
        inside = ((name, f"{key}.{name}" if key else name) for name in value)
        found = (name if "\0" in name else _key_with_nul(value[name], dotted) for name, dotted in inside)
    elif isinstance(value, list):
        found = (_key_with_nul(item, key) for item in value)
    else:
        return key if isinstance(value, str) and "\0" in value else None
    return next((place for place in found if place is not None), None)


def _too_deep(path: Path | None) -> ConfigError:
    return ConfigError("tables or arrays are nested too deep", file=path, advice="remove the inner brackets")


class _Problem:
    """One error of a file: where, what, and what to do."""

    def __init__(
        self, key: str, line: int | None, message: str, advice: str, *, unknown: bool = False
    ) -> None:
        self.key = key
        self.line = line
        self.message = message
        self.advice = advice
        self.unknown = unknown

    def place(self) -> str:
        return f"key '{self.key}'" if self.line is None else f"line {self.line}, key '{self.key}'"


def _config_error(path: Path | None, problems: Sequence[_Problem]) -> ConfigError:
    # an unknown key often explains a missing one
    problems = sorted(problems, key=lambda problem: not problem.unknown)
    first = problems[0]
    message, advice = first.message, first.advice
    if len(problems) > 1:
        rest = [f"{p.place()}: {p.message} ({p.advice})" for p in problems[1:]]
        message = f"{message}\n  and {len(rest)} more: " + "\n  ".join(rest)
    key = None if first.key == _WHOLE_FILE else first.key
    return ConfigError(message, file=path, line=first.line, key=key, advice=advice)


def _describe(
    error: ErrorDetails,
    data: Mapping[str, Any],
    model: type[BaseModel],
    lines: dict[tuple[str | int, ...], int],
) -> _Problem:
    cause = error.get("ctx", {}).get("error")
    place = cause.place if isinstance(cause, KeyValueError) else ()
    path = _path_in_file((*error["loc"], *place), data)
    keys = tuple(part for part in path if isinstance(part, str))
    key = ".".join(keys) or _WHOLE_FILE
    entry = f"entry {path[-1] + 1}: " if path and isinstance(path[-1], int) else ""
    line = line_of(path, lines)
    kind = error["type"]
    if kind.startswith("union_tag"):
        line = line_of((*path, "kind"), lines)
        return _Problem(f"{key}.kind", line, *_unknown_kind(error), unknown=True)
    if kind == "extra_forbidden":
        return _Problem(
            key, line, "unknown key", _nearest_keys(keys, model, _kind_at(path, data)), unknown=True
        )
    if kind == "missing":
        return _Problem(
            key, line, f"{entry}missing" if entry else "missing key", f"give {key}{_purpose(keys, model)}"
        )
    if kind in ("value_error", "assertion_error"):
        # what the schema says of a whole table does not tell which of its keys to change; the message does
        purpose = "" if isinstance(error["input"], Mapping) and not place else _purpose(keys, model)
        advice = cause.advice if isinstance(cause, KeyValueError) else ""
        return _Problem(key, line, error["msg"].split(", ", 1)[-1], advice or f"change {key}{purpose}")
    expected = _EXPECTED.get(kind) or error["msg"].removeprefix("Input should be ").removeprefix("a valid ")
    message = f"{entry}expected {expected}; got {_short(error['input'])}"
    return _Problem(key, line, message, f"change {key}{_purpose(keys, model)}")


def _unknown_kind(error: ErrorDetails) -> tuple[str, str]:
    """Return message and advice for a table whose ``kind`` is missing or unknown."""
    context = error.get("ctx", {})
    known = re.findall(r"'([^']*)'", str(context.get("expected_tags", "")))
    if error["type"] == "union_tag_not_found":
        return "missing key", "say which kind it is"
    tag = str(context.get("tag"))
    near = difflib.get_close_matches(tag, known, n=2, cutoff=0.5)
    named = "nearest: " + ", or ".join(f"'{name}'" for name in near) if near else f"known: {', '.join(known)}"
    return f"unknown kind '{tag}'", named


def _kind_at(path: Sequence[str | int], data: Any) -> str | None:
    """Return the ``kind`` of the table that holds a path's last key, None where tables have no kinds."""
    for part in path[:-1]:
        data = data[part]
    kind = data.get("kind") if isinstance(data, Mapping) else None
    return kind if isinstance(kind, str) else None


def _path_in_file(location: Sequence[int | str], data: Any) -> tuple[str | int, ...]:
    """Return the keys and indices that lead to an error, without the union branches that pydantic puts between them."""
    path: list[str | int] = []
    for position, part in enumerate(location):
        last = position == len(location) - 1
        if isinstance(data, Mapping):
            if part in data:
                data = data[str(part)]
            elif not last or part == data.get("kind"):  # the branch of a union, no key
                continue
            path.append(str(part))
        elif isinstance(data, list) and isinstance(part, int):
            path.append(part)
            data = data[part] if part < len(data) else None
    return tuple(path)


def _without_other_branches(errors: Sequence[ErrorDetails], data: Mapping[str, Any]) -> list[ErrorDetails]:
    """Return the errors without those of the union branches that the value plainly was not meant for."""
    kept = []
    for error in errors:
        given = error["input"]
        same_place = [e for e in errors if e is not error and _path_in_file(e["loc"], data) != ()]
        is_other_scalar = error["type"] in _SCALAR_BRANCHES and isinstance(given, Mapping)
        is_other_table = error["type"] in _TABLE_BRANCHES and isinstance(given, str)
        if (is_other_scalar or is_other_table) and same_place:
            continue
        kept.append(error)
    return kept or list(errors)


def _nearest_keys(path: tuple[str, ...], model: type[BaseModel], kind: str | None) -> str:
    """Return advice naming the nearest valid keys: first those of this table, then those of other tables."""
    here = _fields_at(path[:-1], model, kind)
    near = [
        ".".join((*path[:-1], name))
        for name in difflib.get_close_matches(path[-1], here, n=1, cutoff=_NEAR_HERE)
    ]
    everywhere = {dotted.rsplit(".", 1)[-1]: dotted for dotted in reversed(_dotted_keys(model))}
    for leaf in difflib.get_close_matches(path[-1], everywhere, n=2, cutoff=_NEAR_ELSEWHERE):
        if everywhere[leaf] not in near:
            near.append(everywhere[leaf])
    if near:
        return "nearest valid key: " + ", or ".join(f"'{name}'" for name in near)
    own = model if issubclass(model, StrictModel) else StrictModel
    more = (own.needs if len(path) == 1 else "", own.lists_keys)
    return "; ".join((f"valid here: {', '.join(here)}", *filter(None, more)))


def _purpose(path: tuple[str, ...], model: type[BaseModel]) -> str:
    """Return ": ..." from the schema's description of a key, when it has one."""
    for table in _tables_at(path[:-1], model) if path else []:
        field = table.model_fields.get(path[-1])
        if field is not None and field.description:
            return f": {field.description}"
    return ""


def _fields_at(path: tuple[str, ...], model: type[BaseModel], kind: str | None) -> list[str]:
    """Return the keys of a table; of a table that has a kind, those of its kind."""
    tables = _tables_at(path, model)
    own = [
        t for t in tables if "kind" in t.model_fields and kind in get_args(t.model_fields["kind"].annotation)
    ]
    return list(dict.fromkeys(name for table in own or tables for name in table.model_fields))


def _tables_at(path: tuple[str, ...], model: type[BaseModel]) -> list[type[BaseModel]]:
    """Return the schemas that are valid for the table at ``path``."""
    tables = [model]
    for part in path:
        fields = [table.model_fields[part] for table in tables if part in table.model_fields]
        tables = [nested for field in fields for nested in _models_in(field.annotation)]
    return tables


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    """Return the schemas in an annotation, alone, in a union or as entries of an array."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if isinstance(annotation, type) and not get_args(annotation) and not isinstance(annotation, UnionType):
        return []
    return [model for part in get_args(annotation) for model in _models_in(part)]


def _dotted_keys(model: type[BaseModel], prefix: str = "") -> list[str]:
    keys = []
    for name, field in model.model_fields.items():
        keys.append(prefix + name)
        for nested in _models_in(field.annotation):
            keys += _dotted_keys(nested, f"{prefix}{name}.")
    return keys


def _short(value: Any) -> str:
    text = json.dumps(value, default=str)
    return text if len(text) <= 60 else text[:57] + "..."
