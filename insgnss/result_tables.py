"""From the compiled loop's arrays to the tables of a run."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from insgnss.fusion.output import NAV_COLUMNS, Output
from insgnss.gnss.observation_rows import ABSENT, PSEUDORANGE, Rows
from insgnss.gpstime import ns_to_week_seconds
from insgnss.status import NAMES, USED
from insgnss.tables import Event, Float64, GnssTable, Int64

KINDS = ("pseudorange", "range_rate")


def nav_table(out: Output, week: int, clock_groups: tuple[str, ...]) -> pd.DataFrame:
    """Return the navigation table, one row per output time."""
    rows = out.nav[: out.counts[0].nav]
    columns: dict[str, Any] = {"time_s": ns_to_week_seconds(rows["t_ns"], week)}
    columns.update({name: rows["value"][:, i] for i, name in enumerate(NAV_COLUMNS)})
    for i, letter in enumerate(clock_groups[1:]):
        columns[f"offset_{letter}_m"] = rows["offsets"][:, i]
    table = pd.DataFrame(columns)
    return table.astype({"n_used": np.int64, "n_hypotheses": np.int64})


def measurement_table(out: Output, rows: Rows, gnss: GnssTable, week: int) -> pd.DataFrame:
    """Return the ledger: one row for each value in the log, pseudorange before range rate, in the log's order."""
    status = out.ledger["status"]
    present = status != ABSENT
    values = np.count_nonzero(present, axis=1)  # of each row; repeating is cheaper than looking up
    kind = np.broadcast_to(np.arange(len(KINDS), dtype=np.int8), present.shape)
    innovation = out.ledger["innovation"][present]
    variance = out.ledger["variance"][present]
    codes = sorted(NAMES)
    place = np.zeros(max(codes) + 1, np.int8)
    place[codes] = np.arange(len(codes))
    return pd.DataFrame(
        {
            "time_s": np.repeat(ns_to_week_seconds(gnss.t_ns, week), values),
            "sv": _words(np.repeat(gnss.sv, values), gnss.sv_names),
            "signal": _words(np.repeat(gnss.signal, values), gnss.signal_names),
            "kind": _words(kind[present], KINDS),
            "innovation": innovation,
            "sd_innovation": np.sqrt(variance),
            "nis": innovation**2 / variance,
            "status": _words(place[status[present]], tuple(NAMES[c] for c in codes)),
        },
        copy=False,
    )


def satellite_table(out: Output, rows: Rows, gnss: GnssTable, week: int) -> pd.DataFrame:
    """Return one row per satellite and epoch: where it stands, and how well its range and rate were predicted.

    Of several signals of a satellite the one that was used stands, else the first. ``sd_range_m`` and
    ``sd_range_rate_mps`` are sqrt(h P h^T) before the update.
    """
    ledger = out.ledger
    epoch = np.repeat(np.arange(len(rows.epoch_ns)), np.diff(rows.first))
    seen = np.isfinite(ledger["u_n"][:, 0])
    tracked = (ledger["status"][:, 0] == USED) | (ledger["status"][:, 1] == USED)
    chosen = _one_per_satellite(epoch, gnss.sv, seen, tracked, len(gnss.sv_names))
    # every row, as a rule: then nothing is copied
    rows_of_table = slice(None) if len(chosen) == len(ledger) else chosen
    names = ("tracked", *(NAMES[c] for c in sorted(NAMES) if c != USED), "absent")
    place = np.zeros(max(NAMES) + 1, np.int8)
    place[sorted(NAMES)[1:]] = np.arange(1, len(NAMES))
    status = ledger["status"][rows_of_table, PSEUDORANGE]
    state = place[np.maximum(status, 0)]
    state[status == ABSENT] = len(names) - 1
    state[tracked[rows_of_table]] = 0
    return pd.DataFrame(
        {
            "time_s": ns_to_week_seconds(gnss.t_ns[rows_of_table], week),
            "sv": _words(gnss.sv[rows_of_table], gnss.sv_names),
            **_angles(ledger["u_n"][rows_of_table], ""),
            **_angles(ledger["u_b"][rows_of_table], "body_"),
            "state": _words(state, names),
            "sd_range_m": np.sqrt(ledger["predicted"][rows_of_table, 0]),
            "sd_range_rate_mps": np.sqrt(ledger["predicted"][rows_of_table, 1]),
        },
        copy=False,
    )


def _angles(u: Float64, prefix: str) -> dict[str, Float64]:
    """Return azimuth (first axis towards second) and elevation (against the third) of directions (n, 3)."""
    return {
        f"{prefix}az_deg": np.degrees(np.arctan2(u[:, 1], u[:, 0])) % 360.0,
        f"{prefix}el_deg": np.degrees(np.arcsin(np.clip(-u[:, 2], -1.0, 1.0))),
    }


def _one_per_satellite(
    epoch: Int64,
    sv: npt.NDArray[np.int16],
    seen: npt.NDArray[np.bool_],
    tracked: npt.NDArray[np.bool_],
    n_sv: int,
) -> Int64:
    """Return one row of each satellite and epoch among ``seen``: a tracked one before the others, else the first."""
    index = np.flatnonzero(seen)
    key = epoch[index] * max(n_sv, 1) + sv[index]
    # stable, so that rows in nearly the right order are sorted fast
    order = np.argsort(2 * key + ~tracked[index], kind="stable")
    first = np.ones(len(order), np.bool_)
    first[1:] = np.diff(key[order]) != 0
    return np.sort(index[order[first]])


def event_table(events: list[Event], week: int) -> pd.DataFrame:
    """Return the events in the order of their time; those of whole files (no time) first."""
    ordered = sorted(events, key=lambda e: -1 if e.t_ns is None else e.t_ns)
    times = [np.nan if e.t_ns is None else float(ns_to_week_seconds(e.t_ns, week)) for e in ordered]
    return pd.DataFrame(
        {
            "time_s": np.array(times, np.float64),
            "kind": pd.Series([e.kind for e in ordered], dtype="str"),
            "detail": pd.Series([e.detail for e in ordered], dtype="str"),
        }
    )


def _words(codes: npt.NDArray[Any], names: tuple[str, ...]) -> pd.Categorical:
    return pd.Categorical.from_codes(codes, categories=pd.Index(list(names), dtype="str"))


def interpolated(t_ns: Int64, at_ns: Int64, values: Float64) -> Float64:
    """Return the columns of ``values`` (n, k) at the times ``at_ns`` by linear interpolation."""
    t, at = (t_ns - t_ns[0]) * 1e-9, (at_ns - t_ns[0]) * 1e-9
    return np.column_stack([np.interp(at, t, values[:, i]) for i in range(values.shape[1])])
