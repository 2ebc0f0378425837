"""What a fault does to the logs of a drawn flight. Every function returns a spoiler: (case, begin [s], rng) -> case."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS, NS_PER_S
from insgnss.tables import Float64, GnssTable, ImuTable
from tests.benchmarks.trust.rows import Case, Spoiler

L1_HZ: Final = 1575.42e6
WAVELENGTH_M: Final = C_MPS / L1_HZ
Sensor = Literal["gyro", "accel"]
Rows = npt.NDArray[np.bool_]


def _seconds(t_ns: npt.NDArray[np.int64], case: Case) -> Float64:
    return np.asarray((t_ns - case.start_ns) / NS_PER_S)


def _with_imu(case: Case, sensor: Sensor, values: Float64) -> Case:
    imu = replace(case.imu, w_ib_b=values) if sensor == "gyro" else replace(case.imu, f_b=values)
    return replace(case, imu=imu)


def _changed_imu(case: Case, sensor: Sensor, at_s: float, for_s: float) -> tuple[Float64, Rows]:
    """Return a copy of a sensor's values and the rows from ``at_s`` on."""
    t_s = _seconds(case.imu.t_ns, case)
    values = case.imu.w_ib_b if sensor == "gyro" else case.imu.f_b
    return values.copy(), (t_s > at_s) & (t_s <= at_s + for_s)


def bias_step(sensor: Sensor, size: float) -> Spoiler:
    """A bias that steps, on an axis drawn by the seed; rad/s or m/s^2."""

    def spoil(case: Case, at_s: float, rng: np.random.Generator) -> Case:
        values, rows = _changed_imu(case, sensor, at_s, np.inf)
        values[rows, rng.integers(3)] += size * rng.choice([-1.0, 1.0])
        return _with_imu(case, sensor, values)

    return spoil


def stuck(sensor: Sensor, for_s: float) -> Spoiler:
    """All three axes hold the value they have at the begin: the sensor's interface repeats its last sample."""

    def spoil(case: Case, at_s: float, rng: np.random.Generator) -> Case:
        values, rows = _changed_imu(case, sensor, at_s, for_s)
        values[rows] = values[np.flatnonzero(rows)[0]]
        return replace(_with_imu(case, sensor, values), through_file=True)

    return spoil


def zero(sensor: Sensor, for_s: float) -> Spoiler:
    """All three axes are zero."""

    def spoil(case: Case, at_s: float, rng: np.random.Generator) -> Case:
        values, rows = _changed_imu(case, sensor, at_s, for_s)
        values[rows] = 0.0
        return replace(_with_imu(case, sensor, values), through_file=True)

    return spoil


def saturated(sensor: Sensor, limit: float, for_s: float) -> Spoiler:
    """No axis goes beyond a limit that the motion exceeds; rad/s or m/s^2."""

    def spoil(case: Case, at_s: float, rng: np.random.Generator) -> Case:
        values, rows = _changed_imu(case, sensor, at_s, for_s)
        values[rows] = np.clip(values[rows], -limit, limit)
        return replace(_with_imu(case, sensor, values), through_file=True)

    return spoil


def spikes(sensor: Sensor, size: float, for_s: float, every_s: float = 1.0) -> Spoiler:
    """One sample in each second is off by ``size`` on a drawn axis; rad/s or m/s^2."""

    def spoil(case: Case, at_s: float, rng: np.random.Generator) -> Case:
        values, rows = _changed_imu(case, sensor, at_s, for_s)
        step_s = float(np.median(np.diff(case.imu.t_ns))) / NS_PER_S
        hit = np.flatnonzero(rows)[:: max(1, round(every_s / step_s))]
        values[hit, rng.integers(3, size=len(hit))] += size
        return replace(_with_imu(case, sensor, values), through_file=True)

    return spoil


def wild_value(case: Case, at_s: float, rng: np.random.Generator) -> Case:
    """One cell holds a number that no sensor gives, of a size and at a place drawn by the seed."""
    sensor: Sensor = "gyro" if rng.random() < 0.5 else "accel"
    values, rows = _changed_imu(case, sensor, at_s, np.inf)
    size = float(rng.choice([1e6, 1e9, 1e30, 1e35, 1e100, 1e300]))
    values[np.flatnonzero(rows)[0], rng.integers(3)] = size * rng.choice([-1.0, 1.0])
    return _with_imu(case, sensor, values)


