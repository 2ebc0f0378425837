"""The schema of a filter file: which measurements are used, how good they are, and what happens when they fail."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from insgnss.config.strict import StrictModel

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]


class Measurements(StrictModel):
    """Which rows of the log the filter uses and which corrections the range model applies."""

    constellations: tuple[Literal["G", "E", "J", "C"], ...] = Field(
        ("G", "E", "J"),
        min_length=1,
        description="the first one present is the reference of the receiver clock",
    )
    signals: dict[Literal["G", "E", "J", "C"], tuple[str, ...]] = Field(
        {"G": ("C1C",), "E": ("C1C", "C1X", "C1B"), "J": ("C1C",), "C": ("C1P", "C1X", "C1D", "C2I")},
        description="RINEX codes in order of preference: the first one a satellite has in an epoch is used",
    )
    pseudorange: bool = True
    range_rate: bool = True
    elevation_mask_deg: Annotated[float, Field(ge=-90.0, lt=90.0)] = 5.0
    cn0_mask_dbhz: NotNegative = 0.0
    ionosphere: Literal["klobuchar", "none"] = "klobuchar"
    troposphere: Literal["saastamoinen", "none"] = "saastamoinen"
    max_ephemeris_age_s: Positive | None = None

    def signals_of(self) -> dict[str, tuple[str, ...]]:
        """Return the codes that may be used, per constellation letter."""
        return {str(letter): codes for letter, codes in self.signals.items()}


class Noise(StrictModel):
    """One kind's variance: floor^2 + (elevation / sin el)^2 + cn0^2 10^((45 - C/N0) / 10)."""

    floor: Positive
    elevation: NotNegative
    cn0_at_45_dbhz: NotNegative
    correlation_time_s: NotNegative = Field(
        0.0, description="epochs nearer than this share their errors: each weighs less by the ratio"
    )
    missing_cn0_dbhz: Positive = Field(42.0, description="assumed where the log gives none")


class Gates(StrictModel):
    """Innovation gates in sigmas of the predicted innovation, all judged on the prior."""

    pseudorange_sigma: Positive = 5.0
    range_rate_sigma: Positive = 5.0
    clock_jump_min_m: Positive = Field(
        150.0, description="smaller common steps are left to the clock's process noise"
    )


class Process(StrictModel):
    """Process noise that is not in the sensor's grade, and the rate of the covariance."""

    covariance_step_s: Positive = Field(0.025, description="the covariance is carried on at least this often")
    scale_factor_time_s: NotNegative = Field(
        10.0, description="how long one manoeuvre keeps its scale-factor error"
    )
    inter_system_sigma_m: Positive = Field(
        3000.0, description="initial sigma of an inter-system clock offset"
    )
    inter_system_walk_m_per_sqrt_s: NotNegative = 0.005


class Gaps(StrictModel):
    """What happens when inertial samples are missing."""

    longest_step_s: Positive = Field(0.05, description="a longer step between inertial samples is a gap")
    acceleration_sigma_mps2: Positive = Field(3.0, description="of the unknown motion inside a gap")
    rate_sigma_degps: Positive = Field(20.0, description="of the unknown rotation inside a gap")
    restart_s: Positive = Field(5.0, description="after a longer gap the filter starts anew")


class Health(StrictModel):
    """When the filter concludes that it is lost, and what it does."""

    lockout_epochs: Annotated[int, Field(ge=2)] = Field(
        5,
        description="consecutive epochs with most rows refused before position, velocity and clock are set anew",
    )
    strain_nis: Positive = Field(
        6.0, description="a mean normalised innovation squared (at most the gate's) above it"
    )
    strain_s: Positive = Field(
        10.0, description="for that long means the filter is lost though it refuses little"
    )
    heading_lost_resets: Annotated[int, Field(ge=1)] = Field(
        2, description="that many resets within lost_window_s mean the attitude is wrong too"
    )
    lost_window_s: Positive = 60.0


class Start(StrictModel):
    """How the filter starts by itself."""

    window_s: Positive = Field(1.0, description="of inertial samples for levelling")
    rest_rate_degps: Positive = Field(1.0, description="gyro spread that still counts as rest")
    rest_accel_mps2: Positive = Field(0.6, description="accelerometer spread that still counts as rest")
    rest_speed_mps: Positive = Field(0.5, description="GNSS speed that still counts as rest")
    sd_level_moving_deg: Positive = Field(
        3.0, description="roll and pitch sigma when levelled in motion, at least"
    )
    min_satellites: Annotated[int, Field(ge=4)] = 5
    patience_s: NotNegative = Field(10.0, description="after that long, four satellites are enough")
    max_gdop: Positive = 12.0


class Heading(StrictModel):
    """How an unknown heading is found: a bank of filters, one for each heading, that the measurements thin out."""

    hypotheses: Annotated[int, Field(ge=1, le=36)] = 12
    unknown_above_deg: Positive = Field(30.0, description="a start with a wider heading sigma opens the bank")
    drop_below: Annotated[float, Field(gt=0.0, lt=0.1)] = Field(
        1e-6, description="a hypothesis of less weight goes"
    )
    known_below_deg: Positive = Field(5.0, description="the heading counts as known below this sigma")


class Adaptation(StrictModel):
    """How far the filter may correct its assumed noise levels by what it sees."""

    on: bool = True
    memory_s: Positive = Field(30.0, description="over which the levels follow")
    least_factor: Positive = Field(0.02, description="on a variance")
    least_factor_at_rest: Positive = Field(
        0.25, description="on a pseudorange's variance while the vehicle stands"
    )
    most_factor: Positive = Field(100.0, description="on a variance")


class FilterConfig(StrictModel):
    """A whole filter file."""

    name: str = ""
    measurements: Measurements = Measurements()
    pseudorange_noise_m: Noise
    range_rate_noise_mps: Noise
    gates: Gates = Gates()
    process: Process = Process()
    gaps: Gaps = Gaps()
    adaptation: Adaptation = Adaptation()
    health: Health = Health()
    start: Start = Start()
    heading: Heading = Heading()
    latency_s: Positive = Field(1.0, description="how late a GNSS epoch may reach the streaming engine")
