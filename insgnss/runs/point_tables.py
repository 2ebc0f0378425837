"""From the arrays of a point solution to its tables."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pandas as pd

from insgnss.geodesy.directions import angle_columns
from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.gnss.dilution import DOPS
from insgnss.gnss.least_squares import CLOCKS
from insgnss.gnss.observation_rows import ABSENT
from insgnss.gnss.point import integrity
from insgnss.gnss.point.rows import PointLog, PointRows
from insgnss.gpstime import ns_to_week_seconds
from insgnss.results.nav_columns import PLACE
from insgnss.results.table_files import words
from insgnss.runs.result_tables import status_words
from insgnss.status import INCONSISTENT
from insgnss.tables import Float64, GnssTable
from insgnss.units import RAD_PER_DEG

VERDICTS: Final[dict[int, str]] = {
    integrity.OK: "ok",
    integrity.EXCLUDED: "fault excluded",
    integrity.NOT_IDENTIFIED: "fault detected, not identified",
    integrity.UNTESTED: "not tested",
    integrity.TOO_FEW: "not enough satellites",
    integrity.BAD_GEOMETRY: "bad geometry",
}
KINDS: Final = ("pseudorange", "range_rate")
_AXES: Final = ("n", "e", "d")


def point_table(
    out: PointLog, rows: PointRows, limits: Float64, gnss: GnssTable, week: int, clock_groups: tuple[str, ...]
) -> pd.DataFrame:
    """Return one row per epoch: position, velocity, clocks, their sigmas, dilution, test and verdict."""
    place = geodetic(out.r_e)
    C_ne = ned_axes(place)
    columns: dict[str, Any] = {"time_s": ns_to_week_seconds(rows.epoch_ns, week)}
    columns |= {f"{axis}_m": out.r_e[:, i] for i, axis in enumerate("xyz")}
    columns |= dict(zip(PLACE, (place / [RAD_PER_DEG, RAD_PER_DEG, 1.0]).T, strict=True))
    v_n = np.einsum("kij,kj->ki", C_ne, out.v_e)
    columns |= {f"v{axis}_mps": v_n[:, i] for i, axis in enumerate(_AXES)}
    columns |= _covariances(C_ne @ out.P[:, :3, :3] @ C_ne.transpose(0, 2, 1), "{}_m", "cov_{}_m2")
    columns |= _covariances(C_ne @ out.P_v[:, :3, :3] @ C_ne.transpose(0, 2, 1), "v{}_mps", "cov_v{}_m2ps2")
    for i, group in enumerate(clock_groups):
        columns[f"clock_{group}_m"] = out.clock_m[:, i]
        columns[f"sd_clock_{group}_m"] = np.sqrt(out.P[:, CLOCKS + i, CLOCKS + i])
    columns |= {"clock_drift_mps": out.drift_mps, "sd_clock_drift_mps": np.sqrt(out.P_v[:, 3, 3])}
    columns |= {name: out.dop[:, i] for i, name in enumerate(DOPS)}
    columns |= {"hpl_m": out.level_m[:, 0], "vpl_m": out.level_m[:, 1]}
    for kind, prefix in enumerate(("", "velocity_")):
        columns |= {
            f"n_{prefix}used": out.n_used[:, kind],
            f"n_{prefix}redundant": out.freedom[:, kind],
            f"{prefix}test_statistic": out.statistic[:, kind],
            f"{prefix}test_limit": limits[out.freedom[:, kind]],
            f"{prefix}verdict": pd.Series(_verdicts(out, rows, gnss, kind), dtype="str"),
        }
    return pd.DataFrame(columns)


def residual_table(out: PointLog, gnss: GnssTable, week: int) -> pd.DataFrame:
    """Return one row for each value in the log, pseudorange before range rate, in the log's order.

    ``residual`` is measured minus predicted by the solution, of rows that are not in it too; ``sd`` the measurement's
    sigma; ``normalised`` the residual by its own deviation, NaN where no other row tests it.
    """
    present = out.status != ABSENT
    values = np.count_nonzero(present, axis=1)
    kind = np.broadcast_to(np.arange(len(KINDS), dtype=np.int8), present.shape)
    return pd.DataFrame(
        {
            "time_s": np.repeat(ns_to_week_seconds(gnss.t_ns, week), values),
            "sv": words(np.repeat(gnss.sv, values), gnss.sv_names),
            "signal": words(np.repeat(gnss.signal, values), gnss.signal_names),
            "kind": words(kind[present], KINDS),
            "residual": out.residual[present],
            "sd": out.sigma[present],
            "normalised": out.normalised[present],
            **angle_columns(np.repeat(out.u_n, values, axis=0)),
            "status": status_words(out.status[present]),
        }
    )


def _verdicts(out: PointLog, rows: PointRows, gnss: GnssTable, kind: int) -> list[str]:
    """Return each epoch's verdict in words, the excluded satellites named."""
    words = [VERDICTS[int(code)] for code in out.verdict[:, kind]]
    excluded: dict[int, set[str]] = {}
    at = np.flatnonzero(out.status[:, kind] == INCONSISTENT)
    for epoch, i in zip((np.searchsorted(rows.first, at, side="right") - 1).tolist(), at, strict=True):
        excluded.setdefault(epoch, set()).add(gnss.sv_names[gnss.sv[i]])
    for epoch, names in excluded.items():
        if out.verdict[epoch, kind] == integrity.EXCLUDED:
            words[epoch] += ": " + " ".join(sorted(names))
    return words


def _covariances(P: Float64, sigma: str, product: str) -> dict[str, Float64]:
    """Return the columns of a covariance (m, 3, 3) in north, east, down."""
    columns = {f"sd_{sigma.format(axis)}": np.sqrt(P[:, i, i]) for i, axis in enumerate(_AXES)}
    for i, j in ((0, 1), (0, 2), (1, 2)):
        columns[product.format(_AXES[i] + _AXES[j])] = P[:, i, j]
    return columns
