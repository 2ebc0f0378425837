"""The schema of a flight file: which logs, in which columns, units, axes and time, and how the vehicle was equipped.

Nothing here is guessed: what a log does not say itself, the flight file declares, and the readers hold the numbers
against the declaration.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from insgnss.config.imu import ImuColumns as ImuColumns
from insgnss.config.imu import ImuConfig as ImuConfig
from insgnss.config.imu import ImuGrade as ImuGrade
from insgnss.config.key_errors import KeyValueError, require_own_names
from insgnss.config.log_table import NO_COLUMN, ColumnName, LogColumns, LogTable, Names3
from insgnss.config.quantities import Angles as Angles
from insgnss.config.quantities import AngleSigma as AngleSigma
from insgnss.config.quantities import Height as Height
from insgnss.config.quantities import LeverArm as LeverArm
from insgnss.config.quantities import NotNegative as NotNegative
from insgnss.config.quantities import Positive as Positive
from insgnss.config.quantities import Vector3 as Vector3
from insgnss.config.quantities import Velocity as Velocity
from insgnss.config.sensors import Sensor
from insgnss.config.slow_errors import SlowErrorSizes
from insgnss.config.strict import StrictModel
from insgnss.config.vehicle_kind import VehicleRows

LONGEST_LAG_S: Final = 2.0  # of range rates

_ROW_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_ROTATION_TOLERANCE = 1e-4  # of the products of a rotation's rows: numbers with four digits


class Oscillator(StrictModel):
    """A two-state clock by its h-parameters (one-sided densities of fractional frequency)."""

    h0_s: NotNegative = Field(le=1.0, description="white frequency noise")
    h_minus2_per_s: NotNegative = Field(le=1.0, description="random walk of the frequency")
    source: str = ""


class GnssColumns(LogColumns):
    """Names of the columns of a GNSS log; the optional ones are used where the file has them."""

    sv: ColumnName = "sv"
    system: ColumnName = Field(
        NO_COLUMN, description="column of constellations, where the satellites are bare numbers"
    )
    signal: ColumnName = "signal"
    pseudorange: ColumnName = "pseudorange_m"
    doppler: ColumnName = "doppler_hz"
    range_rate: ColumnName = "range_rate_mps"
    carrier: ColumnName = "carrier_phase_cycles"
    lli: ColumnName = "lli"
    cn0: ColumnName = "cn0_dbhz"
    sigma_pseudorange: ColumnName = "sigma_pseudorange_m"
    sigma_range_rate: ColumnName = "sigma_range_rate_mps"
    sat_position: Names3 = ("sat_x_m", "sat_y_m", "sat_z_m")
    sat_velocity: Names3 = ("sat_vx_mps", "sat_vy_mps", "sat_vz_mps")
    sat_clock: ColumnName = "sat_clock_m"
    sat_clock_drift: ColumnName = "sat_clock_drift_mps"


GlonassSatellite = Annotated[str, Field(pattern=r"^R\d\d$")]
PseudorangeCode = Annotated[str, Field(pattern=r"^C\d[A-Z]$")]
LogFormat = Literal["csv", "rinex", "ubx", "sbf", "android"]
System = Literal["G", "R", "E", "C", "J", "I", "S"]


class ObservationLog(LogTable):
    """A log of GNSS observations; columns, time and satellites are declared where it is a table."""

    files: tuple[Path, ...] = Field(min_length=1)
    format: LogFormat = "csv"
    columns: GnssColumns = GnssColumns()
    system: System | None = Field(
        None, description="constellation of satellites written as bare numbers, by its letter in RINEX"
    )
    system_codes: dict[str, System] = Field(
        {}, description="what the column of constellations holds if it is not a name or letter: 1 = 'G'"
    )
    signal_codes: dict[str, PseudorangeCode] = Field(
        {}, description="RINEX codes of signals that the log names otherwise: 'L1 C/A' = 'C1C'"
    )

    @model_validator(mode="after")
    def _codes_have_their_columns(self) -> Self:
        if self.system is not None and self.columns.system != NO_COLUMN:
            raise ValueError(
                f"system = '{self.system}' declares one constellation for all rows, and columns.system ="
                f" '{self.columns.system}' reads one from each row: leave one of them out"
            )
        if self.system_codes and self.columns.system == NO_COLUMN:
            raise ValueError("system_codes translate a column of constellations: declare columns.system too")
        if self.signal_codes and self.columns.signal == NO_COLUMN:
            raise ValueError("signal_codes translate a column of signals: declare columns.signal too")
        return self


class Base(ObservationLog):
    """A base station at a known place, whose ranges correct those of the flight."""

    format: LogFormat = "rinex"
    lat_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    lon_deg: Annotated[float, Field(ge=-360.0, le=360.0)]
    h_m: Height = Field(
        description="height of the antenna above the ellipsoid, in the frame of the satellites' orbits"
    )
    max_age_s: Positive = Field(30.0, description="largest age of a correction")
    same_receiver: bool = Field(
        False, description="base and flight have receivers of one type: their signals share one clock"
    )


class MountedAntenna(StrictModel):
    """A receiving antenna: where it sits, how it is turned, its field of view and the airframe's obstructions."""

    name: str = ""
    pattern: str = Field(description="a name in models/antennas, or a file ending in .csv")
    lever_arm_m: LeverArm | None = Field(
        None, description="IMU to phase centre in metres, body axes; that of the GNSS log when left out"
    )
    mounting_rpy_deg: Angles = Field(
        (0.0, 0.0, 0.0),
        description="roll, pitch, yaw of the antenna's axes against the body's; roll 180 looks down",
    )
    mounting_matrix: tuple[Vector3, Vector3, Vector3] | None = Field(
        None, description="C_ba, antenna axes to body axes; instead of mounting_rpy_deg"
    )
    obstruction: Path | None = Field(None, description="file of the airframe's obstructions (TOML)")

    @model_validator(mode="after")
    def _is_turned_in_one_way(self) -> MountedAntenna:
        if self.mounting_matrix is None:
            return self
        if self.mounting_rpy_deg != (0.0, 0.0, 0.0):
            raise ValueError("give mounting_rpy_deg or mounting_matrix, not both")
        (a, b, c), (d, e, f), (g, h, i) = rows = self.mounting_matrix
        skew = [sum(x * y for x, y in zip(rows[j], rows[k], strict=True)) - (j == k) for j, k in _ROW_PAIRS]
        turns = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
        if max(map(abs, skew)) > _ROTATION_TOLERANCE or turns < 0.0:
            raise ValueError(
                "mounting_matrix is not a rotation: its rows are not three right-handed unit vectors"
            )
        return self


