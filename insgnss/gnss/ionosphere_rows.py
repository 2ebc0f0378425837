"""The ionosphere's delay of every row of a log on L1, by the broadcast model that a setting names.

| setting      | model                                                                                    |
|--------------|------------------------------------------------------------------------------------------|
| "klobuchar"  | GPS's coefficients for every satellite                                                   |
| "nequick"    | Galileo's coefficients for every satellite                                               |
| "beidou"     | BeiDou's coefficients for every satellite                                                |
| "own"        | each constellation's own coefficients where the navigation data have them, else GPS's,   |
|              | else Galileo's, else BeiDou's; GLONASS and SBAS broadcast none                           |
| "none"       | no delay                                                                                 |

Done for the whole log before the filter's loop, at an approximate place of the antenna: a kilometre matters 1 cm. A row
that GPS's model serves stays NaN, because the compiled loop computes it at the antenna itself.
NeQuick-G takes milliseconds, so it is evaluated for each satellite every five minutes and interpolated by a cubic
spline: within 3 cm of the model for 99 of 100 rows above 5 deg, 0.15 m at worst at 40 m of delay (an aircraft at
250 m/s; half of it is the noise of the model's own numerical integration).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S, NS_PER_WEEK, S_PER_DAY, SYSTEMS
from insgnss.errors import ConfigError, NavigationDataError
from insgnss.geodesy.directions import angles_of
from insgnss.geodesy.ellipsoid import ecef_to_geodetic
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.gnss.ionosphere import beidou_delay, ionosphere_above, klobuchar_delay
from insgnss.gnss.nequick import nequick_delay
from insgnss.gnss.orbits.plausible_messages import is_ionosphere, plausible_klobuchar
from insgnss.gnss.signals import B1I_HZ, L1_HZ
from insgnss.gpstime import BDT_MINUS_GPST_S, leap_seconds, ns_to_datetime
from insgnss.tables import Float64, GnssTable, Int16, Int64, NavigationData

MODELS: Final = ("klobuchar", "nequick", "beidou", "own", "none")
NODE_S: Final = 300.0  # a satellite moves by 2.5 deg of its orbit
_ARC_GAP_S: Final = 60.0  # over which a difference still is a rate: a delay bends by 1e-5 m/s^2 at most

_OWN: Final = {"G": "klobuchar", "E": "nequick", "C": "beidou", "J": "qzss", "I": "navic"}
_FALLBACK: Final = ("klobuchar", "nequick", "beidou")  # GPS's is the best tested and known to every receiver
_COEFFICIENTS: Final = {"nequick": "galileo", "beidou": "beidou", "qzss": "qzss", "navic": "navic"}

Rows = npt.NDArray[np.intp]


def ionosphere_rows(
    gnss: GnssTable,
    navigation: NavigationData,
    model: str,
    position_ns: Int64,
    position_e: Float64,
    sat: Float64,
) -> Float64:
    """Return the delay of a code on L1 [m] for each row (n,), NaN where the compiled Klobuchar model shall compute it.

    On another carrier times (f_L1 / f)^2. Unlike ``klobuchar_towards`` the delay is already that at the antenna's
    height: it is not to be multiplied by ``ionosphere_above``.

    Parameters
    ----------
    gnss : the log
    navigation : with the coefficients
    model : one of ``MODELS``
    position_ns : (k,) times of the approximate places, increasing
    position_e : (k, 3) antenna, ECEF [m]; linear between, the nearest one outside
    sat : (n, >= 3) satellites, ECEF [m], NaN where there is none

    Raises
    ------
    ConfigError : no such model
    NavigationDataError : the navigation data lack the coefficients of a model that the setting names
    """
    serving = serving_models(navigation, model)
    of_sv = [serving.get(name[0], "none") for name in gnss.sv_names]
    delay = np.zeros(len(gnss.t_ns))
    for name in sorted(set(of_sv) - {"none"}):
        rows = np.flatnonzero(np.array([served == name for served in of_sv])[gnss.sv])
        delay[rows] = _delays(name, gnss, navigation, position_ns, position_e, sat, rows)
    return delay


def ionosphere_growth(gnss: GnssTable, delay_m: Float64) -> Float64:
    """Return by how much the delays (n,) of ``ionosphere_rows`` grow [m/s], NaN without a neighbour in time.

    Equation: central differences over each satellite's epochs, one-sided at the ends of an arc.
    Neglects: the spline's own error, 3 cm over ``NODE_S``: 0.1 mm/s.
    """
    rate = np.full(len(delay_m), math.nan)
    for satellite in np.unique(gnss.sv):
        rows = np.flatnonzero((gnss.sv == satellite) & np.isfinite(delay_m))
        t_ns, one, of = np.unique(gnss.t_ns[rows], return_index=True, return_inverse=True)
        delay = delay_m[rows[one]]
        growth = np.full(len(t_ns), math.nan)
        for arc in np.split(np.arange(len(t_ns)), np.flatnonzero(np.diff(t_ns) > _ARC_GAP_S * NS_PER_S) + 1):
            if len(arc) > 1:
                growth[arc] = np.gradient(delay[arc], (t_ns[arc] - t_ns[arc[0]]) / NS_PER_S)
        rate[rows] = growth[of]
    return rate


def serving_models(navigation: NavigationData, model: str) -> dict[str, str]:
    """Return which model serves each constellation ("G", "R", ...): "klobuchar", "nequick", "beidou", "qzss", ...

    "none" where no coefficients at all are known ("own", "klobuchar") or where the setting says so.

    Raises
    ------
    ConfigError : no such model
    NavigationDataError : "nequick" or "beidou" without its coefficients
    """
    if model not in MODELS:
        raise ConfigError(f"no model '{model}'", key="ionosphere", advice=f"one of {', '.join(MODELS)}")
    if model in _COEFFICIENTS and not _known(navigation, model):
        raise NavigationDataError(
            f"no coefficients of {_COEFFICIENTS[model]} in the navigation data",
            key="ionosphere",
            advice="give a navigation file with 'IONOSPHERIC CORR' (RINEX 3) or STO/ION records (RINEX 4), "
            'or set ionosphere = "own"',
        )
    if model != "own":
        return dict.fromkeys(SYSTEMS, model if model == "none" or _known(navigation, model) else "none")
    fallback = next((name for name in _FALLBACK if _known(navigation, name)), "none")
    own = {system: _OWN.get(system, "none") for system in SYSTEMS}
    return {system: name if _known(navigation, name) else fallback for system, name in own.items()}


def _known(navigation: NavigationData, name: str) -> bool:
    """Return whether a model's coefficients are there; all zero is how converters write that they are not."""
    if name == "klobuchar":
        return plausible_klobuchar(navigation.klobuchar) is not None
    coefficients = navigation.ionosphere.get(_COEFFICIENTS.get(name, ""))
    return coefficients is not None and is_ionosphere(coefficients) and bool(np.any(coefficients))


