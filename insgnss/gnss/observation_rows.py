"""The GNSS log for the filter: satellite states for each observation, and the unused rows with their reasons.

Everything here is done for the whole log at once, before the filter's loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS, SYSTEMS
from insgnss.gnss.carrier_rows import ABSENT as ABSENT
from insgnss.gnss.carrier_rows import carrier_rows, no_carriers
from insgnss.gnss.clock_groups import group_of_rows
from insgnss.gnss.ionosphere_free import combine_pseudoranges
from insgnss.gnss.measurement_kinds import CARRIER as CARRIER
from insgnss.gnss.measurement_kinds import N_KINDS as N_KINDS
from insgnss.gnss.measurement_kinds import PSEUDORANGE as PSEUDORANGE
from insgnss.gnss.measurement_kinds import RANGE_RATE as RANGE_RATE
from insgnss.gnss.noise_model import thermal_factor
from insgnss.gnss.orbits.ephemeris_choice import BroadcastMessages, broadcast_messages
from insgnss.gnss.orbits.satellite_state import (
    SatelliteStates,
    glonass_channels,
    range_rates,
    satellite_states,
    status_of_given,
)
from insgnss.gnss.signal_weakness import weakness_db
from insgnss.gnss.signals import L1_HZ, SIGNALS, carrier_hz, signal_of
from insgnss.kernels.jit import kernel
from insgnss.kernels.records import Record, dtype_of
from insgnss.status import (
    BAD_SIGMA,
    BAD_VALUE,
    CONSTELLATION_NOT_USED,
    DUPLICATE,
    NO_CORRECTION,
    NO_EPHEMERIS,
    SIGNAL_NOT_USED,
    SWITCHED_OFF,
    USED,
)
from insgnss.tables import Bool, EphemerisTable, Float64, GnssTable, Int8, Int64, NavigationData

_SLOTS_EACH: Final = 64
_BANDS: Final = sorted({signal.band for signal in SIGNALS})
N_BANDS: Final = len(_BANDS)
N_SATELLITE_SLOTS: Final = _SLOTS_EACH * len(SYSTEMS)
N_SLOTS: Final = N_SATELLITE_SLOTS * N_BANDS
# pseudoranges outside cannot be ranges to a satellite, whatever the clock
_CLOSEST_M, _FARTHEST_M = 1.0e5, 1.0e9
_FASTEST_MPS = 2.0e4
# a stated sigma beyond is a filler for "not known", and its square would swamp the covariance
_WIDEST_SIGMA: Final = (1.0e6, 1.0e5)  # [m], [m/s]
MOST_CN0_DBHZ: Final = 100.0  # no antenna and no simulator gives more: beyond, it counts as not logged


class Observation(Record):
    """One row of the log: a satellite and signal at an epoch."""

    value: Annotated[Float64, 2]  # pseudorange [m], range rate [m/s]
    sigma: Annotated[npt.NDArray[np.float32], 2]  # stated by the log, NaN elsewhere
    cn0: Annotated[float, np.float32]  # [dBHz], NaN where not logged
    thermal: Annotated[float, np.float32]  # thermal variance relative to 45 dBHz
    weakness: Annotated[float, np.float32]  # C/N0 below that of free signals [dB], see ``signal_weakness``
    ionosphere_factor: float  # (f_L1 / f)^2 of the pseudorange
    phase_factor: float  # of carrier and Doppler, which no combination touches
    ionosphere_m: Annotated[float, np.float32]  # delay on L1 at the antenna, NaN where the filter computes it
    ionosphere_rate: Annotated[float, np.float32]  # its growth [m/s], zero where the filter computes it
    variance_scale: Annotated[float, np.float32]  # of the pseudorange's variance
    bias_sigma: Annotated[float, np.float32]  # of the satellite's slow range error [m]; 0: it has none
    sv: Annotated[int, np.int16]  # index into the log's satellite names
    # number of the satellite's band in any log, below N_SLOTS; over N_BANDS its own
    slot: Annotated[int, np.int16]
    group: Annotated[int, np.int8]  # clock: 0 the reference, 1.. the others
    channel: Annotated[int, np.int8]  # GLONASS frequency channel, 0 for all others
    # per kind: USED when the filter may try it, ABSENT, or why not
    status: Annotated[Int8, 2]
    no_satellite: Annotated[int, np.int8]  # 1: no satellite state, nothing can be predicted


OBSERVATION_DTYPE: Final = dtype_of(Observation, align=True)
Observations: TypeAlias = npt.NDArray[Any]  # (n,) of OBSERVATION_DTYPE


class GnssRows(NamedTuple):
    """One row per observation, in the order of the log; epochs are runs of rows. Read-only to the filter."""

    epoch_ns: Int64  # (m,) receiver time tag
    first: Int64  # (m + 1,) first row of each epoch
    observation: npt.NDArray[Any]  # (n,) of OBSERVATION_DTYPE
    sat: Float64  # (n, 8) x y z vx vy vz ECEF at transmit time, clock [m], clock drift [m/s]
    klobuchar: Float64  # (8,)
    # (n,) of CARRIER_DTYPE: carrier phase less that of the epoch before; (0,) without carrier
    carrier: npt.NDArray[Any]
    before: Float64  # (n, 8) as ``sat``, at the epoch before; (0, 8) without carrier
    before_ns: Int64  # (m,) time tag of the epoch before each epoch; 0 for the first


@np.errstate(over="ignore", invalid="ignore")  # a wild cell is refused by its status
def prepare_rows(
    gnss: GnssTable,
    navigation: EphemerisTable | NavigationData | BroadcastMessages | None,
    klobuchar: Float64 | None,
    *,
    clock_groups: tuple[str, ...],
    signals: Mapping[str, tuple[str, ...]],
    every_band: bool = False,
    pseudorange: bool = True,
    range_rate: bool = True,
    carrier: bool | None = None,
    carrier_max_interval_s: float = 2.0,
    ionosphere_free: bool = False,
    max_age_s: float | None = None,
    states: SatelliteStates | None = None,
    ionosphere_l1: Float64 | None = None,
    correction_m: Float64 | None = None,
    variance_scale: Mapping[str, float] | None = None,
    slow_sigma_m: Mapping[str, float] | None = None,
) -> GnssRows:
    """Return the rows of a log with satellite states and the status each starts with.

    Parameters
    ----------
    gnss : the log
    navigation : None when the log carries satellite states
    klobuchar : (8,) coefficients or None
    clock_groups : groups of ``gnss.clock_groups``, the reference of the receiver clock first
    signals : per constellation the codes that may be used, the preferred first
    every_band : one signal of each band of a satellite is used, not the most preferred one alone
    pseudorange, range_rate : whether the kind is used at all
    carrier : whether carrier differences are used; None: they are ignored, and get no entry in the ledger
    carrier_max_interval_s : epochs farther apart are not differenced
    ionosphere_free : the pseudoranges of two bands of a satellite become their ionosphere-free combination
    max_age_s : oldest ephemeris to use; the constellation's own validity when None
    states : of the satellites, where another source than the messages gives them
    ionosphere_l1 : (n, 2) delays on L1 [m] and their growth [m/s] where they are computed beforehand, NaN elsewhere
    correction_m : (n,) taken off the pseudoranges; a row with NaN is refused
    variance_scale : per constellation, of its pseudoranges' variance
    slow_sigma_m : per constellation, of its satellites' slow range errors; None if there are none
    """
    if isinstance(navigation, EphemerisTable | NavigationData):
        navigation = broadcast_messages(navigation, max_age_s=max_age_s)
    sat, of_state, message = _states(gnss, navigation, states)
    epoch_ns, first = np.unique(gnss.t_ns, return_index=True)
    first = np.append(first, len(gnss.t_ns)).astype(np.int64)
    channels = glonass_channels(gnss, navigation)
    carrier_of = _by_signal(gnss, lambda sv, code: carrier_hz(sv[0], code, channels.get(sv)))
    group = group_of_rows(gnss, clock_groups, signals)
    usable = _usable(gnss, group, of_state, signals, every_band)
    observation = np.zeros(len(gnss.t_ns), OBSERVATION_DTYPE)
    observation["sv"] = gnss.sv
    observation["slot"] = _by_signal(gnss, _slot)
    observation["group"] = np.maximum(group, 0)
    observation["channel"] = _by_signal(gnss, lambda sv, _: channels.get(sv, 0) if sv[0] == "R" else 0)
    observation["ionosphere_m"] = math.nan if ionosphere_l1 is None else ionosphere_l1[:, 0]
    observation["ionosphere_rate"] = 0.0 if ionosphere_l1 is None else np.nan_to_num(ionosphere_l1[:, 1])
    observation["variance_scale"] = _by_constellation(gnss, variance_scale, 1.0)
    observation["bias_sigma"] = _by_constellation(gnss, slow_sigma_m, 0.0)
    observation["no_satellite"] = ~np.isfinite(sat[:, 0])
    _write_strength(observation, gnss.cn0_dbhz, usable == USED, first)
    factor = (L1_HZ / carrier_of) ** 2
    observation["ionosphere_factor"] = observation["phase_factor"] = np.where(np.isnan(factor), 1.0, factor)
    rates = range_rates(gnss, channels)
    for kind, value, sigma, wanted in (
        (PSEUDORANGE, gnss.pseudorange_m, gnss.sigma_pseudorange_m, pseudorange),
        (RANGE_RATE, rates, gnss.sigma_range_rate_mps, range_rate),
    ):
        absent = np.isnan(value)
        if kind == RANGE_RATE:  # a Doppler of unknown wavelength still counts as a measurement
            absent &= np.isnan(gnss.doppler_hz)
        status = _kind_status(kind, value, absent, usable, sigma, wanted)
        if kind == RANGE_RATE:
            moves = np.isfinite(sat[:, 3] + sat[:, 4] + sat[:, 5] + sat[:, 7])
            status[(status == USED) & ~moves] = NO_EPHEMERIS
        bad = gnss.bad_cells
        status[bad] = np.where(np.isfinite(value[bad]), status[bad], BAD_VALUE)
        observation["value"][:, kind] = value
        observation["sigma"][:, kind] = math.nan if sigma is None else sigma
        observation["status"][:, kind] = status
    carriers, before = no_carriers()
    if carrier is not None:
        carriers, before = carrier_rows(
            gnss, usable, sat, message, C_MPS / carrier_of, rates,
            epoch_ns=epoch_ns, first=first, max_interval_s=carrier_max_interval_s, wanted=carrier,
        )  # fmt: skip
    if correction_m is not None:
        apply_corrections(observation, correction_m)
    if ionosphere_free:
        sat = combine_pseudoranges(observation, sat, carrier_of, first)
    return GnssRows(
        epoch_ns=epoch_ns,
        first=first,
        observation=observation,
        sat=sat,
        klobuchar=np.zeros(8) if klobuchar is None else np.asarray(klobuchar, dtype=np.float64),
        carrier=carriers,
        before=before,
        before_ns=np.concatenate([[0], epoch_ns])[:-1].astype(np.int64),
    )


def _write_strength(observation: npt.NDArray[Any], cn0_dbhz: Float64, usable: Bool, first: Int64) -> None:
    """Write C/N0 and what follows from it; the rows have their slots. Rows that no kind uses make no other weak."""
    observation["cn0"] = cn0 = np.where(np.abs(cn0_dbhz) <= MOST_CN0_DBHZ, cn0_dbhz, math.nan)
    observation["thermal"] = thermal_factor(cn0)
    strength = np.where(usable, cn0, math.nan)
    observation["weakness"] = weakness_db(strength, observation["slot"] % N_BANDS, first)


def apply_corrections(observation: npt.NDArray[Any], correction_m: Float64) -> None:
    """Take corrections (n,) [m] off the pseudoranges; a usable one without a correction becomes NO_CORRECTION."""
    known = np.isfinite(correction_m)
    observation["value"][known, PSEUDORANGE] -= correction_m[known]
    status = observation["status"][:, PSEUDORANGE]
    observation["status"][:, PSEUDORANGE] = np.where((status == USED) & ~known, NO_CORRECTION, status)


def from_epoch(rows: GnssRows, epoch: int) -> GnssRows:
    """Return the rows from an epoch on, with the data of the epoch before that the carrier differences need."""
    if epoch <= 0:
        return rows
    part = some_epochs(rows, epoch, len(rows.epoch_ns))
    return GnssRows(**{name: array.copy() for name, array in part._asdict().items()})


def one_epoch(rows: GnssRows, epoch: int) -> GnssRows:
    """Return the rows of one epoch; they share their memory with ``rows``."""
    return some_epochs(rows, epoch, epoch + 1)


def some_epochs(rows: GnssRows, begin: int, end: int) -> GnssRows:
    """Return the rows of the epochs ``begin`` to ``end - 1``; they share their memory with ``rows``."""
    first, last = int(rows.first[begin]), int(rows.first[end])
    part = slice(first, last) if len(rows.carrier) else slice(0, 0)
    return GnssRows(
        epoch_ns=rows.epoch_ns[begin:end],
        first=rows.first[begin : end + 1] - first,
        observation=rows.observation[first:last],
        sat=rows.sat[first:last],
        klobuchar=rows.klobuchar,
        carrier=rows.carrier[part],
        before=rows.before[part],
        before_ns=rows.before_ns[begin:end],
    )


def joined_epochs(parts: Sequence[GnssRows]) -> GnssRows:
    """Return the rows of successive parts of a log as one.

    The parts have the same broadcast ionosphere, and carriers either in all or in none.
    """

    def column(name: str) -> npt.NDArray[Any]:
        arrays = [getattr(part, name) for part in parts]
        return np.concatenate(arrays, dtype=arrays[0].dtype)

    names = [name for name in GnssRows._fields if name not in ("first", "klobuchar")]
    counts = np.concatenate([np.diff(part.first) for part in parts])
    first = np.concatenate(([0], np.cumsum(counts)))
    return GnssRows(**{name: column(name) for name in names}, first=first, klobuchar=parts[0].klobuchar)


def satellite_name(number: int) -> str:
    """Return the name of a satellite by its number in any log, slot over ``N_BANDS``."""
    return f"{SYSTEMS[number // _SLOTS_EACH]}{number % _SLOTS_EACH:02d}"


def _slot(sv: str, code: str) -> int:
    # an unknown constellation is refused before its slot is checked
    system = max(SYSTEMS.find(sv[0]), 0)
    return (system * _SLOTS_EACH + int(sv[1:]) % _SLOTS_EACH) * N_BANDS + _band_number(sv, code)


def _usable(
    gnss: GnssTable, group: Int64, of_state: Int8, signals: Mapping[str, tuple[str, ...]], every_band: bool
) -> Int8:
    """Return for each row USED, or why neither of its measurements can be used."""
    choice = _signal_choice(gnss, signals)
    usable = np.where(choice < 0, np.int8(SIGNAL_NOT_USED), of_state)
    usable[group < 0] = CONSTELLATION_NOT_USED
    refused_twice = _refused_twice(gnss, np.where(usable == USED, choice, -1), every_band)
    again = (usable == USED) & (refused_twice > 0)
    usable[again] = refused_twice[again]
    return usable


def _by_constellation(gnss: GnssTable, given: Mapping[str, float] | None, otherwise: float) -> Float64:
    """Return a number for each row by its constellation."""
    return _by_signal(gnss, lambda sv, _: (given or {}).get(sv[0], otherwise))


def _by_signal(gnss: GnssTable, value: Callable[[str, str], float]) -> Float64:
    """Return (n,) a function of satellite and code for each row."""
    table = np.zeros((max(len(gnss.sv_names), 1), max(len(gnss.signal_names), 1)))
    for i, sv in enumerate(gnss.sv_names):
        for j, code in enumerate(gnss.signal_names):
            table[i, j] = value(sv, code)
    return np.asarray(table[gnss.sv, gnss.signal])


def _states(
    gnss: GnssTable, messages: BroadcastMessages | None, states: SatelliteStates | None
) -> tuple[Float64, Int8, Int64 | None]:
    """Return position, velocity, clock and its drift (n, 8), the reason if missing, and the messages used.

    States in the log are not copied if all of them are good: an hour of a big log has 70 MB of them.
    """
    if gnss.sat is not None:
        status = status_of_given(gnss.sat).astype(np.int8)
        given = status == USED
        if messages is None or not (status == NO_EPHEMERIS).any():
            sat = np.require(gnss.sat, np.float64, ("C", "W"))
            return (sat if given.all() else np.where(given[:, None], sat, math.nan)), status, None
    states = satellite_states(gnss, messages) if states is None else states
    sat = np.column_stack([states.position, states.velocity, states.clock_m, states.drift_mps])
    return sat, states.status.astype(np.int8), states.message


def _signal_choice(gnss: GnssTable, signals: Mapping[str, tuple[str, ...]]) -> Int64:
    """Return each row's rank in its constellation's list of signals, -1 where the signal is not in it."""
    rank = np.full((max(len(gnss.sv_names), 1), max(len(gnss.signal_names), 1)), -1, np.int64)
    for i, sv in enumerate(gnss.sv_names):
        for j, code in enumerate(gnss.signal_names):
            wanted = signals.get(sv[0], ())
            if code in wanted:
                rank[i, j] = wanted.index(code)
    return np.asarray(rank[gnss.sv, gnss.signal])


def _kind_status(
    kind: int,
    value: Float64,
    absent: Bool,
    usable: Int8,
    sigma: Float64 | None,
    wanted: bool,
) -> Int8:
    """Return the starting status of one kind: absent, the row's own reason, or a bad value or sigma."""
    if kind == PSEUDORANGE:
        good = (value >= _CLOSEST_M) & (value <= _FARTHEST_M)
    else:
        good = np.abs(value) <= _FASTEST_MPS
    status = usable.copy()
    status[(usable == USED) & ~good] = BAD_VALUE
    if sigma is not None:
        status[(status == USED) & ((sigma <= 0.0) | (sigma > _WIDEST_SIGMA[kind]))] = BAD_SIGMA
    if not wanted:
        status[status == USED] = SWITCHED_OFF
    status[absent] = ABSENT
    return status


