"""The declared units checked by gravity: at rest |f| is g, and where the gyros turn, gravity turns.

A contradiction is an error only where nothing but a wrong unit explains it; everything weaker is an event. All rules
look at means over windows of about a second, in which vibration averages out.
"""

from __future__ import annotations

from typing import Final, get_args

import numpy as np

from insgnss.config.flight import ImuConfig, ImuGrade
from insgnss.config.imu import AccelUnit
from insgnss.constants import NS_PER_S, STANDARD_GRAVITY_MPS2
from insgnss.errors import UnitsError
from insgnss.inertial.sensor_model import OVER_RANGE
from insgnss.log.imu.windows import ImuWindows, imu_windows
from insgnss.tables import Bool, Event, Float64, ImuTable
from insgnss.units import RAD_PER_DEG, SI_PER_UNIT

MIN_QUIET_WINDOWS: Final = 4
# Of |f| / g at rest: consumer sensors are off by 2 to 3 %, gravity itself varies by 0.5 %
REST_TOLERANCE: Final = 0.10
# of g: by so much a unit must be worse than another to count as wrong; mg and cm/s^2 differ by twice that
UNITS_APART: Final = 0.01
UNIT_TOLERANCE: Final = 0.07  # how well a wrong unit must explain |f| in one window; the median to half of it
TRUSTED_SHARE: Final = 0.2  # so many quiet windows at g prove the unit: a rocket rests before its flight
AGREEING_SHARE: Final = 0.5  # of the quiet windows must show what the wrong unit would
MIN_TURN_PAIRS: Final = 10
TURN_NEAR_G: Final = 0.05  # |f| within this share of g: acceleration alone tilts f by at most 18 deg there
TURN_SPAN_RAD: Final = 40.0 * RAD_PER_DEG  # of f's direction about its mean: no acceleration alone does that
TURN_STEP_RAD: Final = 20.0 * RAD_PER_DEG  # per window, so that small-angle algebra holds
TURN_CORRELATION: Final = 0.8
TURN_FACTOR: Final = 1.6  # how far the found ratio may lie from 57.3 or its inverse
REST_RATE_RADPS: Final = 0.1  # twice the bias of the worst consumer gyro
REST_DIRECTION_RAD: Final = 1.5 * RAD_PER_DEG  # f's direction from window to window
REST_NEAR_G: Final = 0.03  # in a steady turn or on a rate table the rate lies within 15 deg of f there ...
REST_ACROSS: Final = 0.5  # ... so a rate that lies more than 30 deg off f contradicts a steady f
REST_STEADY: Final = 0.2  # share by which a bias changes from window to window: rolls about f vary more
WHOLE_STEPS: Final = 1.5  # a longer step lost a sample
OVER_RANGE_SHARE: Final = 0.01


def check_units(
    imu: ImuTable, config: ImuConfig, grade: ImuGrade | None, median_ns: float, file: str
) -> list[Event]:
    """Hold an inertial log against the declared units.

    Parameters
    ----------
    imu : the log as converted by the declared units
    config, grade : the declaration, and the sensor's ranges if known
    median_ns : nominal step [ns]
    file : for the messages

    Returns
    -------
    Events of the kind ``units_suspicion``: what looks odd, but has other explanations.

    Raises
    ------
    UnitsError : the numbers contradict the declared units; the advice names the unit that fits
    """
    windows = imu_windows(imu, median_ns)
    if windows is None:
        return []
    quiet = windows.quiet()
    _check_range(imu, config, grade, file)
    events = _check_accelerometer(windows, quiet, config, _mean_ns(imu, median_ns), file)
    if not events:
        events = _check_gyro(windows, quiet, config, file)
    return events


# --------------------------------------------------------------------------------------------------- accelerometers


def _check_accelerometer(
    windows: ImuWindows, quiet: Bool, config: ImuConfig, mean_ns: float, file: str
) -> list[Event]:
    size = np.linalg.norm(windows.f_b, axis=1) / STANDARD_GRAVITY_MPS2
    at_rest = int(quiet.sum()) >= MIN_QUIET_WINDOWS
    seen = size[quiet] if at_rest else size
    middle = float(np.median(seen))
    right = float(np.mean(np.abs(seen - 1.0) <= REST_TOLERANCE))
    if abs(middle - 1.0) <= REST_TOLERANCE or right > TRUSTED_SHARE:
        return []
    shown = middle * STANDARD_GRAVITY_MPS2 / SI_PER_UNIT[config.accel_unit]
    if config.values == "increments":
        shown *= mean_ns / NS_PER_S
    where = "while the sensor is at rest or in steady motion" if at_rest else "in the middle of the log"
    symptom = f"|f| is {shown:.4g} {config.accel_unit} {where}, which as declared is {middle:.3g} g"
    fitting = _fitting_units(seen, config, mean_ns, at_rest)
    if not fitting:
        turn = "; a long steady turn would explain it" if middle > 1.0 else ""
        return [Event(None, "units_suspicion", f"{file}: {symptom}{turn}")] if at_rest else []
    texts = []
    for unit in fitting:
        values = _values_of(unit)
        prefix = "" if values == config.values else f"values = '{values}' with "
        texts.append(f"{prefix}accel_unit = '{unit}'")
    advice = " or ".join(texts) + (" fits" if len(texts) == 1 else " would fit")
    if at_rest:
        error = UnitsError(
            f"{symptom}: wrong unit of the accelerometers", file=file, key="imu.accel_unit", advice=advice
        )
        error.fits = keys_of_accel_unit(fitting[0], config) if len(fitting) == 1 else ()
        raise error
    return [Event(None, "units_suspicion", f"{file}: {symptom}; {advice}")]


