"""The GNSS log as the filter sees it: satellite states beside each observation, and what is not used, with the reason.

Everything here is done for the whole log at once, before the filter's loop.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from insgnss.gnss.ephemeris_choice import BroadcastMessages
from insgnss.gnss.noise_model import thermal_factor
from insgnss.gnss.satellite_state import range_rates, satellite_states, states_given
from insgnss.gnss.signals import L1_HZ, signal_of
from insgnss.jit import kernel
from insgnss.status import (
    BAD_SIGMA,
    BAD_VALUE,
    CONSTELLATION_NOT_USED,
    DUPLICATE,
    NO_EPHEMERIS,
    SIGNAL_NOT_USED,
    SWITCHED_OFF,
    USED,
)
from insgnss.tables import EphemerisTable, Float64, GnssTable, Int64

PSEUDORANGE, RANGE_RATE = 0, 1
ABSENT = -1  # the log has no value of this kind in the row: no entry in the ledger
_CLOSEST_M, _FARTHEST_M = (
    1.0e5,
    1.0e9,
)  # pseudoranges outside are no ranges to a satellite, whatever the clock
_FASTEST_MPS = 2.0e4


Int8: TypeAlias = npt.NDArray[np.int8]
OBSERVATION_DTYPE: Final = np.dtype(
    (
        np.record,
        np.dtype(
            [
                ("value", np.float64, (2,)),  # pseudorange [m], range rate [m/s]
                ("sigma", np.float64, (2,)),  # stated by the log, NaN elsewhere
                ("cn0", np.float64),  # [dBHz], NaN where not logged
                ("thermal", np.float64),  # thermal variance relative to 45 dBHz
                ("ionosphere_factor", np.float64),  # (f_L1 / f)^2
                ("sv", np.int16),  # index into the log's satellite names
                ("group", np.int8),  # clock: 0 reference constellation, 1.. the others
                ("status", np.int8, (2,)),  # per kind: USED when the filter may try it, ABSENT, or why not
                ("no_satellite", np.int8),  # 1: no satellite state, nothing can be predicted
            ],
            align=True,
        ),
    )
)
Observation: TypeAlias = Any  # one element of OBSERVATION_DTYPE


class Rows(NamedTuple):
    """One row per observation, in the order of the log; epochs are runs of rows. Read-only to the filter."""

    epoch_ns: Int64  # (m,) receiver time tag
    first: Int64  # (m + 1,) first row of each epoch
    observation: npt.NDArray[Any]  # (n,) of OBSERVATION_DTYPE
    sat: Float64  # (n, 8) x y z vx vy vz ECEF at transmit time, clock [m], clock drift [m/s]
    klobuchar: Float64  # (8,)


def prepare_rows(
    gnss: GnssTable,
    ephemerides: EphemerisTable | BroadcastMessages | None,
    klobuchar: Float64 | None,
    *,
    clock_groups: tuple[str, ...],
    signals: dict[str, tuple[str, ...]],
    pseudorange: bool = True,
    range_rate: bool = True,
    max_age_s: float | None = None,
) -> Rows:
    """Return the rows of a log with satellite states and the status each starts with.

    Parameters
    ----------
    gnss : the log
    ephemerides : None when the log carries satellite states
    klobuchar : (8,) coefficients or None
    clock_groups : constellations used, the reference of the receiver clock first
    signals : per constellation the codes that may be used, the preferred first
    pseudorange, range_rate : whether the kind is used at all
    max_age_s : oldest ephemeris to use; the constellation's own validity when None
    """
    sat, of_state = _states(gnss, ephemerides, max_age_s)
    epoch_ns, first = np.unique(gnss.t_ns, return_index=True)
    group = _groups(gnss, clock_groups)
    choice = _signal_choice(gnss, signals)
    usable = np.where(choice < 0, np.int8(SIGNAL_NOT_USED), of_state)
    usable[group < 0] = CONSTELLATION_NOT_USED
    refused_twice = _refused_twice(gnss, np.where(usable == USED, choice, -1))
    again = (usable == USED) & (refused_twice > 0)
    usable[again] = refused_twice[again]
    observation = np.zeros(len(gnss.t_ns), OBSERVATION_DTYPE)
    observation["sv"] = gnss.sv
    observation["group"] = np.maximum(group, 0)
    observation["no_satellite"] = ~np.isfinite(sat[:, 0])
    observation["cn0"] = gnss.cn0_dbhz
    observation["thermal"] = thermal_factor(gnss.cn0_dbhz)
    observation["ionosphere_factor"] = _ionosphere_factors(gnss)
    for kind, value, sigma, wanted in (
        (PSEUDORANGE, gnss.pseudorange_m, gnss.sigma_pseudorange_m, pseudorange),
        (RANGE_RATE, range_rates(gnss), gnss.sigma_range_rate_mps, range_rate),
    ):
        status = _kind_status(kind, value, usable, sigma, wanted)
        bad = gnss.bad_cells
        status[bad] = np.where(np.isfinite(value[bad]), status[bad], BAD_VALUE)
        observation["value"][:, kind] = value
        observation["sigma"][:, kind] = math.nan if sigma is None else sigma
        observation["status"][:, kind] = status
    return Rows(
        epoch_ns=epoch_ns,
        first=np.append(first, len(gnss.t_ns)).astype(np.int64),
        observation=observation,
        sat=sat,
        klobuchar=np.zeros(8) if klobuchar is None else np.asarray(klobuchar, dtype=np.float64),
    )


def _states(
    gnss: GnssTable, ephemerides: EphemerisTable | BroadcastMessages | None, max_age_s: float | None
) -> tuple[Float64, Int8]:
    """Return position, velocity, clock and its drift (n, 8), NaN where there is no satellite, and why there is none.

    States that stand in the log are not copied where all of them are good: an hour of a big log has 70 MB of them.
    """
    if gnss.sat is None:
        states = satellite_states(gnss, ephemerides, max_age_s=max_age_s)
        sat = np.column_stack([states.position, states.velocity, states.clock_m, states.drift_mps])
        return sat, states.status.astype(np.int8)
    given = states_given(gnss.sat)
    sat = np.require(gnss.sat, np.float64, ("C", "W"))
    if not given.all():
        sat = np.where(given[:, None], sat, math.nan)
    return sat, np.where(given, np.int8(USED), np.int8(NO_EPHEMERIS))


def _groups(gnss: GnssTable, clock_groups: tuple[str, ...]) -> Int64:
    """Return the clock group of each row, -1 where its constellation is not used; QZSS keeps GPS's time."""
    order = {letter: i for i, letter in enumerate(clock_groups)}
    if "G" in order:
        order.setdefault("J", order["G"])
    by_name = np.array([order.get(name[0], -1) for name in gnss.sv_names] or [0], np.int64)
    return np.asarray(by_name[gnss.sv])


