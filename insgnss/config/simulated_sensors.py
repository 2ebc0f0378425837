"""The schema of ``[[sensor]]`` in a scenario file, and of the faults of such sensors.

Each error of a simulated sensor is drawn with the sigma given here, and the flight file of the logs
declares the same sigmas: what the filter assumes is then true, but for the faults.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from insgnss.config.quantities import LeverArm, NotNegative, Positive, Vector3
from insgnss.config.sensors import AngleSigmas, Name, Sigmas3
from insgnss.config.signal_faults import TimedFault
from insgnss.config.strict import StrictModel

_CENTRE: LeverArm = (0.0, 0.0, 0.0)


class SimulatedSensorLog(StrictModel):
    """The keys of every simulated sensor."""

    kind: str
    name: Name = Field("", description="its kind when left out")
    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] = 10.0
    noise_time_s: NotNegative = Field(0.0, description="correlation time of the noise; 0: white")
    time_offset_s: Annotated[float, Field(ge=-10.0, le=10.0)] = Field(
        0.0, description="delay of its time tags, not declared in the flight file"
    )

    @property
    def label(self) -> str:
        """Its name: that given, else its kind."""
        return self.name or self.kind


class SimulatedOdometer(SimulatedSensorLog):
    """A wheel's speed."""

    kind: Literal["odometer"]
    lever_arm_m: LeverArm = _CENTRE
    noise_mps: Positive = 0.05
    scale_sigma: Positive = 0.02


class SimulatedBarometer(SimulatedSensorLog):
    """Static pressure."""

    kind: Literal["barometer"]
    lever_arm_m: LeverArm = _CENTRE
    noise_m: Positive = 0.5
    offset_sigma_m: Positive = 30.0
    drift_sigma_m: Positive = 10.0
    drift_time_s: Positive = 20_000.0
    scale_sigma: Positive = 0.02


class SimulatedMagnetometer(SimulatedSensorLog):
    """The magnetic field along three axes."""

    kind: Literal["magnetometer"]
    declination_deg: float = 3.0
    declination_sigma_deg: Positive = 0.5
    horizontal_ut: Positive = 20.0
    horizontal_share: Positive = 0.02
    down_ut: float | None = Field(
        None,
        description="vertical field [uT]; default: 43 north, -43 south of the magnetic equator, 0 near it",
    )
    noise_ut: Positive = 0.5
    hard_iron_sigma_ut: Positive = 1.0


class SimulatedHeading(SimulatedSensorLog):
    """A heading."""

    kind: Literal["heading"]
    noise_deg: Positive = 1.0
    offset_sigma_deg: Positive = 0.5


class SimulatedAttitudeSensor(SimulatedSensorLog):
    """Roll, pitch, yaw."""

    kind: Literal["attitude"]
    noise_deg: AngleSigmas = (0.5, 0.5, 1.0)


class SimulatedPosition(SimulatedSensorLog):
    """Position fixes."""

    kind: Literal["position"]
    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] = 1.0
    noise_time_s: NotNegative = 5.0
    lever_arm_m: LeverArm = _CENTRE
    noise_m: Sigmas3 = Field((1.5, 1.5, 3.0), description="north, east, down")


class SimulatedVelocity(SimulatedSensorLog):
    """Velocities against the Earth."""

    kind: Literal["velocity"]
    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] = 1.0
    lever_arm_m: LeverArm = _CENTRE
    noise_mps: Sigmas3 = Field((0.1, 0.1, 0.2), description="north, east, down")


SimulatedSensor = Annotated[
    SimulatedOdometer
    | SimulatedBarometer
    | SimulatedMagnetometer
    | SimulatedHeading
    | SimulatedAttitudeSensor
    | SimulatedPosition
    | SimulatedVelocity,
    Field(discriminator="kind"),
]


class Slip(TimedFault):
    """A wheel that slips: it turns faster than the vehicle moves, or slower (locked: -1)."""

    kind: Literal["slip"]
    sensor: str = "odometer"
    share: Annotated[float, Field(ge=-1.0, le=10.0)] = 0.3


class Draught(TimedFault):
    """A window, a fan or wind that changes the pressure at the port."""

    kind: Literal["draught"]
    sensor: str = "barometer"
    size_hpa: Annotated[float, Field(ge=-100.0, le=100.0)] = 1.0


class MagneticDisturbance(TimedFault):
    """A motor, a current or steel near the magnetometer."""

    kind: Literal["disturbance"]
    sensor: str = "magnetometer"
    field_ut: Vector3 = (15.0, -10.0, 5.0)


class FrozenSensor(TimedFault):
    """A sensor that repeats its last reading."""

    kind: Literal["frozen"]
    sensor: str


class SensorStep(TimedFault):
    """Readings with a constant error: m/s, m, uT, deg; for positions metres north, east, down."""

    kind: Literal["sensor_step"]
    sensor: str
    size: tuple[float, ...] = Field(min_length=1, max_length=3)


class SensorSilence(TimedFault):
    """A sensor whose cells are empty."""

    kind: Literal["sensor_silence"]
    sensor: str


SensorFault = Slip | Draught | MagneticDisturbance | FrozenSensor | SensorStep | SensorSilence
