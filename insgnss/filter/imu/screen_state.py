"""The memory of the screening of inertial samples, and the format of its verdicts."""

from __future__ import annotations

import math
from typing import Annotated, Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from insgnss.config.filter import FilterConfig
from insgnss.config.flight import ImuGrade
from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.inertial.sensor_model import OVER_RANGE, sensor_model
from insgnss.kernels.records import Record, dtype_of
from insgnss.tables import Float64, Int64
from insgnss.units import RAD_PER_DEG

# Beyond these no sensor measures: shells spin at 300 revolutions a second (1900 rad/s) and leave the gun at 20 000 g
LARGEST_RATE_RADPS: Final = 1e4
LARGEST_FORCE_MPS2: Final = 5e5

# verdicts; a sample without an entry is good as it is
BAD_SAMPLE: Final = 1  # left out: a value that no sensor gives; ``amount`` is 1 at the first of a run
SPIKE: Final = 2  # left out: far off the samples before and after it; ``amount`` is the sensor
# a sample is put in before this one, for the time without samples; ``amount`` is the step [s]
BRIDGE: Final = 3
BRIDGE_TOLD: Final = 4  # the same, and long enough to be reported
# too long to bridge: the filter restarts with this sample. After a gap it is as BRIDGE, for a smoother; where samples
# went on, ``amount`` is 0, ``unknown`` begins with the variance of the rotation and ``axes`` is the sensor that was out
CUT: Final = 5
REPLACED: Final = 6  # a sensor is out: the sample's values and noise are these
# ``amount`` is the sensor, ``axes`` which of its axes (bits) and whether saturated (bit 3)
OUT_BEGINS: Final = 7
OUT_ENDS: Final = 8  # ``amount`` is how long it was [s]

GYRO: Final = 0
ACCEL: Final = 1
STUCK: Final = 1
SATURATED: Final = 2

EDIT_DTYPE: Final = np.dtype(
    (
        np.record,
        [
            ("sample", np.int64),  # index of the sample it is about
            ("kind", np.int64),
            ("t_ns", np.int64),  # time of a sample put in, else that of the sample
            ("w", np.float64, (3,)),  # values of a sample put in or replaced
            ("f", np.float64, (3,)),
            ("unknown", np.float64, (2,)),  # densities of its unknown motion [rad^2/s], [m^2/s^3]
            ("amount", np.float64),
            ("axes", np.int64),  # of a gap: when it began [ns]
        ],
    )
)


class ScreenRecord(Record):
    """The memory of the screening of inertial samples."""

    # pairs: 0 gyro [rad/s], 1 accelerometer [m/s^2]; six axes: three gyros, then three accelerometers
    limit: Annotated[Float64, 2]  # larger values are not measurements
    range: Annotated[Float64, 2]  # declared measuring range, infinite if not declared
    noise_density: Annotated[Float64, 2]  # white noise of the grade, unit^2 s
    least_change: Annotated[Float64, 2]  # least density of change, unit^2 / s
    longest_step: float  # a longer one is a gap [s]; 0: by the log's own step
    restart_s: float
    restart_variance: float  # of rotation, beyond which the filter restarts [rad^2]
    lever2: float  # square of the lever arm, by which an unknown rate moves the antenna [m^2]
    spike_sigma: float  # 0: not tested
    test_outages: int
    n: int  # samples taken since the beginning or the last cut
    t_ns: int  # the newest sample taken
    x: Annotated[Float64, 6]
    before: Annotated[Float64, 6]  # the one before it
    even: int  # samples in a row without a gap, those two among them
    step: float  # typical step [s]
    n_steps: int
    left_out: int  # samples left out since the newest one taken
    in_bad_run: int
    spike: int  # samples of the spike since the newest one taken
    spike_in_doubt: int  # 1: it may be a shock
    in_spike: Annotated[Float64, 6]  # what they would have changed: rotation [rad], velocity [m/s]
    calm: int  # samples since the last one that leapt
    wiggle2: Annotated[Float64, 2]  # mean square of a sample's departure from its neighbours
    n_wiggles: int
    # means over MEAN_S
    part_s: float
    part_sum: Annotated[Float64, 6]
    part_mean: Annotated[Float64, 6]
    n_parts: int  # in a row
    n_changes: int
    change: Annotated[Float64, 2]  # squared change of the means over their length, lately, unit^2 / s
    most_change: Annotated[Float64, 2]  # and the most of it, slowly forgotten
    usual: Annotated[Float64, 6]  # of the last half minute; of the gyros zero
    spread2: Annotated[Float64, 2]  # mean square about it
    most_spread2: Annotated[Float64, 2]
    # repeated values
    run: Annotated[Int64, 6]  # so many samples in a row equal the one before
    repeats: Annotated[Int64, 6]  # of the window
    window: int
    most_repeats: Annotated[Float64, 6]  # largest share of a window
    finest: Annotated[Float64, 6]  # smallest change
    largest: Annotated[Float64, 2]  # largest magnitude
    fresh: Annotated[Float64, 6]  # value before a run
    out: Annotated[Int64, 6]  # 0, STUCK or SATURATED
    out_s: Annotated[Float64, 2]  # for how long
    recent_mean: Annotated[Float64, 6]  # of the last samples of an axis that is not out
    beyond_s: Annotated[Float64, 2]  # for how long the sensor is saturated
    slope: Annotated[Float64, 2]  # with which it went beyond its range, unit / s
    # integral of the sigma of what is beyond its range: rotation [rad], velocity [m/s]
    hidden: Annotated[Float64, 2]
    out_variance: float  # of the unknown rotation since the gyros are out [rad^2]


SCREEN_DTYPE: Final = dtype_of(ScreenRecord)
Edits: TypeAlias = npt.NDArray[Any]  # of EDIT_DTYPE


def new_screen(
    config: FilterConfig, grade: ImuGrade, lever_arm_m: tuple[float, float, float]
) -> npt.NDArray[Any]:
    """Return the memory of a log that has not begun, (1,) of ``SCREEN_DTYPE``."""
    screen = np.zeros(1, SCREEN_DTYPE)
    s = screen[0]
    gaps, samples, sensor = config.gaps, config.samples, sensor_model(grade)
    ranges = (grade.gyro_range_deg_per_s, grade.accel_range_g)
    units = (RAD_PER_DEG, STANDARD_GRAVITY_MPS2)
    for i, (span, unit) in enumerate(zip(ranges, units, strict=True)):
        s.range[i] = math.inf if span is None else span * unit
    s.limit[:] = np.minimum((LARGEST_RATE_RADPS, LARGEST_FORCE_MPS2), OVER_RANGE * s.range)
    s.noise_density[:] = sensor.gyro_density, sensor.accel_density
    s.least_change[:] = (gaps.rate_sigma_degps * RAD_PER_DEG) ** 2, gaps.acceleration_sigma_mps2**2
    s.longest_step = 0.0 if gaps.longest_step_s is None else gaps.longest_step_s
    s.restart_s = gaps.restart_s
    s.restart_variance = (gaps.restart_rotation_deg * RAD_PER_DEG) ** 2
    s.lever2 = sum(arm * arm for arm in lever_arm_m)
    s.spike_sigma = samples.spike_sigma
    s.test_outages = int(samples.sensor_outages)
    s.finest[:] = math.inf
    return screen