def fitting_accel_units(imu: ImuTable, config: ImuConfig) -> list[str]:
    """Return the units that make |f| g in the middle of a log or at rest; the declared one first if it does.

    Parameters
    ----------
    imu : the log as converted by the declared units, in any axes
    config : the declaration
    """
    median_ns = float(np.median(np.diff(imu.t_ns)))
    windows = imu_windows(imu, median_ns)
    if windows is None:
        return []
    mean_ns = _mean_ns(imu, median_ns)
    size = np.linalg.norm(windows.f_b, axis=1) / STANDARD_GRAVITY_MPS2
    quiet = windows.quiet()
    seen = size[quiet] if int(quiet.sum()) >= MIN_QUIET_WINDOWS else size
    fits = _fitting_units(seen, config, mean_ns, False)
    declared = abs(float(np.median(seen)) - 1.0) < REST_TOLERANCE
    return [config.accel_unit, *fits] if declared else fits


def keys_of_accel_unit(unit: str, config: ImuConfig) -> tuple[tuple[str, str], ...]:
    """Return the keys of the flight file, and their values, that declare a unit of the accelerometers.

    Where rates become increments, or increments rates, the gyros' unit changes with them.
    """
    values = _values_of(unit)
    if values == config.values:
        return (("imu.accel_unit", unit),)
    angle = config.gyro_unit.removesuffix("/s")
    gyro_unit = angle if values == "increments" else f"{angle}/s"
    return (("imu.values", values), ("imu.accel_unit", unit), ("imu.gyro_unit", gyro_unit))


def _mean_ns(imu: ImuTable, median_ns: float) -> float:
    """Return the mean step without gaps [ns]: tags in whole milliseconds alternate about it."""
    step = np.diff(imu.t_ns)
    return float(step[step < WHOLE_STEPS * median_ns].mean())


def _values_of(accel_unit: str) -> str:
    return "increments" if accel_unit in ("m/s", "g*s") else "rates"


def _other_units(config: ImuConfig, mean_ns: float) -> list[tuple[str, float]]:
    """Return every other unit and how many times larger it would make the specific force."""
    per_second = NS_PER_S / mean_ns
    factors = {
        unit: SI_PER_UNIT[unit] * (per_second if unit in ("m/s", "g*s") else 1.0)
        for unit in get_args(AccelUnit)
    }
    declared = factors[config.accel_unit]
    return [(unit, factor / declared) for unit, factor in factors.items() if unit != config.accel_unit]


def _fitting_units(size_g: Float64, config: ImuConfig, mean_ns: float, at_rest: bool) -> list[str]:
    """Return the other units that explain |f|; of mg and cm/s^2 the nearer one, if |f| is steady enough to tell."""
    middle = float(np.median(size_g))
    ratios = {unit: ratio for unit, ratio in _other_units(config, mean_ns) if _fits(size_g, ratio, at_rest)}
    off = {unit: abs(middle * ratio - 1.0) for unit, ratio in ratios.items()}
    is_steady = float(np.std(size_g)) < 0.5 * UNITS_APART * middle
    return [unit for unit in off if not is_steady or off[unit] < min(off.values()) + UNITS_APART]


def alike_accel_unit(declared: str, size_mps2: float) -> str | None:
    """Return the unit that differs from the declared one by a few per cent and makes |f| at rest g, None without one.

    Equation: 1 mg = 0.980665 cm/s^2
    """
    for unit in get_args(AccelUnit):
        ratio = SI_PER_UNIT[unit] / SI_PER_UNIT[declared]
        fits = abs(size_mps2 * ratio / STANDARD_GRAVITY_MPS2 - 1.0) < 0.5 * UNITS_APART
        if fits and unit != declared and abs(ratio - 1.0) < REST_TOLERANCE:
            return unit if _values_of(unit) == _values_of(declared) else None
    return None


def _fits(size_g: Float64, ratio: float, at_rest: bool) -> bool:
    """Return whether |f| would be g if it were ``ratio`` times larger; at rest, in most windows."""
    middle = abs(float(np.median(size_g)) * ratio - 1.0)
    if not at_rest:
        return middle < REST_TOLERANCE
    agreeing = float(np.mean(np.abs(size_g * ratio - 1.0) < UNIT_TOLERANCE))
    return middle < 0.5 * UNIT_TOLERANCE and agreeing > AGREEING_SHARE


