"""Wild numbers in random cells: does a replay survive them, and does none of them reach a table?

    python -m tests.benchmarks.wild_cells [--cases 10000] [--seed 0] [--processes 2]

replays a slice of the sample flight, in memory, once for each case, with NaN, infinities, negative zero, denormals and
numbers up to +-1e308 in a few cells of the inertial samples, the observations, the satellites' own states, the
ephemerides, the time tags or the settings. A case is right when it ends in a run or in an error of ``insgnss.errors``,
with no inf in any table, and no NaN where COLUMNS.md does not say that a column may be empty. The replays run in
processes of their own, so that memory overwritten shows as what it is: a process that a signal has ended.
"""

from __future__ import annotations

import argparse
import collections
import itertools
import math
import signal
import subprocess
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from pydantic import ValidationError

import insgnss
from insgnss.config.filter import FilterConfig
from insgnss.config.flight import FlightConfig, ImuGrade, MountedAntenna, Oscillator
from insgnss.config.library import filter_config
from insgnss.constants import NS_PER_S
from insgnss.errors import InsGnssError
from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.log.flight import Flight, FlightInMemory
from insgnss.runs.result import Run
from insgnss.tables import Float64, GnssTable, ImuTable, NavigationData

SAMPLE = Path(__file__).resolve().parents[2] / "data" / "sample_flight" / "flight.toml"
FIRST_S, LENGTH_S = 60.0, 20.0
_TELL_EVERY: Final = 1000
OK, REFUSED, WRONG, CRASHED = "ok", "refused", "wrong", "crashed"
Case = Callable[[np.random.Generator, "Job"], "Job"]

# what a table may leave empty, as COLUMNS.md says; the rest holds a number in every row
MAY_BE_ENDLESS: Final = ("accumulation_s", "search_s")
MAY_BE_EMPTY: Final = {
    "nav": ("sd_slow_n_m", "sd_slow_e_m", "sd_slow_d_m"),
    "measurements": ("innovation", "sd_innovation", "nis"),
    "satellites": ("gain_dbi", "cn0_dbhz", "sd_range_m", "sd_range_rate_mps"),
    "events": ("time_s",),
    "errors": ("sd_slow_n_m", "sd_slow_e_m", "sd_slow_d_m"),
    "aiding": (),
    "aiding_budget": (),
    "supervision": ("gain_dbi",),
    "transitions": (),
    "search_times": (),
}


@dataclass(frozen=True)
class Job:
    """A replay to be done."""

    flight: FlightInMemory
    filter: FilterConfig
    how: dict[str, Any]  # further arguments of ``replay``


@cache
def base() -> FlightInMemory:
    """Return the slice of the sample flight, with a carrier phase made of its Doppler."""
    flight = Flight.load(SAMPLE)
    logs = flight.read()
    first = int(logs.imu.t_ns[0] + FIRST_S * NS_PER_S)
    last = int(first + LENGTH_S * NS_PER_S)
    imu, gnss = logs.imu, logs.gnss
    samples = (imu.t_ns >= first) & (imu.t_ns <= last)
    rows = np.flatnonzero((gnss.t_ns >= first) & (gnss.t_ns <= last))
    gnss = gnss.take(rows)
    sliced = replace(
        logs,
        imu=ImuTable(imu.t_ns[samples], imu.w_ib_b[samples], imu.f_b[samples]),
        gnss=replace(gnss, carrier_cycles=carrier_of(gnss)),
    )
    return FlightInMemory(flight.path, flight.config, flight.imu_grade, flight.oscillator, sliced)


def carrier_of(gnss: GnssTable) -> Float64:
    """Return a phase [cycles] that grows by the Doppler, by the trapezoid."""
    cycles = np.zeros(len(gnss.t_ns))
    for sv in np.unique(gnss.sv):
        own = np.flatnonzero(gnss.sv == sv)
        rate, t = -gnss.doppler_hz[own], (gnss.t_ns[own] - gnss.t_ns[own[0]]) / NS_PER_S
        cycles[own[1:]] = np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))
        cycles[own] += 1e6
    return cycles