def _signal_choice(gnss: GnssTable, signals: dict[str, tuple[str, ...]]) -> Int64:
    """Return each row's rank in its constellation's list of signals, -1 where the signal is not in it."""
    rank = np.full((max(len(gnss.sv_names), 1), max(len(gnss.signal_names), 1)), -1, np.int64)
    for i, sv in enumerate(gnss.sv_names):
        for j, code in enumerate(gnss.signal_names):
            wanted = signals.get(sv[0], ())
            if code in wanted:
                rank[i, j] = wanted.index(code)
    return np.asarray(rank[gnss.sv, gnss.signal])


def _ionosphere_factors(gnss: GnssTable) -> Float64:
    """Return (f_L1 / f)^2 of each row, 1 for unknown signals."""
    factor = np.ones((max(len(gnss.sv_names), 1), max(len(gnss.signal_names), 1)))
    for i, sv in enumerate(gnss.sv_names):
        for j, code in enumerate(gnss.signal_names):
            signal = signal_of(sv[0], code)
            if signal is not None:
                factor[i, j] = (L1_HZ / signal.carrier_hz) ** 2
    return np.asarray(factor[gnss.sv, gnss.signal])


def _kind_status(kind: int, value: Float64, usable: Int8, sigma: Float64 | None, wanted: bool) -> Int8:
    """Return the starting status of one kind: absent, the row's own reason, or a bad value or sigma."""
    if kind == PSEUDORANGE:
        good = (value >= _CLOSEST_M) & (value <= _FARTHEST_M)
    else:
        good = np.abs(value) <= _FASTEST_MPS
    status = usable.copy()
    status[(usable == USED) & ~good] = BAD_VALUE
    if sigma is not None:
        status[(status == USED) & (sigma <= 0.0)] = BAD_SIGMA
    if not wanted:
        status[status == USED] = SWITCHED_OFF
    status[np.isnan(value)] = ABSENT
    return status


@kernel
def _mark_repeats(t_ns: Int64, sv: Int64, signal: Int64, choice: Int64, n_sv: int, refused: Int64) -> None:
    """Write DUPLICATE for a satellite's repeated signal, SIGNAL_NOT_USED for its less preferred ones, per epoch."""
    best = np.full(n_sv, -1, np.int64)  # row that stands for the satellite in this epoch
    start = 0
    for i in range(len(t_ns)):
        if i > 0 and t_ns[i] != t_ns[i - 1]:
            for k in range(start, i):
                best[sv[k]] = -1
            start = i
        if choice[i] < 0:
            continue
        other = best[sv[i]]
        if other < 0:
            best[sv[i]] = i
        elif signal[i] == signal[other]:
            refused[i] = DUPLICATE
        elif choice[i] < choice[other]:
            refused[other] = SIGNAL_NOT_USED
            best[sv[i]] = i
        else:
            refused[i] = SIGNAL_NOT_USED


def _refused_twice(gnss: GnssTable, choice: Int64) -> Int64:
    """Return, for rows of satellites that stand several times in an epoch, why all but one are refused; 0 elsewhere."""
    refused = np.zeros(len(gnss.t_ns), np.int64)
    _mark_repeats(
        gnss.t_ns, gnss.sv.astype(np.int64), gnss.signal.astype(np.int64), choice, len(gnss.sv_names), refused
    )
    return refused
