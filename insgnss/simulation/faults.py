"""Faults of a receiver's observations, as functions to hand to ``observe``; times are receiver tags, ``[from, to)``.

A jump of the receiver's clock is a fault of the clock: ``oscillator.with_clock_jump``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from insgnss.simulation.observations import Fault, Observations


def _where(
    observations: Observations, sv: Iterable[str], from_s: float, to_s: float
) -> npt.NDArray[np.bool_]:
    """Return (m, n), true for these satellites within the window."""
    window = (observations.tag_s >= from_s) & (observations.tag_s < to_s)
    return np.asarray(np.outer(window, np.isin(observations.sv_names, list(sv))))


def range_step(sv: str, size_m: float, from_s: float, to_s: float = np.inf) -> Fault:
    """Return the fault that adds ``size_m`` to the pseudorange of one satellite."""

    def fault(observations: Observations) -> Observations:
        added = size_m * _where(observations, [sv], from_s, to_s)
        return replace(observations, pseudorange_m=observations.pseudorange_m + added)

    return fault


def range_ramp(sv: str, rate_mps: float, from_s: float, to_s: float = np.inf) -> Fault:
    """Return the fault that lets the pseudorange of one satellite run away; its Doppler stays right."""

    def fault(observations: Observations) -> Observations:
        elapsed = np.maximum(observations.tag_s - from_s, 0.0)[:, None]
        added = rate_mps * elapsed * _where(observations, [sv], from_s, to_s)
        return replace(observations, pseudorange_m=observations.pseudorange_m + added)

    return fault


def outage(sv: Iterable[str] | None, from_s: float, to_s: float) -> Fault:
    """Return the fault that hides these satellites, or all of them when None."""

    def fault(observations: Observations) -> Observations:
        names = observations.sv_names if sv is None else sv
        return replace(
            observations, tracked=observations.tracked & ~_where(observations, names, from_s, to_s)
        )

    return fault


def reversed_range_rate() -> Fault:
    """Return the fault of a log whose Doppler has the wrong sign."""

    def fault(observations: Observations) -> Observations:
        return replace(observations, range_rate_mps=-observations.range_rate_mps)

    return fault
