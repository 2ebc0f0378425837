"""A covariance on its way through a scenario: the user at rest, level or banked, satellites on given tracks.

The filter's own kernels carry it and correct it; there are no measurements, for a linear covariance needs none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from insgnss.antenna.equipment import limits_of
from insgnss.antenna.installation import Installation
from insgnss.antenna.visibility import (
    IS_VISIBLE,
    UNDECIDED,
    VisibilityLimits,
    attitude_covariance,
    look_at,
    variance_along,
)
from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.config.library import imu_grade, oscillator
from insgnss.config.scenario import ScenarioConfig
from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.errors import ConfigError
from insgnss.filter.layout import Layout
from insgnss.filter.measurements.pseudorange import range_row
from insgnss.filter.measurements.range_rate import rate_row
from insgnss.filter.parameters import resolve_parameters
from insgnss.filter.prediction import Scratch, new_scratch, predict_covariance
from insgnss.filter.rows.lines import ANTENNA_DTYPE
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI, Bank, new_bank
from insgnss.filter.update.predictions import RANGE_COLUMNS, RATE_COLUMNS
from insgnss.filter.update.scalar_update import predicted_variance, scalar_update
from insgnss.geodesy.rotations import euler_to_matrix
from insgnss.simulation.sky_law import SkyLaw
from insgnss.studies.scenario_equipment import filter_of, installation_of, sky_of, visibility_of
from insgnss.tables import Bool, Float64, Int8
from insgnss.units import deg_per_h_to_radps, deg_to_rad, mg_to_mps2

OutageCause = Literal["switch", "bank"]
Sensors = Literal["strapdown", "levelled"]
_LEVEL_NORTH = (0.0, 0.0)  # roll and heading of the user at rest [rad]


# the paper's sensors have biases, noise and scale factors, nothing else
_NO_MISALIGNMENT: Final = {
    "gyro_misalignment_mrad": 0.0,
    "gyro_g_sensitivity_deg_per_h_per_g": 0.0,
    "accel_misalignment_mrad": 0.0,
}


class Update(NamedTuple):
    """Record of one update, one entry per satellite."""

    time_s: float
    angles: Float64  # (n, 2) azimuth, elevation [rad]
    body_elevation: Float64  # [rad]
    is_hidden: Bool
    waits: bool  # the visibility stage, for the heading
    D: Float64  # (n, 2) range [m^2], range rate [m^2/s^2]


@dataclass(frozen=True)
class CovarianceRun:
    """A covariance propagated through the scenario."""

    scenario: ScenarioConfig
    sky: SkyLaw
    bank: Bank
    par: npt.NDArray[Any]
    scratch: Scratch
    antennas: Installation
    limits: VisibilityLimits
    seen: Int8  # (n,) the visibility stage's decisions so far
    by_bank: bool
    sensors_bank: bool

    @classmethod
    def of(
        cls, scenario: ScenarioConfig, imu: str, clock: str, outage: OutageCause, sensors: Sensors
    ) -> CovarianceRun:
        """Return a covariance at the start of a scenario; the names are those of the model library.

        Raises
        ------
        ModelError : the library has no such sensor, oscillator or antenna
        ConfigError : ``outage`` or ``sensors`` is none of their words
        """
        for key, word, words in (
            ("outage", outage, get_args(OutageCause)),
            ("sensors", sensors, get_args(Sensors)),
        ):
            if word not in words:
                raise ConfigError(f"{word!r} is unknown", key=key, advice=f"give one of {', '.join(words)}")
        grade, sky = imu_grade(imu).model_copy(update=_NO_MISALIGNMENT), sky_of(scenario)
        bank = new_bank(1, 0)
        bank.state[0].r_e[:] = sky.r_e
        bank.P[0] = initial_covariance(scenario, grade, sky.C_ne)
        return cls(
            scenario,
            sky,
            bank,
            _parameters(scenario, grade, oscillator(clock)),
            new_scratch(OFFSETS),
            installation_of(scenario),
            limits_of(visibility_of(scenario)),
            np.full(len(scenario.satellites), UNDECIDED, np.int8),
            outage == "bank",
            sensors == "strapdown",
        )

    def update(self, t_s: float) -> Update:
        """Propagate the covariance to ``t_s``, record it, and correct it by the satellites that are not hidden."""
        m, P, config = self.bank.state[0], self.bank.P[0], self.scenario
        C_nb = self._attitude(t_s, banks=True)
        self._predict(self._attitude(t_s, banks=self.sensors_bank))
        at = np.full((1, len(self.seen)), t_s)
        u_n = self.sky.directions(at)[0]
        rows = [_rows_towards(m, u_e) for u_e in u_n @ self.sky.C_ne]
        D = [
            (predicted_variance(P, a, RANGE_COLUMNS), predicted_variance(P, b, RATE_COLUMNS)) for a, b in rows
        ]
        hidden, waits = self._hidden_by_stage(u_n, C_nb) if self.by_bank else (self._switched_off(t_s), False)
        v = np.zeros((3, OFFSETS))
        noise = config.measurements.range_variance_m2, config.measurements.rate_variance_m2ps2
        for kind, columns in enumerate((RANGE_COLUMNS, RATE_COLUMNS)):
            for row in (row for row, off in zip(rows, hidden, strict=True) if not off):
                scalar_update(P, row[kind], columns, 0.0, noise[kind], v)
        body_elevation = np.arcsin(-(u_n @ C_nb)[:, 2])
        return Update(t_s, self.sky.angles(at)[0], body_elevation, hidden, waits, np.array(D))

    def _attitude(self, t_s: float, *, banks: bool) -> Float64:
        """Return C_nb: level to the north, or on the heading that the bank needs, banked during the outage."""
        roll, heading = _LEVEL_NORTH
        if self.by_bank:
            outage, manoeuvre = self.scenario.outage, self.scenario.bank
            heading = deg_to_rad(manoeuvre.heading_deg)
            if banks and outage.from_s <= t_s < outage.until_s:
                roll = deg_to_rad(manoeuvre.roll_deg)
        C_nb = np.empty((3, 3))
        euler_to_matrix(roll, 0.0, heading, C_nb)
        return C_nb

    def _predict(self, C_nb: Float64) -> None:
        """Carry the covariance over one interval between updates, in steps, at the attitude of its end."""
        m, par, config = self.bank.state[0], self.par[0], self.scenario
        m.C_eb[:] = self.sky.C_ne.T @ C_nb
        f_e = self.sky.C_ne.T @ np.array([0.0, 0.0, -STANDARD_GRAVITY_MPS2])
        interval_s = 1.0 / config.measurements.rate_hz
        steps = max(round(interval_s / config.equipment.covariance_step_s), 1)
        dt = interval_s / steps
        for _ in range(steps):
            m.sum_dt, m.sum_dv, m.sum_C = dt, f_e * dt, m.C_eb * dt
            m.sum_gyro_q, m.sum_accel_q = par.gyro_density * dt, par.accel_density * dt
            predict_covariance(m, self.bank.P[0], par, self.scratch)

    def _switched_off(self, t_s: float) -> Bool:
        """Return which satellites the scenario's switch has off."""
        outage = self.scenario.outage
        off = outage.from_s <= t_s < outage.until_s
        return np.asarray(off & np.isin(self.scenario.sv_names, outage.sv))

    def _hidden_by_stage(self, u_n: Float64, C_nb: Float64) -> tuple[Bool, bool]:
        """Return which satellites the visibility stage hides, and whether it waits for the heading."""
        P_b = np.empty((3, 3))
        attitude_covariance(self.bank.P[0], PSI, self.sky.C_ne.T @ C_nb, P_b)
        # the third row of C_nb is down in body axes: along it the attitude's variance is the heading's
        waits = not variance_along(P_b, *C_nb[2]) <= self.limits.heading_variance
        for i, u_b in enumerate(u_n @ C_nb):
            look = look_at(u_b, P_b, waits, self.antennas, self.limits, int(self.seen[i]))
            self.seen[i] = look.decision
        return (self.seen & IS_VISIBLE) == 0, waits