def wild(rng: np.random.Generator) -> float:
    """Return a wild number."""
    kind = rng.integers(8)
    if kind == 0:
        return math.nan
    if kind == 1:
        return float(rng.choice([math.inf, -math.inf]))
    if kind == 2:
        return float(rng.choice([-0.0, 5e-324, -5e-324, 1e-310]))
    return float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(3.0, 308.0))


def spoilt(values: Float64, rng: np.random.Generator, most: int = 6) -> Float64:
    """Return a copy with wild numbers in a few cells."""
    changed = np.array(values, np.float64)
    if changed.size:
        for _ in range(int(rng.integers(1, most + 1))):
            changed.flat[int(rng.integers(changed.size))] = wild(rng)
    return changed


def with_logs(job: Job, **changes: Any) -> Job:
    """Return the job with other logs."""
    return replace(job, flight=replace(job.flight, logs=replace(job.flight.logs, **changes)))


def in_imu(rng: np.random.Generator, job: Job) -> Job:
    """Spoil inertial samples."""
    imu = job.flight.logs.imu
    name = str(rng.choice(["w_ib_b", "f_b"]))
    return with_logs(job, imu=replace(imu, **{name: spoilt(getattr(imu, name), rng)}))


def in_observations(rng: np.random.Generator, job: Job) -> Job:
    """Spoil observations, as the log or as sigmas of its own."""
    gnss, n = job.flight.logs.gnss, len(job.flight.logs.gnss.t_ns)
    names = ("pseudorange_m", "doppler_hz", "range_rate_mps", "cn0_dbhz", "carrier_cycles")
    name = str(rng.choice([*names, "sigma_pseudorange_m", "sigma_range_rate_mps"]))
    values = getattr(gnss, name)
    whole = np.full(n, 2.0 if "pseudo" in name else 0.1) if values is None else values
    return with_logs(job, gnss=replace(gnss, **{name: spoilt(whole, rng, 40)}))


def in_states(rng: np.random.Generator, job: Job) -> Job:
    """Let the log itself say where the satellites are, some of it wrongly."""
    gnss = job.flight.logs.gnss
    states = satellite_states(gnss, job.flight.logs.navigation)
    sat = np.column_stack([states.sat[:, :6], states.clock_m, states.drift_mps])
    return with_logs(job, gnss=replace(gnss, sat=spoilt(sat, rng, 40)))


def in_ephemerides(rng: np.random.Generator, job: Job) -> Job:
    """Spoil messages, or the ionosphere's coefficients."""
    navigation = job.flight.logs.navigation
    assert isinstance(navigation, NavigationData)
    table = navigation.ephemerides
    if rng.random() < 0.1:
        klobuchar = spoilt(navigation.klobuchar if navigation.klobuchar is not None else np.zeros(8), rng)
        return with_logs(job, navigation=replace(navigation, klobuchar=klobuchar))
    for _ in range(int(rng.integers(1, 4))):
        name = str(rng.choice([f.name for f in fields(table) if f.name not in ("sv_names", "message")]))
        values = getattr(table, name)
        if values.dtype == np.int64:
            changed = values.copy()
            changed[int(rng.integers(len(values)))] += int(rng.integers(-(2**61), 2**61))
        else:
            changed = spoilt(values, rng, 2)
        table = replace(table, **{name: changed})
    return with_logs(job, navigation=replace(navigation, ephemerides=table))


def in_tags(rng: np.random.Generator, job: Job) -> Job:
    """Move time tags anywhere, in an order that a reader would let pass."""
    imu, gnss = job.flight.logs.imu, job.flight.logs.gnss
    far = int(rng.choice([NS_PER_S, 100 * NS_PER_S, 10**6 * NS_PER_S, 2**60]))
    if rng.random() < 0.5:
        t_ns = imu.t_ns.copy()
        t_ns[int(rng.integers(len(t_ns)))] += int(rng.integers(-far, far))
        t_ns, order = np.unique(t_ns, return_index=True)
        return with_logs(job, imu=ImuTable(t_ns, imu.w_ib_b[order], imu.f_b[order]))
    t_ns = gnss.t_ns.copy()
    t_ns[int(rng.integers(len(t_ns)))] += int(rng.integers(-far, far))
    order = np.argsort(t_ns, kind="stable")
    return with_logs(job, gnss=replace(gnss.take(order), t_ns=t_ns[order]))


