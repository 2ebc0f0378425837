"""Logs and the faults that are put into copies of them: what the doctor's tests and its table have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa
import pyarrow.csv as pa_csv

from insgnss.constants import C_MPS, STANDARD_GRAVITY_MPS2
from insgnss.gpstime import ns_to_week_seconds
from insgnss.log.checks import corrected_flight
from insgnss.log.checks.report import CheckReport, Finding
from insgnss.log.flight import Flight
from insgnss.log.gnss_log import read_receiver
from insgnss.log.imu.csv_log import read_imu
from insgnss.runs.check import examine

Float64 = npt.NDArray[np.float64]
WEEK_S = 604_800.0
TIME_TOLERANCE_S = 0.06  # of a corrected offset: the logs' own labels are not known better


@dataclass(frozen=True)
class Log:
    """An inertial log in body axes and SI units, a GNSS log as text, and what a flight file says of them."""

    imu: Float64  # (n, 7) seconds of the week, rates, specific forces
    gnss: pd.DataFrame
    navigation: str
    week: int
    grade: str  # as TOML
    oscillator: str
    lever: tuple[float, float, float] | None
    imu_keys: str = ""  # lines of the flight file's [imu]
    gnss_keys: str = ""

    def write(self, folder: Path) -> Path:
        """Write the logs and their flight file; return the latter."""
        names = ["time_s", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
        pa_csv.write_csv(pa.table(dict(zip(names, self.imu.T, strict=True))), folder / "imu.csv")
        self.gnss.to_csv(folder / "gnss.csv", index=False)
        (folder / "nav.rnx").write_text(self.navigation)
        lever = "" if self.lever is None else f"lever_arm_m = {list(self.lever)}\n"
        text = (
            f"# a copy that is spoilt on purpose\ngps_week = {self.week}\n\n[imu]\n"
            f'files = ["imu.csv"]  # the inertial log\n{self.imu_keys}grade = {self.grade}\n\n'
            f'[gnss]\nfiles = ["gnss.csv"]\nnavigation = ["nav.rnx"]\n{lever}{self.gnss_keys}'
            f"oscillator = {self.oscillator}\n"
        )
        (folder / "flight.toml").write_text(text)
        return folder / "flight.toml"


def log_of(path: Path, until_s: float = np.inf) -> Log:
    """Return the logs of a flight whose GNSS log is a CSV file, ``until_s`` after its inertial log begins."""
    flight = Flight.load(path)
    config = flight.config
    table, _ = read_imu(config.imu, config.gps_week, flight.imu_grade)
    time_s = ns_to_week_seconds(table.t_ns, config.gps_week)
    imu = np.column_stack([time_s, table.w_ib_b, table.f_b])
    gnss = pd.read_csv(config.gnss.files[0], comment="#", dtype=str, keep_default_na=False)
    end = time_s[0] + until_s
    numbers = {k: v for k, v in flight.imu_grade.model_dump().items() if v is not None and k != "source"}
    grade = "{ " + ", ".join(f"{k} = {v!r}" for k, v in numbers.items()) + " }"
    clock = flight.oscillator
    return Log(
        imu[time_s <= end],
        gnss[gnss["time_s"].astype(float) <= end].reset_index(drop=True),
        config.gnss.navigation[0].read_text(),
        config.gps_week,
        grade,
        f"{{ h0_s = {clock.h0_s!r}, h_minus2_per_s = {clock.h_minus2_per_s!r} }}",
        config.gnss.lever_b,
    )


# ------------------------------------------------------------------------------------------------------------- faults


def scaled(log: Log, gyro: float = 1.0, accel: float = 1.0) -> Log:
    """Return the log with other units in its columns."""
    imu = log.imu.copy()
    imu[:, 1:4] *= gyro
    imu[:, 4:7] *= accel
    return replace(log, imu=imu)


def mapped(log: Log, accel: Float64, gyro: Float64 | None = None) -> Log:
    """Return the log with the body's axes turned into columns: f_s = M f_b, w_s = M w_b, or each with its own M."""
    imu = log.imu.copy()
    imu[:, 1:4] = imu[:, 1:4] @ (accel if gyro is None else gyro).T
    imu[:, 4:7] = imu[:, 4:7] @ accel.T
    return replace(log, imu=imu)


def increments(log: Log) -> Log:
    """Return the log with increments of angle and velocity where rates are declared."""
    step = np.diff(log.imu[:, 0])
    interval = np.concatenate(([np.median(step)], step))
    imu = log.imu.copy()
    imu[:, 1:] *= np.where(interval < 1.5 * np.median(step), interval, np.median(step))[:, None]
    return replace(log, imu=imu)


def imu_later(log: Log, seconds: float) -> Log:
    """Return the log with ``seconds`` added to the inertial tags."""
    imu = log.imu.copy()
    imu[:, 0] += seconds
    return replace(log, imu=imu)


def gnss_later(log: Log, seconds: float) -> Log:
    """Return the log with ``seconds`` added to the GNSS tags."""
    gnss = log.gnss.copy()
    gnss["time_s"] = [f"{float(t) + seconds:.9f}" for t in gnss["time_s"]]
    return replace(log, gnss=gnss)