def _delays(
    name: str,
    gnss: GnssTable,
    navigation: NavigationData,
    position_ns: Int64,
    position_e: Float64,
    sat: Float64,
    rows: Rows,
) -> Float64:
    """Return the delays of the rows that one model serves."""
    t_ns = gnss.t_ns[rows]
    if name == "klobuchar":
        return np.full(len(rows), math.nan)
    coefficients = np.asarray(navigation.ionosphere[_COEFFICIENTS[name]], dtype=np.float64)
    epoch_ns, epoch = np.unique(t_ns, return_inverse=True)
    antenna_e = antenna_places(epoch_ns, position_ns, position_e)
    antenna = np.array([ecef_to_geodetic(r_e) for r_e in antenna_e]).reshape(-1, 3)
    if name == "nequick":
        sv = gnss.sv[rows]
        return _nequick(coefficients, t_ns, sv, sat[rows, :3], antenna[epoch])
    azimuth, elevation = _directions(antenna, antenna_e, epoch, sat[rows, :3])
    above = np.array([ionosphere_above(h) for h in antenna[:, 2]])[epoch]
    place = antenna[epoch]
    week_s = (t_ns % NS_PER_WEEK) / NS_PER_S
    if name == "beidou":
        on_b1i = beidou_delay(
            coefficients, place[:, 0], place[:, 1], azimuth, elevation, week_s + BDT_MINUS_GPST_S
        )
        return np.asarray(above * on_b1i * (B1I_HZ / L1_HZ) ** 2)
    on_ground = [
        klobuchar_delay(coefficients, *row)
        for row in zip(place[:, 0], place[:, 1], azimuth, elevation, week_s, strict=True)
    ]
    return np.asarray(above * np.array(on_ground))


