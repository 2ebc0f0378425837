"""A receiver study's linear theory: thresholds and errors without a simulation, beside those of its runs.

- Channels with loops of their own: the optimal loop of a channel's model, in the steady state. Without INS it follows
  the vehicle's acceleration, with INS a residual error of 0.06 m/s^2 over 100 s and 0.1 m/s^2 white at 1 ms, whatever
  IMU is asked for: that of the laboratory's reference table. The velocity is that by least squares of all channels.
- One stage without INS: the optimal filter of 11 states, in the steady state.
- One stage with INS: the covariance of 17 states along the motion, with the IMU that is asked for. Errors are averaged
  from the same moment as those of the runs, but to the end of the motion.

    theory = LinearTheory.of(scene, variant)
    theory.threshold_dbhz()          # NaN where there is none
    theory.errors(40.0).phase_rad

Thresholds of steady models neglect the length T of an integration, errors do not (``interference.linear_threshold``).
Neglects: of the IMU scale factors, misalignments and a random walk of its biases. It does not know loops that are wider
than the optimal ones or made for another C/N0, a filter behind channels, and the replicas of ``optimal``, which the
second stage sets anew; nothing of ``optimal`` without INS.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from insgnss.config.imu import ImuGrade
from insgnss.errors import ConfigError
from insgnss.geodesy.directions import directions
from insgnss.inertial.sensor_model import sensor_model
from insgnss.interference.discriminators import ENGINEERING_RATIO, discriminator
from insgnss.interference.linear_threshold import (
    phase_threshold,
    sampled_filter,
    sampled_one_stage_velocity_mps,
    sampled_phase_rms_rad,
    sampled_two_stage_velocity_mps,
)
from insgnss.interference.margin import PhaseLoop
from insgnss.interference.phase_models import (
    PhaseModel,
    UnknownAcceleration,
    channel_model,
    one_stage_model,
)
from insgnss.studies.receiver.manoeuvring_covariance import ManoeuvringReceiver
from insgnss.studies.receiver.scene import StudyScene
from insgnss.studies.receiver.variants import Variant
from insgnss.studies.receiver.workspace import INTERVAL_MESSAGE, ONE_STAGE, SCALAR
from insgnss.tables import Float64
from insgnss.tracking.discriminator_outputs import PHASE_KINDS
from insgnss.units import deg_per_h_to_radps, mg_to_mps2

_INS_ERROR: Final = UnknownAcceleration(0.06, 100.0, 0.1, 1e-3)  # what an aided loop is designed for
_NAMES: Final = {"q": "Q", "iq": "IQ", "sign": "sign(I)Q", "atan": "atan(Q/I)"}
_CONFIDENCE: Final = 0.95
_HALF: Final = 0.5


class LinearErrors(NamedTuple):
    """Errors by the linear theory, rms, named as in ``summary``; NaN where the theory gives none."""

    phase_rad: float = math.nan  # of all channels together, before an update
    # 3-D, of the receiver's own solution, after an update (one stage with INS: before)
    velocity_mps: float = math.nan
    attitude_deg: float = math.nan
    channels_mps: float = math.nan  # 3-D, by least squares of all range rates


NOTHING: Final = LinearErrors()


@dataclass(frozen=True)
class LinearTheory:
    """The linear theory of one receiver in a study's scene."""

    loop: PhaseLoop
    kind: int  # of the receiver
    model: PhaseModel | None  # of a channel, or of one stage without INS; None: no theory ...
    along: ManoeuvringReceiver | None  # ... or one stage with INS
    sky: Float64  # (m, 3) directions to the satellites, north-east-down
    carrier_hz: float
    settle_s: float  # of the trajectory, which do not count

    @classmethod
    def of(cls, scene: StudyScene, variant: Variant) -> LinearTheory:
        """Return the theory of a receiver that tracks the phase with loops made for its C/N0, motion and oscillator."""
        setting, kind = scene.setting, PHASE_KINDS[scene.setting.channels.kinds[0]]
        optimal = variant.widening == 1.0 and setting.options.told_cn0_dbhz is None
        known = optimal and setting.channels.coherent and kind in _NAMES and setting.drift_density > 0.0
        name = _NAMES[kind] if known else "IQ"
        loop = PhaseLoop(discriminator(name, ENGINEERING_RATIO), scene.bandwidth_hz, setting.truth.step_s)
        sky = directions(scene.azimuth_deg, scene.elevation_deg)
        settled_s = float(setting.truth.t_s[setting.settle]) - scene.trajectory.first_s
        model, along = _models(scene, variant, sky) if known else (None, None)
        return cls(loop, variant.kind, model, along, sky, setting.options.carrier_hz, settled_s)

    def threshold_dbhz(self) -> float:
        """Return the C/N0 at which the largest phase rms reaches A_d C_A; NaN where there is none."""
        try:
            if self.along is not None:
                return self.along.threshold(self.loop, settle_s=self.settle_s).cn0_dbhz
            return math.nan if self.model is None else phase_threshold(self.model, self.loop).cn0_dbhz
        except ConfigError:  # the loop holds lock at every C/N0, or at none
            return math.nan

    def errors(self, cn0_dbhz: float) -> LinearErrors:
        """Return the errors at a C/N0 [dBHz]; NaN below -10 dBHz."""
        try:
            return self._errors(cn0_dbhz)
        except ConfigError:
            return NOTHING

    def _errors(self, cn0_dbhz: float) -> LinearErrors:
        """Return the errors.

        Raises
        ------
        ConfigError : no steady state, or a C/N0 out of range
        """
        if self.along is not None:
            errors = self.along.errors(self.loop, cn0_dbhz, self.settle_s)
            attitude_deg = math.degrees(errors.attitude_rad)
            return LinearErrors(_rms(errors.phase_rms_rad), errors.velocity_mps, attitude_deg)
        if self.model is None or self.kind == INTERVAL_MESSAGE:
            return NOTHING
        loop_filter, T = sampled_filter(self.model, self.loop, cn0_dbhz), self.loop.accumulation_s
        phase_rad = _rms(sampled_phase_rms_rad(self.model, loop_filter))
        if self.kind == ONE_STAGE:
            return LinearErrors(phase_rad, sampled_one_stage_velocity_mps(self.model, loop_filter))
        solved = sampled_two_stage_velocity_mps(self.model, loop_filter, T, self.sky, self.carrier_hz)
        own = solved if self.kind == SCALAR else math.nan
        return LinearErrors(phase_rad, own, channels_mps=solved)