def reversed_doppler(log: Log) -> Log:
    """Return the log with Doppler of the other sign."""
    gnss = log.gnss.copy()
    gnss["doppler_hz"] = [f"{-float(d)}" if d else "" for d in gnss["doppler_hz"]]
    return replace(log, gnss=gnss)


def with_clock_jumps(log: Log) -> Log:
    """Return the log with a receiver clock that jumps by a millisecond every 20 s."""
    gnss = log.gnss.copy()
    t = gnss["time_s"].astype(float)
    jumps = np.floor((t - t.iloc[0]) / 20.0)
    gnss["pseudorange_m"] = [
        f"{float(p) - 1e-3 * C_MPS * j:.4f}" if p else ""
        for p, j in zip(gnss["pseudorange_m"], jumps, strict=True)
    ]
    gnss["time_s"] = [f"{v - 1e-3 * j:.9f}" for v, j in zip(t, jumps, strict=True)]
    return replace(log, gnss=gnss)


def without_messages(log: Log, keep: int = 3) -> Log:
    """Return the log with the navigation messages of the first ``keep`` satellites alone."""
    head, body = log.navigation.split("END OF HEADER")
    end, *rest = body.split("\n", 1)
    lines = rest[0].split("\n")
    starts = [k for k, line in enumerate(lines) if line[:1].isalpha()] + [len(lines)]
    kept = dict.fromkeys(lines[k][:3] for k in starts[:-1])
    names = list(kept)[:keep]
    chosen = [
        "\n".join(lines[a:b])
        for a, b in pairwise(starts)
        if lines[a][:3] in names and "\n".join(lines[a:b]).strip()
    ]
    text = head + "END OF HEADER" + end + "\n" + "\n".join(part.rstrip("\n") for part in chosen) + "\n"
    return replace(log, navigation=text)


def with_gap(log: Log, seconds: float, *, gnss: bool = False) -> Log:
    """Return the log without the samples, or the epochs, of some seconds in its middle."""
    middle = float(np.median(log.imu[:, 0]))
    if gnss:
        t = log.gnss["time_s"].astype(float)
        return replace(log, gnss=log.gnss[(t < middle) | (t >= middle + seconds)].reset_index(drop=True))
    t_imu = log.imu[:, 0]
    return replace(log, imu=log.imu[(t_imu < middle) | (t_imu >= middle + seconds)])


X, Y, Z = np.eye(3)
ROTATIONS = {
    "z up (x -y -z)": np.array([X, -Y, -Z]),
    "backwards (-x -y z)": np.array([-X, -Y, Z]),
    "ENU (y x -z)": np.array([Y, X, -Z]),
    "on its side (x -z y)": np.array([X, -Z, Y]),
    "on its nose (z y -x)": np.array([Z, Y, -X]),
    "cyclic (y z x)": np.array([Y, Z, X]),
}
MIRRORED = {
    "left-handed (x y -z)": np.array([X, Y, -Z]),
    "left-handed (y x z)": np.array([Y, X, Z]),
    "left-handed (-x y z)": np.array([-X, Y, Z]),
}


class Fault(NamedTuple):
    """A fault, and what must be found: keys of the proposals, or words of a finding where nothing can be declared."""

    spoil: Callable[[Log], Log]
    keys: tuple[str, ...] = ()
    words: str = ""


