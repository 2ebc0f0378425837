"""Uncertainty of the aiding: sigma of each value from the filter's covariance, and its parts.

At the time of use, dt = age of the covariance + latency after it, the range rate's error is h x with the row of H

    h = h_rate + dt h_acceleration

since what is wrong with the acceleration has been integrated meanwhile: position and velocity (-u, and the turning of
the line of sight), attitude (through the lever arm's velocity, and through the specific force times dt), accelerometer
bias (u dt), gyro bias (l x u). Total = h P h^T, all correlations in it; a part is the block of P of one kind of state
with the noise of its sensor; ``cross`` is what the correlations between the blocks add (negative as a rule: attitude
and accelerometer bias have been balanced against each other by the measurements), so

    sd_doppler^2 lambda^2 = sum of the parts squared + cross

and the same for the acceleration with h_acceleration alone. What the inertial samples cannot know enters as ``motion``:
a jerk of ``jerk_sigma`` during the latency. Not in it: gravity's gradient (2e-5 m/s^2 for 5 m), the gyro's white noise
between covariance and use (|f| arw sqrt(dt), 3e-4 m/s^2 for 0.1 deg/sqrt h and 1 s).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from insgnss.aiding.antenna_motion import ARM, FORCE, RATE, VehicleTrace, place_motion, turn_about_axis
from insgnss.aiding.observables import LANES, N_LANE_ROWS, Spans, expand_satellite, towards
from insgnss.aiding.satellite_arcs import Arcs
from insgnss.aiding.trace import Covariances
from insgnss.constants import STANDARD_GRAVITY_MPS2, WGS84_OMEGA_RADPS
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI
from insgnss.geodesy.vectors import cross, place
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int64

PARTS: Final = ("velocity", "attitude", "accelerometer", "gyro", "clock", "satellite", "motion")
_VELOCITY, _ATTITUDE, _ACCELEROMETER, _GYRO, _CLOCK, _SATELLITE, _MOTION = range(len(PARTS))
N_PARTS: Final = len(PARTS)
# Columns of a row of sigma, lengths and their rates [m, m/s, m/s^2, m/s^3]
SD_RANGE: Final = 0
SD_RATE: Final = 1  # of the range, no receiver clock
SD_ACCELERATION: Final = 2
SD_JERK: Final = 3
SD_DOPPLER: Final = 4  # with the receiver clock where asked [m/s]
SD_DOPPLER_RATE: Final = 5
RATE_PARTS: Final = 6  # then N_PARTS sigma, then the cross variance
ACCELERATION_PARTS: Final = RATE_PARTS + N_PARTS + 1
N_SIGMA: Final = ACCELERATION_PARTS + N_PARTS + 1

_PART_OF_STATE: Final = np.array(
    [_VELOCITY] * 6 + [_ATTITUDE] * 3 + [_ACCELEROMETER] * 3 + [_GYRO] * 3 + [_CLOCK] * 2, np.int64
)
_TOGETHER: Final = 3  # row of the work space that takes the sum of the others


class UncertaintyTerms(NamedTuple):
    """The inputs of the sigma besides the covariance; densities two-sided."""

    gyro_density: float  # [rad^2/s]
    accel_density: float  # [m^2/s^3]
    gyro_scale: float  # one sigma [-]
    accel_scale: float
    drift_density: float  # of the receiver clock's drift [m^2/s^3]
    receiver_clock: float  # 1.0 in, 0.0 out
    clock_averaging_s: float
    latency_s: float
    jerk_sigma: float  # [m/s^3]
    satellite_range: float  # [m]
    satellite_rate: float  # [m/s]
    satellite_acceleration: float  # [m/s^2]


Slope: TypeAlias = tuple[float, float, float]  # a, 1/D (``instant_rates``) and the sample's length [s]


@kernel
def motion_rows(rho: float, line: Float64, C_eb: Float64, work: Float64, h: Float64, s: Float64) -> None:
    """Write the rows of H of range, range rate and acceleration, and what angular rate and its slope do to the latter.

    Equations, with g = -(W - u (u.W)) / rho, c = C (w x l), q = C (f + a_l) and u_b = C^T u:
    range:        dr -u, psi u x l_e
    rate:         dr g - u x omega, dv -u, psi u x c + l_e x g, b_g l x u_b
    acceleration: dv 2 g, psi u x q + 2 c x g, b_a u_b, b_g c_b x u_b + l x (u_b x w)

    Parameters
    ----------
    rho : range [m]
    line : (2, 3) u and W in ECEF axes of the instant
    work : as ``place_motion`` leaves it; rows 0 to 3 are not used
    h : (3, n) output over the error states
    s : (6, 3) scratch; row 5 is left as u_b
    """
    u, W, l_b, c_b, q_b = line[0], line[1], work[ARM], work[ARM + 1], work[ARM + 2]
    along = u[0] * W[0] + u[1] * W[1] + u[2] * W[2]
    g, l_e, c_e, q_e, u_b = s[0], s[1], s[2], s[3], s[5]
    for i in range(3):
        g[i] = (u[i] * along - W[i]) / rho
        l_e[i] = C_eb[i, 0] * l_b[0] + C_eb[i, 1] * l_b[1] + C_eb[i, 2] * l_b[2]
        c_e[i] = C_eb[i, 0] * c_b[0] + C_eb[i, 1] * c_b[1] + C_eb[i, 2] * c_b[2]
        q_e[i] = C_eb[i, 0] * q_b[0] + C_eb[i, 1] * q_b[1] + C_eb[i, 2] * q_b[2]
        u_b[i] = C_eb[0, i] * u[0] + C_eb[1, i] * u[1] + C_eb[2, i] * u[2]
    for i in range(3):
        h[0, DR + i], h[1, DR + i] = -u[i], g[i]
        h[1, DV + i], h[2, DV + i] = -u[i], 2.0 * g[i]
        h[2, BA + i] = u_b[i]
    h[1, DR] -= u[1] * WGS84_OMEGA_RADPS
    h[1, DR + 1] += u[0] * WGS84_OMEGA_RADPS
    place(h[0], PSI, cross(u, l_e))
    place(h[1], PSI, cross(u, c_e))
    v = cross(l_e, g)
    for i in range(3):
        h[1, PSI + i] += v[i]
    place(h[2], PSI, cross(u, q_e))
    v = cross(c_e, g)
    for i in range(3):
        h[2, PSI + i] += 2.0 * v[i]
    place(h[1], BG, cross(l_b, u_b))
    v = cross(u_b, work[RATE])
    place(h[2], BG, cross(l_b, v))
    v = cross(c_b, u_b)
    for i in range(3):
        h[2, BG + i] += v[i]


@kernel
def block_variances(P: Float64, h: Float64, parts: Float64) -> tuple[float, float]:
    """Add the blocks of h P h^T to ``parts`` (variances); return what correlations add: without, and with the clock.

    Parameters
    ----------
    P : (q, q), q >= 17
    h : (n,) row of H, its first 17 states are taken
    """
    others, clock = 0.0, 0.0
    for i in range(OFFSETS):
        if h[i] == 0.0:
            continue
        part = _PART_OF_STATE[i]
        for j in range(OFFSETS):
            term = h[i] * P[i, j] * h[j]
            of_j = _PART_OF_STATE[j]
            if of_j == part:
                parts[part] += term
            elif part == _CLOCK or of_j == _CLOCK:
                clock += term
            else:
                others += term
    return others, clock


@kernel(inline=True)
def sensor_noise(
    doubts: UncertaintyTerms, work: Float64, of_rate: Float64, of_slope: Float64, slope: Slope
) -> float:
    """Return the variance that the gyro's sample noise and scale factor make through two rows (of rate and slope).

    Equation: samples last and first of the slope carry (1 + a) of_rate + of_slope / D and -a of_rate - of_slope / D.
    """
    a, per_d, dt = slope
    white, scale = 0.0, 0.0
    for i in range(3):
        last = (1.0 + a) * of_rate[i] + per_d * of_slope[i]
        first = a * of_rate[i] + per_d * of_slope[i]
        white += last * last + first * first
        scale += (of_rate[i] * work[RATE, i]) ** 2
    return white * doubts.gyro_density / dt + scale * doubts.gyro_scale**2


@kernel
def satellite_sigma(
    P: Float64,
    doubts: UncertaintyTerms,
    age_s: float,
    slope: Slope,
    group: int,
    work: Float64,
    h: Float64,
    out: Float64,
) -> None:
    """Write one row of sigma from the rows of H in ``h``; the module's text says what is in it.

    Parameters
    ----------
    P : (q, q) covariance, ``age_s`` old
    slope : of the inertial sample
    group : clock group of the satellite, 0 for the receiver's own
    work : (28, 3) as ``place_motion`` leaves it; the last eight rows are scratch
    h : (4, n) rows of range, rate, acceleration; the last is scratch
    out : (N_SIGMA,) output
    """
    s, (a, per_d, dt), clock = work[20:28], slope, doubts.receiver_clock
    latency, use_s = doubts.latency_s, age_s + doubts.latency_s
    f2 = work[FORCE, 0] ** 2 + work[FORCE, 1] ** 2 + work[FORCE, 2] ** 2
    beyond = doubts.accel_scale * (math.sqrt(f2) - STANDARD_GRAVITY_MPS2)
    sample = doubts.accel_density / dt
    force = sample * ((1.0 + a) ** 2 + a * a) + beyond * beyond
    out[:] = 0.0
    row = h[_TOGETHER]
    # range: position, and the velocity since
    for i in range(OFFSETS):
        row[i] = h[0, i] + use_s * h[1, i]
    row[CLOCK], row[DRIFT] = clock, clock * use_s
    total = 0.0
    for i in range(OFFSETS):
        if row[i] != 0.0:
            for j in range(OFFSETS):
                total += row[i] * P[i, j] * row[j]
    if group > 0:
        k = OFFSETS + group - 1
        total += P[k, k]
        for i in range(OFFSETS):
            total += 2.0 * row[i] * P[i, k]
    total += doubts.satellite_range**2 + (doubts.jerk_sigma * latency**3 / 6.0) ** 2
    out[SD_RANGE] = math.sqrt(max(total, 0.0))
    # range rate: at the covariance's time, and the acceleration since
    for i in range(OFFSETS):
        row[i] = h[1, i] + use_s * h[2, i]
    row[DRIFT] = clock
    parts = out[RATE_PARTS : RATE_PARTS + N_PARTS]
    others, with_clock = block_variances(P, row, parts)
    for i in range(3):
        s[6, i] = h[1, BG + i] + latency * h[2, BG + i]
        s[7, i] = latency * h[1, BG + i]
    parts[_ACCELEROMETER] += doubts.accel_density * age_s + latency * latency * force
    parts[_GYRO] += sensor_noise(doubts, work, s[6], s[7], slope)
    parts[_CLOCK] += clock * doubts.drift_density * use_s
    parts[_SATELLITE] = doubts.satellite_rate**2 + (latency * doubts.satellite_acceleration) ** 2
    parts[_MOTION] = (0.5 * doubts.jerk_sigma * latency * latency) ** 2
    out[SD_RATE], out[SD_DOPPLER] = close_parts(parts, others, with_clock, out, RATE_PARTS + N_PARTS)
    # acceleration
    parts = out[ACCELERATION_PARTS : ACCELERATION_PARTS + N_PARTS]
    others, with_clock = block_variances(P, h[2], parts)
    parts[_ACCELEROMETER] += force
    parts[_GYRO] += sensor_noise(doubts, work, h[2, BG : BG + 3], h[1, BG : BG + 3], slope)
    parts[_CLOCK] = clock * doubts.drift_density / doubts.clock_averaging_s
    parts[_SATELLITE] = doubts.satellite_acceleration**2
    parts[_MOTION] = (doubts.jerk_sigma * latency) ** 2
    both = close_parts(parts, others, with_clock, out, ACCELERATION_PARTS + N_PARTS)
    out[SD_ACCELERATION], out[SD_DOPPLER_RATE] = both
    jerk2 = 2.0 * sample * per_d * per_d if per_d > 0.0 else doubts.jerk_sigma**2
    out[SD_JERK] = math.sqrt(jerk2)


@kernel(inline=True)
def close_parts(
    parts: Float64, others: float, with_clock: float, out: Float64, at: int
) -> tuple[float, float]:
    """Turn variances into sigma, write the cross variance at ``at``; return both totals, without and with the clock."""
    total = others
    for i in range(N_PARTS):
        if i != _CLOCK:
            total += parts[i]
    with_it = total + parts[_CLOCK] + with_clock
    for i in range(N_PARTS):
        parts[i] = math.sqrt(max(parts[i], 0.0))
    out[at] = others + with_clock
    return math.sqrt(max(total, 0.0)), math.sqrt(max(with_it, 0.0))


@kernel
def fill_sigma(
    vehicle: VehicleTrace,
    covariances: Covariances,
    newest: Int64,
    arcs: Arcs,
    spans: Spans,
    groups: Int64,
    doubts: UncertaintyTerms,
    out: Float64,
) -> None:
    """Write a row of sigma for each satellite of each span, at the span's first time.

    Parameters
    ----------
    newest : (m,) row of ``covariances`` for each span, -1 for none (its sigma stay NaN)
    groups : (s,) clock group of each satellite of the arcs
    out : (q, N_SIGMA) output
    """
    trace, imu = vehicle.trace, vehicle.imu
    work, h, e = np.zeros((28, 3)), np.zeros((4, OFFSETS)), np.zeros(N_LANE_ROWS * LANES)
    line = work[18:20]
    for span in range(len(spans.first_time) - 1):
        m = newest[span]
        if m < 0:
            continue
        i = spans.first_time[span]
        p, since_s, a, per_d = place_motion(vehicle, i, arcs, work)
        k = trace.sample[i]
        dt = (imu.t_ns[k] - imu.t_ns[k - 1]) * 1e-9 if k > 0 else 1.0
        age_s = (trace.t_ns[i] - covariances.t_ns[m]) * 1e-9
        for j in range(spans.first_satellite[span], spans.first_satellite[span + 1]):
            satellite = spans.satellite[j]
            expand_satellite(arcs.pieces[satellite, p], since_s, work[0:4], e, 0)
            rho = towards(e, 0, work[0:4], line)
            turn_about_axis(line, 0, 2, -WGS84_OMEGA_RADPS * since_s)
            motion_rows(rho, line, trace.C_eb[i], work, h, work[20:26])
            slope, group = (a, per_d, dt), groups[satellite]
            satellite_sigma(covariances.P[m], doubts, age_s, slope, group, work, h, out[j])
