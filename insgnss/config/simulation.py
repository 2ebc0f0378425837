"""The schema of a simulation's scenario file: the vehicle's motion and equipment, the sky, and the faults."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from insgnss.config.flight import (
    ImuGrade,
    MountedAntenna,
    NotNegative,
    Oscillator,
    Positive,
    ReferenceColumns,
    Vector3,
)
from insgnss.config.key_errors import require_own_names
from insgnss.config.log_table import LogTable
from insgnss.config.manoeuvres import Manoeuvre
from insgnss.config.quantities import Elevation, GpsSatellite
from insgnss.config.signal_faults import SignalFault
from insgnss.config.simulated_sensors import SensorFault, SensorStep, SimulatedSensor
from insgnss.config.strict import StrictModel

GpsSignal = Literal["C1C", "C1L", "C1X", "C2L", "C2X", "C2S", "C5I", "C5Q", "C5X"]


class StartPlace(StrictModel):
    """Where the vehicle begins, and where its nose points."""

    lat_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    lon_deg: Annotated[float, Field(ge=-360.0, le=360.0)]
    h_m: float
    heading_deg: float = 0.0


class LoggedReference(LogTable):
    """A reference trajectory that the vehicle follows, in place of manoeuvres."""

    file: Path
    columns: ReferenceColumns = ReferenceColumns()
    from_s: float | None = Field(
        None, description="start, seconds of the GPS week; left out: that of the file"
    )
    to_s: float | None = Field(None, description="end, seconds of the GPS week; left out: that of the file")
    smoothing_s: Positive = Field(0.5, description="distance of the knots: faster motion is smoothed away")


class Vibration(StrictModel):
    """A spectrum that both triads feel: corners of the power density, straight in log-log, and lines."""

    frequency_hz: tuple[Positive, ...] = Field((), description="corner frequencies, increasing")
    accel_g2_per_hz: tuple[Positive, ...] = Field(
        (), description="power density of the accelerometers at each corner"
    )
    gyro_deg2_per_s2_per_hz: tuple[Positive, ...] = Field(
        (), description="power density of the gyros at each corner"
    )
    accel_lines_hz_g: tuple[tuple[Positive, NotNegative], ...] = Field(
        (), description="pairs of frequency and amplitude"
    )
    gyro_lines_hz_deg_per_s: tuple[tuple[Positive, NotNegative], ...] = Field(
        (), description="pairs of frequency and amplitude"
    )
    from_s: NotNegative = Field(0.0, description="start of the vibration, as of a motor")
    end_s: Positive | None = Field(None, description="end of the vibration; left out: that of the log")

    @model_validator(mode="after")
    def _begins_before_it_ends(self) -> Vibration:
        if self.end_s is not None and self.end_s <= self.from_s:
            raise ValueError("end_s must be later than from_s")
        return self

    @model_validator(mode="after")
    def _corners_go_together(self) -> Vibration:
        f = self.frequency_hz
        if len(f) == 1 or any(b <= a for a, b in pairwise(f)):
            raise ValueError("frequency_hz needs two or more corners, increasing")
        if any(
            len(density) not in (0, len(f))
            for density in (self.accel_g2_per_hz, self.gyro_deg2_per_s2_per_hz)
        ):
            raise ValueError("a density needs one value for each corner of frequency_hz")
        return self


class SimulatedImu(StrictModel):
    """The inertial sensor and its log."""

    grade: str | ImuGrade = Field("tactical", description="a name, see `insgnss models`, or a table")
    rate_hz: Annotated[float, Field(gt=0.0, le=4000.0)] = 100.0
    values: Literal["rates", "increments"] = "rates"
    vibration: Vibration = Vibration()
    tag_jitter_s: NotNegative = Field(0.0, description="jitter of the time tags, one sigma")
    lost_share: Annotated[float, Field(ge=0.0, lt=0.5)] = Field(
        0.0, description="mean share of the samples that are lost"
    )
    lost_at_once: Annotated[int, Field(ge=1)] = Field(
        1, description="number of consecutive samples lost each time"
    )


class SimulatedClock(StrictModel):
    """The receiver's oscillator and where its clock begins."""

    oscillator: str | Oscillator = Field("tcxo", description="a name, see `insgnss models`, or a table")
    bias_m: float = Field(0.0, description="clock bias at the start")
    drift_mps: float = Field(0.0, description="clock drift at the start")
    jump_beyond_m: Positive | None = Field(
        None, description="beyond this bias the clock jumps by whole milliseconds"
    )


class _AnySky(StrictModel):
    """The keys of every sky."""

    qzss: tuple[GpsSatellite, ...] = Field(
        (), max_length=10, description="satellites that become QZSS satellites J01, J02, ..."
    )
    qzss_offset_m: Annotated[float, Field(ge=-1e3, le=1e3)] = Field(
        0.0, description="delay of their pseudoranges in the receiver"
    )


class NominalSky(_AnySky):
    """An evenly filled GPS-like constellation."""

    kind: Literal["nominal"] = "nominal"
    planes: Annotated[int, Field(ge=1, le=8)] = 6
    per_plane: Annotated[int, Field(ge=1, le=8)] = 5


