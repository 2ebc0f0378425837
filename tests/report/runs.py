"""Runs without a filter: tables of the right form and of any length, for the pages drawn of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from insgnss.filter.output.writing import NAV_COLUMNS
from insgnss.gpstime import week_seconds_to_ns
from insgnss.runs.imu_summary import imu_spectrum, imu_table
from insgnss.runs.result import Run
from insgnss.tables import ImuTable

WEEK = 2385
START_S = 293_700.0
KINDS = ("pseudorange", "range_rate")


def made_run(
    seconds: float = 300.0,
    rate_hz: float = 1.0,
    satellites: int = 8,
    *,
    seed: int = 1,
    aiding: bool = False,
    reference: bool = True,
    gain: bool = False,
) -> Run:
    """Return a run around a circle of 500 m, every value with a little noise."""
    rng = np.random.default_rng(seed)
    time_s = START_S + np.arange(0.0, seconds, 1.0 / rate_hz)
    nav = nav_table(rng, time_s)
    names = [f"G{i + 1:02d}" for i in range(satellites)]
    return Run(
        nav=nav,
        measurements=_ledger(rng, time_s, names),
        satellites=_satellites(rng, time_s, names, gain),
        events=_events(),
        errors=_errors(rng, nav) if reference else None,
        aiding=_aiding(rng, time_s, names) if aiding else None,
        imu=imu_table(_imu(time_s), WEEK),
        imu_spectrum=imu_spectrum(_imu(time_s)),
        settings={
            "flight": {"name": "made", "gps_week": WEEK},
            "filter": {"name": "tight17"},
            "versions": {"insgnss": "0"},
            "input_sha256": {"imu.csv": "ab" * 32},
            "took": {"read_s": 0.5},
            "made": "2025-01-01T00:00:00+00:00",
        },
    )


def nav_table(rng: np.random.Generator, time_s: np.ndarray) -> pd.DataFrame:
    n = len(time_s)
    columns: dict[str, Any] = {"time_s": time_s}
    columns |= {name: 0.01 * rng.standard_normal(n) for name in NAV_COLUMNS}
    columns |= {name: 0.1 + 0.01 * rng.random(n) for name in NAV_COLUMNS if name.startswith("sd_")}
    angle = 0.02 * (time_s - time_s[0])
    columns["lat_deg"] = 45.0 + np.degrees(500.0 * np.sin(angle) / 6.37e6)
    columns["lon_deg"] = 10.0 + np.degrees(500.0 * np.cos(angle) / 6.37e6) / np.cos(np.pi / 4.0)
    columns["h_m"] = 300.0 + 20.0 * np.sin(angle)
    columns["vn_mps"], columns["ve_mps"] = 10.0 * np.cos(angle), -10.0 * np.sin(angle)
    columns["yaw_deg"] = (np.degrees(angle) + 180.0) % 360.0 - 180.0
    columns["n_used"], columns["n_hypotheses"] = np.full(n, 8), np.ones(n, np.int64)
    return pd.DataFrame(columns)


def _ledger(rng: np.random.Generator, time_s: np.ndarray, names: list[str]) -> pd.DataFrame:
    rows = len(time_s) * len(names) * len(KINDS)
    sd = np.where(np.arange(rows) % 2 == 0, 2.0, 0.07)
    innovation = sd * rng.standard_normal(rows)
    status = np.where(np.abs(innovation) > 3.0 * sd, 1, 0)
    sv = np.tile(np.repeat(np.arange(len(names)), len(KINDS)), len(time_s))
    return pd.DataFrame(
        {
            "time_s": np.repeat(time_s, len(names) * len(KINDS)),
            "sv": words(sv, names),
            "signal": words(np.zeros(rows, int), ["C1C"]),
            "kind": words(np.arange(rows) % 2, list(KINDS)),
            "innovation": innovation,
            "sd_innovation": sd,
            "nis": (innovation / sd) ** 2,
            "status": words(status, ["used", "gated"]),
        }
    )


def _satellites(rng: np.random.Generator, time_s: np.ndarray, names: list[str], gain: bool) -> pd.DataFrame:
    n = len(time_s) * len(names)
    sv = np.tile(np.arange(len(names)), len(time_s))
    return pd.DataFrame(
        {
            "time_s": np.repeat(time_s, len(names)),
            "sv": words(sv, names),
            "az_deg": (40.0 * sv) % 360.0,
            "el_deg": 10.0 + 8.0 * sv % 80.0,
            "body_az_deg": 360.0 * rng.random(n),
            "body_el_deg": 10.0 + 70.0 * rng.random(n),
            "gain_dbi": rng.normal(0.0, 2.0, n) if gain else np.full(n, np.nan),
            "cn0_dbhz": 45.0 - 0.5 * sv + 0.5 * np.sin(np.arange(n)),
            "state": words((rng.random(n) > 0.98).astype(int), ["tracked", "gated"]),
            "sd_range_m": np.ones(n),
            "sd_range_rate_mps": np.full(n, 0.1),
        }
    )


def _imu(time_s: np.ndarray) -> ImuTable:
    """Return a log of 100 Hz without noise, with a line at 20 Hz."""
    t_s = np.arange(time_s[0], time_s[-1] + 0.02, 0.01)
    wave = np.sin(2.0 * np.pi * 20.0 * (t_s - t_s[0]))
    w, f = np.column_stack([0.01 * wave, wave * 0.0, 0.0 * wave + 0.02]), np.zeros((len(t_s), 3))
    f[:, 2] = -9.81 + 0.1 * wave
    return ImuTable(week_seconds_to_ns(WEEK, t_s), w, f)


def _events() -> pd.DataFrame:
    events = [
        (np.nan, "csv_delimiter", "a semicolon"),
        (START_S, "start", "automatic"),
        (START_S + 20.0, "heading_known", "heading 10 deg"),
        (START_S + 50.0, "imu_gap", "2.0 s without a sample <script>window.broken = 1</script>"),
    ]
    return pd.DataFrame(events, columns=["time_s", "kind", "detail"])


def _errors(rng: np.random.Generator, nav: pd.DataFrame) -> pd.DataFrame:
    table = pd.DataFrame({"time_s": nav["time_s"], "quality": 1.0})
    for name in ("n_m", "e_m", "d_m", "vn_mps", "ve_mps", "vd_mps", "roll_deg", "pitch_deg", "yaw_deg"):
        table[f"d_{name}"] = nav[f"sd_{name}"] * rng.standard_normal(len(nav))
        table[f"sd_{name}"] = nav[f"sd_{name}"]
    return table


def _aiding(rng: np.random.Generator, time_s: np.ndarray, names: list[str]) -> pd.DataFrame:
    n = len(time_s) * len(names)
    columns = ("doppler_hz", "doppler_rate_hz_per_s", "sd_doppler_hz", "sd_doppler_rate_hz_per_s")
    table = {name: 0.1 + rng.random(n) for name in columns}
    sv = words(np.tile(np.arange(len(names)), len(time_s)), names)
    return pd.DataFrame({"time_s": np.repeat(time_s, len(names)), "sv": sv, **table})


def words(codes: np.ndarray, names: list[str]) -> pd.Categorical:
    return pd.Categorical.from_codes(codes, categories=pd.Index(names, dtype="str"))
