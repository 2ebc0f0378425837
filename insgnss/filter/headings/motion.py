"""The motion that the measurements have shown: only it tells headings apart; compiled.

The horizontal specific force of a vehicle at rest or on a straight is the accelerometers' noise and what tilt and bias
leave of each other. It drives the velocity as well, so a filter that takes it for motion finds headings in noise.
"""

from __future__ import annotations

from typing import Final

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import AntennaState
from insgnss.filter.sensor_errors import accel_error_covariance, gyro_error_variance
from insgnss.filter.state import BA, DR, DV, PSI, StateRecord
from insgnss.geodesy.vectors import Vector
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

FORCE_MEAN_TIME_S: Final = (
    0.25  # over which specific force and rates are smoothed to separate motion from noise
)
VELOCITY_MEAN_TIME_S: Final = 10.0  # with which a velocity is compared to detect a change
LEVEL_GATE2: Final = 4.0  # squared sigmas of tilt and bias errors, within which a lasting force is not motion
MANOEUVRE_S: Final = 1.0  # correlation time of a horizontal specific force that is not credited as motion
EARTH_RATE_SHARE: Final = 0.2  # of the horizontal Earth rate: gyros with smaller bias errors find north


@kernel(inline=True)
def motion_specific_force(
    m: StateRecord, P: Float64, par: Parameters, g_e: Float64, scratch: Float64
) -> tuple[float, float, float, float]:
    """Return the velocity increment used in the transition, and the noise density of the part left out [m^2/s^3].

    The error equation dv' = (I - E^T)(a - g) - C (n + db), E = C_hat C^T, holds the true acceleration a, not the
    measured one: without motion the attitude's errors turn gravity alone, and the horizontal specific force is noise
    and the remainder of tilt and bias. A filter that takes it for motion finds headings in it that nothing
    shows. So the horizontal force f_h of the last moments counts by s = 1 - (k^2 N + 2^2 E) / |f_h|^2, N the variance
    of the sensor's noise in it, independent from sample to sample, and E that of tilt and bias together, which lasts.
    Tilt turns the vertical force that is there: all of gravity where a vehicle is carried, nothing in free fall, where
    a small drag is a motion with a direction.
    While the heading is open, it counts only where the velocity has changed too: a sensor may be noisier than its
    grade. What does not count may still be a slow motion that the attitude's errors turn, and what counts holds
    the error E: both come in as noise.
    Where the gyros see the Earth's rate, the Earth's turn is a motion that is shown, and everything counts.

    Parameters
    ----------
    scratch : (n, n)
    """
    dv = m.sum_dv
    g2 = g_e[0] * g_e[0] + g_e[1] * g_e[1] + g_e[2] * g_e[2]
    if par.motion_gate2 <= 0.0 or g2 < 1e-6:
        return dv[0], dv[1], dv[2], 0.0
    f = m.f_smooth
    along = (f[0] * g_e[0] + f[1] * g_e[1] + f[2] * g_e[2]) / g2
    hx, hy, hz = f[0] - along * g_e[0], f[1] - along * g_e[1], f[2] - along * g_e[2]
    h2 = hx * hx + hy * hy + hz * hz
    accel_error_covariance(m, par, P, scratch[1:4])
    unknown = unknown_force(m.C_eb, P, scratch[1:4], g_e, g2, -along, scratch[0])
    noise = 0.5 * par.accel_density / FORCE_MEAN_TIME_S  # of an axis, as half of ``unknown`` is
    least2 = par.motion_gate2 * noise + 0.5 * LEVEL_GATE2 * unknown
    share = max(1.0 - least2 / h2, 0.0) if h2 > 0.0 else 0.0
    if sees_earth_rate(m, par, P):
        share = 1.0
    elif m.log_weight < 0.0 and not velocity_changed(m, P, par.motion_gate2):
        share = 0.0
    along = (dv[0] * g_e[0] + dv[1] * g_e[1] + dv[2] * g_e[2]) / g2
    x, y, z = dv[0] - along * g_e[0], dv[1] - along * g_e[1], dv[2] - along * g_e[2]
    x, y, z = share * x, share * y, share * z
    if m.log_weight < 0.0:  # one of several headings
        move_response(m, x, y, z)
    attitude = P[PSI, PSI] + P[PSI + 1, PSI + 1] + P[PSI + 2, PSI + 2]
    residual = ((1.0 - share) ** 2 * h2 + share * share * unknown) * attitude * MANOEUVRE_S
    return x + along * g_e[0], y + along * g_e[1], z + along * g_e[2], residual


