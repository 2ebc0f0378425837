"""Carrying a filter forward in time: inertial samples into the state, their errors into the covariance, compiled.

The state moves with every sample. The covariance moves in steps of at least ``covariance_step`` over which the specific
force and the attitude are summed; what that costs in accuracy is tested, not assumed.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.antenna.visibility import variance_along
from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.filter.headings.motion import (
    FORCE_MEAN_TIME_S,
    follow_near_motion,
    follow_velocity,
    motion_specific_force,
)
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.late_rates import carry_late_velocity
from insgnss.filter.sensor_errors import bias_row, correct_sensors, factor_of, place_further_errors
from insgnss.filter.state import (
    BA,
    BG,
    BIAS_FACTOR,
    CLOCK,
    DR,
    DRIFT,
    DRIFT_FACTOR,
    DV,
    MAX_COUPLINGS,
    OFFSETS,
    PSI,
    Bank,
    HeadRecord,
    StateRecord,
)
from insgnss.geodesy.vectors import dot, times
from insgnss.inertial.error_dynamics import (
    COUPLING_DTYPE,
    Couplings,
    StepSpace,
    carry_covariance,
    step_space,
    transition_step,
)
from insgnss.inertial.increments import effective_rates
from insgnss.inertial.mechanization import mechanize
from insgnss.kernels.jit import kernel
from insgnss.kernels.records import Record, dtype_of
from insgnss.tables import Float64, Int64


class Rates(Record):
    """Rates and forces of an interval, and scratch."""

    w: Annotated[Float64, 3]  # effective rate of the interval [rad/s]
    f: Annotated[Float64, 3]  # effective specific force [m/s^2]
    w_before: Annotated[Float64, 3]
    f_before: Annotated[Float64, 3]
    w_now: Annotated[Float64, 3]
    f_now: Annotated[Float64, 3]
    g_e: Annotated[Float64, 3]
    errors: Annotated[Float64, 7, 6]  # see ``place_further_errors``


RATES_DTYPE: Final = dtype_of(Rates)
SHOWN2: Final = 25.0  # squared sigmas of its noise beyond which a rate or a force is one
FORCE_DEPARTURE_TIME_S: Final = (
    30.0  # over which a specific force becomes the usual one, whose errors are the biases'
)
_FARTHEST2: Final = 4e10  # 200 km of height, beyond which the expansion is not valid
_CURVED_M2: Final = 9e6  # 3 km, over which it leaves 3 mm/s: see ``add_gravity_curvature``
LONGEST_STEP_S: Final = 0.125  # a longer interval is carried in pieces: the state's steps are of second order


class ImuSamples(NamedTuple):
    """Inertial samples as the loop reads them."""

    t_ns: Int64
    w_ib_b: Float64
    f_b: Float64
    # (n, 2) densities of the motion that a sample does not show [rad^2/s], [m^2/s^3]; (0, 2): there is none
    unknown: Float64 = np.zeros((0, 2))

    def part(self, first: int, last: int) -> ImuSamples:
        """Return the samples from ``first`` up to ``last``."""
        chosen = slice(first, last)
        return ImuSamples(self.t_ns[chosen], self.w_ib_b[chosen], self.f_b[chosen], self.unknown[chosen])


class Scratch(NamedTuple):
    """Work space of the prediction, allocated once."""

    rates: npt.NDArray[Any]  # (1,) of RATES_DTYPE
    A: Float64  # (n, n)
    step: StepSpace
    keep: Float64  # (n,) decay factor of each state over a step, 1 where it does not decay
    couplings: Couplings  # (MAX_COUPLINGS,) of the further errors of the sensors


def new_scratch(n: int) -> Scratch:
    """Return work space for ``n`` error states."""
    couplings = np.zeros(MAX_COUPLINGS, COUPLING_DTYPE)
    return Scratch(np.zeros(1, RATES_DTYPE), np.zeros((n, n)), step_space(n), np.ones(n), couplings)


@kernel(inline=True)
def predict_covariance(m: StateRecord, P: Float64, par: Parameters, scratch: Scratch) -> None:
    """Carry the covariance over everything summed since the last call, let the biases decay, and clear the sums."""
    follow_velocity(m, P, m.sum_dt)
    propagate_covariance(m, P, par, scratch)
    if m.sum_dt > 0.0:
        for i in range(3):
            m.b_a[i] *= scratch.keep[BA + i]
            m.b_g[i] *= scratch.keep[BG + i]
        for i in range(min(par.n_optional, P.shape[0] - OFFSETS)):
            m.optional[i] *= scratch.keep[OFFSETS + i]
    clear_sums(m)


@kernel(apart=True)
def propagate_covariance(m: StateRecord, P: Float64, par: Parameters, scratch: Scratch) -> None:
    """Propagate the covariance ``P`` over the sums in ``m``; write the decay factor of each state into ``keep``.

    Equation: P <- Phi (P + Q/2) Phi^T + Q/2: the trapezoid rule for the integral of Phi Q Phi^T, which gives the
    noise's way into position, velocity and clock bias to second order in the step.
    """
    dt = m.sum_dt
    if dt <= 0.0:
        return
    x, y, z, residual = motion_specific_force(m, P, par, scratch.rates[0].g_e, scratch.A)
    accel_q = m.sum_accel_q + residual * dt
    step = transition_step(dt, x, y, z, m.r_e)
    place_decays(m, par, dt, scratch.keep)
    couplings = scratch.couplings[: par.n_couplings]
    mean_f, mean_w = times(m.sum_f, 1.0 / dt), times(m.sum_w, 1.0 / dt)
    for k in range(couplings.shape[0]):
        couplings[k].at, couplings[k].bias = par.coupling_at[k], bias_row(par, k)
        couplings[k].factor = factor_of(par.coupling_times[k], mean_f, mean_w)
    add_half_noise(m, P, par, dt, accel_q)
    carry_covariance(step, m.sum_C, couplings, scratch.keep, P, scratch.step)
    add_half_noise(m, P, par, dt, accel_q)
    if P[DR, DR] + P[DR + 1, DR + 1] + P[DR + 2, DR + 2] > _CURVED_M2:
        add_gravity_curvature(m, P, dt)


@kernel(inline=True)
def add_gravity_curvature(m: StateRecord, P: Float64, dt: float) -> None:
    """Add to the vertical velocity the second-order effect of the gravity gradient on a height error.

    Equation: g(h) = g (1 - 2 h / R + 3 h^2 / R^2), so an error h of sigma s neglects a = 3 g h^2 / R^2, of the rms
    sqrt(3) 3 g s^2 / R^2. It grows with h^2 as exp(2 t / T), T = sqrt(R / 2 g) = 570 s, and leaves a T / 2 in the
    velocity. White noise of density a^2 T leaves the same variance.
    """
    r2 = dot(m.r_e, m.r_e)
    up = times(m.r_e, 1.0 / math.sqrt(r2))
    s2 = variance_along(P[DR : DR + 3, DR : DR + 3], up[0], up[1], up[2])
    if not s2 < _FARTHEST2:
        s2 = _FARTHEST2
    density = (
        27.0
        * (STANDARD_GRAVITY_MPS2 * s2 / r2) ** 2
        * math.sqrt(math.sqrt(r2) / (2.0 * STANDARD_GRAVITY_MPS2))
    )
    for i in range(3):
        for j in range(3):
            P[DV + i, DV + j] += density * dt * up[i] * up[j]


@kernel(inline=True)
def bias_decays(m: StateRecord, par: Parameters, dt: float) -> tuple[float, float]:
    """Return the decay factors exp(-dt / time) of the biases of accelerometers and gyros over ``dt`` [s].

    The time is that of a sound sensor. What one has jumped by when it failed stays.
    """
    of_a = 1.0 if m.failed[0] else math.exp(-dt / par.accel_bias_time)
    of_g = 1.0 if m.failed[1] else math.exp(-dt / par.gyro_bias_time)
    return of_a, of_g


@kernel(inline=True)
def place_decays(m: StateRecord, par: Parameters, dt: float, keep: Float64) -> None:
    """Write the decay factors exp(-dt / time) of a step of ``dt`` [s]."""
    of_a, of_g = bias_decays(m, par, dt)
    for i in range(3):
        keep[BA + i] = of_a
        keep[BG + i] = of_g
    for i in range(min(par.n_optional, keep.shape[0] - OFFSETS)):
        if par.optional_rate[i] > 0.0:
            keep[OFFSETS + i] = math.exp(-dt * par.optional_rate[i])


@kernel(inline=True)
def clear_sums(m: StateRecord) -> None:
    """Set the sums of the covariance's step to zero."""
    m.sum_dt = 0.0
    m.sum_gyro_q = 0.0
    m.sum_accel_q = 0.0
    for i in range(3):
        m.sum_dv[i] = m.sum_f[i] = m.sum_w[i] = 0.0
        for j in range(3):
            m.sum_C[i, j] = 0.0


