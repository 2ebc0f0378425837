"""One filter and its measurements, made by hand: a place, an attitude, a sky, rows as the truth predicts them.

The noise is the same for every row (no elevation, no C/N0), nothing adapts, nothing is masked, the air is empty: a test
adds what it is about.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pymap3d

from insgnss.config.filter import FilterConfig
from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.constants import NS_PER_S, NS_PER_WEEK, WGS84_OMEGA_RADPS
from insgnss.filter.loop import ImuSamples, run_epochs
from insgnss.filter.output.writing import Output, new_output
from insgnss.filter.parameters import resolve_parameters
from insgnss.filter.rows.lines import EpochWorkspace
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI, Bank, copy_bank, new_bank
from insgnss.filter.update.epoch_space import FilterWorkspace, new_epoch, new_workspace
from insgnss.filter.update.predictions import RANGE_COLUMNS, RATE_COLUMNS
from insgnss.filter.update.prior_rows import predict_measurements
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.rotations import euler_to_matrix, matrix_to_quaternion
from insgnss.gnss.carrier_rows import no_carriers
from insgnss.gnss.observation_rows import ABSENT, OBSERVATION_DTYPE, GnssRows
from insgnss.status import USED
from insgnss.tables import Float64, Int64
from tests.layouts import layout_with

START_NS = 2268 * NS_PER_WEEK + 200_000 * NS_PER_S
W_IE_E = np.array([0.0, 0.0, WGS84_OMEGA_RADPS])
TACTICAL = ImuGrade(
    gyro_bias_deg_per_h=1.0,
    gyro_bias_instability_deg_per_h=0.5,
    gyro_correlation_time_s=1000.0,
    gyro_arw_deg_per_sqrt_h=0.1,
    accel_bias_mg=1.0,
    accel_bias_instability_mg=0.3,
    accel_correlation_time_s=1000.0,
    accel_vrw_mps_per_sqrt_h=0.06,
)
TCXO = Oscillator(h0_s=2e-19, h_minus2_per_s=2e-20)
# azimuth and elevation [deg] of twelve satellites; any first n of at least four are a fair geometry
SKY_DEG = (
    *((20, 30), (140, 45), (250, 20), (300, 75), (90, 15), (200, 60)),
    *((340, 12), (60, 50), (170, 25), (280, 35), (110, 65), (230, 10)),
)
RANGE_SIGMA_M, RATE_SIGMA_MPS = 1.0, 0.05
# one sigma of each block at the start
SIGMAS = {DR: 3.0, DV: 0.3, PSI: 0.02, BA: 0.01, BG: 5e-6, CLOCK: 100.0, DRIFT: 3.0, OFFSETS: 20.0}


def geometry(azimuth: Float64, elevation: Float64) -> Float64:
    """Return the rows of H (n, 4) for position or velocity and the clock, of satellites in these directions [rad]."""
    across = np.cos(elevation)
    return np.column_stack(
        [np.cos(azimuth) * across, np.sin(azimuth) * across, -np.sin(elevation), np.ones(len(azimuth))]
    )


class Place(NamedTuple):
    """A point on or above the Earth and what holds there."""

    r_e: Float64  # (3,)
    C_ne: Float64  # (3, 3)
    f_e: Float64  # (3,) specific force of a body at rest [m/s^2]


def place(lat_deg: float = 59.97, lon_deg: float = 30.32, h_m: float = 120.0) -> Place:
    """Return a place by its geodetic coordinates."""
    r_e = np.array(pymap3d.geodetic2ecef(lat_deg, lon_deg, h_m))
    C_ne = np.array([pymap3d.ecef2enuv(*axis, lat_deg, lon_deg) for axis in np.eye(3)]).T[[1, 0, 2]]
    C_ne[2] *= -1.0
    g_e = np.zeros(3)
    normal_gravity_ecef(r_e, g_e)
    return Place(r_e, C_ne, -g_e)


def parameters(lever_b: Sequence[float] = (0.0, 0.0, 0.0), **changes: Any) -> npt.NDArray[Any]:
    """Return the filter's numbers; ``changes`` replaces single ones as ``set_number`` does."""
    noise = {"elevation": 0.0, "cn0_at_45_dbhz": 0.0}
    config = FilterConfig.model_validate(
        {
            "pseudorange_noise_m": {"floor": RANGE_SIGMA_M, **noise},
            "range_rate_noise_mps": {"floor": RATE_SIGMA_MPS, **noise},
            "measurements": {"elevation_mask_deg": -90.0, "ionosphere": "none", "troposphere": "none"},
            "adaptation": {"on": False},
            "health": {"suspicion_sigma": 0.0},
            "faults": {
                "residual_sigma": 0.0,
                "drift_sigma": 0.0,
                "reflected_below_db": 0.0,
            },
        }
    )
    lever = (float(lever_b[0]), float(lever_b[1]), float(lever_b[2]))
    par = resolve_parameters(
        config, TACTICAL, TCXO, lever, klobuchar_known=True, layout=layout_with(n_offsets=6)
    )
    for name, value in changes.items():
        set_number(par, name, value)
    return par