def initial_covariance(scenario: ScenarioConfig, grade: ImuGrade, C_ne: Float64) -> Float64:
    """Return P0 (17, 17) in the order of ``filter.state``: the scenario's sigmas, the biases those of the grade.

    Roll, pitch and heading errors are independent rotations about north, east and down.
    """
    start = scenario.start
    level, heading = start.sd_roll_pitch_deg, start.sd_heading_deg
    tilt = C_ne.T @ np.diag(np.radians([level, level, heading]) ** 2) @ C_ne
    blocks = (
        (DR, start.sd_position_m),
        (DV, start.sd_velocity_mps),
        (BA, mg_to_mps2(grade.accel_bias_mg)),
        (BG, deg_per_h_to_radps(grade.gyro_bias_deg_per_h)),
    )
    P = np.zeros((OFFSETS, OFFSETS))
    for first, sigma in blocks:
        P[first : first + 3, first : first + 3] = sigma**2 * np.eye(3)
    P[PSI : PSI + 3, PSI : PSI + 3] = 0.5 * (tilt + tilt.T)
    P[CLOCK, CLOCK], P[DRIFT, DRIFT] = start.sd_clock_m**2, start.sd_clock_drift_mps**2
    return P


def _parameters(scenario: ScenarioConfig, grade: ImuGrade, clock: Oscillator) -> npt.NDArray[Any]:
    """Return the filter's numbers; biases first-order Gauss-Markov, q = 2 sigma^2 / tau, sigma that of P0."""
    no_lever = (0.0, 0.0, 0.0)
    par = resolve_parameters(filter_of(scenario), grade, clock, no_lever, False, Layout())
    gyro, accel = deg_per_h_to_radps(grade.gyro_bias_deg_per_h), mg_to_mps2(grade.accel_bias_mg)
    par["gyro_bias_time"], par["accel_bias_time"] = (
        grade.gyro_correlation_time_s,
        grade.accel_correlation_time_s,
    )
    par["gyro_bias_density"] = 2.0 * gyro**2 / grade.gyro_correlation_time_s
    par["accel_bias_density"] = 2.0 * accel**2 / grade.accel_correlation_time_s
    return par


def _rows_towards(m: Any, u_e: Float64) -> tuple[Float64, Float64]:
    """Return the filter's rows of H of a pseudorange and a range rate towards ``u_e``, without lever arm.

    Neglects: the range rate's dependence on position, 1e-4 1/s.
    """
    antenna = np.zeros(1, ANTENNA_DTYPE)
    antenna["u"][0] = u_e
    h_range, h_rate = np.zeros(len(RATE_COLUMNS)), np.zeros(len(RATE_COLUMNS))
    range_row(antenna[0].u, antenna[0].l_e, h_range)
    rate_row(m, antenna[0], h_rate)
    return h_range[: len(RANGE_COLUMNS)].copy(), h_rate