# ------------------------------------------------------------------------------------------------------------- gyros


def _check_range(imu: ImuTable, config: ImuConfig, grade: ImuGrade | None, file: str) -> None:
    if grade is None or grade.gyro_range_deg_per_s is None:
        return
    limit = OVER_RANGE * grade.gyro_range_deg_per_s * RAD_PER_DEG
    if max(imu.w_ib_b.max(), -imu.w_ib_b.min()) < limit:
        return
    share = float(np.mean((np.abs(imu.w_ib_b) > limit).any(axis=1)))
    if share > OVER_RANGE_SHARE:
        raise UnitsError(
            f"{share:.0%} of the angular rates lie beyond twice the grade's range of"
            f" {grade.gyro_range_deg_per_s:g} deg/s",
            file=file,
            key="imu.gyro_unit",
            advice=f"the unit is probably not '{config.gyro_unit}', or the grade is another sensor's",
        )


def _check_gyro(windows: ImuWindows, quiet: Bool, config: ImuConfig, file: str) -> list[Event]:
    """Hold the turning of f's direction against the gyros, at rest and in motion."""
    size = np.linalg.norm(windows.f_b, axis=1)
    g = float(np.median(size[quiet])) if quiet.any() else STANDARD_GRAVITY_MPS2
    events = _check_rest(windows, np.abs(size / g - 1.0) < REST_NEAR_G, config, file)
    _check_turns(windows, np.abs(size / g - 1.0) < TURN_NEAR_G, config, file)
    return events


def _check_rest(windows: ImuWindows, near_g: Bool, config: ImuConfig, file: str) -> list[Event]:
    """Refuse rates that would turn gravity while it stands still: a bias in deg/s read as rad/s."""
    turn, across = windows.turns()
    w = np.linalg.norm(windows.mid_rate(), axis=1)
    across_rate = np.linalg.norm(across, axis=1) / windows.length_s
    resting = windows.pairs & near_g[:-1] & near_g[1:] & (np.linalg.norm(turn, axis=1) < REST_DIRECTION_RAD)
    change = np.linalg.norm(np.diff(windows.w_ib_b, axis=0), axis=1)
    contrary = (
        resting
        & (across_rate > REST_RATE_RADPS)
        & (across_rate > REST_ACROSS * w)
        & (change < REST_STEADY * w)
    )
    if contrary.sum() < max(MIN_QUIET_WINDOWS, AGREEING_SHARE * resting.sum()):
        return []
    rate = float(np.median(across_rate[contrary]))
    symptom = f"the gyros show {rate:.3g} rad/s ({rate / RAD_PER_DEG:.0f} deg/s) while gravity's direction stands still"
    if config.gyro_unit in ("rad/s", "rad"):
        unit = config.gyro_unit.replace("rad", "deg")
        raise _gyro_error(symptom, file, unit)
    return [Event(None, "units_suspicion", f"{file}: {symptom}")]


def _gyro_error(symptom: str, file: str, unit: str) -> UnitsError:
    error = UnitsError(
        f"{symptom}: the gyros' unit is wrong",
        file=file,
        key="imu.gyro_unit",
        advice=f"gyro_unit = '{unit}' fits",
    )
    error.fits = (("imu.gyro_unit", unit),)
    return error


def _check_turns(windows: ImuWindows, near_g: Bool, config: ImuConfig, file: str) -> None:
    """Refuse rates that are 57.3 times too large or too small for the turning of gravity they go with.

    Judged only where the sensor tilts so far at |f| near g that no acceleration can be taken for it.
    """
    turn, across = windows.turns()
    angle = np.linalg.norm(turn, axis=1)
    used = windows.pairs & near_g[:-1] & near_g[1:] & (angle < TURN_STEP_RAD) & windows.same_side()
    if used.sum() < MIN_TURN_PAIRS or windows.span(near_g) < TURN_SPAN_RAD:
        return
    product = float(np.sum(turn[used] * across[used]))
    by_gyro, by_gravity = float(np.sum(across[used] ** 2)), float(np.sum(turn[used] ** 2))
    if by_gyro == 0.0 or product < TURN_CORRELATION * np.sqrt(by_gyro * by_gravity):
        return
    ratio = product / by_gyro  # how many times more gravity turned than the gyros say
    for factor, now, fits in ((RAD_PER_DEG, "rad", "deg"), (1.0 / RAD_PER_DEG, "deg", "rad")):
        if factor / TURN_FACTOR < ratio < factor * TURN_FACTOR and config.gyro_unit.startswith(now):
            symptom = f"gravity turns {ratio:.3g} times as far as the gyros say"
            raise _gyro_error(symptom, file, config.gyro_unit.replace(now, fits))
