"""Differential corrections: a base station's error of each pseudorange at a known place.

Equation: correction = P_base - (rho + T + I - c dt_s) - b_base, to be subtracted from the rover's pseudorange of the
same satellite and signal. What both receivers share goes out: orbit and clock of the satellite, its code biases, and
of the atmosphere what the models left (0.1 to 1 m for each 100 km between them).

Rules:
- Both sides are computed with the same models: satellite states, ionosphere and troposphere of the corrections must be
  those of the rover's filter, with the base's and the rover's own height. Without models on the base's side, the rover
  must have none either; then a difference of height of 100 m costs 3 cm at the zenith.
- Same message: a correction holds for the broadcast message that it was computed with (clock, orbit, group delay). A
  rover's row takes corrections of its own message alone; across a change of messages the side that agrees is held.
- The base's clock is the median over the satellites of a constellation at an epoch, for all its signals
  (``clock_per_signal``: for each signal, where two kinds of receivers differ in their delays between signals). A jump
  of the base's clock thus never enters. A satellite that rises or sets moves the median by a fraction of its own
  error, the same for all satellites of a constellation: the rover's clock absorbs it.
- Nothing is smoothed; in time the correction is linear between the base's epochs, within ``max_age_s`` of the row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.geodesy.ellipsoid import ecef_to_geodetic
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.gnss.line_of_sight import line_of_sight_range
from insgnss.gnss.orbits.satellite_state import SatelliteStates
from insgnss.gnss.range_model import AIR_DTYPE, AirModel, evaluate_atmosphere, slant_delay
from insgnss.gnss.signals import ionosphere_factor
from insgnss.gnss.troposphere import STANDARD_WEATHER, Weather
from insgnss.kernels.jit import kernel
from insgnss.status import USED
from insgnss.tables import Event, Float64, GnssTable, Int16, Int64

# below, the base's own multipath is larger than what it corrects
LOWEST_SINE: Final = math.sin(math.radians(5.0))
# Orbit, clock and atmosphere of a healthy satellite are within 30 m of their models; more is the base's own fault
LARGEST_M: Final = 100.0
FEWEST_SATELLITES: Final = 3  # satellites of a constellation that make a median worth its name


@dataclass(frozen=True)
class Corrections:
    """One row per correction, sorted by satellite, signal and time."""

    sv_names: tuple[str, ...]
    signal_names: tuple[str, ...]
    t_ns: Int64  # (n,) the base's time tag
    sv: Int16  # (n,)
    signal: Int16  # (n,)
    message: Int64  # (n,) message of the satellite state
    correction_m: Float64  # (n,) to be subtracted from the rover's pseudorange


def differential_corrections(
    base: GnssTable,
    base_position_e: Float64,
    states: SatelliteStates,
    klobuchar: Float64 | None = None,
    *,
    ionosphere_m: Float64 | None = None,
    troposphere: bool = True,
    weather: Weather = STANDARD_WEATHER,
    clock_per_signal: bool = False,
    channels: dict[str, int] | None = None,
) -> tuple[Corrections, list[Event]]:
    """Return the corrections of all rows of a base station's log that can give one.

    Parameters
    ----------
    base : the base's log
    base_position_e : (3,) its antenna, ECEF at the log's time, in the frame of the orbits [m]
    states : of the base's rows, by the same function and data as the rover's
    klobuchar : (8,) GPS's coefficients as the rover's filter uses them, None for no ionosphere
    ionosphere_m : (n,) delays on L1 of the base's rows where the rover's filter has such (``ionosphere_rows``)
    troposphere, weather : as in the rover's filter
    clock_per_signal : remove the base's clock for each signal by itself
    channels : of GLONASS, those of the log when None
    """
    factor = _ionosphere_factors(base, channels or base.glonass_channels) * float(
        klobuchar is not None or ionosphere_m is not None
    )
    model, sine = np.empty(len(base.t_ns)), np.empty(len(base.t_ns))
    given = np.full(len(base.t_ns), math.nan) if ionosphere_m is None else ionosphere_m
    if klobuchar is None:
        given = np.nan_to_num(given)
    base_ranges(
        base.t_ns,
        np.ascontiguousarray(states.sat),
        states.clock_m,
        np.asarray(base_position_e, dtype=np.float64),
        AirModel(
            np.zeros(8) if klobuchar is None else np.asarray(klobuchar, dtype=np.float64),
            factor,
            float(troposphere),
            Weather(*(float(value) for value in weather)),
        ),
        given,
        model,
        sine,
    )
    usable = (states.status == USED) & np.isfinite(base.pseudorange_m) & np.isfinite(model)
    rows = np.flatnonzero(usable & (sine >= LOWEST_SINE))
    residual = base.pseudorange_m - model
    used, correction, events = _without_clock(base, rows, residual[rows], clock_per_signal)
    order = np.lexsort((base.t_ns[used], base.signal[used], base.sv[used]))
    used, correction = used[order], correction[order]
    table = Corrections(
        base.sv_names,
        base.signal_names,
        base.t_ns[used],
        base.sv[used],
        base.signal[used],
        states.message[used],
        correction,
    )
    return table, events


def apply(corrections: Corrections, gnss: GnssTable, message: Int64 | None, max_age_s: float) -> Float64:
    """Return the corrections to subtract from the rover's pseudoranges (n,) [m], NaN where there is no correction.

    Linear between the base's epochs before and after where both are within ``max_age_s`` of the row and hold for its
    message, else the one that does. A row with another signal than the base tracks of its satellite has none.

    Parameters
    ----------
    corrections : of the base
    gnss : the rover's log
    message : (n,) of the rover's satellite states; None when the messages are known to be the same
    max_age_s : the oldest (or youngest) correction to use
    """
    correction_m = np.full(len(gnss.t_ns), math.nan)
    for s, name in enumerate(corrections.sv_names):
        for c, code in enumerate(corrections.signal_names):
            if name not in gnss.sv_names or code not in gnss.signal_names:
                continue
            first, last = _span(corrections, s, c)
            own = (gnss.sv == gnss.sv_names.index(name)) & (gnss.signal == gnss.signal_names.index(code))
            rows = np.flatnonzero(own)
            if last > first and len(rows):
                wanted = None if message is None else message[rows]
                correction_m[rows] = _at(corrections, first, last, gnss.t_ns[rows], wanted, max_age_s)
    return correction_m


def _span(corrections: Corrections, sv: int, signal: int) -> tuple[int, int]:
    """Return the first row of a satellite's signal and the one after its last."""
    first, last = np.searchsorted(corrections.sv, [sv, sv + 1])
    inner = np.searchsorted(corrections.signal[first:last], [signal, signal + 1])
    return int(first + inner[0]), int(first + inner[1])


