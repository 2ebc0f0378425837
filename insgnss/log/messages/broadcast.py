"""Broadcast messages: ephemerides, state vectors, ionosphere and leap seconds, gathered and turned into tables."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import fields
from typing import Final, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S, NS_PER_WEEK, S_PER_DAY
from insgnss.gpstime import BDT_TO_GPS_NS
from insgnss.tables import EphemerisTable, Event, Float64, NavigationData, StateVectorTable

# A message's own time and the receiver's time nearest to it in the log differ by less; else one has the wrong week
TIME_AGREES_NS: Final = S_PER_DAY * NS_PER_S


class Stated(NamedTuple):
    """What a Keplerian message states besides the motion and the clock; fields of ``EphemerisTable``."""

    group_delay_s: tuple[float, float]
    health: float
    accuracy_m: float
    issue: float
    fit_interval_s: float = math.nan


class Ephemeris(NamedTuple):
    """One complete Keplerian message; the fields are those of ``EphemerisTable``."""

    sv: str
    message: str
    toe_ns: int
    toc_ns: int
    group_delay_s: tuple[float, float]
    health: float
    accuracy_m: float
    issue: float
    fit_interval_s: float
    elements: tuple[float, ...]  # in the order of ELEMENTS


ELEMENTS: Final = (
    *("toe_sow_s", "af0", "af1", "af2", "sqrt_a", "e", "i0", "omega0", "omega", "m0", "delta_n"),
    *("omega_dot", "idot", "cuc", "cus", "crc", "crs", "cic", "cis"),
)


class StateVector(NamedTuple):
    """One complete message of the integrated kind; the fields are those of ``StateVectorTable``."""

    sv: str
    t_ns: int
    r_e: tuple[float, ...]
    v_e: tuple[float, ...]
    a_e: tuple[float, ...]
    clock_s: float
    clock_rate: float
    group_delay_s: float
    health: float
    channel: int


class Broadcast:
    """The content of a log's messages, each distinct message once, and a count of rejected messages by reason."""

    def __init__(self) -> None:
        self.ephemerides: dict[Ephemeris, None] = {}
        self.states: dict[StateVector, None] = {}
        # "gps", "galileo", "beidou", "qzss"; the first counts
        self.ionosphere: dict[str, tuple[float, ...]] = {}
        self.leap_seconds: int | None = None
        self.refused: Counter[str] = Counter()

    def keep(
        self, sv: str, message: str, stated: Stated, elements: tuple[float, ...], toc_s: float, near_ns: int
    ) -> None:
        """Keep a Keplerian message, once.

        Parameters
        ----------
        elements : in the order of ELEMENTS; reference time and ``toc_s`` are seconds of the week, BeiDou's of its own
        near_ns : GPS time within half a week of both
        """
        shift_ns = BDT_TO_GPS_NS if sv[0] == "C" else 0
        toe_ns, toc_ns = (nearest_in_week(s, near_ns - shift_ns) + shift_ns for s in (elements[0], toc_s))
        self.ephemerides.setdefault(Ephemeris(sv, message, toe_ns, toc_ns, *stated, elements))

    def ionosphere_of(self, system: str, coefficients: tuple[float, ...]) -> None:
        """Keep a system's coefficients, the first that are not all zero (zero means "not available")."""
        if any(coefficients):
            self.ionosphere.setdefault(system, coefficients)

    def refused_events(self, file: object) -> list[Event]:
        """Return the events of rejected messages, with counts."""
        return [
            Event(None, "navigation_damaged", f"{file}: {count} x {reason}")
            for reason, count in self.refused.items()
        ]

    def navigation(self) -> NavigationData | None:
        """Return the gathered messages as tables, None without any."""
        if not (self.ephemerides or self.states or self.ionosphere):
            return None
        rows = {name: np.array(values, dtype=np.float64) for name, values in self.ionosphere.items()}
        return NavigationData(
            ephemeris_table(self.ephemerides),
            rows.pop("gps", None),
            self.leap_seconds,
            state_table(self.states) if self.states else None,
            rows,
        )


def nearest_in_week(sow_s: float, near_ns: int) -> int:
    """Return the time with these seconds of the week that is nearest to ``near_ns`` [ns]."""
    half = NS_PER_WEEK // 2
    return near_ns + (round(sow_s * NS_PER_S) - near_ns + half) % NS_PER_WEEK - half


def in_nearest_week(week: int, rollover: int, sow_s: float, near_ns: int) -> int:
    """Return the time of a week number sent modulo ``rollover``, its cycle the one nearest to ``near_ns`` [ns]."""
    period = rollover * NS_PER_WEEK
    sent = week * NS_PER_WEEK + round(sow_s * NS_PER_S)
    return near_ns + (sent - near_ns + period // 2) % period - period // 2


def ephemeris_table(messages: Iterable[Ephemeris]) -> EphemerisTable:
    """Return the messages by satellite and reference time; equal ones in the order received."""
    rows = sorted(messages, key=lambda m: (m.sv, m.toe_ns, m.toc_ns, m.message))
    columns: dict[str, Float64] = {
        name: np.array([row.elements[i] for row in rows], dtype=np.float64) for i, name in enumerate(ELEMENTS)
    }
    for name in ("health", "accuracy_m", "issue", "fit_interval_s"):
        columns[name] = np.array([getattr(row, name) for row in rows], dtype=np.float64)
    return EphemerisTable(
        sv_names=tuple(row.sv for row in rows),
        message=tuple(row.message for row in rows),
        toe_ns=np.array([row.toe_ns for row in rows], dtype=np.int64),
        toc_ns=np.array([row.toc_ns for row in rows], dtype=np.int64),
        group_delay_s=np.array([row.group_delay_s for row in rows], dtype=np.float64).reshape(-1, 2),
        **columns,
    )


def state_table(messages: Iterable[StateVector]) -> StateVectorTable:
    """Return the messages by satellite and reference time."""
    rows = sorted(messages, key=lambda m: (m.sv, m.t_ns))
    values = {f.name: [getattr(row, f.name, None) for row in rows] for f in fields(StateVectorTable)}
    dtypes = {"t_ns": np.int64, "channel": np.int16}
    columns = {
        name: np.array(column, dtype=dtypes.get(name, np.float64))
        for name, column in values.items()
        if name != "sv_names"
    }
    return StateVectorTable(sv_names=tuple(row.sv for row in rows), **columns)