@kernel(inline=True)
def horizontal_variance(m: StateRecord, P: Float64) -> float:
    """Return the variance of the velocity along a horizontal axis, the mean of both [m^2/s^2]."""
    r2 = m.r_e[0] ** 2 + m.r_e[1] ** 2 + m.r_e[2] ** 2
    total, vertical = 0.0, 0.0
    for i in range(3):
        total += P[DV + i, DV + i]
        for j in range(3):
            vertical += m.r_e[i] * P[DV + i, DV + j] * m.r_e[j]
    return float(0.5 * (total - vertical / r2))


@kernel(inline=True)
def follow_velocity(m: StateRecord, P: Float64, dt: float) -> None:
    """Carry the mean velocity of the last seconds on by ``dt`` [s], and the mean of its variance."""
    share = 1.0 if m.v_mean_variance == 0.0 else dt / max(VELOCITY_MEAN_TIME_S, dt)
    for i in range(3):
        m.v_mean[i] += share * (m.v_e[i] - m.v_mean[i])
    m.v_mean_variance += share * (horizontal_variance(m, P) - m.v_mean_variance)


@kernel(inline=True)
def follow_near_motion(m: StateRecord, w: Float64, dv_e: Vector, dt: float) -> None:
    """Carry on specific force and rate, averaged over as long as the IMU's tags may be off; at least of the sample.

    Over that time the state goes to the time of a measurement, in one step. What a vehicle vibrates meanwhile
    averages out; the mean of a moment far shorter or longer would be that of another motion.
    """
    if dt <= 0.0:
        return
    gain = 1.0 / max(m.near_s, dt)
    for i in range(3):
        m.f_near[i] += (dv_e[i] - m.f_near[i] * dt) * gain
        m.w_near[i] += (w[i] - m.w_near[i]) * (dt * gain)


@kernel(inline=True)
def velocity_changed(m: StateRecord, P: Float64, gate2: float) -> bool:
    """Return whether the horizontal velocity is not that of the last seconds any more.

    Equation: |v_h - mean v_h|^2 > k^2 (sigma^2 + mean sigma^2), of a horizontal axis each
    """
    r2 = m.r_e[0] ** 2 + m.r_e[1] ** 2 + m.r_e[2] ** 2
    x, y, z = m.v_e[0] - m.v_mean[0], m.v_e[1] - m.v_mean[1], m.v_e[2] - m.v_mean[2]
    up = x * m.r_e[0] + y * m.r_e[1] + z * m.r_e[2]
    change2 = x * x + y * y + z * z - up * up / r2
    return bool(change2 > gate2 * (horizontal_variance(m, P) + m.v_mean_variance))


@kernel(inline=True)
def move_response(m: StateRecord, x: float, y: float, z: float) -> None:
    """Carry on how far the shown motion has moved velocity and position, by its velocity increment (x, y, z) [m/s]."""
    response, dt = m.motion_response, m.sum_dt
    response[DR] += (response[DV] + 0.5 * x) * dt
    response[DR + 1] += (response[DV + 1] + 0.5 * y) * dt
    response[DR + 2] += (response[DV + 2] + 0.5 * z) * dt
    response[DV] += x
    response[DV + 1] += y
    response[DV + 2] += z


