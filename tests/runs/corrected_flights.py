"""Simulated flights with an atmosphere and with several clocks, and what the tests of corrections ask of their runs."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

import insgnss
from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.constants import C_MPS, NS_PER_S
from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.runs.result import Run
from insgnss.simulation.atmosphere import Atmosphere, broadcast_atmosphere
from insgnss.simulation.simulated_log import SimulatedLog, Simulator
from insgnss.tables import Float64, GnssTable
from tests.runs.scenes import (
    START_NS,
    START_S,
    FlightInMemory,
    assert_sound,
    flight,
    turns,
)

SETTLED_S = 15.0
SECOND = ("G02", "G10", "G16", "G20", "G31")  # play another constellation: spread around, six stay


def settings(**measurements: Any) -> FilterConfig:
    """Return the library's filter with other measurements."""
    config = filter_config("tight17")
    use = config.measurements.model_copy(update=measurements)
    return config.model_copy(update={"measurements": use})


def under(base: Simulator, air: Atmosphere, **changes: Any) -> Simulator:
    """Return the same flight under another atmosphere, or with another receiver at the same tags."""
    other = copy.copy(base)
    receiver = replace(base.scenario.receiver, atmosphere=air, **changes)
    other.scenario = replace(base.scenario, receiver=receiver)
    return other


def seconds_of(gnss: GnssTable) -> Float64:
    return np.asarray((gnss.t_ns - START_NS) / NS_PER_S)


def statuses(
    run: Run, letter: str, from_s: float = 0.0, to_s: float = np.inf, kind: str = "pseudorange"
) -> Mapping[str, int]:
    """Return how often each status stands in the ledger of a constellation."""
    rows = run.measurements
    t = rows["time_s"] - START_S
    mine = (
        rows["sv"].astype(str).str.startswith(letter)
        & (rows["kind"] == kind)
        & (t >= from_s - 1e-6)
        & (t < to_s - 1e-6)
    )
    return dict(rows.loc[mine, "status"].astype(str).value_counts())


def replayed(flown: FlightInMemory, config: FilterConfig) -> Run:
    run = insgnss.replay(flown, config)
    assert_sound(run, flown)
    return run


# ------------------------------------------------------------------------------------------------ clocks


@cache
def two_systems(letter: str = "E") -> tuple[Simulator, SimulatedLog]:
    """Return a flight without ionosphere whose log carries its satellites' states, five of another constellation."""
    base = under(turns(), broadcast_atmosphere(None))
    log = base.draw(np.random.default_rng(3))
    states = satellite_states(log.gnss, log.navigation)
    sat = np.column_stack([states.position, states.velocity, states.clock_m, states.drift_mps])
    names = tuple(letter + n[1:] if n in SECOND else n for n in log.gnss.sv_names)
    rate = -log.gnss.doppler_hz * C_MPS / 1575.42e6
    none = np.full(len(rate), np.nan)
    gnss = replace(log.gnss, sv_names=names, sat=sat, range_rate_mps=rate, doppler_hz=none)
    return base, replace(log, gnss=gnss)


def of_second(gnss: GnssTable) -> np.ndarray:
    return np.array([name[0] != "G" for name in gnss.sv_names])[gnss.sv]


def two_clocks(
    offset_m: float | Float64,
    keep: np.ndarray | None = None,
    letter: str = "E",
    stepped_m: float | Float64 = 0.0,
) -> FlightInMemory:
    """Return the flight with an offset of the second constellation's clock, steps of all, and only the rows to keep."""
    base, log = two_systems(letter)
    added_m = stepped_m + np.where(of_second(log.gnss), offset_m, 0.0)
    gnss = replace(log.gnss, pseudorange_m=log.gnss.pseudorange_m + added_m)
    return flight(base, log, gnss=gnss if keep is None else gnss.take(np.flatnonzero(keep)))
