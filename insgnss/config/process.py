"""Settings of the process noise, and of the installation's numbers that the filter estimates."""

from __future__ import annotations

from typing import Literal, Self, get_args

from pydantic import Field, model_validator

from insgnss.config.quantities import NotNegative, Positive
from insgnss.config.strict import StrictModel

SensorError = Literal[
    "gyro_scale_factor", "gyro_misalignment", "gyro_g_sensitivity", "accel_scale_factor", "accel_misalignment"
]


class Process(StrictModel):
    """Process noise that is not in the sensor's grade, and the rate of the covariance."""

    covariance_step_s: Positive = Field(0.025, le=10.0, description="longest step of the covariance")
    sensor_error_states: tuple[SensorError, ...] = Field(
        get_args(SensorError),
        description="errors of the inertial sensors that are states of the filter, if the grade has them; the others"
        " count as bias, and as noise in manoeuvres",
    )
    sensor_error_columns: bool = Field(
        False, description="write those states and their sigmas to nav: up to 54 columns"
    )
    scale_factor_change: NotNegative = Field(
        0.05,
        le=1.0,
        description="part of scale factors and misalignments that changes with rate and temperature: it counts as"
        " noise in manoeuvres",
    )
    scale_factor_time_s: NotNegative = Field(
        10.0, description="correlation time of that noise: about the length of one manoeuvre"
    )
    motion_sigma: NotNegative = Field(
        0.0,
        description="a horizontal specific force below this many sigmas of its noise does not count as motion and"
        " gives no heading; 0: every force counts",
    )
    inter_system_sigma_m: Positive = Field(
        3000.0, description="initial sigma of an inter-system clock offset"
    )
    qzss_offset_sigma_m: Positive = Field(
        3.0,
        ge=0.01,
        description="initial sigma of the clock offset between QZSS and GPS, which keep the same time; the range of a"
        " single QZSS satellite is then used with this much extra noise",
    )
    inter_system_walk_m_per_sqrt_s: NotNegative = Field(
        0.005, description="random walk of an inter-system clock offset"
    )
    channel_bias_sigma_m: Positive = Field(
        0.3, description="initial sigma of the GLONASS delay per frequency channel"
    )
    zenith_delay_sigma_m: Positive = Field(0.15, description="initial sigma of the residual zenith delay")
    zenith_delay_walk_m_per_sqrt_s: NotNegative = Field(0.0003, description="random walk of that delay")
    ionosphere_sigma_m: NotNegative = Field(
        0.5,
        description="initial sigma of the ionosphere model's residual at the zenith on L1: a state where carriers"
        " of one band are used, which the ionosphere advances as it delays the codes; 0: no such state",
    )
    ionosphere_walk_m_per_sqrt_s: NotNegative = Field(
        0.02, description="its random walk: 1.2 m in an hour, as in a day's ionosphere against its model"
    )
    range_bias_states: bool = Field(
        False,
        description="estimate slowly varying range errors of the sizes in [slow_errors]: one state per satellite, one"
        " for the ionosphere and one for the troposphere at the zenith; sd_n_m, sd_e_m and sd_d_m then include them",
    )
    lever_arm_sigma_m: NotNegative = Field(
        0.0, le=100.0, description="sigma of each lever arm component, then estimated; 0: exact"
    )
    imu_time_sigma_s: NotNegative | None = Field(
        None,
        le=0.1,
        description="sigma of the IMU's time offset, which is estimated; 0: exact; left out: 0.02 s with raw GNSS data,"
        " 0 with position fixes alone; declare a larger offset with imu.time.offset_s, which insgnss check finds",
    )
    range_rate_lag_sigma_s: NotNegative | None = Field(
        None,
        le=0.3,
        description="sigma of the time by which range rates lag behind the motion, beyond gnss.range_rate_lag_s; it is"
        " estimated; 0: exact; left out: 0.05 s where the IMU's time offset is estimated, else 0",
    )

    @model_validator(mode="after")
    def _lag_comes_with_the_offset(self) -> Self:
        if self.range_rate_lag_sigma_s and self.imu_time_sigma_s == 0.0:
            raise ValueError(
                "range_rate_lag_sigma_s > 0 with imu_time_sigma_s = 0: a lag is estimated only beside the IMU's time"
                " offset, whose effect is nearly the same"
            )
        return self