@kernel
def mark_repeats(
    t_ns: Int64, slot: Int64, signal: Int64, choice: Int64, n_slots: int, refused: Int64
) -> None:
    """Write DUPLICATE for a satellite's repeated signal, SIGNAL_NOT_USED for its less preferred ones, per epoch.

    ``slot`` numbers what can be used once in an epoch: a satellite, or a band of a satellite.
    """
    best = np.full(n_slots, -1, np.int64)  # row that represents the slot in this epoch
    start = 0
    for i in range(len(t_ns)):
        if i > 0 and t_ns[i] != t_ns[i - 1]:
            for k in range(start, i):
                best[slot[k]] = -1
            start = i
        if choice[i] < 0:
            continue
        other = best[slot[i]]
        if other < 0:
            best[slot[i]] = i
        elif signal[i] == signal[other]:
            refused[i] = DUPLICATE
        elif choice[i] < choice[other]:
            refused[other] = SIGNAL_NOT_USED
            best[slot[i]] = i
        else:
            refused[i] = SIGNAL_NOT_USED


def _refused_twice(gnss: GnssTable, choice: Int64, every_band: bool) -> Int64:
    """Return, for rows of satellites that stand several times in an epoch, why all but one are refused; 0 elsewhere."""
    refused = np.zeros(len(gnss.t_ns), np.int64)
    slot, n_slots = gnss.sv.astype(np.int64), len(gnss.sv_names)
    if every_band:
        slot, n_slots = slot * N_BANDS + _by_signal(gnss, _band_number).astype(np.int64), n_slots * N_BANDS
    mark_repeats(gnss.t_ns, slot, gnss.signal.astype(np.int64), choice, n_slots, refused)
    return refused


def _band_number(sv: str, code: str) -> int:
    signal = signal_of(sv[0], code)
    return 0 if signal is None else _BANDS.index(signal.band)