def set_number(par: npt.NDArray[Any], name: str, value: Any) -> None:
    """Set one of the filter's numbers; ``range_gate2`` is the field ``gate2`` of the pseudoranges' numbers."""
    prefix, _, field = name.partition("_")
    if prefix in ("range", "rate", "carrier"):
        par["kind"][field][:, ("range", "rate", "carrier").index(prefix)] = value
    else:
        par[name] = value


def attitude(at: Place, roll_deg: float, pitch_deg: float, yaw_deg: float) -> Float64:
    """Return C_eb of an attitude given in degrees."""
    C_nb = np.zeros((3, 3))
    euler_to_matrix(math.radians(roll_deg), math.radians(pitch_deg), math.radians(yaw_deg), C_nb)
    return at.C_ne.T @ C_nb


def new_filter(
    at: Place,
    *,
    v_n: Sequence[float] = (0.0, 0.0, 0.0),
    C_eb: Float64 | None = None,
    clock: Sequence[float] = (1200.0, 3.0),
    offsets: Sequence[float] = (),
    now_ns: int = START_NS,
    sigmas: dict[int, float] | None = None,
) -> Bank:
    """Return a filter of one hypothesis; level and heading north unless ``C_eb`` says otherwise."""
    bank = new_bank(1, len(offsets))
    m = bank.state[0]
    m.C_eb[:] = at.C_ne.T if C_eb is None else C_eb
    matrix_to_quaternion(m.C_eb, m.q_eb)
    m.r_e[:], m.v_e[:] = at.r_e, at.C_ne.T @ np.array(v_n)
    m.clock[:], m.optional[: len(offsets)] = clock, offsets
    sigma = {**SIGMAS, **(sigmas or {})}
    for first in (DR, DV, PSI, BA, BG):
        bank.P[0, range(first, first + 3), range(first, first + 3)] = sigma[first] ** 2
    for state in (CLOCK, DRIFT):
        bank.P[0, state, state] = sigma[state] ** 2
    for state in range(OFFSETS, bank.P.shape[1]):
        bank.P[0, state, state] = sigma[OFFSETS] ** 2
    bank.head["now_ns"], bank.head["next"] = now_ns, 1
    return bank


def sky(at: Place, angles_deg: Sequence[tuple[float, float]] = SKY_DEG) -> Float64:
    """Return (k, 8) satellites 22 000 km away at azimuths and elevations, 3 km/s across the line of sight."""
    states = np.zeros((len(angles_deg), 8))
    for k, (azimuth, elevation) in enumerate(np.radians(angles_deg)):
        level = [math.cos(azimuth), math.sin(azimuth)]
        u_e = at.C_ne.T @ np.array([*(math.cos(elevation) * c for c in level), -math.sin(elevation)])
        states[k, 0:3] = at.r_e + 22e6 * u_e
        across = np.cross(u_e, [0.3 + 0.1 * k, -0.5, 0.8 - 0.2 * k])
        states[k, 3:6] = 3e3 * across / np.linalg.norm(across)
        states[k, 6:8] = 5000.0 - 900.0 * k, 0.01 * k
    return states


def rows_of(
    epoch_ns: Sequence[int] | Int64, sat: Float64, value: Float64 | None = None, group: Sequence[int] = ()
) -> GnssRows:
    """Return rows of ``sat`` (k, 8), or (m, k, 8), and values (m, k, 2), NaN where the log has none, else zeros."""
    m = len(epoch_ns)
    sat = np.array(np.broadcast_to(sat, (m, *sat.shape[-2:])), order="C")
    k = sat.shape[1]
    value = np.zeros((m, k, 2)) if value is None else value
    row = np.zeros(m * k, OBSERVATION_DTYPE)
    row["sv"] = np.tile(np.arange(k), m)
    row["group"] = np.tile(group, m) if len(group) else 0
    row["value"] = value.reshape(m * k, 2)
    row["status"] = np.where(np.isnan(row["value"]), ABSENT, USED)
    row["sigma"] = math.nan
    row["cn0"], row["ionosphere_factor"] = 45.0, 1.0
    first = np.arange(0, m * k + 1, max(k, 1), dtype=np.int64) if k else np.zeros(m + 1, np.int64)
    row["variance_scale"], row["ionosphere_m"], row["phase_factor"] = 1.0, math.nan, 1.0
    carrier, before = no_carriers()
    return GnssRows(
        np.array(epoch_ns, np.int64),
        first,
        row,
        sat.reshape(m * k, 8),
        np.zeros(8),
        carrier,
        before,
        np.zeros(m, np.int64),
    )