@kernel(inline=True)
def add_half_noise(m: StateRecord, P: Float64, par: Parameters, dt: float, accel_q: float) -> None:
    """Add half of the step's process noise to the diagonal of the covariance; ``accel_q`` is the velocity's."""
    half = 0.5 * dt
    for i in range(3):
        P[DV + i, DV + i] += 0.5 * accel_q
        P[PSI + i, PSI + i] += 0.5 * m.sum_gyro_q
        P[BA + i, BA + i] += half * par.accel_bias_density
        P[BG + i, BG + i] += half * par.gyro_bias_density
    P[CLOCK, CLOCK] += half * m.noise_factor[BIAS_FACTOR] * par.clock_bias_density
    P[DRIFT, DRIFT] += half * m.noise_factor[DRIFT_FACTOR] * par.clock_drift_density
    for i in range(min(par.n_optional, P.shape[0] - OFFSETS)):
        P[OFFSETS + i, OFFSETS + i] += half * par.optional_density[i]


@kernel(inline=True)
def step_state(
    m: StateRecord, par: Parameters, dt: float, gyro_unknown: float, accel_unknown: float, rates: Rates
) -> None:
    """Move the state by ``dt`` [s] with the effective ``rates`` and add to the sums of the covariance.

    ``gyro_unknown`` [rad^2/s] and ``accel_unknown`` [m^2/s^3] are the densities of motion that the samples do not show.
    """
    w, f = rates.w, rates.f
    C = m.C_eb
    half = 0.5 * dt
    departure2 = force_departure2(m, f, dt)
    shown_rates(m, par, w, f, departure2, dt)
    for i in range(3):
        m.sum_f[i] += dt * m.f_last[i]
        m.sum_w[i] += dt * m.w_last[i]
        for j in range(3):
            m.sum_C[i, j] += half * C[i, j]
    before_e = (m.v_e[0], m.v_e[1], m.v_e[2])
    dv_e = mechanize(m.q_eb, C, m.r_e, m.v_e, w, f, dt, rates.g_e)
    gain = 1.0 / max(FORCE_MEAN_TIME_S, dt)
    for i in range(3):
        m.sum_dv[i] += dv_e[i]
        m.f_smooth[i] += (dv_e[i] - m.f_smooth[i] * dt) * gain
        m.w_smooth[i] += (w[i] - m.w_smooth[i]) * (dt * gain)
        for j in range(3):
            m.sum_C[i, j] += half * C[i, j]
    follow_near_motion(m, w, dv_e, dt)
    if m.rates_late_s > 0.0:
        carry_late_velocity(m, par, w, before_e, dt)
    m.clock[0] += m.clock[1] * dt
    w2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    gyro = par.gyro_density + par.gyro_scale_density * w2
    accel = par.accel_density + par.accel_scale_density * departure2
    m.sum_gyro_q += (gyro + gyro_unknown) * dt
    m.sum_accel_q += (accel + accel_unknown) * dt
    m.sum_dt += dt


