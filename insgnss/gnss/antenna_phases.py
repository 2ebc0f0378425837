"""The carrier phases of all antennas of a vehicle, laid side by side by epoch, satellite and signal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.gnss.observation_rows import ABSENT, GnssRows
from insgnss.gnss.signals import wavelength_m
from insgnss.gpstime import nearest
from insgnss.status import (
    BAD_SIGMA,
    BAD_VALUE,
    COMBINED,
    HALF_CYCLE,
    NO_CORRECTION,
    NO_RANGE,
    NO_SECOND_SIGNAL,
    SWITCHED_OFF,
    USED,
)
from insgnss.tables import LLI_HALF_CYCLE, LLI_SLIP, Bool, Float64, GnssTable, Int8, Int16, Int64

MATCH_S: Final = 2e-3  # receivers of clocks of their own tag one epoch up to a millisecond apart each
# what the range of a row may have become without harm to its phase
_RANGE_ALONE: Final = (SWITCHED_OFF, COMBINED, NO_SECOND_SIGNAL, NO_CORRECTION, BAD_SIGMA, BAD_VALUE)
MATCH_NS: Final = round(MATCH_S * NS_PER_S)
Channel = tuple[str, str]  # satellite, RINEX code


@dataclass(frozen=True)
class AntennaPhases:
    """One row per phase; the rows of an epoch of the main log stand together, those of none of its epochs at the end.

    ``channel`` numbers satellite and signal; ``antenna`` is 0 for the main one.
    """

    # of each channel, in their order: one epoch alone has them in that of the whole log
    names: tuple[Channel, ...]
    epoch_ns: Int64  # (m,) time tags of the main log
    first: Int64  # (m + 1,) first row of each epoch; from the last on: rows of no epoch
    t_ns: Int64  # (n,) the row's own time tag
    antenna: Int8  # (n,)
    channel: Int64  # (n,)
    phase_m: Float64  # (n,) wavelength times carrier phase: grows with the distance
    code_m: Float64  # (n,) pseudorange
    wavelength_m: Float64  # (n,)
    cn0_dbhz: Float64  # (n,) NaN where not logged
    sat: Float64  # (n, 6) position [m] and velocity [m/s] of the satellite at transmission, ECEF
    has_slipped: Bool  # (n,) as the receiver says
    status: Int8  # (n,) USED where the phase can be used, or why not


def antenna_phases(
    logs: Sequence[tuple[GnssTable, GnssRows]], channels: Mapping[str, int] | None = None
) -> AntennaPhases:
    """Return the phases of all antennas at the epochs of the first log.

    Parameters
    ----------
    logs : each antenna's observations with the filter's rows of them, the main antenna first
    channels : of GLONASS satellites
    """
    numbers: dict[Channel, int] = {}
    epoch_ns = logs[0][1].epoch_ns
    parts = [_part(gnss, rows, i, epoch_ns, numbers, channels or {}) for i, (gnss, rows) in enumerate(logs)]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    names = tuple(sorted(numbers))
    columns["channel"] = np.argsort([numbers[name] for name in names])[columns["channel"]]
    order = np.lexsort((columns["antenna"], columns["epoch"]))
    columns = {name: values[order] for name, values in columns.items()}
    first = np.searchsorted(columns.pop("epoch"), np.arange(len(epoch_ns) + 1))
    return AntennaPhases(names=names, epoch_ns=epoch_ns, first=first.astype(np.int64), **columns)


def _part(
    gnss: GnssTable,
    rows: GnssRows,
    antenna: int,
    epoch_ns: Int64,
    numbers: dict[Channel, int],
    channels: Mapping[str, int],
) -> dict[str, npt.NDArray[np.generic]]:
    """Return the columns of one antenna, those rows alone that have a phase."""
    cycles = gnss.carrier_cycles
    with_phase = np.flatnonzero(np.isfinite(cycles)) if cycles is not None else np.zeros(0, np.int64)
    table = gnss.take(with_phase)
    number = np.zeros((max(len(gnss.sv_names), 1), max(len(gnss.signal_names), 1)), np.int64)
    wave = np.full(number.shape, np.nan)
    for i, j in {(int(i), int(j)) for i, j in zip(table.sv, table.signal, strict=True)}:
        key = gnss.sv_names[i], gnss.signal_names[j]
        number[i, j] = numbers.setdefault(key, len(numbers))
        wave[i, j] = wavelength_m(key[0][0], key[1], channels.get(key[0]))
    wavelength = wave[table.sv, table.signal]
    lli = np.zeros(len(with_phase), np.int8) if table.lli is None else table.lli
    return {
        "epoch": epoch_of(table.t_ns, epoch_ns),
        "t_ns": table.t_ns,
        "antenna": np.full(len(with_phase), antenna, np.int8),
        "channel": number[table.sv, table.signal],
        "phase_m": wavelength * _taken(table.carrier_cycles),
        "code_m": table.pseudorange_m,
        "wavelength_m": wavelength,
        "cn0_dbhz": table.cn0_dbhz,
        "sat": rows.sat[with_phase, :6],
        "has_slipped": (lli & LLI_SLIP) != 0,
        "status": _status(
            rows.observation["status"][with_phase, 0], wavelength, rows.sat[with_phase, 0], lli
        ),
    }


def _taken(cycles: Float64 | None) -> Float64:
    return np.zeros(0) if cycles is None else cycles


def _status(of_range: Int8, wavelength: Float64, x: Float64, lli: Int8 | Int16) -> Int8:
    """Return whether each phase can be used: as its range, but for what concerns the range alone."""
    status = np.where(np.isin(of_range, _RANGE_ALONE), USED, of_range).astype(np.int8)
    status[status == ABSENT] = NO_RANGE  # the time of transmission is unknown
    status[(status == USED) & (lli & LLI_HALF_CYCLE != 0)] = HALF_CYCLE
    status[(status == USED) & ~(np.isfinite(wavelength) & np.isfinite(x))] = BAD_VALUE
    return status


def epoch_of(t_ns: Int64, epoch_ns: Int64) -> Int64:
    """Return the epoch nearest to each time, the number of epochs where none is near."""
    if not len(epoch_ns):
        return np.zeros(len(t_ns), np.int64)
    epoch = nearest(epoch_ns, t_ns)
    apart = np.abs(t_ns - epoch_ns[epoch])
    return np.where(apart <= MATCH_NS, epoch, len(epoch_ns))
