"""The schema of a filter file: the measurements used, their noise, and the response to faults."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field

from insgnss.config.aiding import AidingConfig
from insgnss.config.integrity import Integrity
from insgnss.config.process import Process
from insgnss.config.quantities import Constellation, NotNegative, Positive
from insgnss.config.search import Search
from insgnss.config.slow_errors import SlowErrorSizes
from insgnss.config.strict import StrictModel

# Upper limits are the field's own, or those of all settings (``strict``): one given here would override the field's
# One sigma of a measurement: below a micrometre there is none, beyond a million metres nothing is left of one
Sigma = Annotated[float, Field(ge=1e-6, le=1e6)]
SigmaOrNone = Annotated[float, Field(ge=0.0, le=1e6)]
Share = Annotated[float, Field(ge=1e-6, le=1e6)]  # of a variance

# The first band of each list keeps the constellation's clock. Left out: GPS L1 P(Y) and L2 P(Y) tracked without the
# code (their noise is that of a squared signal), signals whose group delay the common messages do not hold.
DEFAULT_SIGNALS: Final[dict[Constellation, tuple[str, ...]]] = {
    "G": ("C1C", "C1L", "C1X", "C5Q", "C5X", "C5I", "C2L", "C2X", "C2S"),
    "E": ("C1C", "C1X", "C1B", "C5Q", "C5X", "C5I", "C7Q", "C7X", "C7I"),
    "J": ("C1C", "C1E", "C1L", "C1X", "C5Q", "C5X", "C5I", "C2L", "C2X", "C2S"),
    "C": ("C2I", "C2X", "C1P", "C1X", "C1D", "C7I", "C7X", "C6I", "C6X", "C5P", "C5X", "C5D"),
    "R": ("C1C", "C1P", "C2C", "C2P"),
    "I": ("C5A", "C5X", "C9A", "C9X"),
    "S": ("C1C",),
}


class WeatherConfig(StrictModel):
    """The weather of the troposphere model; omitted values are those of the standard atmosphere."""

    pressure_hpa: Annotated[float, Field(gt=300.0, lt=1200.0)] | None = Field(
        None, description="at the height h_m, not reduced to sea level"
    )
    temperature_c: Annotated[float, Field(gt=-90.0, lt=60.0)] | None = Field(
        None, description="at the height h_m"
    )
    humidity_percent: Annotated[float, Field(ge=0.0, le=100.0)] | None = Field(
        None, description="relative, at the height h_m"
    )
    h_m: float = Field(0.0, description="height of the weather station")


class Measurements(StrictModel):
    """Which rows of the log the filter uses and which corrections the range model applies."""

    constellations: tuple[Constellation, ...] = Field(
        ("G", "E", "J", "C", "R", "I"),
        min_length=1,
        description="those used; the first one present defines the receiver clock",
    )
    signals: dict[Constellation, tuple[str, ...]] = Field(
        DEFAULT_SIGNALS,
        description="RINEX codes in order of preference: in each band the first one that a satellite has is used",
    )
    every_band: bool = Field(True, description="one signal per band; false: only the most preferred one")
    pseudorange: bool = Field(True, description="use pseudoranges")
    range_rate: bool = Field(True, description="use range rates, or the Doppler of the log")
    carrier: bool = Field(True, description="use time-differenced carrier phases, where the log has them")
    carrier_max_interval_s: Positive = Field(2.0, description="longest interval that is differenced")
    elevation_mask_deg: Annotated[float, Field(ge=-90.0, lt=90.0)] = 5.0
    cn0_mask_dbhz: NotNegative = Field(0.0, description="signals below it are not used; 0: all are")
    ionosphere: Literal["klobuchar", "nequick", "beidou", "own", "ionosphere_free", "none"] = Field(
        "klobuchar", description="'own': for each constellation the model that it broadcasts"
    )
    troposphere: Literal["saastamoinen", "none"] = Field("saastamoinen", description="model of the delay")
    weather: WeatherConfig = WeatherConfig()
    variance_scale: dict[Constellation, Share] = Field(
        {"R": 4.0},
        description="factor on the variance of a constellation's pseudoranges: GLONASS chips are twice as long",
    )
    glonass_channel_bias: bool = Field(
        True, description="estimate a delay proportional to the frequency channel"
    )
    zenith_delay: bool = Field(False, description="estimate the model's residual zenith delay")
    max_ephemeris_age_s: Positive | None = Field(
        None, description="oldest message used; left out: its constellation's own limit"
    )

    def signals_of(self) -> dict[str, tuple[str, ...]]:
        """Return the codes that may be used, per letter of the constellations in use."""
        return {str(letter): self.signals.get(letter, ()) for letter in self.constellations}


class NoiseConfig(StrictModel):
    """One kind's variance: floor^2 + (elevation / sin el)^2 + cn0^2 10^((45 - C/N0) / 10)."""

    floor: Sigma
    elevation: SigmaOrNone
    cn0_at_45_dbhz: SigmaOrNone
    correlation_time_s: NotNegative = Field(
        0.0, description="epochs closer than this share their errors: the weight of each falls in proportion"
    )
    missing_cn0_dbhz: Positive = Field(42.0, le=100.0, description="C/N0 assumed where the log has none")


