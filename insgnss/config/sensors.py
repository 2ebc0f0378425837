"""The schema of ``[[sensor]]``: a further sensor of the vehicle, its log, its errors and where it sits.

Each entry is a log of text like the inertial one: files, columns by name, time, decimal mark. What it measures and
which errors it has, its ``kind`` says. Errors that stay are states of the filter; errors that last for a moment longer
than the time between two readings (``correlation_time_s``) make each reading count less:

    variance of a row = sigma^2 max(1, 2 correlation_time_s / time since the reading before).

So ten readings in a second of an error that lasts a second weigh as little as they are worth together.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from insgnss.config.log_table import NO_COLUMN, ColumnName, LogColumns, LogTable, Names3
from insgnss.config.quantities import (
    AXES,
    Angle,
    Angles,
    AngleSigma,
    LeverArm,
    NotNegative,
    Positive,
    Vector3,
)

Clock = Literal["gps", "imu"]
Name = Annotated[str, Field(pattern=r"^([A-Za-z][A-Za-z0-9_]*)?$", max_length=40)]
Sigmas3 = tuple[Positive, Positive, Positive]
SpeedUnit = Literal["m/s", "km/h", "mph", "kn"]
AngleSigmas = tuple[AngleSigma, AngleSigma, AngleSigma]


class SensorLog(LogTable):
    """The keys of every further sensor's table."""

    kind: str
    name: Name = Field("", description="name in tables, columns and events; its kind when left out")
    files: tuple[Path, ...] = Field(
        (), description="its log, one file after the other; none: values come live"
    )
    interval_s: NotNegative = Field(
        0.1, description="readings that follow sooner are left out (a fifth less passes as jitter)"
    )
    correlation_time_s: NotNegative = Field(1.0, description="correlation time of the readings' noise")
    gate_sigma: Positive = Field(4.0, description="a reading further from its prediction is refused")
    clock: Clock = Field(
        "gps", description="whose time its tags are: gps, or imu (the IMU's tags: they share its time offset)"
    )

    @property
    def label(self) -> str:
        """Its name: that given, else its kind."""
        return self.name or self.kind

    @property
    def value_columns(self) -> tuple[str, ...]:
        """The columns of the measurements; ``NO_COLUMN`` where the log lacks one."""
        raise NotImplementedError

    @property
    def sigma_columns(self) -> tuple[str, ...]:
        """The columns of the readings' own sigmas, which a log need not have."""
        return ()


class OdometerColumns(LogColumns):
    """Names of the columns of an odometer's log."""

    speed: ColumnName = Field(
        "speed", description="column of the speed, or of the count of pulses (metres_per_count)"
    )
    sigma: ColumnName = "sd_speed"


class Odometer(SensorLog):
    """The speed of a wheel, or of a point of the vehicle, along its forward axis ([vehicle.non_holonomic])."""

    kind: Literal["odometer"]
    columns: OdometerColumns = OdometerColumns()
    unit: SpeedUnit = "m/s"
    metres_per_count: Positive | None = Field(
        None, description="the column counts pulses of so many metres (a trip meter in metres: 1)"
    )
    signed: bool = Field(True, description="false: it reads the same forwards and backwards")
    least_speed_mps: NotNegative = Field(0.0, description="below this speed it reads zero")
    lever_arm_m: LeverArm = Field(
        (0.0, 0.0, 0.0), description="IMU to the wheel that does not steer: forward, right, down"
    )
    sigma_mps: Positive = Field(0.1, description="noise of a reading")
    sigma_share: NotNegative = Field(0.01, description="noise in proportion to the speed: slip")
    scale_sigma: Positive = Field(0.03, description="sigma of the unknown scale factor at the start")
    scale_walk_per_sqrt_h: NotNegative = Field(0.002, description="random walk of the scale factor")
    gate_sigma: Positive = 3.0
    clock: Clock = "imu"

    @property
    def value_columns(self) -> tuple[str, ...]:
        """The column of speeds or counts."""
        return (self.columns.speed,)

    @property
    def sigma_columns(self) -> tuple[str, ...]:
        """The column of sigmas, in the unit of the speed."""
        return (self.columns.sigma,)


class BarometerColumns(LogColumns):
    """Names of the columns of a barometer's log."""

    value: ColumnName = Field("pressure_hpa", description="pressure, or pressure altitude")
    sigma: ColumnName = "sd_altitude_m"