def steady_force(m: np.record) -> Float64:
    """Return the specific force in body axes that keeps the velocity as it is: C^T (2 w_ie x v - g)."""
    g_e = np.zeros(3)
    normal_gravity_ecef(m.r_e, g_e)
    turning = 2.0 * WGS84_OMEGA_RADPS * np.array([-m.v_e[1], m.v_e[0], 0.0])
    return np.asarray(m.C_eb.T @ (turning - g_e))


def observed(
    bank: Bank,
    par: npt.NDArray[Any],
    log: GnssRows,
    epoch: int = 0,
    w_ib_b: Float64 | None = None,
    f_b: Float64 | None = None,
) -> EpochWorkspace:
    """Return the work space after the epoch's rows were held against the filter's prior; not accelerated by default."""
    work = new_epoch(int(log.first[epoch + 1] - log.first[epoch]), bank.P.shape[1])
    rate = np.zeros(3) if w_ib_b is None else w_ib_b
    force = steady_force(bank.state[0]) if f_b is None else f_b
    predict_measurements(bank.state[0], bank.P[0], par[0], log, epoch, rate, force, work)
    return work


def dense_rows(work: EpochWorkspace, n: int) -> Float64:
    """Return (2, k, n) rows of H over all states, pseudoranges first, of a work space that ``observed`` filled."""
    lines = work.lines
    H = np.zeros((2, len(lines), n))
    H[0][:, RANGE_COLUMNS] = lines["h"][:, 0, : len(RANGE_COLUMNS)]
    H[1][:, RATE_COLUMNS] = lines["h"][:, 1, : len(RATE_COLUMNS)]
    for line in np.flatnonzero(lines["group"]):
        H[0, line, OFFSETS + lines["group"][line] - 1] = 1.0
    return H


def perfect_rows(
    truth: Bank,
    par: npt.NDArray[Any],
    epoch_ns: Sequence[int] | Int64,
    sat: Float64,
    *,
    w_ib_b: Float64 | None = None,
    group: Sequence[int] = (),
) -> GnssRows:
    """Return rows whose values are what ``truth`` (constant over the epochs, but for its clock) predicts."""
    log = rows_of(epoch_ns, sat, group=group)
    for epoch, t_ns in enumerate(epoch_ns):
        moved = copy_bank(truth)
        moved.state["clock"][0, 0] += (
            truth.state["clock"][0, 1] * (t_ns - int(truth.head["now_ns"][0])) * 1e-9
        )
        work = observed(moved, par, log, epoch, w_ib_b)
        log.observation["value"][log.first[epoch] : log.first[epoch + 1]] = -work.lines["innovation"][:, :2]
    return log


def at_rest(
    at: Place, C_eb: Float64, seconds: float, rate_hz: float, *, start_ns: int = START_NS
) -> ImuSamples:
    """Return the samples of a perfect sensor that rests on the Earth."""
    n = round(seconds * rate_hz)
    t_ns = start_ns + np.rint(np.arange(n + 1) * (NS_PER_S / rate_hz)).astype(np.int64)
    still = np.ones((n + 1, 1))
    return ImuSamples(t_ns, still * (C_eb.T @ W_IE_E), still * (C_eb.T @ at.f_e))


class Result(NamedTuple):
    """What a run leaves besides the filter itself."""

    code: int
    out: Output
    work: FilterWorkspace


def run(bank: Bank, log: GnssRows, imu: ImuSamples, par: npt.NDArray[Any]) -> Result:
    """Run the compiled loop over all epochs of the rows."""
    n = bank.P.shape[1]
    out = new_output(log, len(log.epoch_ns), 100, np.zeros(0, np.int64))
    work = new_workspace(max(1, int(np.diff(log.first).max())), layout_with(n_offsets=n - OFFSETS))
    code, _ = run_epochs(bank, (0, len(log.epoch_ns)), log, imu, par, -1e9, out, work)
    return Result(code, out, work)


def update(bank: Bank, log: GnssRows, par: npt.NDArray[Any], w_ib_b: Float64 | None = None) -> Result:
    """Run the first epoch alone, at the filter's own time; the correction is left in ``work.epoch.vectors[0]``."""
    rate = np.zeros(3) if w_ib_b is None else w_ib_b
    now_ns = int(bank.head["now_ns"][0])
    force = steady_force(bank.state[0])
    imu = ImuSamples(np.array([now_ns - 10_000_000, now_ns]), np.tile(rate, (2, 1)), np.tile(force, (2, 1)))
    bank.head["next"] = 2
    return run(bank, log, imu, par)