def antenna_places(t_ns: Int64, position_ns: Int64, position_e: Float64) -> Float64:
    """Return approximate places (m, 3) at given times: linear between the known ones, the nearest outside."""
    seconds = (position_ns - position_ns[0]) / NS_PER_S
    at = (t_ns - position_ns[0]) / NS_PER_S
    return np.column_stack([np.interp(at, seconds, position_e[:, k]) for k in range(3)])


def _directions(
    antenna: Float64, antenna_e: Float64, epoch: Rows, satellite_e: Float64
) -> tuple[Float64, Float64]:
    """Return azimuth and elevation of each row [rad]; the Earth's turn (5e-6 rad) is left out."""
    C_ne = np.empty((len(antenna), 3, 3))
    for k, (lat, lon, _) in enumerate(antenna):
        ecef_to_ned_matrix(lat, lon, C_ne[k])
    return angles_of(np.einsum("nij,nj->ni", C_ne[epoch], satellite_e - antenna_e[epoch]))


def _nequick(
    coefficients: Float64, t_ns: Int64, sv: Int16, satellite_e: Float64, antenna: Float64
) -> Float64:
    """Return NeQuick's delays: at every satellite's nodes by the model, between them by a spline."""
    delay = np.full(len(t_ns), math.nan)
    present = np.isfinite(satellite_e).all(axis=1)
    for satellite in np.unique(sv[present]):
        rows = np.flatnonzero((sv == satellite) & present)
        for arc in np.split(rows, np.flatnonzero(np.diff(t_ns[rows]) > 2.0 * NODE_S * NS_PER_S) + 1):
            nodes = arc[_node_places(t_ns[arc])]
            values = [_nequick_at(coefficients, t_ns[i], antenna[i], satellite_e[i]) for i in nodes]
            delay[arc] = _between(t_ns[nodes], np.array(values), t_ns[arc])
    return delay


def _node_places(t_ns: Int64) -> Rows:
    """Return which of an arc's rows are nodes: first and last, and evenly spread ones ``NODE_S`` apart at most."""
    span_s = (t_ns[-1] - t_ns[0]) / NS_PER_S
    count = max(math.ceil(span_s / NODE_S), 3) + 1
    wanted = np.linspace(t_ns[0], t_ns[-1], count)
    places = np.searchsorted(t_ns, wanted).clip(0, len(t_ns) - 1)
    return places[np.unique(t_ns[places], return_index=True)[1]]


def _nequick_at(coefficients: Float64, t_ns: int, antenna: Float64, satellite_e: Float64) -> float:
    when = ns_to_datetime(int(t_ns))
    utc_h = (t_ns / NS_PER_S - leap_seconds(when)) % S_PER_DAY / 3600.0
    satellite = np.array(ecef_to_geodetic(satellite_e))
    return nequick_delay(coefficients, when.month, utc_h, antenna, satellite)


def _between(node_ns: Int64, values: Float64, t_ns: Int64) -> Float64:
    """Return a spline through the finite nodes; NaN outside of them (a ray below the horizon has no value)."""
    good = np.isfinite(values)
    if not good.any():
        return np.full(len(t_ns), math.nan)
    x, y, at = (node_ns[good] - node_ns[0]) / NS_PER_S, values[good], (t_ns - node_ns[0]) / NS_PER_S
    from scipy.interpolate import CubicSpline  # late: a fifth of a second that few flights need

    spline = CubicSpline(x, y)(at) if len(x) >= 4 else np.interp(at, x, y)
    return np.where((at >= x[0]) & (at <= x[-1]), spline, math.nan)
