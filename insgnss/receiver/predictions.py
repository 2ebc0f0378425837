"""The supervisor's predictions: the filter's prediction of every satellite above the horizon, tracked or hidden.

D is the filter's own: the rows of H of pseudorange and range rate about the covariance that the trace holds, the
receiver's clock in, neither the satellite's error nor any measurement noise in it:

    D = h P^- h^T

A row of the trace at an epoch is from before its update, so P^- is the covariance just before it. Where a trace brings
its covariance less often than its states, D is carried over the age dt: the range by h + dt h_rate, the rate by
h_rate + dt h_acceleration, and the white noise of accelerometer and clock meanwhile is added; the biases' wander and
the gyro's noise are not (of the rate 3e-4 m/s after 1 s at 0.1 deg/sqrt h). The same noise is added from a row of the
trace to the time it is used for, such as an epoch a fraction of an inertial interval later.

Delay and range rate are what the receiver would measure, its clock in them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from insgnss.aiding.observables import Spans
from insgnss.aiding.satellite_arcs import SatelliteArcs, lines_of_sight
from insgnss.aiding.table import AidingSetup, aiding_arrays
from insgnss.aiding.trace import Covariances, FilterTrace, Trace
from insgnss.aiding.uncertainty import SD_DOPPLER, SD_RANGE
from insgnss.antenna.equipment import limits_of
from insgnss.antenna.installation import Installation, no_antenna
from insgnss.antenna.visibility import (
    HIDDEN,
    HIDE,
    UNCERTAIN_HIDDEN,
    UNDECIDED,
    VISIBLE,
    look_at_all,
    new_looks,
)
from insgnss.config.filter import Visibility
from insgnss.config.search import Grid, Search
from insgnss.constants import C_MPS, NS_PER_S
from insgnss.errors import InputError
from insgnss.filter.state import PSI
from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.receiver.search_window import SignalScale
from insgnss.receiver.supervisor import Predictions
from insgnss.tables import Float64, Int8, Int64

_EVERY_ROW_S: Final = 1e-9  # spans of one row each: D at every time
# Chips per second and in a period of each code
_LEGACY: Final = (1.023e6, 1023)  # C/A, IS-GPS-200N, 3.3.2.3; QZSS, NavIC and SBAS have its rate and length
_WIDE: Final = (10.23e6, 10230)  # IS-GPS-705J, 3.2.1.1; Galileo OS SIS ICD 2.1, 3.4 (primary code)
_CODES: Final = {
    **{(letter, "C1C"): _LEGACY for letter in "GJS"},
    **{("E", code): (1.023e6, 4092) for code in ("C1B", "C1C", "C1X")},  # Galileo OS SIS ICD 2.1, 3.4
    ("C", "C2I"): (2.046e6, 2046),  # BDS-SIS-ICD B1I 3.0, on the ranging code
    **{("R", code): (0.511e6, 511) for code in ("C1C", "C2C")},  # GLONASS ICD 5.1, 3.3.2.2
    **{("I", code): _LEGACY for code in ("C5A", "C9A")},
    **{(letter, code): _WIDE for letter in "GJE" for code in ("C5I", "C5Q", "C5X")},
}


@dataclass(frozen=True)
class SupervisionSetup:
    """Everything that fixes the supervision of a run before its first row."""

    aiding: AidingSetup  # carriers, lever arm, clock groups, air: its sigmas beyond the filter's do not count
    antennas: Installation | None = None  # None, or no antenna in it: isotropic ones, that hide nothing
    visibility: Visibility = field(default_factory=Visibility)
    search: Search = field(default_factory=Search)
    elevation_mask_deg: float = 5.0  # lower satellites are hidden


@dataclass(frozen=True)
class Outlook:
    """Predictions of m satellites at n times; NaN and UNDECIDED where one is below the horizon or not known."""

    sv_names: tuple[str, ...]  # (m,)
    predicted: Predictions
    elevation: Float64  # (n, m) [rad]
    gain: Float64  # (n, m, 2) gain of the antenna that decides [dBic] and its sigma by the attitude's [dB]
    scale: SignalScale  # of each satellite's signal


def outlook(
    setup: SupervisionSetup,
    satellites: SatelliteArcs,
    traced: FilterTrace,
    at_ns: Int64 | None = None,
    memory: Int8 | None = None,
) -> Outlook:
    """Return the predictions at all rows of a trace.

    Parameters
    ----------
    satellites : pieces that cover the trace
    traced : the filter's states and covariances, and the inertial samples
    at_ns : (n,) times that the predictions are for, by the receiver's clock as it tags its epochs, within an interval
        of the samples from the trace's: delays and D are carried there, the rest is that of the trace's rows; None: the
        trace's own, GPS time
    memory : (s,) what antennas decided last of each satellite of the pieces, carried on; None: nothing, UNDECIDED

    Raises
    ------
    InputError : ``at_ns`` has another length than the trace
    """
    trace = traced.trace
    t_ns = trace.t_ns if at_ns is None else at_ns
    if len(t_ns) != len(trace.t_ns):
        message = f"{len(t_ns)} times for a trace of {len(trace.t_ns)} rows"
        raise InputError(message, column="at_ns", advice="give one time for each row of the trace")
    own = filter_alone(setup.aiding)
    spans, values, sigma = aiding_arrays(own, satellites, trace, traced.samples, traced.covariances)
    number = np.unique(spans.satellite)  # those ever above the horizon
    names = tuple(satellites.sv_names[i] for i in number)
    # a span is a row of the trace: entries are (row, satellite)
    row = np.repeat(np.arange(len(spans.first_time) - 1), np.diff(spans.first_satellite))
    place = row, np.searchsorted(number, spans.satellite)
    shape = (len(trace.t_ns), len(number))

    def spread(entries: Float64) -> Float64:
        filled = np.full((*shape, *entries.shape[1:]), np.nan)
        filled[place] = entries
        return filled

    since_s = (t_ns - trace.t_ns) / NS_PER_S
    # the receiver reaches its tag early by as much as its clock is fast: 0.3 ms of 900 m/s are 0.3 m
    lag_s = (since_s if at_ns is None else since_s - trace.clock[:, 0] / C_MPS)[row]
    rate, drift = values.range_rate - spans.drift_mps, trace.clock[row, 1]
    delay = values.pseudorange + lag_s * (rate + 0.5 * lag_s * values.acceleration) + since_s[row] * drift
    range_noise, rate_noise = _white_noise(own, _newest(trace, traced.covariances)[1], since_s)
    u_n, C_nb = _sight(own, satellites, trace, spans, row)
    directions = spread(u_n)
    before = np.full(len(satellites.sv_names), UNDECIDED, np.int8) if memory is None else memory
    own_memory = before[number]
    P_b = _attitude_covariance(trace, traced.covariances)
    decision, gain = _decisions(setup, directions, C_nb, P_b, own_memory)
    before[:] = UNDECIDED
    before[number] = own_memory
    predicted = Predictions(
        t_ns=t_ns,
        decision=decision,
        cn0_dbhz=setup.visibility.nominal_cn0_dbhz + gain[..., 0],
        d_range_m2=spread(sigma[:, SD_RANGE] ** 2 + range_noise[row]),
        d_rate_m2ps2=spread(sigma[:, SD_DOPPLER] ** 2 + rate_noise[row]),
        delay_m=spread(delay),
        range_rate_mps=spread(rate + drift + lag_s * values.acceleration),
    )
    scale = scales(own, names, setup.search.grid)
    return Outlook(names, predicted, np.arcsin(np.clip(-directions[..., 2], -1.0, 1.0)), gain, scale)


def filter_alone(aiding: AidingSetup) -> AidingSetup:
    """Return the setup whose sigmas are the filter's alone, at every row of a trace, receiver clock included."""
    config = aiding.config.model_copy(
        update={
            "receiver_clock": True,
            "latency_s": 0.0,
            "sigma_interval_s": _EVERY_ROW_S,
            "jerk_sigma_mps3": 0.0,
            "satellite_range_sigma_m": 0.0,
            "satellite_rate_sigma_mps": 0.0,
            "satellite_acceleration_sigma_mps2": 0.0,
        }
    )
    # the gyro's sample noise, which the lever arm turns into velocity, is none of the covariance's
    return replace(aiding, config=config, sensor=replace(aiding.sensor, gyro_density=0.0, gyro_scale=0.0))


