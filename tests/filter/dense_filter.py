"""The 17-state filter once more, dense: filterpy's EKF over matrices written down from the error state's equations.

Only the strapdown mechanization and the coning terms are the package's own; dynamics, process noise, measurements,
their rows and the closed loop are built here, from the docstring of ``inertial.error_dynamics`` and the paper.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from scipy.spatial.transform import Rotation

from insgnss.constants import C_MPS, WGS84_GM_M3PS2, WGS84_OMEGA_RADPS
from insgnss.filter.state import Bank
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.inertial.increments import effective_rates
from insgnss.inertial.mechanization import mechanize
from insgnss.tables import Float64, Int64

R, V, A, BA, BG = (slice(i, i + 3) for i in range(0, 15, 3))
CLOCK, DRIFT, N = 15, 16, 17
OMEGA_E = np.array([0.0, 0.0, WGS84_OMEGA_RADPS])


def skew(a: Float64) -> Float64:
    """Return [a x]."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def gravity_gradient(r_e: Float64) -> Float64:
    """Return dg/dr [1/s^2] of a point mass and the centrifugal acceleration."""
    distance = np.linalg.norm(r_e)
    u = r_e / distance
    point_mass = -WGS84_GM_M3PS2 / distance**3 * (np.eye(3) - 3.0 * np.outer(u, u))
    return np.asarray(point_mass - skew(OMEGA_E) @ skew(OMEGA_E))


