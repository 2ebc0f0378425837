"""The tables of a receiver on samples: its solution, its channels and its searches against the truth of the signals.

All begin with ``cn0_dbhz`` (of the link budget) and ``receiver``; errors are estimate minus truth.

| table    | one row for each | columns |
|----------|------------------|---------|
| epochs   | epoch            | time_s n_channels (handed to the filter); error_*_m sd_*_m, error_v*_mps sd_v*_mps: north, east, down, after the update |
| channels | epoch, satellite | time_s sv open locked (by the receiver's own detector) supervisor (state, "none" without) estimated_cn0_dbhz; delay_error_m phase_moved_cycles on_signal (by the truth) |
| searches | search           | time_s sv dwell_s cells statistic threshold found; delay_error_chips doppler_error_hz search_cn0_dbhz; took_s |
| summary  | run              | first_fix_s; from 5 s after it on: share_locked share_on_signal on_signal_at_end, position_* velocity_*, position_over_sigma velocity_over_sigma (rms of error over sigma); took_s times_real_time |
"""  # noqa: E501 - the table is the documentation

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import pandas as pd

from insgnss.constants import C_MPS, NS_PER_S
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.geodesy.local_level import ned_axes
from insgnss.gpstime import ns_to_week_seconds
from insgnss.results.nav_columns import PLACE, VELOCITY
from insgnss.simulation.observations import WAVELENGTH_M
from insgnss.simulation.signal_samples import BORDER_S, SignalSky
from insgnss.simulation.simulated_log import Scenario
from insgnss.simulation.trajectory import reference_table
from insgnss.studies.samples.loop import SampleLoop
from insgnss.studies.samples.search import origin_chips
from insgnss.tables import Float64, rms
from insgnss.tracking.codes import GPS_CA_CHIP_HZ
from insgnss.tracking.lock_and_cn0 import SLIP_SHARE
from insgnss.tracking.sample_channel import DELAY_CHIPS, MIDDLE, PHASE_RAD

AXES: Final = ("n", "e", "d")
SETTLED_S: Final = 5.0  # after the first fix: loops pulled in, the given start forgotten
SLIP_CYCLES: Final = SLIP_SHARE * 0.5  # of the half cycle that data leave between stable points
_LOST_CHIPS: Final = 0.5