class Gates(StrictModel):
    """Innovation gates in sigmas of the predicted innovation, all judged on the prior."""

    pseudorange_sigma: Positive = Field(5.0, description="gate of one pseudorange")
    range_rate_sigma: Positive = Field(5.0, description="gate of one range rate")
    carrier_sigma: Positive = Field(4.0, description="gate of one carrier difference: detects cycle slips")
    clock_jump_min_m: Positive = Field(
        150.0,
        description="a smaller common step of fewer than five pseudoranges counts only if it lasts for"
        " health.lockout_epochs",
    )


class Faults(StrictModel):
    """How wrong measurements that pass their gate are detected or down-weighted; 0 switches a test off."""

    weights: Literal["gate", "huber", "student"] = Field(
        "gate", description="weight of accepted rows: full up to the gate, or reduced for large innovations"
    )
    huber_k: Positive = Field(1.5, ge=0.1, description="sigmas from which Huber's weight falls as k / |nu|")
    student_freedom: Positive = Field(4.0, ge=0.1, description="degrees of freedom of Student's t")
    residual_sigma: NotNegative = Field(
        5.0,
        description="limit of a residual after the update: pseudoranges and range rates beyond it that the others"
        " contradict are left out",
    )
    drift_sigma: NotNegative = Field(
        4.0,
        description="limit of a satellite's drift against the others: of its range rate, averaged over ten seconds,"
        " and of its pseudorange within half a minute",
    )
    reflected_below_db: NotNegative = Field(
        8.0,
        description="C/N0 deficit, corrected for elevation, at which a range that is too long is a reflection",
    )


class Gaps(StrictModel):
    """The response to missing inertial samples."""

    longest_step_s: Positive | None = Field(
        None,
        ge=1e-4,
        le=60.0,
        description="a longer step between inertial samples is a gap; left out: 1.75 typical steps of the log",
    )
    acceleration_sigma_mps2: Positive = Field(
        1.0,
        description="smallest assumed change of the specific force in a second of a gap; larger if the log has"
        " shown more",
    )
    rate_sigma_degps: Positive = Field(5.0, description="the same for the angular rate")
    restart_s: Positive = Field(
        2.5,
        le=600.0,
        description="after a longer gap the filter restarts from a fix; it keeps the biases and the known part of"
        " the heading",
    )
    restart_rotation_deg: Annotated[float, Field(gt=0.0, le=60.0)] = Field(
        20.0, description="the same if a gap or a gyro outage leaves the attitude this uncertain"
    )


class SampleChecks(StrictModel):
    """Which inertial samples are refused, and whether sensor outages are detected."""

    spike_sigma: NotNegative = Field(
        15.0, description="a spike of this many sigmas of the log's own noise is refused; 0: none is"
    )
    sensor_outages: bool = Field(True, description="detect axes that repeat their value or saturate")


class HealthConfig(StrictModel):
    """When the filter concludes that it is lost, and its reaction."""

    lockout_epochs: Annotated[int, Field(ge=2)] = Field(
        5,
        description="consecutive epochs with most rows refused before position, velocity and clock are reset,"
        " or with too few satellites the clock alone",
    )
    strain_nis: Positive = Field(
        6.0, description="limit of the mean NIS, each value capped at its gate; see strain_s"
    )
    strain_s: Positive = Field(
        10.0, description="how long the mean NIS must exceed strain_nis before the filter counts as lost"
    )
    recovery: bool = Field(
        True,
        description="allow resets, reruns of the last minute in search of a fault, and another start in place of a"
        " given one; false: none of these, unless the satellites would not be visible from that start",
    )
    suspicion_sigma: NotNegative = Field(
        4.5,
        description="limit of the common deviation of all satellites from the prediction over eight seconds: beyond it"
        " the last minute is rerun under fault hypotheses (by noise alone once in several hours); 0: never",
    )
    heading_lost_resets: Annotated[int, Field(ge=1)] = Field(
        2, description="this many resets within lost_window_s: the attitude counts as wrong too"
    )
    lost_window_s: Positive = Field(60.0, description="time window of heading_lost_resets")


class StartConfig(StrictModel):
    """How the filter starts by itself."""

    window_s: Positive = Field(1.0, description="inertial samples averaged for levelling")
    rest_rate_degps: Positive = Field(1.0, description="gyro spread that still counts as rest")
    rest_accel_mps2: Positive = Field(0.6, description="accelerometer spread that still counts as rest")
    rest_speed_mps: Positive = Field(0.5, description="GNSS speed that still counts as rest")
    rest_acceleration_mps2: Positive = Field(
        0.3, description="GNSS acceleration between two fixes that still counts as rest"
    )
    sd_level_moving_deg: Positive = Field(
        3.0, description="smallest sigma of roll and pitch when levelled in motion"
    )
    min_satellites: Annotated[int, Field(ge=4)] = Field(
        5, description="needed for the first fix, for patience_s"
    )
    patience_s: NotNegative = Field(10.0, description="after this time four satellites are enough")
    max_gdop: Positive = Field(12.0, description="largest GDOP of the first fix")


