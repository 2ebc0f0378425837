"""Modules by the names they had in version 0.1: they can be imported until 0.3, and warn with the new name."""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.machinery
import sys
import types
import warnings
from collections.abc import Sequence
from typing import Final

FORMER: Final = {
    "allan": "runs.allan",
    "columns": "runs.columns",
    "comparison": "runs.reference_errors",
    "doctor": "log.checks",
    "engine": "runs.engine",
    "flown_margin": "runs.margin",
    "interference.lasting_acceleration": "interference.steady_acceleration",
    "jit": "kernels.jit",
    "library": "config.library",
    "log.declared": "log.receiver",
    "log_replay": "runs.replay",
    "point_solutions": "runs.point",
    "run": "runs.result",
    "saving": "results.saving",
    "simulate": "runs.simulate",
    "simulation.journeys": "simulation.sample_trajectories",
    "supervision": "receiver",
    "visibility": "runs.visibility",
}


class _FormerName(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds a module under its former name and gives the one that has its contents now."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        package, _, name = fullname.partition(".")
        known = package == "insgnss" and name in FORMER
        return importlib.machinery.ModuleSpec(fullname, self) if known else None

    def exec_module(self, module: types.ModuleType) -> None:
        now = "insgnss." + FORMER[module.__name__.partition(".")[2]]
        warnings.warn(f"{module.__name__} is {now} since version 0.2", DeprecationWarning, stacklevel=2)
        sys.modules[module.__name__] = importlib.import_module(now)


def register() -> None:
    """Let former names be imported; those that exist as files are found first."""
    if not any(isinstance(finder, _FormerName) for finder in sys.meta_path):
        sys.meta_path.append(_FormerName())
