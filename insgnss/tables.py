"""The tables that flow through the package: frozen records of arrays, time first, component last.

``log`` fills them, ``gnss`` and ``filter`` read them. Time is GPS time in integer nanoseconds (``insgnss.gpstime``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import numpy.typing as npt

Int64 = npt.NDArray[np.int64]
Int16 = npt.NDArray[np.int16]
Int8 = npt.NDArray[np.int8]
Float64 = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]
Complex = npt.NDArray[np.complex128]

# Bits of the loss-of-lock indicator: a cycle slip, an open half cycle (RINEX 3.05, table A3; 4.01, 6.5.2)
LLI_SLIP: Final = 1
LLI_HALF_CYCLE: Final = 2
_SAME_TIME_NS: Final = 200_000_000  # within which readings of two sensors count as of one time


def stretches_of(flags: Bool) -> Int64:
    """Return the first index and the end of each unbroken stretch of True, (k, 2)."""
    return np.flatnonzero(np.diff(flags, prepend=False, append=False)).reshape(-1, 2)


def rms(values: Float64) -> float:
    """Return the root mean square, NaN where there are no values."""
    return math.sqrt(float(np.mean(values**2))) if values.size else math.nan


@dataclass(frozen=True)
class Event:
    """An event: when (None if it concerns a whole file), what kind, and the details in words."""

    t_ns: int | None
    kind: str
    detail: str


@dataclass(frozen=True)
class ImuTable:
    """Inertial samples in body axes (forward-right-down), strictly increasing in time, all values finite.

    Sample k holds the mean over the interval (t_ns[k-1], t_ns[k]].
    """

    t_ns: Int64  # (n,) end of the sample's interval
    w_ib_b: Float64  # (n, 3) mean angular rate [rad/s]
    f_b: Float64  # (n, 3) mean specific force [m/s^2]


@dataclass(frozen=True)
class GnssTable:
    """Raw observations, one row per satellite, signal and epoch, sorted by epoch (stable within an epoch).

    ``sv`` and ``signal`` are indices into ``sv_names`` ("G05") and ``signal_names`` (RINEX codes, "C1C"). An empty cell
    is NaN. ``sat`` is present when the log itself carries satellite states.
    """

    t_ns: Int64  # (n,) receiver time tag
    sv: Int16  # (n,)
    signal: Int16  # (n,)
    pseudorange_m: Float64  # (n,)
    doppler_hz: Float64  # (n,) RINEX sign: positive when the distance shrinks
    range_rate_mps: Float64  # (n,) positive when the distance grows; NaN where only Doppler was logged
    cn0_dbhz: Float64  # (n,)
    sv_names: tuple[str, ...]
    signal_names: tuple[str, ...]
    # (n, 8) x y z [m], vx vy vz [m/s] ECEF at transmit time, clock [m], drift [m/s]
    sat: Float64 | None = None
    sigma_pseudorange_m: Float64 | None = None  # (n,) where the log states it
    sigma_range_rate_mps: Float64 | None = None  # (n,)
    # rows with an unreadable range or rate
    bad_cells: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    # (n,) carrier phase, RINEX sign: grows with the distance; NaN without
    carrier_cycles: Float64 | None = None
    # (n,) loss-of-lock indicator as in RINEX: bit 0 slip, bit 1 half cycle unresolved
    lli: Int8 | None = None
    glonass_channels: dict[str, int] = field(default_factory=dict)  # if the log states it: "R07" -> -7..6

    def later(self, added_ns: int | Int64) -> GnssTable:
        """Return the table with so much added to its tags: one number, or one for each row."""
        return replace(self, t_ns=self.t_ns + added_ns)

    def take(self, rows: npt.NDArray[np.intp] | slice) -> GnssTable:
        """Return the given rows, in the given order, of a slice without copying; ``bad_cells`` follows its rows."""
        flagged = np.zeros(len(self.t_ns), np.bool_)
        flagged[self.bad_cells] = True
        return replace(
            self,
            t_ns=self.t_ns[rows],
            sv=self.sv[rows],
            signal=self.signal[rows],
            pseudorange_m=self.pseudorange_m[rows],
            doppler_hz=self.doppler_hz[rows],
            range_rate_mps=self.range_rate_mps[rows],
            cn0_dbhz=self.cn0_dbhz[rows],
            sat=None if self.sat is None else self.sat[rows],
            sigma_pseudorange_m=None if self.sigma_pseudorange_m is None else self.sigma_pseudorange_m[rows],
            sigma_range_rate_mps=None
            if self.sigma_range_rate_mps is None
            else self.sigma_range_rate_mps[rows],
            bad_cells=np.flatnonzero(flagged[rows]).astype(np.int64),
            carrier_cycles=None if self.carrier_cycles is None else self.carrier_cycles[rows],
            lli=None if self.lli is None else self.lli[rows],
        )


@dataclass(frozen=True)
class EphemerisTable:
    """Broadcast ephemerides of the Keplerian kind, one row per message, SI units and radians, times in GPS ns."""

    sv_names: tuple[str, ...]  # of each row
    message: tuple[str, ...]  # of each row: "LNAV", "CNAV", "INAV", "FNAV", "D1", "D2"
    toe_ns: Int64
    toc_ns: Int64
    toe_sow_s: Float64  # seconds of the system's own week, for the node's longitude
    af0: Float64  # [s]
    af1: Float64  # [s/s]
    af2: Float64  # [s/s^2]
    sqrt_a: Float64  # [sqrt(m)]
    e: Float64
    i0: Float64
    omega0: Float64
    omega: Float64
    m0: Float64
    delta_n: Float64
    omega_dot: Float64
    idot: Float64
    cuc: Float64
    cus: Float64
    crc: Float64
    crs: Float64
    cic: Float64
    cis: Float64
    group_delay_s: Float64  # (n, 2) TGD; BGD E5a/E1, E5b/E1; TGD1 (B1I), TGD2 (B2I)
    health: Float64  # 0 is healthy
    accuracy_m: Float64  # URA or SISA [m], NaN when not given
    issue: Float64  # IODE, IODnav or AODE
    fit_interval_s: Float64  # the whole interval centred on toe [s], NaN when not given


@dataclass(frozen=True)
class StateVectorTable:
    """Broadcast states to be integrated (GLONASS, SBAS), one row per message, SI units, times in GPS ns.

    Positions are in the system's Earth-fixed frame (GLONASS: PZ-90.11, equal to WGS-84 to centimetres).
    """

    sv_names: tuple[str, ...]  # of each row: "R07", "S23"
    t_ns: Int64  # (n,) reference time of state and clock
    r_e: Float64  # (n, 3) [m]
    v_e: Float64  # (n, 3) [m/s]
    a_e: Float64  # (n, 3) [m/s^2]; GLONASS: luni-solar part alone
    clock_s: Float64  # (n,) -tau_n: to be added to the satellite's time, as af0
    clock_rate: Float64  # (n,) gamma_n, as af1
    group_delay_s: Float64  # (n,) delta tau_n: L2 later than L1; NaN when not given
    health: Float64  # (n,) 0 is healthy
    channel: Int16  # (n,) GLONASS frequency channel, -7..6; -128 when not known


@dataclass(frozen=True)
class NavigationData:
    """What navigation files give: ephemerides, ionosphere coefficients, leap seconds."""

    ephemerides: EphemerisTable
    klobuchar: Float64 | None  # (8,) alpha 0..3, beta 0..3 [s, s/semicircle, ...] of GPS
    leap_seconds: int | None
    state_vectors: StateVectorTable | None = None
    # further coefficients: "beidou" (8,) alpha, beta; "galileo" (3,) a_i0, a_i1, a_i2; "qzss" and "navic" (8,)
    ionosphere: dict[str, Float64] = field(default_factory=dict)
    # (6,) of each satellite that sent CNAV: inter-signal corrections of L1 C/A, L2C, L5I, L5Q, L1C data, L1C pilot [s],
    # NaN where not given; (dt)signal = dt - TGD + correction
    inter_signal_s: dict[str, Float64] = field(default_factory=dict)

    @property
    def has_messages(self) -> bool:
        """Whether there is a message of any satellite; ionosphere coefficients may stand alone."""
        states = self.state_vectors
        return bool(len(self.ephemerides.sv_names)) or (states is not None and bool(len(states.sv_names)))


@dataclass(frozen=True)
class PreciseProducts:
    """Orbits and clocks computed afterwards (SP3, RINEX clock), NaN where a product has a gap."""

    sv_names: tuple[str, ...]
    orbit_ns: Int64  # (m,) GPS time of the orbit nodes, strictly increasing
    r_e: Float64  # (s, m, 3) position of the centre of mass (of the antenna after its offset was applied), ECEF [m]
    clock_ns: Int64  # (k,) GPS time of the clock nodes, strictly increasing
    clock_s: Float64  # (s, k) satellite clock without the relativistic term of the orbit's eccentricity [s]


@dataclass(frozen=True)
class ReferenceTable:
    """A reference trajectory; missing attitude is NaN. ``quality``: 1 good, 2 do not score tightly."""

    t_ns: Int64  # (n,)
    lat_deg: Float64
    lon_deg: Float64
    h_m: Float64
    v_n: Float64  # (n, 3) [m/s]
    rpy_deg: Float64  # (n, 3) roll, pitch, yaw
    quality: Float64
    # (n, 9) of position north, east, down [m], velocity [m/s], roll, pitch, yaw [deg], where stated
    sigma: Float64 | None = None


@dataclass(frozen=True)
class SensorTable:
    """The readings of a further sensor, strictly increasing in time; NaN where a cell holds none.

    | kind | values |
    |---|---|
    | odometer | speed [m/s] |
    | barometer | pressure altitude [m] |
    | magnetometer | field, body axes [uT] |
    | heading | [rad] from true north |
    | attitude | roll, pitch, yaw of the body [rad] |
    | position | latitude, longitude [rad], height above the ellipsoid [m] |
    | velocity | north, east, down [m/s] |
    """

    name: str
    t_ns: Int64  # (n,)
    values: Float64  # (n, k)
    # (n, s) of the values, of positions north, east, down [m]; NaN where not stated, s = 0 for a magnetometer
    sigma: Float64

    def at_times(self, t_ns: Int64) -> tuple[Float64, Float64]:
        """Return the values (m, k) and sigmas (m, s) read nearest to times (m,); NaN where none is within 0.2 s."""
        after = np.clip(np.searchsorted(self.t_ns, t_ns), 0, len(self.t_ns) - 1)
        before = np.maximum(after - 1, 0)
        nearest = np.where(t_ns - self.t_ns[before] <= self.t_ns[after] - t_ns, before, after)
        near = np.abs(self.t_ns[nearest] - t_ns)[:, None] <= _SAME_TIME_NS
        values, sigma = (np.where(near, each[nearest], np.nan) for each in (self.values, self.sigma))
        return values, sigma