class HeadingConfig(StrictModel):
    """How an unknown heading is found: a bank of filters, one for each heading; measurements remove wrong ones."""

    hypotheses: Annotated[int, Field(ge=1, le=36)] = Field(12, description="evenly spaced; 1: no bank")
    unknown_above_deg: Positive = Field(30.0, description="a start with a wider heading sigma opens the bank")
    drop_below: Annotated[float, Field(gt=0.0, lt=0.1)] = Field(
        1e-6, description="heading hypotheses below this weight are dropped"
    )
    known_below_deg: Positive = Field(5.0, description="the heading counts as known below this sigma")


class Adaptation(StrictModel):
    """How far the filter may correct its assumed noise levels from its residuals."""

    on: bool = Field(True, description="false: the noise levels stay as given")
    memory_s: Positive = Field(30.0, ge=1e-3, description="time constant of the levels")
    least_factor: Share = Field(0.02, description="smallest factor on a variance")
    least_factor_at_rest: Share = Field(
        0.25, description="the same on a pseudorange's variance at standstill"
    )
    most_factor: Share = Field(1000.0, description="largest factor on a variance, except the clock drift's")
    reflection_time_s: NotNegative = Field(
        30.0,
        description="correlation time of a reflection that a satellite's residuals show: sd_* include its effect on"
        " the position, if slow errors are used; 0: reflections are ignored",
    )
    weak_signal_m_per_db: NotNegative = Field(
        2.0, description="error of a weak signal's pseudorange until the residuals show it; 0: none"
    )
    weak_signal_mps_per_db: NotNegative = Field(
        0.2, description="error of its range rate in the solution of a single epoch; 0: none"
    )
    rate_memory_s: NotNegative = Field(
        8.0,
        description="time constant of the noise level of one satellite's range rates; 0: it has none of its own",
    )
    rate_error_s: NotNegative = Field(
        3.0,
        description="assumed correlation time of the errors of range rates and carrier differences until the"
        " residuals show it; 0: uncorrelated",
    )


class Visibility(StrictModel):
    """When a satellite counts as hidden from the vehicle's antennas, which the flight file describes."""

    on: bool = Field(True, description="masking needs antennas in the flight file")
    threshold: Literal["gain", "cn0"] = Field("gain", description="which of the next two is used")
    threshold_gain_dbic: float = -5.0
    threshold_cn0_dbhz: float = Field(
        30.0, description="the same for the predicted C/N0: nominal_cn0_dbhz plus gain"
    )
    nominal_cn0_dbhz: Positive = Field(45.0, description="link budget: what an antenna of 0 dBic receives")
    hysteresis_db: NotNegative = Field(
        1.0, description="a hidden satellite returns this far above the threshold"
    )
    margin_sigma: NotNegative = Field(
        3.0, description="margin in sigmas of the gain (attitude uncertainty): inside it nothing changes"
    )
    uncertain: Literal["keep", "hide", "deweight"] = Field(
        "deweight",
        description="treatment of a satellite within that margin: used if it was used before, not used, or used with "
        "added variance",
    )
    # A steady reflection is tens of metres too long, at most some 60; what is far larger the gate refuses. A path that
    # changes while the vehicle turns, or a loop that runs on without a signal, is off by 0.3 to 6 m/s
    false_range_m: NotNegative = Field(
        60.0, description="rms error of a hidden satellite's pseudorange: reflection or false lock"
    )
    false_rate_mps: NotNegative = Field(3.0, description="the same for its range rate")
    heading_sigma_limit_deg: Positive = Field(5.0, description="no masking while the heading is less certain")
    use_masked: bool = Field(False, description="true: measurements of hidden satellites are still used")


class FilterConfig(StrictModel):
    """A filter file."""

    lists_keys = "every key with its meaning: docs/filter-file.md"
    name: str = ""
    based_on: str = Field(
        "", description="a filter's name or file (.toml): the settings that this file omits are taken from it"
    )
    measurements: Measurements = Measurements()
    pseudorange_noise_m: NoiseConfig = Field(
        description='noise of pseudoranges; to change only a few settings, begin with based_on = "tight"'
    )
    range_rate_noise_mps: NoiseConfig = Field(
        description="noise of range rates; not required if based_on names a filter"
    )
    carrier_noise_m: NoiseConfig = NoiseConfig(floor=0.002, elevation=0.001, cn0_at_45_dbhz=0.002)
    gates: Gates = Gates()
    faults: Faults = Faults()
    process: Process = Process()
    gaps: Gaps = Gaps()
    samples: SampleChecks = SampleChecks()
    adaptation: Adaptation = Adaptation()
    health: HealthConfig = HealthConfig()
    start: StartConfig = StartConfig()
    heading: HeadingConfig = HeadingConfig()
    visibility: Visibility = Visibility()
    slow_errors: SlowErrorSizes = SlowErrorSizes()
    aiding: AidingConfig = AidingConfig()
    search: Search = Search()
    integrity: Integrity = Integrity()
    latency_s: Positive = Field(1.0, description="largest delay of a GNSS epoch in the streaming engine")