def imu_late(by_s: float) -> Spoiler:
    """Every inertial tag of the log is late."""

    def spoil(case: Case, at_s: float, rng: np.random.Generator) -> Case:
        late = case.imu.t_ns + round(by_s * NS_PER_S)
        return replace(case, imu=ImuTable(late, case.imu.w_ib_b, case.imu.f_b))

    return spoil


def _inside(gnss: GnssTable, case: Case, at_s: float, for_s: float) -> Rows:
    t_s = _seconds(gnss.t_ns, case)
    return np.asarray((t_s >= at_s) & (t_s < at_s + for_s))


def _plus(case: Case, rows: Rows, range_m: Float64 | float, rate_mps: Float64 | float) -> Case:
    """Return the case with something added to pseudoranges and range rates of some rows."""
    gnss = case.gnss
    ranges, doppler, rates = (
        getattr(gnss, name).copy() for name in ("pseudorange_m", "doppler_hz", "range_rate_mps")
    )
    ranges[rows] += range_m
    doppler[rows] -= np.asarray(rate_mps) / WAVELENGTH_M
    rates[rows] += rate_mps
    return replace(case, gnss=replace(gnss, pseudorange_m=ranges, doppler_hz=doppler, range_rate_mps=rates))


def frozen_doppler(for_s: float) -> Spoiler:
    """Every satellite repeats its last Doppler."""

    def spoil(case: Case, at_s: float, rng: np.random.Generator) -> Case:
        gnss = case.gnss
        rows = _inside(gnss, case, at_s, for_s)
        doppler, rates = gnss.doppler_hz.copy(), gnss.range_rate_mps.copy()
        for sv in np.unique(gnss.sv[rows]):
            own = np.flatnonzero(rows & (gnss.sv == sv))
            doppler[own], rates[own] = doppler[own[0]], rates[own[0]]
        return replace(case, gnss=replace(gnss, doppler_hz=doppler, range_rate_mps=rates))

    return spoil


def late_doppler(case: Case, at_s: float, rng: np.random.Generator) -> Case:
    """Every Doppler and range rate is that of the epoch before, for good."""
    gnss, t_s = case.gnss, _seconds(case.gnss.t_ns, case)
    late = {name: getattr(gnss, name).copy() for name in ("doppler_hz", "range_rate_mps")}
    for sv in np.unique(gnss.sv):
        own = np.flatnonzero(gnss.sv == sv)
        since = t_s[own[1:]] >= at_s
        for name, values in late.items():
            values[own[1:][since]] = getattr(gnss, name)[own[:-1][since]]
    return replace(case, gnss=replace(gnss, **late))


def reversed_doppler(for_s: float) -> Spoiler:
    """Every Doppler has the wrong sign."""

    def spoil(case: Case, at_s: float, rng: np.random.Generator) -> Case:
        gnss = case.gnss
        sign = np.where(_inside(gnss, case, at_s, for_s), -1.0, 1.0)
        turned = replace(gnss, doppler_hz=sign * gnss.doppler_hz, range_rate_mps=sign * gnss.range_rate_mps)
        return replace(case, gnss=turned)

    return spoil


def _drawn(case: Case, at_s: float, count: int, rng: np.random.Generator) -> tuple[str, ...]:
    """Return satellites that are tracked most of the time from the begin to the end of the log."""
    gnss = case.gnss
    later = gnss.t_ns >= case.start_ns + round(at_s * NS_PER_S)
    epochs = len(np.unique(gnss.t_ns[later]))
    counts = np.bincount(gnss.sv[later], minlength=len(gnss.sv_names))
    there = np.array(gnss.sv_names)[counts >= 0.8 * epochs]
    return tuple(sorted(rng.choice(there, size=min(count, len(there)), replace=False).tolist()))