class Barometer(SensorLog):
    """Static pressure, or the altitude that an instrument made of it with the standard atmosphere."""

    kind: Literal["barometer"]
    columns: BarometerColumns = BarometerColumns()
    unit: Literal["hPa", "Pa", "kPa", "m", "ft"] = Field("hPa", description="m and ft: pressure altitude")
    lever_arm_m: LeverArm = Field((0.0, 0.0, 0.0), description="IMU to the pressure port")
    sigma_m: Positive = Field(1.0, description="noise of a reading, with gusts and draught")
    correlation_time_s: NotNegative = 2.0
    offset_sigma_m: Positive = Field(
        100.0, description="sigma of the offset at the start: the day's pressure at sea level, and the geoid"
    )
    drift_sigma_m: Positive = Field(
        30.0, description="sigma of the weather's changes, Gauss-Markov with drift_time_s"
    )
    drift_time_s: Positive = 86_400.0
    scale_sigma: Positive = Field(
        0.03, description="sigma of height per altitude: 10 K from the standard atmosphere make 3.5 %"
    )
    clock: Clock = "imu"

    @property
    def value_columns(self) -> tuple[str, ...]:
        """The column of pressures or altitudes."""
        return (self.columns.value,)

    @property
    def sigma_columns(self) -> tuple[str, ...]:
        """The column of sigmas [m]."""
        return (self.columns.sigma,)


class MagnetometerColumns(LogColumns):
    """Names of the columns of a magnetometer's log."""

    field: Names3 = ("mag_x", "mag_y", "mag_z")


class Magnetometer(SensorLog):
    """The magnetic field along three axes, whose horizontal part gives the heading."""

    kind: Literal["magnetometer"]
    columns: MagnetometerColumns = MagnetometerColumns()
    unit: Literal["uT", "nT", "mG", "G"] = "uT"
    axes: tuple[str, str, str] = Field(
        ("+x", "+y", "+z"), description="which sensor axis points forward, right, down"
    )
    mounting_matrix: tuple[Vector3, Vector3, Vector3] | None = Field(
        None, description="C_bs, sensor axes to body axes; instead of axes"
    )
    declination_deg: Angle = Field(
        description="declination of place and year: magnetic north east of true north, by a calculator of the World"
        " Magnetic Model"
    )
    declination_sigma_deg: AngleSigma = Field(0.5, description="sigma of what the calculator does not model")
    horizontal_ut: Positive = Field(
        description="horizontal intensity of the field [uT], from the same calculator; 15 to 40 at most places"
    )
    horizontal_share: Positive = Field(
        0.03, description="relative sigma of the horizontal intensity, with the sensor's scale"
    )
    sigma_ut: Positive = Field(0.5, description="noise of a reading, per axis")
    hard_iron_sigma_ut: Positive = Field(
        2.0, description="sigma of the vehicle's own field along each axis at the start"
    )
    hard_iron_walk_ut_per_sqrt_h: NotNegative = Field(
        0.5, description="random walk of the vehicle's own field"
    )
    gate_sigma: Positive = 3.0
    clock: Clock = "imu"

    @model_validator(mode="after")
    def _axes_are_a_signed_permutation(self) -> Self:
        named = [a if a[:1] in "+-" else f"+{a}" for a in self.axes]
        if any(a not in AXES for a in named) or len({a[1] for a in named}) != 3:
            raise ValueError(f"axes must name x, y and z once each, with a sign; got {list(self.axes)}")
        if self.axes != ("+x", "+y", "+z") and self.mounting_matrix is not None:
            raise ValueError("axes and mounting_matrix say the same thing twice: give one of them")
        return self

    @property
    def value_columns(self) -> tuple[str, ...]:
        """The columns of the field."""
        return self.columns.field


class HeadingColumns(LogColumns):
    """Names of the columns of a log of headings."""

    heading: ColumnName = "heading_deg"
    sigma: ColumnName = "sd_heading_deg"


class HeadingSensor(SensorLog):
    """A heading from outside: two antennas, a gyro compass, a magnetic compass."""

    kind: Literal["heading"]
    columns: HeadingColumns = HeadingColumns()
    unit: Literal["deg", "rad"] = Field(
        "deg", description="unit of headings, clockwise from north, and of sigmas"
    )
    declination_deg: Angle = Field(
        0.0, description="is added to the headings: the declination where they are from magnetic north"
    )
    offset_deg: Angle = Field(
        0.0, description="is added to the headings: the vehicle's heading minus that of the device"
    )
    offset_sigma_deg: AngleSigma = Field(0.5, description="sigma of the offset")
    sigma_deg: AngleSigma = 1.0

    @property
    def value_columns(self) -> tuple[str, ...]:
        """The column of headings."""
        return (self.columns.heading,)

    @property
    def sigma_columns(self) -> tuple[str, ...]:
        """The column of sigmas."""
        return (self.columns.sigma,)


class AttitudeColumns(LogColumns):
    """Names of the columns of a log of attitudes; ``none`` for an angle that it lacks."""

    attitude: Names3 = ("roll_deg", "pitch_deg", "yaw_deg")
    sigma: Names3 = ("sd_roll_deg", "sd_pitch_deg", "sd_yaw_deg")