class Gnss(ObservationLog):
    """A GNSS log, the source of satellite positions, and the antenna."""

    navigation: tuple[Path, ...] = ()
    precise: tuple[Path, ...] = Field((), description="SP3 orbits and RINEX clocks, instead of the messages")
    antennas: Path | None = Field(
        None, description="ANTEX file: phase centres of the satellites, with precise orbits"
    )
    base: Base | None = None
    slow_errors: SlowErrorSizes | None = Field(
        None,
        description="slowly varying range errors of this log; used if the filter's [slow_errors] are the defaults",
    )
    glonass_channels: dict[GlonassSatellite, Annotated[int, Field(ge=-7, le=6)]] = Field(
        {}, description="frequency channels that neither log nor messages contain: R07 = -3"
    )
    rate_sign: Literal["standard", "reversed"] = Field(
        "standard", description="reversed: Doppler and range rates have the opposite of their standard signs"
    )
    range_rate_lag_s: float = Field(
        0.0,
        ge=0.0,
        le=LONGEST_LAG_S,
        description="by which range rates lag behind the motion: loops that smooth them",
    )
    lever_arm_m: LeverArm | None = Field(
        None, description="IMU to antenna in metres, forward, right, down; left out means unknown, not zero"
    )
    oscillator: str | Oscillator = "tcxo"
    receiver_events: Path | None = Field(
        None, description="CSV of the receiver's own events, for the search supervisor: time_s, sv, event"
    )
    antenna: tuple[MountedAntenna, ...] = Field(
        (), description="the receiving antennas, for masking; none: nothing is masked"
    )

    @property
    def lever_b(self) -> LeverArm | None:
        """IMU to the antenna of the log: as given for the log, else that of the first antenna."""
        if self.lever_arm_m is None and self.antenna:
            return self.antenna[0].lever_arm_m
        return self.lever_arm_m


