"""All numbers the compiled filter needs, resolved once from the filter file, the sensor grade and the oscillator."""

from __future__ import annotations

import math
from typing import Annotated, Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.config.filter import Adaptation, FilterConfig, HeadingConfig, Measurements, NoiseConfig
from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.filter.layout import SYSTEM_OFFSETS, Layout
from insgnss.filter.state import CLOCK, DR, MAX_COUPLINGS, MAX_OPTIONAL, MAX_RANGE_BIASES, N_CLONE
from insgnss.filter.states.glonass_channel_bias import CHANNEL_BIAS
from insgnss.filter.states.gnss_time import GNSS_TIME
from insgnss.filter.states.imu_time import IMU_TIME
from insgnss.filter.states.ionosphere import IONOSPHERE
from insgnss.filter.states.lever_arm import LEVER_ARM
from insgnss.filter.states.range_biases import RANGE_BIASES
from insgnss.filter.states.rate_lag import RATE_LAG
from insgnss.filter.states.wanted import NO_SLOW, SlowSizes
from insgnss.filter.states.zenith_delay import ZENITH_DELAY
from insgnss.gnss.noise_model import thermal_factor
from insgnss.gnss.observation_rows import N_KINDS
from insgnss.gnss.troposphere import Weather, weather_at_sea_level
from insgnss.inertial.clock_model import clock_model
from insgnss.inertial.sensor_model import sensor_model
from insgnss.kernels.records import Record, dtype_of
from insgnss.tables import Float64, Int64

_KELVIN = 273.15
# the blocks of which a row's equation has to know the place, in the order of the fields
_SINGLE: Final = (
    CHANNEL_BIAS,
    ZENITH_DELAY,
    IONOSPHERE,
    LEVER_ARM,
    IMU_TIME,
    GNSS_TIME,
    RATE_LAG,
    RANGE_BIASES,
)
TAG_JUMP_ODDS: Final = math.log(1e4)  # log odds that an epoch's GNSS tag has jumped (``update.tag_jumps``)
_LEAST_DRIFT_STEP_MPS = 20.0  # a smaller common step of the range rates may be vertical motion
_WIDEST = 5.0 / 3.0  # of the sigma that a new hypothesis has
_OTHER_MODELS = ("nequick", "beidou", "own")  # evaluated before the loop: ``GnssRows`` holds their delays


class KindNumbers(Record):
    """The numbers of one kind of measurement; squares in m^2, of range rates in m^2/s^2."""

    floor2: float
    elevation2: float
    cn02: float
    missing_thermal: float
    correlation: float  # correlation time of the errors [s]; zero for carrier differences
    gate2: float  # squared gate [-]
    least_step: float  # smallest clock step accepted from few rows: bias [m], drift [m/s]


KIND_DTYPE: Final = dtype_of(KindNumbers)


