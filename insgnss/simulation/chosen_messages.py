"""One message for each satellite of a scenario: the nearest of a file's, and any message at another reference time."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from insgnss.constants import GPS_OMEGA_RADPS, NS_PER_S, NS_PER_WEEK
from insgnss.errors import NavigationDataError
from insgnss.gpstime import ns_to_datetime
from insgnss.simulation.constellation import mean_motion
from insgnss.simulation.rinex_nav import as_written
from insgnss.tables import EphemerisTable, NavigationData

LONGEST_AGE_S = 7200.0  # half of a GPS message's usual fit interval, IS-GPS-200N, 20.3.4.4


def rows_of(table: EphemerisTable, rows: list[int]) -> EphemerisTable:
    """Return the given rows, in their order."""
    taken: dict[str, Any] = {}
    for f in dataclasses.fields(EphemerisTable):
        values = getattr(table, f.name)
        taken[f.name] = tuple(values[k] for k in rows) if isinstance(values, tuple) else values[rows]
    return EphemerisTable(**taken)


def without(navigation: NavigationData, missing: set[str]) -> NavigationData:
    """Return the navigation data without the messages of some satellites."""
    names = navigation.ephemerides.sv_names
    left = [row for row, name in enumerate(names) if name not in missing]
    return dataclasses.replace(navigation, ephemerides=rows_of(navigation.ephemerides, left))


def nearest_messages(navigation: NavigationData, middle_ns: int, half_s: float) -> NavigationData:
    """Return of each healthy GPS satellite the message whose reference time is nearest to ``middle_ns``.

    Parameters
    ----------
    half_s : half of the scenario's length; a message must hold from its first to its last moment

    Raises
    ------
    NavigationDataError : no message holds for the whole scenario
    """
    table = navigation.ephemerides
    age_s = np.abs(table.toe_ns - middle_ns) / NS_PER_S
    chosen: dict[str, int] = {}
    for row in np.argsort(age_s, kind="stable"):
        name, whole = table.sv_names[row], age_s[row] + half_s <= LONGEST_AGE_S
        if name[0] == "G" and table.message[row] == "LNAV" and table.health[row] == 0 and whole:
            chosen.setdefault(name, int(row))
    if not chosen:
        gps = [k for k, name in enumerate(table.sv_names) if name[0] == "G"]
        known = "it has no GPS messages"
        if gps:
            first, last = (ns_to_datetime(int(f(table.toe_ns[gps]))) for f in (np.min, np.max))
            known = f"its GPS messages are of {first:%Y-%m-%d %H:%M} to {last:%Y-%m-%d %H:%M} GPS"
        raise NavigationDataError(
            f"no healthy GPS message holds for {2.0 * half_s:.0f} s around {ns_to_datetime(middle_ns):%Y-%m-%d %H:%M}",
            advice=f"{known}: change gps_week and start_s, or the file; a message holds for 4 h",
        )
    return _as_gps(navigation, rows_of(table, [chosen[name] for name in sorted(chosen)]))


def referred_to(navigation: NavigationData, toe_ns: int) -> NavigationData:
    """Return the same orbits and clocks in messages of the reference time ``toe_ns``.

    Equation: ``M0' = M0 + n dt``, ``omega0' = omega0 + (omega_dot - w_e) dt - w_e (toe_sow - toe_sow')``,
    ``i0' = i0 + idot dt``, ``af0' = af0 + af1 dt + af2 dt^2``, ``af1' = af1 + 2 af2 dt``.
    """
    eph = navigation.ephemerides
    dt = (toe_ns - eph.toe_ns) / NS_PER_S
    of_clock = (toe_ns - eph.toc_ns) / NS_PER_S
    count = len(dt)
    toe_sow = np.full(count, (toe_ns % NS_PER_WEEK) / NS_PER_S)
    node = eph.omega0 + (eph.omega_dot - GPS_OMEGA_RADPS) * dt - GPS_OMEGA_RADPS * (eph.toe_sow_s - toe_sow)
    mean = eph.m0 + mean_motion(eph.sqrt_a, eph.delta_n) * dt
    moved = dataclasses.replace(
        eph,
        toe_ns=np.full(count, toe_ns, np.int64),
        toc_ns=np.full(count, toe_ns, np.int64),
        toe_sow_s=toe_sow,
        m0=np.arctan2(np.sin(mean), np.cos(mean)),
        omega0=np.arctan2(np.sin(node), np.cos(node)),
        i0=eph.i0 + eph.idot * dt,
        af0=eph.af0 + of_clock * (eph.af1 + of_clock * eph.af2),
        af1=eph.af1 + 2.0 * eph.af2 * of_clock,
    )
    return _as_gps(navigation, moved)


def _as_gps(navigation: NavigationData, table: EphemerisTable) -> NavigationData:
    """Return the GPS part with each number as the file will hold it, gaps of the file filled with usual values."""

    def or_else(values: np.ndarray, usual: float) -> np.ndarray:
        return np.where(np.isnan(values), usual, values)

    table = dataclasses.replace(
        table,
        group_delay_s=or_else(table.group_delay_s, 0.0),
        accuracy_m=or_else(table.accuracy_m, 2.0),
        issue=or_else(table.issue, 0.0),
        fit_interval_s=or_else(table.fit_interval_s, 4.0 * 3600.0),
    )
    return as_written(NavigationData(table, navigation.klobuchar, navigation.leap_seconds))