class GivenStart(StrictModel):
    """A start state the user gives: the IMU's position, velocity, attitude, and how well each is known."""

    time_s: Annotated[float, Field(ge=-6.1e6, le=6.1e6)] | None = Field(
        None, description="seconds of the GPS week; the first usable epoch when left out"
    )
    lat_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    lon_deg: Annotated[float, Field(ge=-360.0, le=360.0)]
    h_m: Height = Field(description="height above the ellipsoid [m]")
    v_ned_mps: Velocity = Field(description="velocity north, east, down [m/s]")
    rpy_deg: Angles = Field(description="roll, pitch, yaw [deg]")
    sd_position_m: float = Field(30.0, gt=0.0, le=1e7, description="one sigma per axis [m]")
    sd_velocity_mps: float = Field(1.0, gt=0.0, le=2e4, description="one sigma per axis [m/s]")
    sd_roll_pitch_deg: AngleSigma = Field(2.0, description="one sigma; 180 deg: unknown")
    sd_yaw_deg: AngleSigma = Field(10.0, description="one sigma; 180 deg: unknown")


class ReferenceColumns(LogColumns):
    """Names of the columns of a reference trajectory; all but time and position are optional."""

    position: Names3 = Field(("lat_deg", "lon_deg", "h_m"), description="latitude, longitude, height")
    velocity: Names3 = Field(("vn", "ve", "vd"), description="north, east, down")
    attitude: Names3 = Field(("roll_deg", "pitch_deg", "yaw_deg"), description="roll, pitch, yaw")
    quality: ColumnName = Field("quality", description="column of each fix's quality number")
    sigma_position: Names3 = Field(("sd_n_m", "sd_e_m", "sd_d_m"), description="north, east, down")
    sigma_velocity: Names3 = Field(("sd_vn_mps", "sd_ve_mps", "sd_vd_mps"), description="north, east, down")
    sigma_attitude: Names3 = Field(
        ("sd_roll_deg", "sd_pitch_deg", "sd_yaw_deg"), description="roll, pitch, yaw"
    )


class Reference(LogTable):
    """A reference trajectory to score against."""

    file: Path
    columns: ReferenceColumns = ReferenceColumns()
    point: Literal["imu", "antenna"] = "imu"
    quality_max: Positive | None = Field(
        None,
        description="rows with a larger quality number are left out: 1 leaves out RTKLIB's float (2) and single (5)",
    )


class FurtherAntenna(MountedAntenna):
    """A further antenna with a log of its own."""

    name: str = Field(min_length=1)
    pattern: str = "isotropic"
    files: tuple[Path, ...] = Field(min_length=1, description="columns and time as those of [gnss]")
    format: LogFormat | None = Field(
        None,
        description="left out: the one that its first file states, else that of [gnss] if it declares one",
    )
    delay_m: float = Field(
        0.0,
        ge=-1e4,
        le=1e4,
        description="with a common clock: by how much its cable is longer than the main antenna's",
    )