class AttitudeSensor(SensorLog):
    """Roll, pitch and yaw from outside."""

    kind: Literal["attitude"]
    columns: AttitudeColumns = AttitudeColumns()
    unit: Literal["deg", "rad"] = Field("deg", description="unit of angles and sigmas")
    mounting_rpy_deg: Angles = Field(
        (0.0, 0.0, 0.0), description="roll, pitch, yaw of the device's axes against the body's"
    )
    sigma_deg: AngleSigmas = Field((1.0, 1.0, 2.0), description="sigmas of roll, pitch, yaw")

    @model_validator(mode="after")
    def _turned_device_needs_all_angles(self) -> Self:
        if self.mounting_rpy_deg != (0.0, 0.0, 0.0) and NO_COLUMN in self.columns.attitude:
            raise ValueError("mounting_rpy_deg needs roll, pitch and yaw: give all three columns")
        return self

    @property
    def value_columns(self) -> tuple[str, ...]:
        """The columns of roll, pitch and yaw."""
        return self.columns.attitude

    @property
    def sigma_columns(self) -> tuple[str, ...]:
        """The columns of their sigmas."""
        return self.columns.sigma


class PositionColumns(LogColumns):
    """Names of the columns of a log of position fixes; ``none`` for a height that it lacks."""

    position: Names3 = ("lat_deg", "lon_deg", "h_m")
    sigma: Names3 = Field(("sd_n_m", "sd_e_m", "sd_d_m"), description="north, east, down")


class PositionSensor(SensorLog):
    """Position fixes: of a receiver that logs no raw data, of a tracking system, of a map."""

    kind: Literal["position"]
    columns: PositionColumns = PositionColumns()
    frame: Literal["geodetic", "ecef"] = Field(
        "geodetic", description="latitude, longitude [deg] and height [m]; or x, y, z [m]"
    )
    height: Literal["ellipsoid", "sea_level"] = Field(
        "ellipsoid", description="the zero of the heights; sea_level: EGM96, as in NMEA"
    )
    lever_arm_m: LeverArm = Field((0.0, 0.0, 0.0), description="IMU to the point whose position it is")
    sigma_m: Sigmas3 | None = Field(None, description="sigmas north, east, down, where the log has none")
    correlation_time_s: NotNegative = 5.0

    @model_validator(mode="after")
    def _heights_fit_the_frame(self) -> Self:
        if self.frame == "ecef" and self.height != "ellipsoid":
            raise ValueError(
                "height = 'sea_level' needs latitude and longitude: leave it out with x, y and z"
            )
        return self

    @property
    def value_columns(self) -> tuple[str, ...]:
        """The columns of latitude, longitude and height, or of x, y and z."""
        return self.columns.position

    @property
    def sigma_columns(self) -> tuple[str, ...]:
        """The columns of the sigmas north, east, down."""
        return self.columns.sigma


class VelocityColumns(LogColumns):
    """Names of the columns of a log of velocities; ``none`` for a component that it lacks."""

    velocity: Names3 = ("vn_mps", "ve_mps", "vd_mps")
    sigma: Names3 = ("sd_vn_mps", "sd_ve_mps", "sd_vd_mps")


class VelocitySensor(SensorLog):
    """Velocities against the Earth from outside."""

    kind: Literal["velocity"]
    columns: VelocityColumns = VelocityColumns()
    axes: Literal["ned", "enu", "neu"] = Field(
        "ned", description="north, east, down; or east, north, up; or north, east, up, as RTKLIB's; m/s"
    )
    lever_arm_m: LeverArm = Field((0.0, 0.0, 0.0), description="IMU to the point whose velocity it is")
    sigma_mps: Sigmas3 | None = Field(None, description="sigmas along the same axes, where the log has none")

    @property
    def value_columns(self) -> tuple[str, ...]:
        """The columns of the velocity."""
        return self.columns.velocity

    @property
    def sigma_columns(self) -> tuple[str, ...]:
        """The columns of its sigmas, along the same axes."""
        return self.columns.sigma

    @property
    def ned(self) -> tuple[int, int, int]:
        """Where north, east and the vertical stand among its components."""
        return (1, 0, 2) if self.axes == "enu" else (0, 1, 2)

    @property
    def lacking(self) -> tuple[bool, ...]:
        """Whether the log lacks each of north, east, down."""
        return tuple(self.columns.velocity[k] == NO_COLUMN for k in self.ned)


Sensor = Annotated[
    Odometer | Barometer | Magnetometer | HeadingSensor | AttitudeSensor | PositionSensor | VelocitySensor,
    Field(discriminator="kind"),
]
