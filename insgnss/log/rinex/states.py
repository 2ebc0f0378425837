"""State vectors in RINEX navigation files: GLONASS, read through ``sidereon``, and SBAS.

A GLONASS message whose channel is missing is kept, its channel marked as not known: the log may state it.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from insgnss.constants import M_PER_KM
from insgnss.gnss import sidereon_on_demand as sidereon
from insgnss.gnss.signals import CHANNELS, UNKNOWN_CHANNEL
from insgnss.gpstime import datetime_to_ns, utc_to_ns
from insgnss.log.messages.broadcast import StateVector, state_table
from insgnss.log.rinex.text import numbers_in
from insgnss.tables import StateVectorTable

NO_DATE: Final = -1  # [ns] for the year 1 and its like
_J2000: Final = dt.datetime(2000, 1, 1, 12)
IMPOSSIBLE_DATE: Final = "its date is impossible"
_LATEST_NS: Final = datetime_to_ns(dt.datetime(2100, 1, 1))
NUMBER_WIDTH: Final = 19  # characters


@dataclass(frozen=True)
class StateVectors:
    """The messages of a file, and its defects."""

    found: list[StateVector]
    refused: list[tuple[int, str, str]]  # line (1 where it is not known), satellite and reason
    mended: set[int]  # lines of messages that were read without their channel


def read_state_vectors(text: str, glonass: Sequence[int], sbas: Sequence[int]) -> StateVectors:
    """Return the state vectors of a file; ``glonass`` and ``sbas`` are the lines (from 1) where messages begin."""
    result = StateVectors([], [], set())
    lines = text.splitlines()
    try:
        records = sidereon.parse_rinex_glonass_records(text) if glonass else []
        result.found.extend(map(_glonass, records))
    except sidereon.SidereonError:
        for line in glonass:
            _read_alone(lines, line, result)
    for line in sbas:
        try:
            result.found.append(_sbas(_block(lines, line), old=_version(lines) < 3.0))
        except (ValueError, IndexError) as error:
            result.refused.append((line, lines[line - 1][:3], str(error)))
    undated = [state for state in result.found if not is_date(state.t_ns)]
    result.refused.extend((1, state.sv, IMPOSSIBLE_DATE) for state in undated)
    dated = [state for state in result.found if is_date(state.t_ns)]
    return StateVectors(dated, result.refused, result.mended)


def is_date(t_ns: int) -> bool:
    """Return whether a GPS time lies between the start of GPS and a year of which no file can be."""
    return 0 <= t_ns < _LATEST_NS


def state_vector_table(states: Sequence[StateVector]) -> tuple[StateVectorTable | None, int]:
    """Return the distinct messages, sorted by satellite and time, and how many were repeated; None without any."""
    distinct = {(state.sv, state.t_ns): state for state in states}
    return state_table(distinct.values()) if distinct else None, len(states) - len(distinct)


def _glonass(record: Any) -> StateVector:
    """Return a message as read; its time is UTC, a multiple of 15 min (RINEX 3.05, table A10)."""
    delay = record.l1_l2_group_delay_s
    return StateVector(
        sv=record.satellite,
        t_ns=_utc_j2000_to_ns(record.toe_utc_j2000_s),
        r_e=tuple(np.asarray(record.position_m).tolist()),
        v_e=tuple(np.asarray(record.velocity_m_s).tolist()),
        a_e=tuple(np.asarray(record.acceleration_m_s2).tolist()),
        clock_s=record.clock_bias_s,
        clock_rate=record.gamma_n,
        group_delay_s=float("nan") if delay is None else delay,
        # B_n, and l_n and C_n where the file has them
        health=0.0 if record.is_healthy else max(float(record.sv_health), 1.0),
        channel=record.freq_channel if record.freq_channel in CHANNELS else UNKNOWN_CHANNEL,
    )


def _utc_j2000_to_ns(seconds: float) -> int:
    """Return GPS time [ns] of UTC seconds since J2000; no date for an invalid value."""
    try:
        return utc_to_ns(_J2000 + dt.timedelta(seconds=seconds))
    except (OverflowError, ValueError):
        return -1


def _read_alone(lines: list[str], line: int, result: StateVectors) -> None:
    """Add one GLONASS message of a file that cannot be read whole."""
    block = _block(lines, line)
    for attempt in (block, _without_channel(block, old=_version(lines) < 3.0)):
        # a message of four lines is what RINEX 3.04 asks for, whatever the file calls itself
        is_short = 3.04 < _version(lines) < 4.0 and len(attempt) - attempt[0].startswith(">") == 4
        stated = f"{3.04:9.2f}{lines[0][9:]}" if is_short else lines[0]
        try:
            file = "\n".join([stated, "".ljust(60) + "END OF HEADER", *attempt]) + "\n"
            records = sidereon.parse_rinex_glonass_records(file)
        except sidereon.SidereonError as error:
            why = str(error)
            if "channel" not in why:
                break
            continue
        result.found.extend(map(_glonass, records))
        if attempt is not block:
            result.mended.add(line)
        return
    result.refused.append((line, block[-4][:3] if len(block) > 3 else block[0][:3], why))


def _version(lines: list[str]) -> float:
    try:
        return float(lines[0][:9])
    except ValueError:
        return 3.0


def _block(lines: list[str], line: int) -> list[str]:
    """Return the lines of the message that begins at ``line`` (from 1)."""
    first = line - 1
    if _version(lines) < 3.0:
        return lines[first : first + 4]
    last = first + (2 if lines[first].startswith(">") else 1)
    while last < len(lines) and lines[last][:1] == " ":
        last += 1
    return lines[first:last]


def _without_channel(block: list[str], *, old: bool) -> list[str]:
    """Return the message with the channel's field filled in as not known."""
    at = block[0].startswith(">") + 2
    if len(block) <= at:
        return block
    start = (3 if old else 4) + 3 * NUMBER_WIDTH
    return [*block[:at], f"{block[at][:start]:{start}}{UNKNOWN_CHANNEL:{NUMBER_WIDTH}.12E}", *block[at + 1 :]]


def _sbas(block: list[str], *, old: bool) -> StateVector:
    """Return a message of a geostationary satellite: its time is GPS time (RINEX 3.05, table A16)."""
    block = block[block[0].startswith(">") :]
    head = 22 if old else 23
    date = block[0][3:head].split() if old else block[0][4:head].split()
    year, month, day, hour, minute = (int(part) for part in date[:5])
    year += 0 if year > 99 else 1900 if year >= 80 else 2000
    when = dt.datetime(year, month, day, hour, minute) + dt.timedelta(seconds=float(date[5]))
    clock_s, clock_rate, _ = numbers_in(block[0], head, NUMBER_WIDTH, 3)
    rows = np.array([numbers_in(line, head - 19, NUMBER_WIDTH, 4) for line in block[1:4]])
    sv = f"S{int(block[0][:2]):02d}" if old else block[0][:3].replace(" ", "0")
    return StateVector(
        sv=sv,
        t_ns=datetime_to_ns(when),
        r_e=tuple((rows[:, 0] * M_PER_KM).tolist()),
        v_e=tuple((rows[:, 1] * M_PER_KM).tolist()),
        a_e=tuple((rows[:, 2] * M_PER_KM).tolist()),
        clock_s=clock_s,
        clock_rate=clock_rate,
        group_delay_s=float("nan"),
        health=float(rows[0, 3]),
        channel=UNKNOWN_CHANNEL,
    )
