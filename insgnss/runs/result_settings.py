"""The settings of a run: everything needed to repeat it, with the versions of the software."""

from __future__ import annotations

import datetime as dt
import math
import platform
from typing import Any

import numba
import numpy as np
import pandas as pd

from insgnss.constants import NS_PER_S
from insgnss.filter.own_rows.rows import Kind
from insgnss.filter.setup import FilterSetup
from insgnss.log.flight import Flight
from insgnss.version import __version__


def run_settings(flight: Flight, input_hashes: dict[str, str], setup: FilterSetup) -> dict[str, Any]:
    """Return everything needed to repeat the run."""
    settings: dict[str, Any] = {
        "flight": flight.config.model_dump(mode="json"),
        "filter": setup.config.model_dump(mode="json"),
        "imu_grade": setup.grade.model_dump(mode="json"),
        "oscillator": setup.oscillator.model_dump(mode="json"),
        "clock_groups": list(setup.clock_groups),
        "input_sha256": input_hashes,
        "versions": {
            "insgnss": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "numba": numba.__version__,
            "pandas": pd.__version__,
        },
        "made": dt.datetime.now(dt.UTC).isoformat(timespec="seconds"),
    }
    if setup.own is not None:
        settings["measurements"] = [_described(kind) for kind in setup.own.kinds]
    return settings


def _described(kind: Kind) -> dict[str, Any]:
    """Return the settings of a user's own measurement, without its code."""
    gate = None if kind.gate2 is None else "none" if math.isinf(kind.gate2) else math.sqrt(kind.gate2)
    source = type(kind.source)
    count = {"period_s": kind.period_ns / NS_PER_S} if kind.period_ns else {"times": len(kind.times_ns)}
    times = {**count, "gate_sigma": gate, "unit": kind.unit}
    return {"name": kind.name, "class": f"{source.__module__}.{source.__qualname__}", **times}
