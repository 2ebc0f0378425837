"""A case function for tests of campaigns: sleeps, leaves word of its process, fails where it is told to."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np


def sleepy(case: Mapping[str, Any], seed: int) -> list[dict[str, float]]:
    """Return two rows of numbers that only (case, seed) make."""
    if "pids" in case:
        (Path(case["pids"]) / str(os.getpid())).touch()
    if seed == case.get("fails_at"):
        raise ValueError(f"seed {seed} is told to fail")
    if seed == case.get("dies_at"):
        os._exit(1)  # as the system's killer of large processes would have it
    time.sleep(case.get("sleep_s", 0.0))
    rng = np.random.default_rng([seed, case.get("salt", 0)])
    return [{"k": k, "value": float(x)} for k, x in enumerate(rng.standard_normal(2))]