class RinexSky(_AnySky):
    """GPS satellites of RINEX navigation files, each by the message nearest to the middle of the scenario."""

    kind: Literal["rinex"]
    files: tuple[Path, ...] = Field(min_length=1)


class YumaSky(_AnySky):
    """GPS satellites of a YUMA almanac."""

    kind: Literal["yuma"]
    file: Path


class TableSatellite(StrictModel):
    """A satellite's direction at the start, and the direction it should reach at the end."""

    sv: GpsSatellite
    azimuth_deg: tuple[float, float]
    elevation_deg: tuple[Elevation, Elevation]


class TableSky(_AnySky):
    """Satellites on orbits that begin where the table says, and end as near to it as an orbit can."""

    kind: Literal["table"]
    satellite: tuple[TableSatellite, ...] = Field(min_length=1)

    @field_validator("satellite")
    @classmethod
    def _each_one_once(cls, rows: tuple[TableSatellite, ...]) -> tuple[TableSatellite, ...]:
        names = [row.sv for row in rows]
        if len(set(names)) != len(names):
            raise ValueError("a satellite appears twice in the table")
        return rows


Sky = Annotated[NominalSky | RinexSky | YumaSky | TableSky, Field(discriminator="kind")]


class WhiteNoise(StrictModel):
    """White noise of variance floor^2 + (elevation / sin el)^2 + cn0^2 10^((45 - C/N0) / 10)."""

    floor: NotNegative
    elevation: NotNegative = 0.0
    cn0_at_45_dbhz: NotNegative = 0.0


class Loops(StrictModel):
    """Tracking loops whose thermal noise, from C/N0, takes the place of the white noise given above."""

    code_bandwidth_hz: Positive = Field(0.5, description="bandwidth of the delay loop")
    spacing_chips: Annotated[float, Field(gt=0.0, le=1.0)] = Field(0.5, description="early-to-late spacing")
    carrier_bandwidth_hz: Positive = Field(15.0, description="bandwidth of the phase loop")
    frequency_bandwidth_hz: Positive = Field(
        4.0, description="bandwidth of the loop that measures the Doppler"
    )
    integration_s: Positive = Field(0.02, description="coherent integration before each discriminator")


class Multipath(StrictModel):
    """Reflections without a geometry: Gauss-Markov, sigma = floor + horizon exp(-elevation / scale)."""

    floor_m: NotNegative = Field(0.13, description="sigma at high elevation")
    horizon_m: NotNegative = Field(0.53, description="added to the sigma at the horizon")
    scale_deg: Positive = Field(10.0, description="scale in elevation over which the addition falls")
    correlation_time_s: Positive = 60.0
    carrier_ratio: NotNegative = Field(0.01, description="ratio of the carrier error to the code error")


class Specular(StrictModel):
    """One plane mirror below the antenna: sea, deck, ground."""

    height_m: Positive = Field(description="height of the antenna above the mirror")
    amplitude: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        description="amplitude of the reflected signal relative to the direct one"
    )


class EphemerisErrors(StrictModel):
    """The errors of the messages, constant in the orbit's axes, one sigma."""

    radial_m: NotNegative = Field(0.0, description="radial orbit error")
    along_m: NotNegative = Field(0.0, description="along-track orbit error")
    cross_m: NotNegative = Field(0.0, description="cross-track orbit error")
    clock_m: NotNegative = Field(0.0, description="clock error")


class AirErrors(StrictModel):
    """The residuals of the atmosphere models, Gauss-Markov at the zenith, one sigma."""

    ionosphere_m: NotNegative = Field(0.0, description="sigma at the zenith on L1")
    troposphere_m: NotNegative = Field(0.0, description="sigma at the zenith")
    correlation_time_s: Positive = 1800.0


class SimulatedGnss(StrictModel):
    """The receiver: its signals, their noise, and disturbances."""

    rate_hz: Annotated[float, Field(gt=0.0, le=100.0)] = 1.0
    signals: tuple[GpsSignal, ...] = Field(
        ("C1C",), min_length=1, description="RINEX codes of the signals that it tracks"
    )
    lever_arm_m: Vector3 = Field((0.0, 0.0, 0.0), description="IMU to antenna, forward, right, down")
    antenna: tuple[MountedAntenna, ...] = ()
    horizon_mask_deg: Elevation = 5.0
    cn0_dbhz: Positive = Field(45.0, description="link budget: C/N0 at an antenna of 0 dBic")
    cn0_sigma_db: NotNegative = Field(0.5, description="scatter of the C/N0 that it reports")
    threshold_dbhz: NotNegative = Field(28.0, description="signals below this C/N0 are not tracked")
    reacquire_s: NotNegative = Field(
        2.0, description="time from the return of a signal to its first measurement"
    )
    pseudorange_noise_m: WhiteNoise = WhiteNoise(floor=0.5, elevation=0.5, cn0_at_45_dbhz=0.7)
    range_rate_noise_mps: WhiteNoise = WhiteNoise(floor=0.03, elevation=0.02, cn0_at_45_dbhz=0.03)
    carrier_noise_m: WhiteNoise | None = Field(None, description="left out: no carrier phase is logged")
    loops: Loops | None = None
    slips_per_hour: NotNegative = Field(0.0, description="cycle slips per hour of each carrier")
    slips_indicated: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        0.9, description="share of the slips that the receiver flags"
    )
    atmosphere: Literal["broadcast", "none"] = Field(
        "broadcast",
        description="delays of the broadcast ionosphere model and the standard troposphere, or none",
    )
    air_errors: AirErrors = AirErrors()
    ephemeris_errors: EphemerisErrors = EphemerisErrors()
    multipath: Multipath | None = None
    specular: Specular | None = None

    @model_validator(mode="after")
    def _slips_need_a_carrier(self) -> SimulatedGnss:
        if self.slips_per_hour > 0.0 and self.carrier_noise_m is None:
            raise ValueError("slips_per_hour needs a carrier: give carrier_noise_m")
        return self