FAULTS: dict[str, Fault] = {
    "nothing": Fault(lambda log: log),
    "gyro in deg/s": Fault(lambda log: scaled(log, gyro=180.0 / np.pi), ("imu.gyro_unit",)),
    "gyro in rad/s, declared deg/s": Fault(
        lambda log: replace(log, imu_keys='gyro_unit = "deg/s"\n'), ("imu.gyro_unit",)
    ),
    "accelerometer in g": Fault(
        lambda log: scaled(log, accel=1.0 / STANDARD_GRAVITY_MPS2), ("imu.accel_unit",)
    ),
    "increments": Fault(increments, ("imu.values", "imu.gyro_unit", "imu.accel_unit")),
    **{name: Fault(lambda log, M=M: mapped(log, M), ("imu.axes",)) for name, M in ROTATIONS.items()},  # type: ignore[misc]
    **{
        name: Fault(lambda log, M=M: mapped(log, M), ("imu.axes", "imu.gyro_axes"))  # type: ignore[misc]
        for name, M in MIRRORED.items()
    },
    "gyro z reversed": Fault(
        lambda log: mapped(log, np.eye(3), np.diag([1.0, 1.0, -1.0])), ("imu.gyro_axes",)
    ),
    "all gyros reversed": Fault(lambda log: mapped(log, np.eye(3), -np.eye(3)), ("imu.gyro_axes",)),
    "gravity for specific force": Fault(lambda log: mapped(log, -np.eye(3), np.eye(3)), ("imu.axes",)),
    "gyros y and z exchanged": Fault(
        lambda log: mapped(log, np.eye(3), np.array([X, Z, Y])), ("imu.gyro_axes",)
    ),
    "IMU +0.25 s": Fault(lambda log: imu_later(log, 0.25), ("imu.time.offset_s",)),
    "IMU -1.3 s": Fault(lambda log: imu_later(log, -1.3), ("imu.time.offset_s",)),
    "IMU in UTC": Fault(lambda log: imu_later(log, -18.0), ("imu.time.scale",)),
    "IMU 18 s late": Fault(lambda log: imu_later(log, 18.0), ("imu.time.offset_s",)),
    "IMU one hour late": Fault(lambda log: imu_later(log, 3600.0), ("imu.time.offset_s",)),
    "IMU one week early": Fault(lambda log: imu_later(log, -WEEK_S), ("imu.time.offset_s",)),
    "GNSS in UTC": Fault(lambda log: gnss_later(log, -18.0), ("gnss.time.scale",)),
    "GNSS one hour late": Fault(lambda log: gnss_later(log, 3600.0), ("gnss.time.offset_s",)),
    "week off by one": Fault(lambda log: replace(log, week=log.week + 1), ("gps_week",)),
    "Doppler reversed": Fault(reversed_doppler, ("gnss.rate_sign",)),
    "clock jumps of 1 ms": Fault(with_clock_jumps, (), "jump(s) of 1 ms"),
    "messages of 3 satellites": Fault(without_messages, (), "no current ephemeris for"),
    "lever arm not given": Fault(lambda log: replace(log, lever=None), (), "is not given"),
    "IMU gap 0.1 s": Fault(lambda log: with_gap(log, 0.1), (), "IMU gap of 0.1"),
    "IMU gap 1 s": Fault(lambda log: with_gap(log, 1.0), (), "IMU gap of 1"),
    "IMU gap 10 s": Fault(lambda log: with_gap(log, 10.0), (), "IMU gap of 10"),
    "GNSS gap 10 s": Fault(lambda log: with_gap(log, 10.0, gnss=True), (), "GNSS gap of 1"),
    "Doppler, axes, unit and time": Fault(
        lambda log: imu_later(
            mapped(scaled(reversed_doppler(log), gyro=180.0 / np.pi), ROTATIONS["ENU (y x -z)"]), 0.25
        ),
        ("gnss.rate_sign", "imu.axes", "imu.gyro_unit", "imu.time.offset_s"),
    ),
}


class Verdict(NamedTuple):
    """What the doctor made of a spoilt log."""

    keys: frozenset[str]  # proposed
    keys: frozenset[str]  # proposed
    found: bool  # told, as a proposal, a suspicion or a finding
    right: bool  # with the proposals taken the logs are what they were before
    report: CheckReport


def judged(log: Log, fault: Fault, folder: Path) -> Verdict:
    """Spoil a log, examine it, and hold the corrected flight's logs against the unspoilt ones."""
    folder.mkdir(parents=True, exist_ok=True)
    flight = Flight.load(fault.spoil(log).write(folder))
    report = examine(flight)
    keys = frozenset(proposal.key for proposal in report.proposals)
    if not fault.keys:
        told = fault.words in "\n".join(report.lines())
        return Verdict(keys, told, told and not keys - {"gnss.lever_arm_m"}, report)
    suspected = any(_is_suspicion(finding) for finding in report.findings)
    mended = corrected_flight(flight, report.proposals)
    return Verdict(keys, bool(keys) or suspected, _same(mended, log), report)


def _is_suspicion(finding: Finding) -> bool:
    """Return whether a finding says that something is declared wrongly: an error, or a doubt about the sensors."""
    known = ("imu_gap", "at rest for")  # of the sound logs too
    doubt = finding.severity == "warning" and finding.topic in ("imu", "motion")
    return finding.severity == "error" or (doubt and not finding.text.startswith(known))


def _same(flight: Flight, log: Log) -> bool:
    """Return whether a flight's logs are the given ones."""
    config = flight.config
    try:
        imu, _ = read_imu(config.imu, config.gps_week, flight.imu_grade)
        gnss = read_receiver(config.gnss, config.gps_week).gnss
    except Exception:
        return False
    time_s = ns_to_week_seconds(imu.t_ns, log.week)
    if len(time_s) != len(log.imu) or abs(float(np.median(time_s - log.imu[:, 0]))) > TIME_TOLERANCE_S:
        return False
    # an increment after a longer step is taken to cover a nominal one: not every sample comes back
    turned = np.quantile(np.abs(imu.w_ib_b - log.imu[:, 1:4]), 0.95)
    pushed = np.quantile(np.abs(imu.f_b - log.imu[:, 4:7]), 0.95)
    same = turned < 1e-4 and pushed < 1e-3
    first = float(ns_to_week_seconds(gnss.t_ns[:1], log.week)[0])
    wanted = log.gnss.sort_values("time_s", key=lambda t: t.astype(float), kind="stable").iloc[0]
    return (
        bool(same)
        and abs(first - float(wanted["time_s"])) < 1e-3
        and (not wanted["doppler_hz"] or abs(float(gnss.doppler_hz[0]) - float(wanted["doppler_hz"])) < 1e-3)
    )
