"""Wild numbers in a replay: a fixed part of ``tests.benchmarks.wild_cells``, and cells that once ended a replay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insgnss
from insgnss.config.library import filter_config
from insgnss.runs.result import Run
from tests.benchmarks.wild_cells import (
    CRASHED,
    OK,
    REFUSED,
    WRONG,
    Job,
    base,
    run_beside,
    with_logs,
    wrong_cells,
)

SEED, CASES = 7, 40


def test_replays_of_wild_cells_neither_crash_nor_write_what_is_no_number() -> None:
    """In a process of its own: memory overwritten shows as a process that a signal has ended."""
    found = list(run_beside(SEED, 0, CASES))

    assert [case for case, _, _ in found] == list(range(CASES))
    assert [each for each in found if each[1] in (WRONG, CRASHED)] == []
    assert {OK, REFUSED} == {result for _, result, _ in found}


def replayed(job: Job) -> Run:
    return insgnss.replay(job.flight, job.filter, **job.how)


def usual() -> Job:
    return Job(base(), filter_config("tight17"), {})


@pytest.mark.parametrize("value", [1e35, 1e29, -1e100, np.nan])
def test_one_wild_rate_is_survived(value: float) -> None:
    imu = usual().flight.logs.imu
    w = imu.w_ib_b.copy()
    w[1500, 2] = value

    run = replayed(with_logs(usual(), imu=replace(imu, w_ib_b=w)))

    assert list(wrong_cells(run)) == []
    assert run.nav["time_s"].iloc[-1] - run.nav["time_s"].iloc[0] > 10.0


@pytest.mark.parametrize(
    ("name", "value"), [("delta_n", -1e30), ("sqrt_a", 5e9), ("m0", np.nan), ("crs", 1e29)]
)
def test_damaged_ephemeris_is_none_and_an_event_names_its_satellite(name: str, value: float) -> None:
    navigation = usual().flight.logs.navigation
    assert navigation is not None
    table = navigation.ephemerides
    changed = getattr(table, name).copy()
    changed[2] = value
    damaged = replace(navigation, ephemerides=replace(table, **{name: changed}))

    run = replayed(with_logs(usual(), navigation=damaged))

    sv = table.sv_names[2]
    assert set(run.measurements.loc[run.measurements["sv"] == sv, "status"]) <= {
        "no_ephemeris",
        "not_started",
    }
    refused = run.events[run.events["kind"] == "ephemeris_refused"]
    assert len(refused) == 1
    assert refused["detail"].iloc[0].startswith(sv)
    assert list(wrong_cells(run)) == []
    assert not run.nav[["sd_slow_n_m", "sd_slow_e_m", "sd_slow_d_m"]].isna().to_numpy().any()