def epoch_table(loop: SampleLoop, scenario: Scenario) -> pd.DataFrame:
    """Return position and velocity errors of the filter after each epoch, beside its sigmas."""
    rows = pd.DataFrame(loop.epochs)
    week = int(scenario.start_ns // (604_800 * NS_PER_S))
    t_ns = rows["t_ns"].to_numpy(np.int64)
    table = pd.DataFrame({"time_s": ns_to_week_seconds(t_ns, week), "n_channels": rows["n_channels"]})
    motion = scenario.trajectory.motion((t_ns - scenario.start_ns) / NS_PER_S)
    truth = reference_table(motion, scenario.start_ns)
    names = (*PLACE, *VELOCITY)
    started = [rows[name].to_numpy() if name in rows else np.full(len(rows), np.nan) for name in names]
    r_e = np.full((len(rows), 3), np.nan)
    for k, (lat, lon, h) in enumerate(zip(*started[:3], strict=True)):
        if math.isfinite(lat):
            geodetic_to_ecef(math.radians(lat), math.radians(lon), h, r_e[k])
    place = np.column_stack([np.radians(truth.lat_deg), np.radians(truth.lon_deg), truth.h_m])
    error = np.einsum("kij,kj->ki", ned_axes(place), r_e - motion.r_e)
    for i, axis in enumerate(AXES):
        table[f"error_{axis}_m"] = error[:, i]
        table[f"sd_{axis}_m"] = rows.get(f"sd_{axis}_m", np.nan)
    for i, axis in enumerate(AXES):
        table[f"error_v{axis}_mps"] = started[3 + i] - truth.v_n[:, i]
        table[f"sd_v{axis}_mps"] = rows.get(f"sd_v{axis}_mps", np.nan)
    return table


def channel_table(loop: SampleLoop, sky: SignalSky) -> pd.DataFrame:
    """Return lock and C/N0 of each channel at each epoch, its errors against the truth, and its slips since the last.

    A channel is on its signal where its delay is within half a chip and its phase error, whole half cycles aside, has
    moved by less than 0.375 cycles since the epoch before.
    """
    table = pd.DataFrame(loop.tracking)
    epochs = np.unique(table["t_ns"].to_numpy(np.int64))
    m = len(sky.sv_names)
    at = np.asarray((epochs - sky.start_ns) / NS_PER_S * loop.equipment.settings.rate_hz, np.float64)
    delay, phase = (np.full((len(epochs), m), np.nan) for _ in range(2))
    for c in range(m):
        delay[:, c], phase[:, c] = _errors_at(loop, sky, c, at)
    is_open = table["open"].to_numpy().reshape(len(epochs), m)
    delay[~is_open], phase[~is_open] = np.nan, np.nan
    moved = np.abs(np.diff(phase, axis=0, prepend=phase[:1]))
    table["delay_error_m"] = delay.ravel()
    table["phase_moved_cycles"] = moved.ravel()
    on_signal = (np.abs(delay) < _LOST_CHIPS * C_MPS / GPS_CA_CHIP_HZ) & (moved < SLIP_CYCLES)
    table["on_signal"] = on_signal.ravel()
    week = int(sky.start_ns // (604_800 * NS_PER_S))
    table.insert(0, "time_s", ns_to_week_seconds(table["t_ns"].to_numpy(np.int64), week))
    return table.drop(columns="t_ns").rename(columns={"cn0_dbhz": "estimated_cn0_dbhz"})


def _errors_at(loop: SampleLoop, sky: SignalSky, channel: int, at: Float64) -> tuple[Float64, Float64]:
    """Return delay [m] and phase error [cycles] of a channel's integration that is the last one before each sample."""
    rows = loop.channels.records[: loop.channels.written[channel], channel]
    if not len(rows):
        return np.full(len(at), np.nan), np.full(len(at), np.nan)
    last = np.searchsorted(rows[:, MIDDLE], at) - 1
    picked = rows[np.maximum(last, 0)]
    t_s = picked[:, MIDDLE] / loop.equipment.settings.rate_hz
    border_s = np.arange(len(sky.pseudorange_m)) * BORDER_S
    delay = C_MPS / GPS_CA_CHIP_HZ * picked[:, DELAY_CHIPS] - np.interp(
        t_s, border_s, sky.pseudorange_m[:, channel]
    )
    carrier = np.interp(t_s, border_s, sky.carrier_m[:, channel])
    phase = picked[:, PHASE_RAD] / (2.0 * math.pi) + carrier / WAVELENGTH_M
    delay[last < 0], phase[last < 0] = np.nan, np.nan
    return delay, phase


def search_table(loop: SampleLoop, sky: SignalSky) -> pd.DataFrame:
    """Return each search: window, what was found, and its errors."""
    rate = loop.equipment.settings.rate_hz
    border_s = np.arange(len(sky.pseudorange_m)) * BORDER_S
    rows: list[dict[str, Any]] = []
    for c, search in loop.searches:
        first_s, last_s = search.first_sample / rate, search.last_sample / rate
        true_m = float(np.interp(first_s, border_s, sky.pseudorange_m[:, c]))
        off = search.acquired.delay_chips + origin_chips(search.first_sample, rate)
        off -= true_m / C_MPS * GPS_CA_CHIP_HZ
        rate_mps = (
            np.interp(last_s, border_s, sky.carrier_m[:, c])
            - np.interp(first_s, border_s, sky.carrier_m[:, c])
        ) / (last_s - first_s)
        rows.append(
            {
                "time_s": sky.start_ns / NS_PER_S % 604_800.0 + last_s,
                "sv": sky.sv_names[c],
                "dwell_s": last_s - first_s,
                "cells": search.acquired.cells,
                "statistic": search.acquired.statistic,
                "threshold": search.threshold,
                "found": search.found,
                "delay_error_chips": (off + 511.5) % 1023.0 - 511.5,
                "doppler_error_hz": search.acquired.doppler_hz + rate_mps / WAVELENGTH_M,
                "search_cn0_dbhz": search.acquired.cn0_dbhz,
                "took_s": search.took_s,
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


def summary_of(
    epochs: pd.DataFrame, channels: pd.DataFrame, took_s: float, duration_s: float
) -> dict[str, float]:
    """Return the figures of one run: errors from ``SETTLED_S`` after the first fix on."""
    fixed = epochs.loc[epochs["error_n_m"].notna(), "time_s"]
    first_s = float(fixed.min()) if len(fixed) else math.nan
    own = epochs[epochs["time_s"] >= first_s + SETTLED_S]
    tracked = channels[channels["time_s"] >= first_s + SETTLED_S]
    last = tracked[tracked["time_s"] == tracked["time_s"].max()]
    error = own[[f"error_{a}_m" for a in AXES]].to_numpy()
    sd = own[[f"sd_{a}_m" for a in AXES]].to_numpy(float)
    speed = own[[f"error_v{a}_mps" for a in AXES]].to_numpy()
    sd_speed = own[[f"sd_v{a}_mps" for a in AXES]].to_numpy(float)
    size = np.linalg.norm(error, axis=1)
    return {
        "first_fix_s": first_s - float(epochs["time_s"].min()),
        "channels": float(tracked["sv"].nunique()),
        "share_locked": float(tracked["locked"].mean()),
        "share_on_signal": float(tracked["on_signal"].mean()),
        "on_signal_at_end": float(last["on_signal"].sum()),
        "position_rms_m": rms(size),
        "position_largest_m": float(np.max(size)) if len(size) else math.nan,
        "position_at_end_m": float(size[-1]) if len(size) else math.nan,
        "position_over_sigma": rms(error / sd),
        "velocity_rms_mps": rms(np.linalg.norm(speed, axis=1)),
        "velocity_over_sigma": rms(speed / sd_speed),
        "took_s": took_s,
        "times_real_time": took_s / duration_s,
    }