class Parameters(Record):
    """The numbers of the compiled filter: SI units and radians, two-sided densities."""

    gyro_density: float  # [rad^2/s]
    accel_density: float  # [m^2/s^3]
    gyro_scale_density: float  # times rate^2 gives [rad^2/s]
    accel_scale_density: float  # times ``force_departure2`` gives [m^2/s^3]
    gyro_bias_density: float
    gyro_bias_time: float
    accel_bias_density: float
    accel_bias_time: float
    clock_bias_density: float  # [m^2/s]
    clock_drift_density: float  # [m^2/s^3]
    # of each optional state [its unit^2 / s], zero of the clone
    optional_density: Annotated[Float64, MAX_OPTIONAL]
    n_optional: int  # optional states with a value of their own
    optional_rate: Annotated[Float64, MAX_OPTIONAL]  # inverse correlation time of each [1/s], zero: none
    n_couplings: int  # further errors of the sensors ...
    coupling_at: Annotated[Int64, MAX_COUPLINGS]  # ... which state, ...
    coupling_into: Annotated[Int64, MAX_COUPLINGS]  # ... DV of the accelerometers or PSI of the gyros, ...
    coupling_axis: Annotated[Int64, MAX_COUPLINGS]  # ... of which axis, ...
    coupling_times: Annotated[Int64, MAX_COUPLINGS]  # ... in proportion to what: ``layout.FACTORS``
    at_channel_bias: int  # index of these in the error state, -1 if absent
    at_zenith_delay: int
    at_ionosphere: int
    at_lever_arm: int
    at_imu_time: int
    at_gnss_time: int
    at_rate_lag: int
    at_range_biases: int
    n_slow: int  # satellites whose slow errors are followed at the same time, as states or not
    slow_ionosphere: float  # slow errors beyond those of states, at the zenith [m] ...
    slow_gradient: float  # ... over 1000 km
    slow_troposphere: float
    air_rate: float  # inverse correlation times [1/s]: of these ...
    satellite_rate: float  # ... of the satellites' messages ...
    reflection_rate: float  # ... and of their reflections; zero: these are not followed
    n_held: int  # states that the slow errors reach ...
    held: Annotated[Int64, MAX_OPTIONAL]  # ... and where they stand
    ionosphere_wander: float  # of a second, at most [m^2/s]
    at_clone: int
    covariance_step: float  # [s]
    motion_gate2: float  # squared sigmas from which a horizontal force is motion; 0: any is
    sine_mask: float  # sine of the elevation mask
    cn0_mask: float  # [dBHz]
    use_ionosphere: float  # 1 or 0
    visibility: int  # OFF, MASK or LOOK of ``masking``
    use_troposphere: float  # 1 or 0
    pressure_0: float  # air at sea level [hPa]
    temperature_0: float  # [K]
    humidity: float  # relative
    # of pseudoranges, range rates, carrier differences
    kind: Annotated[npt.NDArray[Any], KIND_DTYPE, N_KINDS]
    robust: int  # 0 the gate alone, HUBER or STUDENT of ``faults``
    huber_k: float
    student_freedom: float
    residual_gate2: float  # squared, of a residual after the update; 0: not tested
    drift_gate: float  # sigmas between fast and slow mean; 0: not tested
    rate_memory_s: float  # of a satellite's own noise level of range rates; 0: it has none
    rate_error_s: float  # for which errors of rates and carrier differences are taken to last; 0: not at all
    reflected_below_db: float  # [dB]; 0: not tested
    lockout_epochs: float
    divergence_nis: float
    divergence_time: float  # [s]
    tag_jump_odds: float  # log odds from which the GNSS tags are taken to have jumped; inf: never
    suspicion_limit: float  # chi^2 of three; 0: the prediction is never suspected
    heading_known_variance: float  # [rad^2]
    widest_heading_variance: float  # [rad^2] of one hypothesis; above it several take its place
    adapt_gain: float  # 0: off
    adapt_least: float
    adapt_most: float
    adapt_least_at_rest: float
    weak_signal2: float  # variance that a weak signal adds to its pseudorange [m^2/dB^2]; 0: none
    weak_rate2: float  # the same of a range rate in a solution of one epoch [m^2/s^2/dB^2]
    lever_b: Annotated[Float64, 3]  # IMU to antenna, body [m]


PARAMETERS_DTYPE: Final = dtype_of(Parameters)


def _noise(noise: NoiseConfig) -> tuple[float, float, float, float]:
    return (
        noise.floor**2,
        noise.elevation**2,
        noise.cn0_at_45_dbhz**2,
        float(thermal_factor(noise.missing_cn0_dbhz)),
    )


def _further_states(layout: Layout) -> tuple[Float64, int, Float64]:
    """Return the densities of the further states (SI units squared / s), their number, and their rates [1/s]."""
    density, rate = np.zeros(MAX_OPTIONAL), np.zeros(MAX_OPTIONAL)
    processes = [(block.process, block.si_per_unit) for block in layout.blocks for _ in block.columns]
    for i, (process, unit) in enumerate(processes):
        density[i], rate[i] = process.variance_per_s * unit**2, process.rate
    return density, layout.n_values, rate