def scales(aiding: AidingSetup, sv_names: tuple[str, ...], grid: Grid) -> SignalScale:
    """Return chip, wavelength and code of each satellite's signal; those of the grid for a code not listed here."""
    signals = aiding.signals
    codes = [_CODES.get((n[0], signals[n[0]]), (grid.chip_rate_hz, grid.code_chips)) for n in sv_names]
    rates, chips = np.array(codes, np.float64).reshape(-1, 2).T
    return SignalScale(C_MPS / rates, aiding.wavelengths(sv_names), chips)


def _newest(trace: Trace, covariances: Covariances) -> tuple[Int64, Float64]:
    """Return for each row of the trace its covariance, -1 for none, and its age [s]."""
    newest = np.searchsorted(covariances.t_ns, trace.t_ns, side="right") - 1
    age_s = (trace.t_ns - covariances.t_ns[newest]) / NS_PER_S if len(covariances.t_ns) else np.nan
    return newest.astype(np.int64), np.where(newest >= 0, age_s, np.nan)


def _white_noise(aiding: AidingSetup, age_s: Float64, lag_s: Float64) -> tuple[Float64, Float64]:
    """Return the white clock and accelerometer noise in the variances of range [m^2] and rate [m^2/s^2].

    Equation: S_bias t + (S_drift + S_accel) t^3 / 3, t since the covariance; (S_drift + S_accel) t, t since the row,
    as the sigma of a row has it in already.
    """
    slow, whole_s = aiding.clock.drift_density + aiding.sensor.accel_density, age_s + lag_s
    return aiding.clock.bias_density * whole_s + slow * whole_s**3 / 3.0, slow * lag_s