def _models(
    scene: StudyScene, variant: Variant, sky: Float64
) -> tuple[PhaseModel | None, ManoeuvringReceiver | None]:
    """Return the steady model of a receiver, or its covariance along the motion; neither where the sky is too poor."""
    setting = scene.setting
    unknown = UnknownAcceleration(setting.unknown.sigma, setting.unknown.time_s)
    density, carrier = setting.drift_density, setting.options.carrier_hz
    try:
        if variant.kind == INTERVAL_MESSAGE and setting.inertial is None:
            return None, None
        if variant.kind != ONE_STAGE:
            return channel_model(unknown if variant.kind == SCALAR else _INS_ERROR, density, carrier), None
        if setting.inertial is None or setting.grade is None:
            return one_stage_model(unknown, density, carrier, sky), None
        grade = with_one_process(setting.grade)
        return None, ManoeuvringReceiver.of(
            scene.trajectory, grade, density, carrier, sky, setting.truth.step_s
        )
    except ConfigError:
        return None, None


def with_one_process(grade: ImuGrade) -> ImuGrade:
    """Return a grade whose constant biases and correlation times are those of the filter's Gauss-Markov processes.

    Equation: sigma^2 = constant^2 + instability^2, time = 2 sigma^2 / density       [``sensor_model.bias_model``]
    """
    sensor = sensor_model(grade)
    return grade.model_copy(
        update={
            "accel_bias_mg": sensor.accel_bias.sigma / mg_to_mps2(1.0),
            "accel_correlation_time_s": sensor.accel_bias.time_s,
            "gyro_bias_deg_per_h": sensor.gyro_bias.sigma / deg_per_h_to_radps(1.0),
            "gyro_correlation_time_s": sensor.gyro_bias.time_s,
        }
    )


def _rms(values: Float64) -> float:
    return float(np.sqrt(np.mean(values**2)))


def threshold_table(
    summary: pd.DataFrame, linear_dbhz: Mapping[str, float], scene: StudyScene
) -> pd.DataFrame:
    """Return the C/N0 at which half of the runs lose lock, one row per receiver; NaN where no share passes one half."""
    rows = []
    for name, table in summary.groupby("variant", sort=False):
        ordered = table.sort_values("cn0_dbhz")
        cn0, runs = ordered["cn0_dbhz"].to_numpy(), ordered["runs"].to_numpy()
        lost = np.rint(ordered["lost"].to_numpy() * runs)
        tail = 0.5 * (1.0 - _CONFIDENCE)
        # the shares that runs as these leave open, by the beta distribution         [Clopper & Pearson 1934]
        least = stats.beta.ppf(tail, np.maximum(lost, 1e-9), runs - lost + 1.0)
        most = stats.beta.ppf(1.0 - tail, lost + 1.0, np.maximum(runs - lost, 1e-9))
        threshold, low, high = (crossing(cn0, share) for share in (lost / runs, least, most))
        linear = linear_dbhz[str(name)]
        rows.append((name, threshold, low, high, scene.js_db(threshold), linear, scene.js_db(linear)))
    columns = ["variant", "cn0_dbhz", "low_dbhz", "high_dbhz", "js_db", "linear_cn0_dbhz", "linear_js_db"]
    return pd.DataFrame(rows, columns=columns)


def crossing(cn0_dbhz: Float64, share: Float64) -> float:
    """Return the C/N0 at which a share that falls with it passes one half; NaN where it does not.

    Parameters
    ----------
    cn0_dbhz : (n,) growing
    """
    falling = np.minimum.accumulate(share)  # more signal does not lose more
    if not (falling[0] >= _HALF > falling[-1]):
        return math.nan
    k = int(np.flatnonzero(falling >= _HALF)[-1])
    part = (falling[k] - _HALF) / (falling[k] - falling[k + 1])
    return float(cn0_dbhz[k] + part * (cn0_dbhz[k + 1] - cn0_dbhz[k]))