class AttitudeConfig(StrictModel):
    """Several antennas whose carrier phase differences give the attitude."""

    clocks: Literal["common", "separate"] = Field(
        description="one oscillator drives all receivers, or each has its own"
    )
    vehicle: str | None = Field(
        None, description="where the antennas sit: a name in models/vehicles, or a file ending in .toml"
    )
    main_antenna: str | None = Field(
        None, description="the vehicle's antenna that recorded the log of [gnss]"
    )
    phase_sigma_m: Positive = Field(0.002, description="noise of one antenna's phase at 45 dBHz")
    phase_floor_m: NotNegative = Field(
        0.0, description="additional white noise of one antenna's phase, independent of C/N0"
    )
    phase_elevation_m: NotNegative = Field(
        0.0, description="additional white noise, proportional to one over the sine of the elevation"
    )
    multipath_sigma_m: NotNegative = Field(0.003, description="multipath error of one antenna's phase")
    multipath_time_s: NotNegative = Field(60.0, description="correlation time of reflections")
    ratio: Annotated[float, Field(gt=1.0)] = Field(
        2.0, description="smallest accepted ratio of the second-best integer solution's cost to the best's"
    )
    confirmations: Annotated[int, Field(ge=1)] = Field(
        3, description="successive epochs that must find the same integer cycles"
    )
    gate_sigma: Positive = 4.5
    antenna: tuple[FurtherAntenna, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _antennas_are_told_apart(self) -> AttitudeConfig:
        names = [antenna.name for antenna in self.antenna]
        if len({*names, self.main_antenna}) != len(names) + 1:
            raise ValueError("each antenna needs its own name, different from that of the main antenna")
        if (self.vehicle is None) != (self.main_antenna is None):
            raise ValueError(
                "vehicle and main_antenna go together: main_antenna names the antenna of the log in [gnss]"
            )
        return self


NO_WEEK: Final = -1  # left out


class FlightConfig(StrictModel):
    """A whole flight file. Relative paths are relative to the file itself."""

    lists_keys = "every key with its meaning: docs/flight-file.md"
    needs = (
        "a flight file needs [gnss] with files and navigation, or a [[sensor]] of kind 'position' with files, and"
        " [imu] with files and grade (not for a point solution)"
    )
    name: str = ""
    gps_week: Annotated[int, Field(ge=0, le=9999)] = Field(
        NO_WEEK,
        description="GPS week of all times in seconds of the week; left out: the week in which the log begins",
    )
    imu: ImuConfig | None = Field(None, description="not needed for a point solution")
    gnss: Gnss = Field(
        Gnss.model_construct(files=()),
        description="left out: position fixes of a [[sensor]] start and correct the filter",
    )
    attitude: AttitudeConfig | None = None
    vehicle: VehicleRows | None = Field(None, description="kind of vehicle and the constraints on its motion")
    start: GivenStart | Literal["automatic"] = "automatic"
    reference: Reference | None = None
    sensor: tuple[Sensor, ...] = Field((), description="further sensors, each with a log of its own")
    points: dict[str, LeverArm] = Field(
        {}, description="points of the body by their names, IMU to the point in metres, forward, right, down"
    )

    @model_validator(mode="after")
    def _sensors_are_told_apart(self) -> Self:
        if not self.model_fields_set:
            message = "the file declares nothing"
            advice = f"{self.needs}; 'insgnss convert' writes one from a receiver's files; {self.lists_keys}"
            raise KeyValueError(message, advice=advice)
        if not self.gnss.files and all(sensor.kind != "position" for sensor in self.sensor):
            message = "no GNSS: give [gnss] with its files, or a [[sensor]] of kind 'position'"
            raise KeyValueError(message, "gnss", advice=f"{self.needs}; {self.lists_keys}")
        if not self.gnss.files and self.attitude is not None:
            raise KeyValueError("[attitude] needs the carrier phases of [gnss]: declare [gnss] too", "gnss")
        require_own_names([sensor.label for sensor in self.sensor], "sensors", "sensor")
        return self

    def columns_by_file(self) -> dict[Path, tuple[str, ...]]:
        """Return the columns that the logs read from each file: several may share one."""
        tables: list[tuple[LogColumns, tuple[Path, ...]]] = [
            (sensor.columns, sensor.files) for sensor in self.sensor
        ]
        tables += [] if self.imu is None else [(self.imu.columns, self.imu.every_file)]
        base, antennas = self.gnss.base, () if self.attitude is None else self.attitude.antenna
        tables += [(self.gnss.columns, files) for files in (self.gnss.files, *(a.files for a in antennas))]
        tables += [] if base is None else [(base.columns, base.files)]
        tables += [] if self.reference is None else [(self.reference.columns, (self.reference.file,))]
        found: dict[Path, tuple[str, ...]] = {}
        for columns, files in tables:
            for path in files:
                found[path] = (*found.get(path, ()), *columns.all_names())
        return found
