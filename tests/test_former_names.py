"""Modules by their former names."""

from __future__ import annotations

import importlib
import sys

import pytest

from insgnss.former_names import FORMER
from insgnss.runs import allan


@pytest.mark.parametrize("former", sorted(FORMER))
def test_former_name_gives_the_module_of_today_and_says_so(former: str) -> None:
    name = f"insgnss.{former}"
    sys.modules.pop(name, None)

    with pytest.warns(DeprecationWarning, match=rf"{name} is insgnss\.{FORMER[former]} since"):
        module = importlib.import_module(name)

    assert module is importlib.import_module(f"insgnss.{FORMER[former]}")


def test_the_warning_points_at_the_line_that_imports() -> None:
    sys.modules.pop("insgnss.allan", None)

    with pytest.warns(DeprecationWarning) as told:
        import insgnss.allan as former  # type: ignore[import-not-found]

    assert told[0].filename == __file__
    assert former.__spec__ is allan.__spec__


def test_a_name_that_never_was_is_not_found() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"insgnss\.nothing"):
        importlib.import_module("insgnss.nothing")
