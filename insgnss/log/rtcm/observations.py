"""RTCM's observation messages (MSM4 to MSM7; 1002, 1004, 1010, 1012) become rows.

RTCM 10403.3, 3.5.12 (MSM), with c in metres per millisecond:

- P = c (N + M 2^-10 + fine), fine in 2^-24 ms (MSM4, 5) or 2^-29 ms (MSM6, 7)
- L = c (N + M 2^-10 + fine) / wavelength, fine in 2^-29 ms (MSM4, 5) or 2^-31 ms (MSM6, 7)
- range rate = rough [m/s] + fine 1e-4 m/s (MSM5, 7)

and 3.5.2, 3.5.5 (1002 to 1012): P1 = 0.02 m p + modulus n, L1 = (P1 + 0.0005 m d) / wavelength, P2 and L2 as
differences to P1.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS, NS_PER_MS
from insgnss.gnss import sidereon_on_demand as sidereon
from insgnss.gnss.signals import CHANNEL_OFFSET, CHANNELS, carrier_hz
from insgnss.log.events import counted, listed
from insgnss.log.rtcm.time import EpochTimes
from insgnss.log.satellites import rinex_name
from insgnss.tables import Event, Float64, GnssTable

MSM: Final = {
    first + kind: (system, kind)
    for first, system in zip(range(1070, 1140, 10), "GRESJCI", strict=True)
    for kind in (4, 5, 6, 7)
}
LEGACY: Final = {1002: "G", 1004: "G", 1010: "R", 1012: "R"}
OBSERVATIONS: Final = frozenset((*MSM, *LEGACY))
_M_PER_MS: Final = C_MPS / 1000.0
_NO_ROUGH_MS: Final = 255
_NO_RATE: Final = -8192
_NO_FINE_RATE: Final = -16_384
# Of the cells of MSM4, 5 and of MSM6, 7: bits of the fine code and phase, their scales [ms], that of C/N0 [dB-Hz]
_FINE: Final = {
    **dict.fromkeys((4, 5), (15, 2.0**-24, 22, 2.0**-29, 1.0)),
    **dict.fromkeys((6, 7), (20, 2.0**-29, 24, 2.0**-31, 0.0625)),
}
_SBAS_OFFSET: Final = 19  # satellite 1 is PRN 120, S20
_FIRST_SBAS: Final = 40  # of the GPS numbers of 1002 and 1004: PRN 120
_MODULUS_M: Final = {"G": C_MPS / 1000.0, "R": 2.0 * C_MPS / 1000.0}
_LEGACY_CODES: Final = {
    "G": (("C1C", "C1P"), ("C2X", "C2P", "C2D", "C2W")),
    "R": (("C1C", "C1P"), ("C2C", "C2P")),
}
_NO_PHASE: Final = -(1 << 19)
_NO_DIFFERENCE: Final = -(1 << 13)
_PHASE_CYCLE: Final = 1500.0  # cycles by which the phase against the range is wrapped
# Least time of lock [s] by the indicator of 1002 to 1012 (table 3.4-2): below, factor, taken off
_LOCKS: Final = ((24, 1, 0), (48, 2, 24), (72, 4, 120), (96, 8, 408), (120, 16, 1176), (127, 32, 3096))
_LONGEST_LOCK_S: Final = 937
_LEGACY_RANK: Final = 0  # below the kinds of MSM: of a signal sent twice the finer one counts


# One observation of a signal; of several the one with the highest rank counts, the kind of MSM; missing numbers are NaN
RtcmRow = tuple[int, str, str, int, int, float, float, float, float, int]
_FIELDS: Final = ("t_ns", "sv", "code", "station", "rank", "range_m", "phase_m", "rate_mps", "cn0", "lli")


@dataclass
class RtcmObservations:
    """All observations of a stream as they come."""

    rows: list[RtcmRow] = field(default_factory=list)
    channels: dict[str, int] = field(default_factory=dict)
    unknown: Counter[str] = field(default_factory=Counter)
    trackers: dict[int, Any] = field(default_factory=dict)  # of the locks, for each station
    locks: dict[tuple[int, str, str], tuple[int, int]] = field(default_factory=dict)  # time and lock, legacy

    @property
    def first_ns(self) -> int:
        """GPS time of the first epoch."""
        return self.rows[0][0] if self.rows else 0

    def column(self, name: str, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        """Return a field of all rows of the whole stream."""
        return np.array(self._columns.get(name, ()), dtype)

    @cached_property
    def _columns(self) -> dict[str, tuple[Any, ...]]:
        return dict(zip(_FIELDS, zip(*self.rows, strict=True), strict=False))

    def add(self, message: Any, times: EpochTimes) -> None:
        """Take one observation message."""
        if message.message_number in MSM:
            self._add_msm(message.msm, times)
        else:
            self._add_legacy(message.legacy_observations, times)

    def _add_msm(self, msm: Any, times: EpochTimes) -> None:
        system, kind = MSM[msm.message_number]
        header = msm.header
        t_ns = times.of(system, header.epoch_time)
        if header.reference_station_id not in self.trackers:
            self.trackers[header.reference_station_id] = sidereon.RtcmLockTimeTracker()
        locks = {
            (cell.satellite_id, cell.signal_id): cell.lli
            for cell in self.trackers[header.reference_station_id].observe(msm)
        }
        satellites = {sat.id: _satellite(system, sat) for sat in msm.satellites}
        code_bits, code_ms, phase_bits, phase_ms, cn0_db = _FINE[kind]
        no_code, no_phase = -(1 << code_bits - 1), -(1 << phase_bits - 1)
        for cell in msm.signals:
            sv, rough_ms, rough_mps, channel = satellites[cell.satellite_id]
            suffix = sidereon.rtcm_msm_signal_rinex_code(system, cell.signal_id)
            if not sv or suffix is None:
                self.unknown[f"{sv or system} signal {cell.signal_id}"] += 1
                continue
            if channel is not None:
                self.channels[sv] = channel
            fine, phase, rate = cell.fine_pseudorange, cell.fine_phase_range, cell.fine_phase_range_rate
            has_code, has_phase = (
                fine is not None and fine != no_code,
                phase is not None and phase != no_phase,
            )
            has_rate = rate is not None and rate != _NO_FINE_RATE
            row = (
                *(t_ns, sv, "C" + suffix, header.reference_station_id, kind),
                _M_PER_MS * (rough_ms + fine * code_ms) if has_code else np.nan,
                _M_PER_MS * (rough_ms + phase * phase_ms) if has_phase else np.nan,
                rough_mps + rate * 1e-4 if has_rate else np.nan,
                cell.cnr * cn0_db if cell.cnr else np.nan,
                locks.get((cell.satellite_id, cell.signal_id), 0) if has_phase else 0,
            )
            self.rows.append(row)

    def _add_legacy(self, seen: Any, times: EpochTimes) -> None:
        system = LEGACY[seen.message_number]
        t_ns, station = times.of(system, seen.epoch_time), seen.reference_station_id
        first, second = _LEGACY_CODES[system]
        for satellite in seen.satellites:
            number = satellite.satellite_id
            is_sbas = system == "G" and number >= _FIRST_SBAS
            sv = rinex_name("S", number - _FIRST_SBAS + 20) if is_sbas else rinex_name(system, number)
            if not sv:
                self.unknown[f"{system} satellite {satellite.satellite_id}"] += 1
                continue
            one, two = satellite.l1, satellite.l2
            if satellite.frequency_channel is not None:
                channel = satellite.frequency_channel - CHANNEL_OFFSET
                self.channels.update({sv: channel} if channel in CHANNELS else {})
            has_range = one.pseudorange_modulus_ambiguity is not None
            range_m = one.pseudorange * 0.02 + (one.pseudorange_modulus_ambiguity or 0) * _MODULUS_M[system]
            phases = [(one.phase_range_minus_pseudorange, first[int(one.code_indicator)], one, 0.0)]
            if two is not None and sv[0] != "S" and int(two.code_indicator) >= len(second):
                self.unknown[f"{sv} signal {two.code_indicator} of the second band"] += 1
            elif two is not None and sv[0] != "S":
                is_given = two.pseudorange_difference != _NO_DIFFERENCE
                difference_m = two.pseudorange_difference * 0.02 if is_given else np.nan
                phases.append(
                    (two.phase_range_minus_l1_pseudorange, second[int(two.code_indicator)], two, difference_m)
                )
            for phase, code, band, off_m in phases if has_range else ():
                lli = self._legacy_lli((station, sv, code), t_ns, band.lock_time_indicator)
                phase_m = range_m + phase * 0.0005 if phase != _NO_PHASE else np.nan
                cn0 = band.cnr * 0.25 if band.cnr else np.nan
                key = (t_ns, sv, code, station, _LEGACY_RANK)
                self.rows.append((*key, range_m + off_m, phase_m, np.nan, cn0, lli))

    def _legacy_lli(self, track: tuple[int, str, str], t_ns: int, indicator: int) -> int:
        """Return 1 where the lock has not lasted since the track's row before."""
        steps = (factor * indicator - off for below, factor, off in _LOCKS if indicator < below)
        lock_s = next(steps, _LONGEST_LOCK_S)
        before = self.locks.get(track)
        self.locks[track] = (t_ns, lock_s)
        if before is None:
            return 0
        elapsed_ms = (t_ns - before[0]) // NS_PER_MS
        return int(sidereon.rtcm_derive_lli(before[1] * 1000, max(elapsed_ms, 0), lock_s * 1000, False))