class SimulatedAntenna(MountedAntenna):
    """A further antenna with a receiver and a log of its own."""

    name: str = Field(min_length=1)
    pattern: str = "isotropic"
    lever_arm_m: Vector3 = Field(description="IMU to phase centre, body axes")
    clock_bias_m: float = Field(
        0.0, description="bias of its clock relative to the main receiver's, at the start"
    )


class SimulatedAttitude(StrictModel):
    """Further antennas: receivers like that of [gnss], each with errors of its own."""

    clocks: Literal["common", "separate"] = Field(
        "common", description="one clock for all receivers, or one each"
    )
    wind_up: bool = Field(True, description="phase wind-up between tilted antennas")
    antenna: tuple[SimulatedAntenna, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _names_are_different(self) -> SimulatedAttitude:
        require_own_names([antenna.name for antenna in self.antenna], "further antennas", "antenna")
        return self


class SimulationConfig(StrictModel):
    """A scenario file of ``insgnss simulate``. Relative paths start at its folder."""

    lists_keys = "every key with its meaning: docs/scenario-file.md"

    name: str = ""
    source: str = Field("", description="where the numbers come from")
    gps_week: Annotated[int, Field(ge=0, le=9999)]
    start_s: Annotated[float, Field(ge=0.0, lt=604_800.0)] = Field(description="seconds of the GPS week")
    duration_s: Positive | None = Field(None, description="left out: that of the manoeuvres")
    place: StartPlace | None = None
    speed_mps: NotNegative = Field(0.0, description="speed at the start")
    manoeuvre: tuple[Manoeuvre, ...] = Field((), description="one after the other, see the kinds below")
    follow: LoggedReference | None = None
    reference_rate_hz: Annotated[float, Field(gt=0.0, le=200.0)] = 10.0
    imu: SimulatedImu = SimulatedImu()
    clock: SimulatedClock = SimulatedClock()
    sky: Sky = Field(
        NominalSky(),
        description="where the satellites come from, see the kinds below; left out: an even constellation",
    )
    gnss: SimulatedGnss = SimulatedGnss()
    attitude: SimulatedAttitude | None = None
    sensor: tuple[SimulatedSensor, ...] = Field((), description="further sensors, see the kinds below")
    fault: tuple[Annotated[SignalFault | SensorFault, Field(discriminator="kind")], ...] = Field(
        (), description="faults of receiver, clocks and sensors, see the kinds below"
    )

    @property
    def sensor_faults(self) -> tuple[SensorFault, ...]:
        """The faults of further sensors."""
        return tuple(fault for fault in self.fault if isinstance(fault, SensorFault))

    @model_validator(mode="after")
    def _sensors_are_told_apart(self) -> SimulationConfig:
        require_own_names([sensor.label for sensor in self.sensor], "sensors", "sensor")
        kinds = {sensor.label: sensor.kind for sensor in self.sensor}
        for fault in self.sensor_faults:
            if fault.sensor not in kinds:
                raise ValueError(f"the fault '{fault.kind}' names an unknown sensor '{fault.sensor}'")
            alone = kinds[fault.sensor] in ("odometer", "barometer", "heading")
            if isinstance(fault, SensorStep) and len(fault.size) != (1 if alone else 3):
                raise ValueError(f"a step of '{fault.sensor}' has {1 if alone else 3} component(s)")
            wanted = {"slip": "odometer", "draught": "barometer", "disturbance": "magnetometer"}.get(
                fault.kind
            )
            if wanted not in (None, kinds[fault.sensor]):
                raise ValueError(f"the fault '{fault.kind}' is of kind {wanted}, '{fault.sensor}' is not")
        return self

    @model_validator(mode="after")
    def _moves_in_one_way(self) -> SimulationConfig:
        if bool(self.manoeuvre) == (self.follow is not None):
            raise ValueError("give a list of manoeuvres ([[manoeuvre]]) or a logged reference ([follow])")
        if self.manoeuvre and self.place is None:
            raise ValueError("manoeuvres need a [place] to begin at")
        if self.attitude is not None and self.gnss.carrier_noise_m is None:
            raise ValueError("[attitude] needs a carrier: give gnss.carrier_noise_m")
        return self