def ramps(count: int, rate_mps: float) -> Spoiler:
    """Code and Doppler of some satellites run away together, as with a satellite's own clock."""

    def spoil(case: Case, at_s: float, rng: np.random.Generator) -> Case:
        victims = _drawn(case, at_s, count, rng)
        gnss = case.gnss
        numbers = [gnss.sv_names.index(name) for name in victims]
        rows = _inside(gnss, case, at_s, np.inf) & np.isin(gnss.sv, numbers)
        since_s = _seconds(gnss.t_ns, case)[rows] - at_s
        return replace(_plus(case, rows, rate_mps * since_s, rate_mps), victims=victims)

    return spoil


def range_steps(count: int, size_m: float, for_s: float) -> Spoiler:
    """Some pseudoranges are longer by the same."""

    def spoil(case: Case, at_s: float, rng: np.random.Generator) -> Case:
        victims = _drawn(case, at_s, count, rng)
        gnss = case.gnss
        numbers = [gnss.sv_names.index(name) for name in victims]
        rows = _inside(gnss, case, at_s, for_s) & np.isin(gnss.sv, numbers)
        return replace(_plus(case, rows, size_m, 0.0), victims=victims)

    return spoil


def noise_times(factor: float, for_s: float) -> Spoiler:
    """The noise of every range and rate is that many times the ordinary, of 2 m and 0.07 m/s."""

    def spoil(case: Case, at_s: float, rng: np.random.Generator) -> Case:
        rows = _inside(case.gnss, case, at_s, for_s)
        more = np.sqrt(factor**2 - 1.0)
        count = int(rows.sum())
        noise = rng.standard_normal((2, count))
        return _plus(case, rows, more * 2.0 * noise[0], more * 0.07 * noise[1])

    return spoil


def tags_jitter(sigma_s: float) -> Spoiler:
    """Each epoch's tag is off by itself, as those that a computer's clock gives; the tags stay in order."""

    def spoil(case: Case, at_s: float, rng: np.random.Generator) -> Case:
        rows = _inside(case.gnss, case, at_s, np.inf)
        epochs, of_row = np.unique(case.gnss.t_ns, return_inverse=True)
        off_ns = np.rint(rng.normal(0.0, sigma_s * NS_PER_S, len(epochs))).astype(np.int64)
        t_ns = case.gnss.t_ns + np.where(rows, off_ns[of_row], 0)
        return replace(case, gnss=replace(case.gnss, t_ns=t_ns))

    return spoil


def tags_late(by_s: float, for_s: float) -> Spoiler:
    """The receiver's tags are late by the same for a while; the last of them stay in order."""

    def spoil(case: Case, at_s: float, rng: np.random.Generator) -> Case:
        rows = _inside(case.gnss, case, at_s, for_s)
        t_ns = case.gnss.t_ns + np.where(rows, round(by_s * NS_PER_S), 0)
        return replace(case, gnss=replace(case.gnss, t_ns=t_ns))

    return spoil


def gnss_ends(case: Case, at_s: float, rng: np.random.Generator) -> Case:
    """No epoch comes any more."""
    before = case.gnss.t_ns < case.start_ns + round(at_s * NS_PER_S)
    return replace(case, gnss=case.gnss.take(np.flatnonzero(before)))


def corrupt_ephemeris(case: Case, at_s: float, rng: np.random.Generator) -> Case:
    """The only message of one satellite holds a number that none can be; which one is drawn by the seed."""
    victims = _drawn(case, at_s, 1, rng)
    table = case.navigation.ephemerides
    row = np.array(table.sv_names) == victims[0]
    name, value = (("delta_n", -1e30), ("sqrt_a", 5e9), ("e", 1e20), ("m0", 1e35))[int(rng.integers(4))]
    column = np.where(row, value, getattr(table, name))
    changed: dict[str, Any] = {name: column}
    navigation = replace(case.navigation, ephemerides=replace(table, **changed))
    return replace(case, navigation=navigation, victims=victims)


def without_carrier(case: Case, at_s: float, rng: np.random.Generator) -> Case:
    """The same log without its carrier phases: what the carrier alone changes."""
    return replace(case, gnss=replace(case.gnss, carrier_cycles=None, lli=None))