def _couplings(layout: Layout) -> tuple[int | Int64, ...]:
    """Return the number of couplings, and the columns of ``Layout.couplings`` with room for the most there can be."""
    couplings, table = layout.couplings, np.zeros((MAX_COUPLINGS, 4), np.int64)
    table[: len(couplings)] = np.reshape(couplings, (-1, 4))
    return len(couplings), *table.T


def _slow_sizes(config: FilterConfig, layout: Layout, slow: SlowSizes) -> tuple[int, float, float, float]:
    """Return how many satellites' slow errors are followed, and the sky's sizes beyond what states have."""

    def beyond(sigma: float, state: str) -> float:
        held = sum(block.variance for block in layout.blocks if block.name == state)
        return math.sqrt(max(sigma**2 - held, 0.0))

    states = sum(block.size for block in layout.blocks if block.name == RANGE_BIASES)
    if states or config.process.range_bias_states:
        return states, 0.0, 0.0, 0.0
    ionosphere = beyond(slow.ionosphere, IONOSPHERE)
    gradient = slow.ionosphere * config.slow_errors.ionosphere_gradient_per_1000_km
    troposphere = beyond(slow.troposphere, ZENITH_DELAY)
    largest = max(ionosphere, gradient, troposphere, *slow.satellite.values(), 0.0)
    return MAX_RANGE_BIASES if largest > 0.0 else 0, ionosphere, gradient, troposphere


def _slow_errors(config: FilterConfig, layout: Layout, slow: SlowSizes) -> tuple[Any, ...]:
    """Return all numbers of the slow errors, in the order of the fields."""
    times_s = (config.slow_errors.air_time_s, config.slow_errors.satellite_time_s)
    reflection_s = config.adaptation.reflection_time_s if config.adaptation.on else 0.0
    rates = (*(1.0 / time_s for time_s in times_s), 1.0 / reflection_s if reflection_s > 0.0 else 0.0)
    return (*_slow_sizes(config, layout, slow), *rates, *_held(layout))


def _held(layout: Layout) -> tuple[int, Int64]:
    """Return the states that ranges hold, and so their slow errors reach: position, clock, those of ranges alone."""
    of_ranges = (SYSTEM_OFFSETS, CHANNEL_BIAS, ZENITH_DELAY, IONOSPHERE)
    further = [
        layout.at(block.name) + i
        for block in layout.blocks
        for i in range(block.size if block.name in of_ranges else 0)
    ]
    clone = range(layout.at_clone, layout.at_clone + N_CLONE) if layout.clone else ()
    held, room = [*range(DR, DR + 3), CLOCK, *further, *clone], np.zeros(MAX_OPTIONAL, np.int64)
    room[: len(held)] = held
    return len(held), room


def _visibility(config: FilterConfig, with_antennas: bool) -> int:
    if not (config.visibility.on and with_antennas):
        return 0
    return 2 if config.visibility.use_masked else 1


def widest_heading(heading: HeadingConfig) -> float:
    """Return the sigma [rad] above which a hypothesis of the heading is split; infinite where only one is wanted.

    Hypotheses a spacing apart have half of it as their sigma. Split at once they would be split again and again as
    the gyros drift; a sigma of 25 deg, for twelve of them, is still linear: a filter that begins 30 deg off by one
    sigma is consistent in a turn and an acceleration, one of 60 deg is not.
    """
    if heading.hypotheses == 1:
        return math.inf
    return _WIDEST * math.pi / heading.hypotheses


def weather_of(use: Measurements) -> Weather:
    """Return the air at sea level that the settings describe."""
    air = use.weather
    kelvin = None if air.temperature_c is None else air.temperature_c + _KELVIN
    humidity = None if air.humidity_percent is None else air.humidity_percent / 100.0
    return weather_at_sea_level(air.pressure_hpa, kelvin, humidity, air.h_m)