@kernel(inline=True)
def shown_rates(
    m: StateRecord, par: Parameters, w: Float64, f: Float64, departure2: float, dt: float
) -> None:
    """Keep the rate and the specific force that further errors of the sensors go with, their noise taken off at rest.

    A sample's noise moves the state as an error of scale does, in proportion to itself: a filter that takes it for a
    rate or a force finds in half an hour at rest that the sensor measures nothing but noise. So a rate within five
    sigmas of its noise counts as none, and a force that far from its slow mean as the mean.
    """
    w2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    turns = w2 * dt > SHOWN2 * par.gyro_density
    moves = departure2 * dt > SHOWN2 * par.accel_density
    for i in range(3):
        m.w_last[i] = w[i] if turns else 0.0
        m.f_last[i] = f[i] if moves else m.f_mean[i]


@kernel(inline=True)
def force_departure2(m: StateRecord, f: Float64, dt: float) -> float:
    """Return the square of the specific force's departure from its slow mean, in body axes [m^2/s^4]; keep the mean.

    The effect of scale factors and misalignments on a constant force is in the bias; only its change is a separate
    error.
    """
    total = 0.0
    new = m.f_mean[0] == 0.0 and m.f_mean[1] == 0.0 and m.f_mean[2] == 0.0
    share = 1.0 if new else dt / max(FORCE_DEPARTURE_TIME_S, dt)
    for i in range(3):
        apart = f[i] - m.f_mean[i]
        m.f_mean[i] += share * apart
        total += apart * apart
    return 0.0 if new else total