def _at(
    corrections: Corrections, first: int, last: int, t_ns: Int64, message: Int64 | None, max_age_s: float
) -> Float64:
    """Return one satellite's and signal's correction at the given times."""
    own_ns, value = corrections.t_ns[first:last], corrections.correction_m[first:last]
    after = np.searchsorted(own_ns, t_ns, side="left").clip(0, len(own_ns) - 1)
    before = np.searchsorted(own_ns, t_ns, side="right").clip(1, len(own_ns)) - 1
    # where a time lies outside, both are the nearest one
    of = corrections.message[first:last]
    good = []
    for side in (before, after):
        fresh = np.abs(own_ns[side] - t_ns) <= max_age_s * NS_PER_S
        good.append(fresh if message is None else fresh & (of[side] == message))
    span_ns = own_ns[after] - own_ns[before]
    weight = np.where(span_ns > 0, (t_ns - own_ns[before]) / np.maximum(span_ns, 1), 0.0)
    between = value[before] + weight * (value[after] - value[before])
    one = np.where(good[0], value[before], np.where(good[1], value[after], math.nan))
    return np.where(good[0] & good[1], between, one)


def _without_clock(
    base: GnssTable, rows: npt.NDArray[np.intp], residual: Float64, per_signal: bool
) -> tuple[npt.NDArray[np.intp], Float64, list[Event]]:
    """Return the rows whose epoch shows the base's clock, their residuals without it, and the refused ones."""
    if not len(rows):
        return rows, residual, []
    systems = sorted({name[0] for name in base.sv_names})
    system = np.array([systems.index(name[0]) for name in base.sv_names] or [0], np.int64)[base.sv[rows]]
    group = system * max(len(base.signal_names), 1) + (base.signal[rows] if per_signal else 0)
    _, key = np.unique(np.column_stack([base.t_ns[rows], group]), axis=0, return_inverse=True)
    key = key.reshape(-1)
    satellites = np.bincount(np.unique(np.column_stack([key, base.sv[rows]]), axis=0)[:, 0])
    correction = residual - _medians(key, residual)[key]
    enough = satellites[key] >= FEWEST_SATELLITES
    sound = np.abs(correction) <= LARGEST_M
    events = []
    wrong = np.flatnonzero(enough & ~sound)
    if len(wrong):
        names = ", ".join(sorted({base.sv_names[s] for s in base.sv[rows[wrong]]}))
        detail = f"{len(wrong)} correction(s) above {LARGEST_M:g} m refused: {names}"
        events.append(Event(int(base.t_ns[rows[wrong[0]]]), "base_refused", detail))
    if np.any(~enough):
        detail = f"{int(np.sum(~enough))} row(s) of the base with fewer than {FEWEST_SATELLITES} satellites"
        detail += " of a constellation"
        events.append(Event(int(base.t_ns[rows[np.flatnonzero(~enough)[0]]]), "base_too_few", detail))
    good = enough & sound
    return rows[good], correction[good], events