def _satellite(system: str, seen: Any) -> tuple[str, float, float, int | None]:
    """Return a satellite's name, rough range [ms], rough range rate [m/s] and GLONASS channel."""
    name = rinex_name(system, seen.id + (_SBAS_OFFSET if system == "S" else 0))
    whole_ms, rate = seen.rough_range_ms, seen.rough_phase_range_rate_m_s
    rough_ms = (
        np.nan if whole_ms is None or whole_ms == _NO_ROUGH_MS else whole_ms + seen.rough_range_mod1 / 1024.0
    )
    rough_mps = np.nan if rate is None or rate == _NO_RATE else float(rate)
    channel = (
        seen.extended_info - CHANNEL_OFFSET if system == "R" and seen.extended_info is not None else None
    )
    return name, rough_ms, rough_mps, channel if channel in CHANNELS else None


# ------------------------------------------------------------------------------------------------------------- table


def observation_table(
    cells: RtcmObservations, channels: dict[str, int], file: str
) -> tuple[GnssTable, list[Event]]:
    """Return the rows of the station that has most of them, each epoch, satellite and signal once.

    Parameters
    ----------
    cells : of the whole stream
    channels : of GLONASS satellites as ephemerides state them; those of the observations count before them
    """
    known = channels | cells.channels
    rows, events = _chosen(cells, file)
    sv_names, sv = np.unique(cells.column("sv", "U3"), return_inverse=True)
    codes, code = np.unique(cells.column("code", "U3"), return_inverse=True)
    carriers = np.array(
        [
            # those of SBAS are GPS's
            [carrier_hz("G" if name[0] == "S" else str(name[0]), str(c), known.get(str(name))) for c in codes]
            for name in sv_names
        ]
    ).reshape(len(sv_names), len(codes))
    hz = carriers[sv, code][rows] if len(rows) else np.zeros(0)
    names = ("range_m", "phase_m", "rate_mps", "cn0")
    columns = {name: cells.column(name, np.float64)[rows] for name in names}
    rates = columns["rate_mps"]
    cycles = columns["phase_m"] * hz / C_MPS
    legacy = cells.column("rank", np.int64)[rows] == _LEGACY_RANK
    track = sv[rows] * len(codes) + code[rows]
    if legacy.any():
        cycles = _unwrapped(cycles, columns["range_m"] * hz / C_MPS, np.where(legacy, track, -1))
    lost = np.isnan(hz) & (np.isfinite(columns["phase_m"]) | np.isfinite(rates))
    what = "row(s) without carrier phase and Doppler: channel or carrier not known"
    events += counted("rtcm_carrier_unknown", lost, what, file)
    table = GnssTable(
        cells.column("t_ns", np.int64)[rows],
        sv[rows].astype(np.int16),
        code[rows].astype(np.int16),
        columns["range_m"],
        -rates * hz / C_MPS,
        np.where(np.isnan(hz), rates, np.nan),
        columns["cn0"],
        tuple(map(str, sv_names)),
        tuple(map(str, codes)),
        carrier_cycles=cycles,
        lli=np.where(np.isfinite(cycles), cells.column("lli", np.int64)[rows], 0).astype(np.int8),
        glonass_channels={sv: k for sv, k in known.items() if sv in sv_names},
    )
    return table, events