def _noise_levels(adaptation: Adaptation) -> tuple[float, float, float, float]:
    """Return gain per second, least and most factor, and the least at rest; gain 0 where the levels are fixed."""
    gain = 1.0 / adaptation.memory_s if adaptation.on else 0.0
    return gain, adaptation.least_factor, adaptation.most_factor, adaptation.least_factor_at_rest


def resolve_parameters(
    config: FilterConfig,
    grade: ImuGrade,
    oscillator: Oscillator,
    lever_arm_m: tuple[float, float, float],
    klobuchar_known: bool,
    layout: Layout = Layout(),  # noqa: B008 - frozen
    with_antennas: bool = False,
    slow: SlowSizes = NO_SLOW,
) -> npt.NDArray[Any]:
    """Return the filter's numbers, (1,) of ``PARAMETERS_DTYPE``; no coefficients, no ionosphere."""
    sensor, whole = sensor_model(grade, layout.names), sensor_model(grade)
    change, time_s = config.process.scale_factor_change, config.process.scale_factor_time_s
    clock = clock_model(oscillator)
    use, gates = config.measurements, config.gates
    ranges, rates = config.pseudorange_noise_m, config.range_rate_noise_mps
    values = (
        sensor.gyro_density,
        sensor.accel_density,
        max(sensor.gyro_scale, change * whole.gyro_scale) ** 2 * time_s,
        max(sensor.accel_scale, change * whole.accel_scale) ** 2 * time_s,
        sensor.gyro_bias.density,
        sensor.gyro_bias.time_s,
        sensor.accel_bias.density,
        sensor.accel_bias.time_s,
        clock.bias_density,
        clock.drift_density,
        *_further_states(layout),
        *_couplings(layout),
        *map(layout.at, _SINGLE),
        *_slow_errors(config, layout, slow),
        config.slow_errors.ionosphere_wander_m_per_sqrt_s**2,
        layout.at_clone,
        config.process.covariance_step_s,
        config.process.motion_sigma**2,
        math.sin(math.radians(use.elevation_mask_deg)),
        use.cn0_mask_dbhz,
        float(use.ionosphere != "none" and (klobuchar_known or use.ionosphere in _OTHER_MODELS)),
        _visibility(config, with_antennas),
        float(use.troposphere == "saastamoinen"),
        *weather_of(use),
        [
            (*_noise(ranges), ranges.correlation_time_s, gates.pseudorange_sigma**2, gates.clock_jump_min_m),
            (*_noise(rates), rates.correlation_time_s, gates.range_rate_sigma**2, _LEAST_DRIFT_STEP_MPS),
            (*_noise(config.carrier_noise_m), 0.0, gates.carrier_sigma**2, math.inf),
        ],
        ("gate", "huber", "student").index(config.faults.weights),
        config.faults.huber_k,
        config.faults.student_freedom,
        (config.faults.residual_sigma or 0.0) ** 2,
        config.faults.drift_sigma or 0.0,
        config.adaptation.rate_memory_s if config.adaptation.on else 0.0,
        config.adaptation.rate_error_s if config.adaptation.on else 0.0,
        config.faults.reflected_below_db or 0.0,
        float(config.health.lockout_epochs),
        config.health.strain_nis,
        config.health.strain_s,
        TAG_JUMP_ODDS if config.health.recovery else math.inf,
        config.health.suspicion_sigma**2 if config.health.recovery else 0.0,
        math.radians(config.heading.known_below_deg) ** 2,
        widest_heading(config.heading) ** 2,
        *_noise_levels(config.adaptation),
        config.adaptation.weak_signal_m_per_db**2 if config.adaptation.on else 0.0,
        config.adaptation.weak_signal_mps_per_db**2 if config.adaptation.on else 0.0,
        lever_arm_m,
    )
    return np.array([values], PARAMETERS_DTYPE)
