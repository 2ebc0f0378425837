"""Allan deviation of a resting inertial log, and the sensor's grade fitted to it.

Model of the variance at averaging time t, per axis: ``3 Q^2 / t^2 + N^2 / t + s^2 G(t, T) + K^2 t / 3`` of
quantisation Q, angle or velocity random walk N, a Gauss-Markov bias of sigma s and correlation time T, and rate random
walk K, with
``G = 2 T / t (1 - T / (2 t) (3 - 4 exp(-t / T) + exp(-2 t / T)))``    [IEEE Std 952-1997, annex C]
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.optimize import nnls

from insgnss.config.flight import ImuGrade
from insgnss.constants import NS_PER_S, STANDARD_GRAVITY_MPS2, WGS84_OMEGA_RADPS
from insgnss.errors import InputError, ResultError
from insgnss.results.matplotlib_figure import new_figure
from insgnss.results.saving import saving
from insgnss.results.shown import ResultDisplay
from insgnss.tables import Float64, ImuTable, Int64
from insgnss.units import (
    SQRT_S_PER_SQRT_H,
    mps2_to_mg,
    mps_per_sqrt_s_to_mps_per_sqrt_h,
    rad_per_sqrt_s_to_deg_per_sqrt_h,
    rad_to_deg,
    radps_to_deg_per_h,
)

FILES: Final = ("grade.toml", "allan.csv", "allan.png")
STUDY_NAME: Final = "Allan study"  # in the record of a folder
POINTS_PER_DECADE: Final = 12
# that many independent means at the longest averaging time: its deviation is good to 25 %
LEAST_CLUSTERS: Final = 9
LEAST_SAMPLES: Final = 200
REST_RATE_RADPS: Final = math.radians(1.0)  # means over a second may differ by that much at rest
REST_FORCE_MPS2: Final = 0.6
SHORTEST_CORRELATION_S: Final = 10.0  # what forgets faster is noise to a filter, not a bias
_TIMES_TRIED: Final = 60  # correlation times on a logarithmic grid
# Columns of ``_terms`` that may enter together
_TERM_SETS: Final = ((1,), (0, 1), (1, 2), (0, 1, 2), (1, 2, 3), (0, 1, 2, 3))
# of the weighted sum of squares, three sigma: less does not justify one more
_WORTH_A_PARAMETER: Final = 9.0


@dataclass(frozen=True)
class AllanCurve:
    """Overlapping Allan deviation of three axes."""

    tau_s: Float64  # (m,)
    deviation: Float64  # (m, 3) [rad/s] or [m/s^2]
    relative_sigma: Float64  # (m,) of the variance, from its degrees of freedom


@dataclass(frozen=True)
class NoiseFit:
    """The terms of the model, one set for a triad (the mean of its axes' variances), SI units."""

    quantisation: float  # of an increment's sum: [rad] or [m/s]
    random_walk: float  # [rad/sqrt(s)] or [m/s/sqrt(s)]
    instability: float  # one sigma of the Gauss-Markov process
    correlation_time_s: float
    rate_random_walk: float  # of the bias [per sqrt(s)]

    def variance(self, tau_s: Float64) -> Float64:
        """Return the model's Allan variance at averaging times."""
        parts = _terms(tau_s, self.correlation_time_s) @ np.array(
            [self.quantisation**2, self.random_walk**2, self.instability**2, self.rate_random_walk**2]
        )
        return np.asarray(parts)


def overlapping_allan(values: Float64, step_s: float) -> AllanCurve:
    """Return the overlapping Allan deviation of evenly sampled interval means (n, 3).

    Equation: ``s^2(t) = sum (theta[k + 2 m] - 2 theta[k + m] + theta[k])^2 / (2 t^2 (N - 2 m + 1))``, theta the running
    integral at the N + 1 ends of intervals, t = m step    [IEEE Std 952-1997, C.1]
    Degrees of freedom are those of white noise [Greenhall, in NIST SP 1065 (2008), table 5].
    """
    count = len(values)
    theta = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)]) * step_s
    most = max(count // LEAST_CLUSTERS, 1)
    decades = math.log10(most) if most > 1 else 0.0
    sizes = np.unique(np.rint(np.logspace(0.0, decades, int(decades * POINTS_PER_DECADE) + 2)).astype(int))
    deviation = np.empty((len(sizes), values.shape[1]))
    for row, m in enumerate(sizes):
        second = theta[2 * m :] - 2.0 * theta[m:-m] + theta[: -2 * m]
        deviation[row] = np.sqrt(np.mean(second**2, axis=0) / 2.0) / (m * step_s)
    freedom = (
        (3.0 * (count - 1) / (2.0 * sizes) - 2.0 * (count - 2) / count)
        * 4.0
        * sizes**2
        / (4.0 * sizes**2 + 5.0)
    )
    return AllanCurve(sizes * step_s, deviation, np.sqrt(2.0 / np.maximum(freedom, 1.0)))


def gauss_markov_variance(tau_s: Float64, time_s: float) -> Float64:
    """Return G(t, T), the Allan variance of a Gauss-Markov process of unit variance.

    For t well below T the closed form is a difference of nearly equal numbers; its series is used.
    """
    x = np.asarray(tau_s) / time_s
    small = np.minimum(x, 1e-2)
    series = 2.0 * small / 3.0 * (1.0 - 0.75 * small + 0.35 * small**2)
    large = np.maximum(x, 1e-2)
    closed = 2.0 / large * (1.0 - (3.0 - 4.0 * np.exp(-large) + np.exp(-2.0 * large)) / (2.0 * large))
    return np.where(x < 1e-2, series, closed)


def _terms(tau_s: Float64, time_s: float) -> Float64:
    return np.column_stack([3.0 / tau_s**2, 1.0 / tau_s, gauss_markov_variance(tau_s, time_s), tau_s / 3.0])


def fit(curve: AllanCurve) -> NoiseFit:
    """Return the terms that explain the mean variance of the axes, each not negative, by weighted least squares.

    The correlation time is searched on a grid up to three times the longest averaging time, then on a finer one;
    a term besides the random walk enters only if the curve needs it.
    """
    tau, variance = curve.tau_s, np.mean(curve.deviation**2, axis=1)
    if not np.all(variance > 0.0):
        raise InputError(
            "the readings do not change: no noise to measure",
            advice="take a log of finer resolution",
        )
    # three axes; neighbouring averaging times share most of their data, a decade holds about three independent ones
    weight = 1.0 / (variance * curve.relative_sigma / math.sqrt(3.0) * math.sqrt(POINTS_PER_DECADE / 3.0))
    data = tau, variance, weight
    first_s = max(5.0 * tau[0], min(SHORTEST_CORRELATION_S, tau[-1]))
    last_s = max(3.0 * tau[-1], 2.0 * first_s)
    best = _best(*data, np.geomspace(first_s, last_s, _TIMES_TRIED))
    step = (last_s / first_s) ** (1.0 / (_TIMES_TRIED - 1))
    best = _best(*data, best.time_s * np.geomspace(1.0 / step, step, _TIMES_TRIED + 1))
    quantisation, walk, instability, drift = (float(value) for value in np.sqrt(best.powers))
    return NoiseFit(quantisation, walk, instability, best.time_s, drift)


class _TermFit(NamedTuple):
    cost: float
    powers: Float64  # (4,) squares of the terms' sizes
    time_s: float


def _best(tau: Float64, variance: Float64, weight: Float64, times_s: Float64) -> _TermFit:
    """Return the best of all sets of terms at all correlation times."""
    trials = [
        _trial(tau, variance, weight, columns, float(time_s)) for columns in _TERM_SETS for time_s in times_s
    ]
    return min(trials, key=lambda trial: trial.cost)


def _trial(
    tau: Float64, variance: Float64, weight: Float64, columns: tuple[int, ...], time_s: float
) -> _TermFit:
    """Return the best terms of a set at one correlation time."""
    terms = _terms(tau, time_s)[:, columns] * weight[:, None]
    size = np.linalg.norm(terms, axis=0)
    solution, residual = nnls(terms / size, variance * weight)
    powers = np.zeros(4)
    powers[list(columns)] = solution / size
    free = len(columns) + (2 in columns)  # a correlation time is free, too
    return _TermFit(float(residual**2 + _WORTH_A_PARAMETER * free), powers, time_s)


@dataclass(frozen=True, repr=False)
class AllanStudy(ResultDisplay):
    """Curves, fitted terms and grade of a resting log."""

    gyro: AllanCurve
    accel: AllanCurve
    gyro_fit: NoiseFit
    accel_fit: NoiseFit
    grade: ImuGrade
    duration_s: float

    def save(self, folder: Path, pictures: bool = True) -> list[Path]:
        """Write ``grade.toml``, ``allan.csv`` and the picture ``allan.png``; return the paths.

        Raises
        ------
        ResultError : the folder cannot be written
        """
        try:
            with saving(folder, FILES, STUDY_NAME) as new:
                names = self._write(new, pictures)
        except OSError as error:
            raise ResultError(f"cannot be written: {error}", file=folder) from error
        return [folder / name for name in names]

    def _write(self, folder: Path, pictures: bool) -> list[str]:
        (folder / "grade.toml").write_text(grade_text(self.grade), encoding="utf-8", newline="\n")
        rows = np.column_stack([self.gyro.tau_s, self.gyro.deviation, self.accel.deviation])
        axes = [
            f"{sensor}_{axis}_{unit}"
            for sensor, unit in (("gyro", "radps"), ("accel", "mps2"))
            for axis in "xyz"
        ]
        header = ",".join(["tau_s", *axes])
        np.savetxt(folder / "allan.csv", rows, fmt="%.8g", delimiter=",", header=header, comments="")
        if not pictures:
            return ["grade.toml", "allan.csv"]
        _draw(self, folder / "allan.png")
        return ["grade.toml", "allan.csv", "allan.png"]


def allan_study(imu: ImuTable, like: ImuGrade | None = None) -> AllanStudy:
    """Return the study of a log of a sensor at rest, the longer the better.

    Parameters
    ----------
    like : grade that gives what rest does not show: turn-on bias, scale factor, misalignment, ranges

    Raises
    ------
    InputError : too few samples, or the sensor moves; the message states the time
    """
    if len(imu.t_ns) < LEAST_SAMPLES:
        raise InputError(f"{len(imu.t_ns)} samples are too few", advice=f"take {LEAST_SAMPLES} at least")
    step_s = float(np.median(np.diff(imu.t_ns))) / NS_PER_S
    gyro, accel = (_even(imu.t_ns, values, step_s) for values in (imu.w_ib_b, imu.f_b))
    _check_rest(gyro, step_s, REST_RATE_RADPS, "gyro")
    _check_rest(accel, step_s, REST_FORCE_MPS2, "accelerometer")
    curves = overlapping_allan(gyro, step_s), overlapping_allan(accel, step_s)
    duration_s = len(gyro) * step_s
    fits = fit(curves[0]), fit(curves[1])
    means = gyro.mean(axis=0), accel.mean(axis=0)
    gyro_seen, accel_seen = (_or_at_most(curves[k], fits[k], duration_s) for k in (0, 1))
    grade = _grade(gyro_seen, accel_seen, *means, duration_s, like)
    return AllanStudy(*curves, *fits, grade, duration_s)


def _or_at_most(curve: AllanCurve, noise_fit: NoiseFit, duration_s: float) -> NoiseFit:
    """Return the fit, with the lowest point of the curve for an instability that is not seen: it is at most that."""
    if noise_fit.instability > 0.0 or noise_fit.rate_random_walk > 0.0:
        return noise_fit
    lowest = float(np.sqrt(np.min(np.mean(curve.deviation**2, axis=1))))
    return replace(noise_fit, instability=lowest, correlation_time_s=duration_s)


def _even(t_ns: Int64, values: Float64, step_s: float) -> Float64:
    """Return means over even steps: the integral is kept at the tags and read off between them."""
    t = (t_ns - t_ns[0]) / NS_PER_S
    integral = np.concatenate([np.zeros((1, 3)), np.cumsum(values[1:] * np.diff(t)[:, None], axis=0)])
    edges = step_s * np.arange(int(t[-1] / step_s + 1e-6) + 1)
    return np.diff(np.column_stack([np.interp(edges, t, axis) for axis in integral.T]), axis=0) / step_s


def _check_rest(values: Float64, step_s: float, limit: float, sensor: str) -> None:
    per_second = max(round(1.0 / step_s), 1)
    seconds = values[: len(values) // per_second * per_second].reshape(-1, per_second, 3).mean(axis=1)
    off = np.abs(seconds - np.median(seconds, axis=0)).max(axis=1)
    if off.max() > limit:
        moved_s = int(np.argmax(off > limit)) * per_second * step_s
        raise InputError(
            f"the {sensor} moves {moved_s:.0f} s after the start of the log: an Allan deviation needs a sensor at rest",
            advice="name a resting part with --from and --to",
        )


def _grade(
    gyro: NoiseFit, accel: NoiseFit, rate: Float64, force: Float64, duration_s: float, like: ImuGrade | None
) -> ImuGrade:
    """Return the grade: noise as measured, turn-on biases as far as a resting sensor shows them."""
    # of the gyro's mean the Earth's rate is a part whose direction is not known; of the accelerometer's only the
    # length can be held against gravity, by one axis of three
    gyro_bias = math.sqrt(max(float(rate @ rate) - WGS84_OMEGA_RADPS**2, 0.0) / 3.0)
    accel_bias = abs(float(np.linalg.norm(force)) - STANDARD_GRAVITY_MPS2)
    measured = {
        "gyro_bias_deg_per_h": radps_to_deg_per_h(max(gyro_bias, gyro.instability)),
        "gyro_bias_instability_deg_per_h": radps_to_deg_per_h(gyro.instability),
        "gyro_correlation_time_s": gyro.correlation_time_s,
        "gyro_arw_deg_per_sqrt_h": rad_per_sqrt_s_to_deg_per_sqrt_h(gyro.random_walk),
        "gyro_rate_random_walk_deg_per_h_per_sqrt_h": radps_to_deg_per_h(gyro.rate_random_walk)
        * SQRT_S_PER_SQRT_H,
        "gyro_quantisation_deg": rad_to_deg(gyro.quantisation) * math.sqrt(12.0),
        "accel_bias_mg": mps2_to_mg(max(accel_bias, accel.instability)),
        "accel_bias_instability_mg": mps2_to_mg(accel.instability),
        "accel_correlation_time_s": accel.correlation_time_s,
        "accel_vrw_mps_per_sqrt_h": mps_per_sqrt_s_to_mps_per_sqrt_h(accel.random_walk),
        "accel_random_walk_mg_per_sqrt_h": mps2_to_mg(accel.rate_random_walk) * SQRT_S_PER_SQRT_H,
        "accel_quantisation_mps": accel.quantisation * math.sqrt(12.0),
    }
    measured = {key: float(f"{value:.5g}") for key, value in measured.items()}
    about = f"Allan deviation of {duration_s:.0f} s at rest"
    if like is None:
        note = (
            f"{about}; turn-on biases from the means (less Earth rate and standard gravity); no scale factors"
        )
        return ImuGrade(**measured, source=note)
    noise = {
        key: value for key, value in measured.items() if key not in ("gyro_bias_deg_per_h", "accel_bias_mg")
    }
    note = f"{about}; turn-on biases, scale factors and ranges as in: {like.source}"
    return like.model_copy(update={**noise, "source": note})


def grade_text(grade: ImuGrade) -> str:
    """Return the text of a grade file, as in ``models/imus``."""
    values: dict[str, Any] = grade.model_dump(exclude_defaults=True)
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in values.items())


def _draw(study: AllanStudy, path: Path) -> None:
    figure = new_figure(11.0, 4.8)
    panels = (
        (study.gyro, study.gyro_fit, "gyro, deg/h", radps_to_deg_per_h(1.0)),
        (study.accel, study.accel_fit, "accelerometer, mg", mps2_to_mg(1.0)),
    )
    for axes, (curve, fitted, label, unit) in zip(figure.subplots(1, 2), panels, strict=True):
        for column, name in enumerate("xyz"):
            axes.loglog(curve.tau_s, unit * curve.deviation[:, column], marker=".", label=name)
        axes.loglog(curve.tau_s, unit * np.sqrt(fitted.variance(curve.tau_s)), "k--", label="fit")
        axes.set_xlabel("averaging time, s")
        axes.set_ylabel(f"Allan deviation of the {label}")
        axes.grid(True, which="both", alpha=0.3)
        axes.legend()
    figure.savefig(path, dpi=120)