def _chosen(
    cells: RtcmObservations, file: str
) -> tuple[np.ndarray[tuple[int], np.dtype[np.int64]], list[Event]]:
    """Return the rows that are used, sorted by epoch, satellite and signal, and the events of the others."""
    unknown = {f"of {what}": count for what, count in cells.unknown.most_common(10)}
    events = listed("rtcm_signal_unknown", "observations left out", unknown, file)
    stations = Counter(cells.column("station", np.int64).tolist())
    own = stations.most_common(1)[0][0] if stations else 0
    if len(stations) > 1:
        others = {f"of {number}": count for number, count in sorted(stations.items()) if number != own}
        what = f"observations of station {own} are used; those of others left out"
        events += listed("rtcm_other_station", what, others, file)
    range_m, rate_mps = (cells.column(name, np.float64) for name in ("range_m", "rate_mps"))
    has_value = np.isfinite(range_m) | np.isfinite(rate_mps)
    rows = np.flatnonzero((cells.column("station", np.int64) == own) & has_value).astype(np.int64)
    t_ns, rank = (cells.column(name, np.int64)[rows] for name in ("t_ns", "rank"))
    sv, code = (cells.column(name, "U3")[rows] for name in ("sv", "code"))
    order = np.lexsort((-rank, code, sv, t_ns))
    again = np.zeros(len(rows), np.bool_)
    if len(rows):
        one, other = order[1:], order[:-1]
        again[1:] = (t_ns[one] == t_ns[other]) & (sv[one] == sv[other]) & (code[one] == code[other])
    what = "observation(s) sent again in another message left out, the coarser ones"
    return rows[order[~again]], events + counted("rtcm_repeated", again, what, file)


def _unwrapped(cycles: Float64, range_cycles: Float64, track: Float64) -> Float64:
    """Return the phases of tracks, sent against the range modulo 1500 cycles, without the wraps."""
    out = cycles.copy()
    for number in np.unique(track[track >= 0]):
        rows = np.flatnonzero((track == number) & np.isfinite(cycles))
        off = cycles[rows] - range_cycles[rows]
        out[rows] += np.unwrap(off, period=_PHASE_CYCLE) - off
    return out