@kernel(inline=True)
def load_rates(
    m: StateRecord, par: Parameters, w_ib_b: Float64, f_b: Float64, t_ns: Int64, k: int, s: Rates
) -> None:
    """Write sample ``k``'s effective rates, the sensors' errors removed, the further ones as ``s.errors`` has them."""
    dt: float = (t_ns[k] - t_ns[k - 1]) * 1e-9
    before = k - 1 if k > 1 else k
    dt_before = (t_ns[before] - t_ns[before - 1]) * 1e-9
    for i in range(3):
        s.w_now[i] = w_ib_b[k, i] - m.b_g[i]
        s.f_now[i] = f_b[k, i] - m.b_a[i]
        s.w_before[i] = w_ib_b[before, i] - m.b_g[i]
        s.f_before[i] = f_b[before, i] - m.b_a[i]
    if par.n_couplings > 0:
        correct_sensors(s.errors, s.w_now, s.f_now)
        correct_sensors(s.errors, s.w_before, s.f_before)
    effective_rates(s.w_now, s.f_now, s.w_before, s.f_before, dt, dt_before, s.w, s.f)


@kernel(apart=True)
def carry(
    m: StateRecord,
    P: Float64,
    now_ns: int,
    k: int,
    stop_ns: int,
    imu: ImuSamples,
    par: Parameters,
    scratch: Scratch,
) -> int:
    """Carry one hypothesis from ``now_ns`` to ``stop_ns``; return the next sample's index.

    An interval that holds ``stop_ns`` is split there: its effective rates are constant over it. The covariance's sums
    are carried on whenever they are longer than a covariance step.

    Parameters
    ----------
    now_ns, k : time of the state, inside the interval (t_ns[k-1], t_ns[k]] of sample k (or at its start)
    stop_ns : at most the last sample's time
    """
    rates, t_ns, unknown = scratch.rates[0], imu.t_ns, imu.unknown
    place_further_errors(m, par, rates.errors)
    while now_ns < stop_ns:
        load_rates(m, par, imu.w_ib_b, imu.f_b, t_ns, k, rates)
        gyro_unknown, accel_unknown = m.noise_excess * par.gyro_density, m.noise_excess * par.accel_density
        if k < unknown.shape[0]:
            gyro_unknown += unknown[k, 0]
            accel_unknown += unknown[k, 1]
        end_ns = min(t_ns[k], stop_ns)
        dt = (end_ns - now_ns) * 1e-9
        pieces = 1 if dt <= LONGEST_STEP_S else math.ceil(dt / LONGEST_STEP_S)
        for _ in range(pieces):
            step_state(m, par, dt / pieces, gyro_unknown, accel_unknown, rates)
            if m.sum_dt > par.covariance_step - 1e-6:
                predict_covariance(m, P, par, scratch)
                place_further_errors(m, par, rates.errors)
        now_ns = end_ns
        if end_ns == t_ns[k]:
            k += 1
    return k


@kernel(inline=True)
def carry_bank(bank: Bank, stop_ns: int, imu: ImuSamples, par: Parameters, scratch: Scratch) -> None:
    """Carry every hypothesis to ``stop_ns``."""
    head: HeadRecord = bank.head[0]
    now_ns = head.now_ns
    k = head.next
    if stop_ns <= now_ns:
        return
    k_end = k
    for i in range(bank.state.shape[0]):
        k_end = carry(bank.state[i], bank.P[i], now_ns, k, stop_ns, imu, par, scratch)
    head.now_ns = stop_ns
    head.next = k_end