class DenseFilter:
    """One nominal state, kept as plain arrays, and filterpy's filter of its error."""

    def __init__(self, bank: Bank, par: Any, lever_b: Float64) -> None:
        """Start from a copy of a filter of the package."""
        m = bank.state[0]
        self.q, self.C, self.r, self.v = m.q_eb.copy(), m.C_eb.copy(), m.r_e.copy(), m.v_e.copy()
        self.b_a, self.b_g, self.clock = m.b_a.copy(), m.b_g.copy(), m.clock.copy()
        self.par, self.lever_b = par, lever_b
        self.ekf = ExtendedKalmanFilter(dim_x=N, dim_z=1)
        self.ekf.P = bank.P[0].copy()
        self._dt, self._C_dt, self._dv = 0.0, np.zeros((3, 3)), np.zeros(3)

    def carry(self, now_ns: int, k: int, stop_ns: int, t_ns: Int64, w_ib_b: Float64, f_b: Float64) -> int:
        """Carry state and covariance to ``stop_ns``; sample k's interval holds ``now_ns``; return the next sample."""
        while now_ns < stop_ns:
            before = max(k - 1, 1)
            dt = np.diff(t_ns)[[k - 1, before - 1]] * 1e-9
            w, f = np.zeros(3), np.zeros(3)
            effective_rates(
                w_ib_b[k] - self.b_g, f_b[k] - self.b_a, w_ib_b[before] - self.b_g, f_b[before] - self.b_a,
                dt[0], dt[1], w, f,
            )  # fmt: skip
            end_ns = min(int(t_ns[k]), stop_ns)
            self._move((end_ns - now_ns) * 1e-9, w, f)
            if self._dt > float(self.par["covariance_step"]) - 1e-6:
                self.predict()
            now_ns, k = end_ns, k + (end_ns == t_ns[k])
        return k

    def _move(self, dt: float, w: Float64, f: Float64) -> None:
        """Mechanize ``dt`` and add to the sums over the covariance's step."""
        C_before = self.C.copy()
        dv = np.array(mechanize(self.q, self.C, self.r, self.v, w, f, dt, np.zeros(3)))
        self.clock[0] += self.clock[1] * dt
        self._dt, self._dv = self._dt + dt, self._dv + dv
        self._C_dt = self._C_dt + 0.5 * dt * (C_before + self.C)

    def transition(self) -> Float64:
        """Return Phi over the step; psi and v are taken at its middle."""
        dt, F = self._dt, np.zeros((N, N))
        F[A, A], F[A, BG] = -skew(OMEGA_E) * dt, -self._C_dt
        psi_mid = np.eye(N) + 0.5 * F
        F_v = np.zeros((N, N))
        F_v[V, A], F_v[V, BA] = -skew(self._dv), -self._C_dt
        F_v[V, R], F_v[V, V] = gravity_gradient(self.r) * dt, -2.0 * skew(OMEGA_E) * dt
        Phi = np.eye(N) + F + F_v @ psi_mid
        Phi[R] += 0.5 * dt * (np.eye(N)[V] + Phi[V])
        Phi[BA, BA] *= np.exp(-dt / float(self.par["accel_bias_time"]))
        Phi[BG, BG] *= np.exp(-dt / float(self.par["gyro_bias_time"]))
        Phi[CLOCK, DRIFT] = dt
        return Phi

    def noise(self) -> Float64:
        """Return Q of the step before the transition spreads it."""
        p = {name: float(self.par[name]) for name in self.par.dtype.names if self.par[name].ndim == 0}
        names = ("accel_density", "gyro_density", "accel_bias_density", "gyro_bias_density")
        three = np.repeat([0.0, *(p[name] for name in names)], 3)
        return np.diag(
            np.concatenate([three, [p["clock_bias_density"], p["clock_drift_density"]]]) * self._dt
        )

    def predict(self) -> None:
        """Carry the covariance on: P <- Phi (P + Q/2) Phi^T + Q/2."""
        if self._dt == 0.0:
            return
        Phi, Q = self.transition(), self.noise()
        self.ekf.F, self.ekf.Q = Phi, 0.5 * (Phi @ Q @ Phi.T + Q)
        self.ekf.predict()
        self.b_a, self.b_g = self.b_a * Phi[9, 9], self.b_g * Phi[12, 12]
        self._dt, self._C_dt, self._dv = 0.0, np.zeros((3, 3)), np.zeros(3)

    def update(
        self, sat: Float64, value: Float64, w_ib_b: Float64, f_b: Float64, sigma: tuple[float, float]
    ) -> None:
        """Use the ranges, then the range rates, of satellites (k, 8), all judged on the prior; close the loop."""
        self.predict()
        rows = [self.expected(s, w_ib_b, f_b) for s in sat]
        self.ekf.x = np.zeros((N, 1))
        for kind in range(2):
            for (prediction, H), z in zip(rows, value, strict=True):
                innovation = np.array([[z[kind] - prediction[kind]]])
                row = H[kind : kind + 1]
                self.ekf.update(
                    innovation, lambda _, row=row: row, lambda x, row=row: row @ x, sigma[kind] ** 2
                )
        x = self.ekf.x[:, 0]
        self.r, self.v, self.b_a, self.b_g = self.r + x[R], self.v + x[V], self.b_a + x[BA], self.b_g + x[BG]
        self.clock += x[CLOCK:]
        # the tilt before the heading, and the gyro bias so that b_g + C^T w_ie is what the gyros have shown
        f, w_ie = 1.0 / 298.257223563, np.array([0.0, 0.0, OMEGA_E[2]])
        up = self.r / [1.0, 1.0, 1.0 - f * (2.0 - f) * 6_378_137.0 / np.linalg.norm(self.r)]
        heading = up * (up @ x[A]) / (up @ up)
        turned = Rotation.from_rotvec(heading) * Rotation.from_rotvec(x[A] - heading)
        turned = turned * Rotation.from_quat(np.roll(self.q, -1))
        first_order = self.C.T @ (w_ie + np.cross(w_ie, x[A]))
        self.q, self.C = np.roll(turned.as_quat(), 1), turned.as_matrix()
        self.b_g = self.b_g + first_order - self.C.T @ w_ie

    def expected(self, sat: Float64, w_ib_b: Float64, f_b: Float64) -> tuple[Float64, Float64]:
        """Return predicted range and range rate of one satellite, and their rows of H (2, n).

        Light time by iteration, velocities in the inertial frame that is ECEF at the instant of reception.
        """
        l_e = self.C @ self.lever_b
        a_e = self.C @ np.cross(w_ib_b - self.b_g, self.lever_b)
        v_a = self.v + a_e - np.cross(OMEGA_E, l_e)
        # reception was clock / c before the time tag, on the way there at the antenna's acceleration
        g_e, late = np.zeros(3), self.clock[0] / C_MPS
        normal_gravity_ecef(self.r, g_e)
        w_b = w_ib_b - self.b_g
        f_a = f_b - self.b_a + np.cross(w_b, np.cross(w_b, self.lever_b))
        acceleration = self.C @ f_a + g_e - 2.0 * np.cross(OMEGA_E, self.v)
        r_a = self.r + l_e - v_a * late + 0.5 * acceleration * late**2
        v_a = v_a - acceleration * late
        tau = 0.0
        for _ in range(6):
            turn = Rotation.from_rotvec(-OMEGA_E * tau).as_matrix()
            d = turn @ sat[0:3] - r_a
            tau = float(np.linalg.norm(d)) / C_MPS
        distance = float(np.linalg.norm(d))
        u = d / distance
        v_sat = turn @ (sat[3:6] + np.cross(OMEGA_E, sat[0:3]))
        rate = u @ (v_sat - v_a - np.cross(OMEGA_E, r_a)) / (1.0 + u @ v_sat / C_MPS)
        relative = turn @ sat[3:6] - v_a
        H = np.zeros((2, N))
        H[0, R], H[0, A], H[0, CLOCK] = -u, np.cross(u, l_e), 1.0
        H[1, R] = -(np.eye(3) - np.outer(u, u)) @ relative / distance
        H[1, V], H[1, A] = -u, np.cross(u, a_e) + np.cross(l_e, np.cross(u, OMEGA_E))
        H[1, BG], H[1, DRIFT] = np.cross(self.lever_b, self.C.T @ u), 1.0
        return np.array([distance + self.clock[0] - sat[6], rate + self.clock[1] - sat[7]]), H
