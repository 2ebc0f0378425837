"""Upper limits of settings: each that a schema declares refuses a larger value."""

from __future__ import annotations

import importlib
import math
import pkgutil
from collections.abc import Iterator
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import pytest
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

import insgnss.config
from insgnss.config.library import filter_config
from insgnss.config.strict import StrictModel, changed
from insgnss.errors import ConfigError

REFUSED = ("less_than", "less_than_equal", "value_error")


def models() -> list[type[BaseModel]]:
    """Return every schema of the settings."""
    modules = [
        importlib.import_module(f"insgnss.config.{one.name}")
        for one in pkgutil.iter_modules(insgnss.config.__path__)
    ]
    schemas = {
        member
        for module in modules
        for member in vars(module).values()
        if isinstance(member, type) and issubclass(member, BaseModel) and member is not StrictModel
    }
    return sorted(schemas, key=lambda schema: (schema.__module__, schema.__name__))


def beyond(annotation: Any, metadata: tuple[Any, ...] = ()) -> Iterator[tuple[float, Any]]:
    """Yield each upper limit declared at any depth of an annotation, and a value that is larger than it."""
    if get_origin(annotation) is Annotated:
        inner, *more = get_args(annotation)
        flat = [part for one in more for part in (one.metadata if isinstance(one, FieldInfo) else [one])]
        yield from beyond(inner, (*metadata, *flat))
        return
    limits = [getattr(part, name) for part in metadata for name in ("le", "lt") if hasattr(part, name)]
    for limit in limits:
        larger: float = limit + 1 if annotation is int else math.nextafter(limit, math.inf)
        yield limit, larger
    if get_origin(annotation) in (Union, UnionType):
        for branch in get_args(annotation):
            yield from beyond(branch)
    elif get_origin(annotation) is dict:
        key, value = get_args(annotation)
        names = get_args(key) or ("R07",)
        yield from ((limit, {names[0]: larger}) for limit, larger in beyond(value))
    elif get_origin(annotation) is tuple:
        parts = [part for part in get_args(annotation) if part is not Ellipsis]
        yield from ((limit, [larger] * len(parts)) for limit, larger in beyond(parts[0]))


DECLARED = [
    (schema, name, limit, larger)
    for schema in models()
    for name, field in schema.model_fields.items()
    for limit, larger in beyond(field.annotation, tuple(field.metadata))
]


@pytest.mark.parametrize(
    ("schema", "name", "limit", "larger"),
    DECLARED,
    ids=[f"{s.__name__}.{n}-{v:g}" for s, n, v, _ in DECLARED],
)
def test_value_above_a_declared_limit_is_refused(
    schema: type[BaseModel], name: str, limit: float, larger: Any
) -> None:
    """Whatever else the schema lacks, the refusal of this key is among the errors."""
    with pytest.raises(ValidationError) as refused:
        schema.model_validate({name: larger})
    kinds = {error["type"] for error in refused.value.errors() if error["loc"][0] == name}
    assert kinds & set(REFUSED), f"{schema.__name__}.{name} takes {larger} beyond {limit}"


def test_limits_are_found_in_many_schemas() -> None:
    assert len(DECLARED) > 150
    assert len({schema for schema, *_ in DECLARED}) > 30


def test_imu_time_is_uncertain_by_at_most_what_the_linearisation_holds() -> None:
    assert filter_config("tight", {"process.imu_time_sigma_s": 0.1}).process.imu_time_sigma_s == 0.1
    with pytest.raises(ConfigError, match=r"0\.1") as refused:
        filter_config("tight", {"process.imu_time_sigma_s": 0.2})
    assert "imu.time.offset_s" in refused.value.advice


def test_lag_of_the_range_rates_is_uncertain_only_beside_the_imu_time() -> None:
    lag = {"process.range_rate_lag_sigma_s": 0.02}
    assert filter_config("tight", lag).process.range_rate_lag_sigma_s == 0.02
    with pytest.raises(ConfigError, match="beside the IMU's time"):
        filter_config("tight", {**lag, "process.imu_time_sigma_s": 0.0})


@pytest.mark.parametrize("key", ["process.lever_arm_sigma_m", "gaps.restart_s", "start.window_s"])
def test_setting_beyond_any_use_is_refused(key: str) -> None:
    """With a limit of its own or without."""
    with pytest.raises(ConfigError):
        changed(filter_config("tight"), {key: 2e9})