def _medians(key: npt.NDArray[np.intp], values: Float64) -> Float64:
    """Return the median of the values of each key 0, 1, ..."""
    order = np.lexsort((values, key))
    start = np.concatenate([[0], np.flatnonzero(np.diff(key[order])) + 1])
    count = np.diff(np.concatenate([start, [len(key)]]))
    ranked = values[order]
    return np.asarray(0.5 * (ranked[start + (count - 1) // 2] + ranked[start + count // 2]))


def _ionosphere_factors(base: GnssTable, channels: dict[str, int]) -> Float64:
    """Return (f_L1 / f)^2 of each row, 1 for unknown signals."""
    factor = np.array(
        [
            [ionosphere_factor(name[0], code, channels.get(name)) for code in base.signal_names]
            for name in base.sv_names
        ]
    ).reshape(len(base.sv_names), len(base.signal_names))
    return np.nan_to_num(factor, nan=1.0)[base.sv, base.signal] if len(base.t_ns) else np.zeros(0)


@kernel
def base_ranges(
    t_ns: Int64,
    sat: Float64,
    clock_m: Float64,
    r_e: Float64,
    air_model: AirModel,
    ionosphere_m: Float64,
    model: Float64,
    sine: Float64,
) -> None:
    """Write the pseudoranges that a receiver at a fixed place without a clock error would measure.

    Equation: rho + I (f_L1 / f)^2 + T - c dt_s, see ``range_model``.

    Parameters
    ----------
    t_ns : (n,) GPS time
    sat : (n, >= 3) satellites, ECEF at transmission [m]
    clock_m : (n,) their clocks [m]
    r_e : (3,) the antenna, ECEF [m]
    air_model : with the ionosphere's factor of each row
    ionosphere_m : (n,) delay on L1 by another model, NaN for Klobuchar's
    model, sine : (n,) outputs: pseudorange [m] and sine of the elevation, NaN without a satellite
    """
    lat, lon, h = ecef_to_geodetic(r_e)
    C_ne, u, u_n = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    ecef_to_ned_matrix(lat, lon, C_ne)
    air = np.zeros(1, AIR_DTYPE)
    for i in range(len(t_ns)):
        if i == 0 or t_ns[i] != t_ns[i - 1]:
            week_s = (t_ns[i] % NS_PER_WEEK) / NS_PER_S
            evaluate_atmosphere(air[0], lat, lon, h, week_s, air_model.troposphere, air_model.weather)
        distance = line_of_sight_range(sat, i, r_e, u)
        for k in range(3):
            u_n[k] = C_ne[k, 0] * u[0] + C_ne[k, 1] * u[1] + C_ne[k, 2] * u[2]
        sine[i] = -u_n[2]
        delay = slant_delay(air[0], air_model.klobuchar, u_n, air_model.ionosphere[i], ionosphere_m[i])
        model[i] = distance - clock_m[i] + delay
