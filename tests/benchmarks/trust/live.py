"""One run through the streaming engine: sample by sample, one tag of them of another year."""

from __future__ import annotations

import re

import numpy as np

import insgnss
from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.constants import NS_PER_S
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.runs.setup import setup_filter
from insgnss.tables import Float64
from tests.benchmarks.trust.flying import drawn
from tests.benchmarks.trust.measuring import Record
from tests.benchmarks.trust.rows import Row

AHEAD_S = 1e6


def stream(row: Row, seed: int) -> Record:
    """Return what is kept of a run: whether samples were taken after the wild tag, and where the engine is."""
    ready, log, flight = drawn(row, seed)
    config: FilterConfig = filter_config("tight17")
    engine = insgnss.Engine(setup_filter(flight, flight.logs, config))
    imu, gnss = log.imu, log.gnss
    start_ns = ready.simulator.scenario.start_ns
    wild_ns = start_ns + round(row.origin(seed) * NS_PER_S)
    edges = np.flatnonzero(np.diff(gnss.t_ns, prepend=gnss.t_ns[0] - 1))
    epochs = [gnss.take(part) for part in np.split(np.arange(len(gnss.t_ns)), edges[1:])]
    waiting = 0
    sent = False
    for t_ns, w, f in zip(imu.t_ns.tolist(), imu.w_ib_b, imu.f_b, strict=True):
        if t_ns >= wild_ns and not sent:
            engine.imu(t_ns + round(AHEAD_S * NS_PER_S), w, f)
            sent = True
            continue
        engine.imu(t_ns, w, f)
        while waiting < len(epochs) and epochs[waiting].t_ns[0] <= t_ns:
            engine.gnss(epochs[waiting])
            waiting += 1
    state = engine.state
    reports = [
        e for e in engine.events if re.search(row.event, f"{e.kind}: {e.detail}") and e.kind != "start"
    ]
    found: Record = {
        "taken": float(state.t_ns == imu.t_ns[-1]),
        "reported": float(bool(reports)),
        "reports": float(len(reports)),
        "bad_numbers": float(sum(not np.isfinite(value) for value in state.values.values())),
        "false_heading": 0.0,
        "position_m": np.inf,
    }
    for event in engine.events:
        found[f"events.{event.kind}"] = float(found.get(f"events.{event.kind}", 0.0)) + 1.0
    if state.values:
        found["position_m"] = float(np.linalg.norm(_place(state.values) - log.at_imu.r_e[-1]))
    return found


def _place(values: dict[str, float]) -> Float64:
    r_e = np.zeros(3)
    geodetic_to_ecef(np.radians(values["lat_deg"]), np.radians(values["lon_deg"]), values["h_m"], r_e)
    return r_e