def _attitude_covariance(trace: Trace, covariances: Covariances) -> Float64:
    """Return C_be P_psi C_eb (n, 3, 3) [rad^2] at the trace's rows; NaN before the first covariance."""
    newest, _ = _newest(trace, covariances)
    P_b = np.full((len(trace.t_ns), 3, 3), np.nan)
    rows = np.flatnonzero(newest >= 0)
    P_psi = covariances.P[newest[rows], PSI : PSI + 3, PSI : PSI + 3]
    C_eb = trace.C_eb[rows]
    P_b[rows] = np.swapaxes(C_eb, 1, 2) @ P_psi @ C_eb
    return P_b


def _sight(
    aiding: AidingSetup, satellites: SatelliteArcs, trace: Trace, spans: Spans, row: Int64
) -> tuple[Float64, Float64]:
    """Return the lines of sight u_n of the entries (q, 3), and C_nb (n, 3, 3)."""
    r_e = trace.r_e + trace.C_eb @ np.array(aiding.lever_arm_m, np.float64)
    C_ne = ned_axes(geodetic(r_e))
    u_e = lines_of_sight(satellites.arcs, trace.t_ns[row], spans.satellite, r_e[row])
    return np.einsum("qij,qj->qi", C_ne[row], u_e), C_ne @ trace.C_eb


def _decisions(
    setup: SupervisionSetup, u_n: Float64, C_nb: Float64, P_b: Float64, memory: Int8
) -> tuple[Int8, Float64]:
    """Return the decisions of antennas and mask on every satellite (n, m), and the gain (n, m, 2).

    ``memory`` (m,) is what the antennas decided before, and is carried on.

    Where the filter hides what is uncertain (``visibility.uncertain``), that counts as hidden here too.
    """
    known = np.isfinite(u_n[..., 0])
    antennas = no_antenna() if setup.antennas is None else setup.antennas
    looks = new_looks(*u_n.shape[:2])
    decision, gain = looks.decision, looks.gain
    if len(antennas.lever_b):
        limits = limits_of(setup.visibility)
        looks = looks._replace(decision=np.vstack([memory, decision]))
        look_at_all(C_nb, P_b, u_n, antennas, limits, looks)
        decision, memory[:] = looks.decision[1:], looks.decision[-1]
        if limits.uncertain == HIDE:
            # a receiver that keeps measuring a hidden satellite does not prove it visible
            decision[decision == UNCERTAIN_HIDDEN] = HIDDEN
    else:
        gain[~known] = np.nan
    if not len(antennas.lever_b) or not setup.visibility.on:
        decision[:] = VISIBLE
    low = -u_n[..., 2] < np.sin(np.radians(setup.elevation_mask_deg))  # False for NaN
    decision[low] = HIDDEN
    decision[~known] = UNDECIDED
    return decision, gain
