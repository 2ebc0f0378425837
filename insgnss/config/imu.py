"""The schema of an inertial log in a flight file, and of the sensor behind it."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator, model_validator

from insgnss.config.log_table import LogColumns, LogTable, Names3, require_different
from insgnss.config.quantities import AXES, NotNegative, Positive, Vector3
from insgnss.config.strict import StrictModel


class ImuColumns(LogColumns):
    """Names of the columns of an inertial log."""

    gyro: Names3 = ("gyro_x", "gyro_y", "gyro_z")
    accel: Names3 = ("accel_x", "accel_y", "accel_z")

    def tables(self) -> tuple[tuple[str, ...], ...]:
        """Return the names of each file's columns, where the two sensors have files of their own."""
        return (*self.of_time, *self.gyro), (*self.of_time, *self.accel)


AccelUnit = Literal["m/s^2", "g", "mg", "cm/s^2", "m/s", "g*s"]


class ImuGrade(StrictModel):
    """The error model of an inertial sensor, per axis, one sigma."""

    gyro_bias_deg_per_h: NotNegative
    gyro_bias_instability_deg_per_h: NotNegative
    gyro_correlation_time_s: Positive
    gyro_arw_deg_per_sqrt_h: NotNegative
    gyro_scale_factor_ppm: NotNegative = 0.0
    accel_bias_mg: NotNegative
    accel_bias_instability_mg: NotNegative
    accel_correlation_time_s: Positive
    accel_vrw_mps_per_sqrt_h: NotNegative
    accel_scale_factor_ppm: NotNegative = 0.0
    gyro_range_deg_per_s: Positive | None = None
    accel_range_g: Positive | None = None
    # of data sheets or an Allan deviation that say more; quantisation and bandwidth are the simulation's alone
    gyro_rate_random_walk_deg_per_h_per_sqrt_h: NotNegative = Field(
        0.0, description="random walk of the bias"
    )
    gyro_misalignment_mrad: NotNegative = Field(
        0.0, description="misalignment of each axis against the other two"
    )
    gyro_g_sensitivity_deg_per_h_per_g: NotNegative = 0.0
    gyro_quantisation_deg: NotNegative = Field(0.0, description="smallest step of an angle increment")
    gyro_bandwidth_hz: Positive | None = None
    accel_random_walk_mg_per_sqrt_h: NotNegative = Field(0.0, description="random walk of the bias")
    accel_misalignment_mrad: NotNegative = Field(
        0.0, description="misalignment of each axis against the other two"
    )
    accel_quantisation_mps: NotNegative = Field(0.0, description="smallest step of a velocity increment")
    accel_bandwidth_hz: Positive | None = None
    source: str = ""


class ImuConfig(LogTable):
    """An inertial log and the sensor behind it."""

    files: tuple[Path, ...] = Field(min_length=1)
    accel_files: tuple[Path, ...] = Field(
        (),
        description="logs of the accelerometers, where files are those of the gyros alone; columns may then repeat",
    )
    columns: ImuColumns = ImuColumns()
    values: Literal["rates", "increments"] = "rates"
    sampling: Literal["mean", "instant"] = Field(
        "mean",
        description="a rate is the mean over the interval that ends at its tag, or the value at its tag",
    )
    gyro_unit: Literal["rad/s", "deg/s", "rad", "deg"] = "rad/s"
    accel_unit: AccelUnit = "m/s^2"
    axes: tuple[str, str, str] = Field(
        ("+x", "+y", "+z"), description="which sensor axis points forward, right, down"
    )
    gyro_axes: tuple[str, str, str] | None = Field(
        None,
        description="axes of the gyros, where they differ from the accelerometers'; both may then be left-handed",
    )
    mounting_matrix: tuple[Vector3, Vector3, Vector3] | None = Field(
        None, description="C_bs, sensor axes to body axes; instead of axes"
    )
    grade: str | ImuGrade

    @property
    def every_file(self) -> tuple[Path, ...]:
        """The files of both sensors."""
        return (*self.files, *self.accel_files)

    @field_validator("axes", "gyro_axes")
    @classmethod
    def _axes_are_a_signed_permutation(cls, axes: tuple[str, str, str] | None) -> tuple[str, str, str] | None:
        if axes is None:
            return None
        named = tuple(a if a[:1] in "+-" else f"+{a}" for a in axes)
        if any(a not in AXES for a in named) or len({a[1] for a in named}) != 3:
            raise ValueError(
                f"axes must name x, y and z once each, with a sign, as in ['-y', '-x', '-z']; got {axes}"
            )
        return (named[0], named[1], named[2])

    @model_validator(mode="after")
    def _axes_are_given_in_one_way(self) -> ImuConfig:
        if self.gyro_axes is not None and self.mounting_matrix is not None:
            raise ValueError("gyro_axes goes with axes: mounting_matrix rotates both sensors")
        if self.axes != ("+x", "+y", "+z") and self.mounting_matrix is not None:
            raise ValueError("axes and mounting_matrix say the same thing twice: give one of them")
        return self

    @model_validator(mode="after")
    def _files_fit_the_columns(self) -> ImuConfig:
        if not self.accel_files:
            require_different(
                self.columns.all_names(),
                "each needs a column of its own, or, where gyros and accelerometers have files of their own, files ="
                " [those of the gyros] and accel_files = [...]",
            )
        elif self.values == "increments":
            raise ValueError(
                "accel_files goes with values = 'rates': increments cannot be interpolated to the gyros' times"
            )
        return self

    @model_validator(mode="after")
    def _units_fit_the_values(self) -> ImuConfig:
        increments = self.gyro_unit in ("rad", "deg"), self.accel_unit in ("m/s", "g*s")
        if increments != ((self.values == "increments"),) * 2:
            raise ValueError(
                f"values = '{self.values}' does not go with gyro_unit = '{self.gyro_unit}',"
                f" accel_unit = '{self.accel_unit}':"
                " rates are in rad/s or deg/s and m/s^2, g, mg or cm/s^2; increments in rad or deg and m/s or g*s"
            )
        return self