def in_settings(rng: np.random.Generator, job: Job) -> Job:
    """Give settings a wild number: of the filter, the flight, the sensor or the clock."""
    flight = job.flight
    what = int(rng.integers(4))
    if what == 0:
        return replace(job, filter=FilterConfig.model_validate(changed_leaf(job.filter.model_dump(), rng)))
    if what == 1:
        settings = FlightConfig.model_validate(changed_leaf(flight.config.model_dump(), rng))
        return replace(job, flight=replace(flight, config=settings))
    if what == 2:
        grade = ImuGrade.model_validate(changed_leaf(flight.imu_grade.model_dump(), rng))
        return replace(job, flight=replace(flight, imu_grade=grade))
    clock = Oscillator.model_validate(changed_leaf(flight.oscillator.model_dump(), rng))
    return replace(job, flight=replace(flight, oscillator=clock))


def changed_leaf(settings: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Return settings of which one number is wild, or merely far from usual."""
    leaves = list(number_leaves(settings))
    place, key = leaves[int(rng.integers(len(leaves)))]
    usual = float(place[key])
    far = usual * 10.0 ** rng.uniform(-12.0, 12.0) if usual else 10.0 ** rng.uniform(-12.0, 12.0)
    value = wild(rng) if rng.random() < 0.4 else far
    place[key] = round(value) if isinstance(place[key], int) and abs(value) < 1e18 else value
    return settings


def number_leaves(settings: Any) -> Iterator[tuple[Any, Any]]:
    """Yield table and key of each number; arrays become lists, so that they can be changed."""
    for key, value in settings.items():
        if isinstance(value, tuple):
            settings[key] = value = list(value)
        if isinstance(value, dict):
            yield from number_leaves(value)
        elif isinstance(value, list) and value and all(isinstance(v, float) for v in value):
            yield from ((value, i) for i in range(len(value)))
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield settings, key


PLACES: Final[tuple[Case, ...]] = (
    *(in_imu, in_imu, in_observations, in_states),
    *(in_ephemerides, in_ephemerides, in_settings, in_tags),
)


def job_of(seed: int, case: int) -> Job:
    """Return a case's replay: how it runs, and what is wild in it."""
    rng = np.random.default_rng([seed, case])
    job = Job(base(), filter_config("tight17"), {})
    job = ways(rng, job)
    for _ in range(1 if rng.random() < 0.8 else 2):
        place = PLACES[int(rng.integers(len(PLACES)))]
        job = place(rng, job)
    return job


def ways(rng: np.random.Generator, job: Job) -> Job:
    """Return the job run in one of several ways; the plain one is the most frequent."""
    way = int(rng.integers(16))
    if way == 0:
        return replace(job, how={"output": "imu"})
    if way == 1:
        return replace(job, how={"smooth": True})
    if way == 2:
        return replace(job, how={"aiding": 10.0})
    if way == 3:
        gnss = job.flight.config.gnss
        mounted = gnss.model_copy(update={"antenna": (MountedAntenna(pattern="patch_l1"),)})
        config = job.flight.config.model_copy(update={"gnss": mounted})
        return replace(
            job, flight=replace(job.flight, config=config), how={"supervise": bool(rng.integers(2))}
        )
    if way in (4, 5):
        faults = job.filter.faults.model_copy(update={"weights": "huber" if way == 4 else "student"})
        return replace(job, filter=job.filter.model_copy(update={"faults": faults}))
    return job


def outcome(seed: int, case: int) -> tuple[str, str]:
    """Return what became of a case, and what was wrong."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            job = job_of(seed, case)
            run = insgnss.replay(job.flight, job.filter, **job.how)
        except (InsGnssError, ValidationError) as error:
            return REFUSED, type(error).__name__
        except Exception:
            return WRONG, traceback.format_exc(limit=-3).replace("\n", " | ")
    found = list(wrong_cells(run))
    return (WRONG, "; ".join(found)) if found else (OK, "")


def wrong_cells(run: Run) -> Iterator[str]:
    """Yield what no table of a run may hold."""
    for name, empty in MAY_BE_EMPTY.items():
        table: pd.DataFrame | None = getattr(run, name)
        if table is None:
            continue
        for column in table.select_dtypes("number"):
            values = table[column].to_numpy(np.float64)
            if np.isinf(values).any() and column not in MAY_BE_ENDLESS:
                yield f"inf in {name}.{column}"
            if np.isnan(values).any() and column not in empty:
                yield f"NaN in {name}.{column}"
    used = run.measurements[run.measurements["status"] == "used"]
    if used[["innovation", "sd_innovation", "nis"]].isna().to_numpy().any():
        yield "a row that is used without an innovation"


def run_here(seed: int, first: int, last: int) -> None:
    """Run cases and print each outcome as soon as it is there."""
    for case in range(first, last):
        print(f"begin {case}", flush=True)
        result, detail = outcome(seed, case)
        print(f"end {case} {result} {detail}", flush=True)


def run_beside(seed: int, first: int, last: int) -> Iterator[tuple[int, str, str]]:
    """Yield case, outcome and detail, all run in processes of their own; one that dies is started after its case."""
    while first < last:
        command = [sys.executable, "-m", "tests.benchmarks.wild_cells", "--seed", str(seed)]
        command += ["--first", str(first), "--last", str(last)]
        begun = first
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
            assert child.stdout is not None
            for line in child.stdout:
                word, number, *rest = line.split(" ", 3)
                begun = int(number)
                if word == "end":
                    yield begun, rest[0], rest[1].strip() if len(rest) > 1 else ""
                    first = begun + 1
        code = int(child.returncode)
        if first < last:
            yield begun, CRASHED, signal.Signals(-code).name if code < 0 else f"exit code {code}"
            first = begun + 1


def shares(cases: int, processes: int) -> list[tuple[int, int]]:
    """Return the first case, and the one after the last, of each process."""
    edges = np.linspace(0, cases, processes + 1).astype(int).tolist()
    return list(itertools.pairwise(edges))


def summary(outcomes: list[tuple[int, str, str]]) -> str:
    """Return how many cases ended how, and those that ended wrongly."""
    count = collections.Counter(result for _, result, _ in outcomes)
    errors = collections.Counter(detail for _, result, detail in outcomes if result == REFUSED)
    lines = [", ".join(f"{count[result]} {result}" for result in (OK, REFUSED, WRONG, CRASHED))]
    lines += [f"  refused by {name}: {number}" for name, number in errors.most_common()]
    lines += [
        f"  case {case}: {result}: {detail}"
        for case, result, detail in outcomes
        if result in (WRONG, CRASHED)
    ]
    return "\n".join(lines)


def main() -> int:
    """Run all cases; return 1 if one of them crashed or put a wild number into a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, usual in (
        ("--cases", 10_000),
        ("--seed", 0),
        ("--processes", 2),
        ("--first", -1),
        ("--last", -1),
    ):
        parser.add_argument(name, type=int, default=usual)
    given = parser.parse_args()
    if given.first >= 0:
        run_here(given.seed, given.first, given.last)
        return 0
    began = time.perf_counter()
    outcomes: list[tuple[int, str, str]] = []
    workers = [run_beside(given.seed, *share) for share in shares(given.cases, given.processes)]
    while workers:  # the processes run beside each other; their answers are taken in turn
        for worker in list(workers):
            try:
                outcomes.append(next(worker))
            except StopIteration:
                workers.remove(worker)
                continue
            if len(outcomes) % _TELL_EVERY == 0:
                print(f"after {len(outcomes)}: {summary(sorted(outcomes))}", flush=True)
    print(summary(sorted(outcomes)))
    print(f"{given.cases} replays in {time.perf_counter() - began:.0f} s, seed {given.seed}")
    return 1 if any(result in (WRONG, CRASHED) for _, result, _ in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