@kernel(inline=True)
def place_turning(m: StateRecord, P: Float64, par: Parameters, a: AntennaState) -> None:
    """Write the antenna's velocity about the IMU that may show the attitude.

    The gyros' noise on the lever arm turns with the attitude's errors as the accelerometers' does: what a vehicle at
    rest has of it is not motion. The mean rate of the last moments counts by 1 - (k^2 N + 2^2 B) / |w|^2, N the
    variance of the gyros' noise in it, B that of their biases.
    """
    if par.motion_gate2 <= 0.0:
        for i in range(3):
            a.turning_e[i] = a.a_e[i]
        return
    x, y, z = m.w_smooth[0], m.w_smooth[1], m.w_smooth[2]
    w2 = x * x + y * y + z * z
    noise = 0.5 * par.gyro_density / FORCE_MEAN_TIME_S
    bias = gyro_error_variance(m, par, P)
    share = max(1.0 - (par.motion_gate2 * noise + LEVEL_GATE2 * bias) / w2, 0.0) if w2 > 0.0 else 0.0
    for i in range(3):
        a.w_b[i] *= share
    p, q, r = a.l_b[0], a.l_b[1], a.l_b[2]
    x, y, z = share * (y * r - z * q), share * (z * p - x * r), share * (x * q - y * p)
    for i in range(3):
        a.turning_e[i] = m.C_eb[i, 0] * x + m.C_eb[i, 1] * y + m.C_eb[i, 2] * z


@kernel(inline=True)
def angular_acceleration(m: StateRecord) -> Vector:
    """Return how the body's rate changes, by the last sample against the last moments [rad/s^2]."""
    w, mean = m.w_last, m.w_smooth
    return (
        (w[0] - mean[0]) / FORCE_MEAN_TIME_S,
        (w[1] - mean[1]) / FORCE_MEAN_TIME_S,
        (w[2] - mean[2]) / FORCE_MEAN_TIME_S,
    )


@kernel
def sees_earth_rate(m: StateRecord, par: Parameters, P: Float64) -> bool:
    """Return whether the gyros' errors are known so well that the Earth's rate shows the heading at rest."""
    r2 = m.r_e[0] * m.r_e[0] + m.r_e[1] * m.r_e[1]
    horizontal2 = WGS84_OMEGA_RADPS**2 * r2 / (r2 + m.r_e[2] * m.r_e[2])
    return bool(gyro_error_variance(m, par, P) < EARTH_RATE_SHARE**2 * horizontal2)


@kernel(inline=True)
def unknown_force(
    C: Float64, P: Float64, of_accel: Float64, g_e: Float64, g2: float, load: float, down: Float64
) -> float:
    """Return the variance of the horizontal specific force, both axes, by the errors of attitude and accelerometers.

    Equation: df = n g x psi - C e, of which the trace of (I - u u^T) cov(df), u = g/|g|, is

        n^2 (g^2 tr(P_psi) - g^T P_psi g) + tr(P_e) - (C^T u)^T P_e (C^T u) - 2 n sum_j (c_j x g) . P_psi,e_j

    with c_j the columns of ``C`` (3, 3) and -n g the vertical specific force.

    Parameters
    ----------
    of_accel : (3, n) as ``accel_error_covariance`` writes them
    load : n, 1 where the ground or a wing carries the weight, 0 in free fall
    down : (3,) scratch
    """
    for j in range(3):
        down[j] = C[0, j] * g_e[0] + C[1, j] * g_e[1] + C[2, j] * g_e[2]
    total, inv_g2, load2 = 0.0, 1.0 / g2, load * load
    for j in range(3):
        total += load2 * g2 * P[PSI + j, PSI + j] + of_accel[j, BA + j]
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            total -= load2 * g_e[j] * g_e[k] * P[PSI + j, PSI + k]
            total -= inv_g2 * down[j] * down[k] * of_accel[j, BA + k]
            total -= 2.0 * load * (C[a, j] * g_e[b] - C[b, j] * g_e[a]) * of_accel[j, PSI + k]
    return max(total, 0.0)
