"""A log in blocks of rows: the same run to the last bit, wherever the blocks are cut."""

from __future__ import annotations

import dataclasses
import sys
from typing import Any

import numpy as np
import pandas as pd
import pytest

from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.filter.whole_log import run_blocks
from insgnss.log.flight import FlightInMemory
from insgnss.runs.gnss_rows import block_cuts, row_blocks
from insgnss.runs.replay import replay
from insgnss.runs.result import TABLES, Run
from insgnss.runs.setup import setup_filter
from insgnss.simulation.faults import cycle_slip, outage
from insgnss.simulation.observations import NoiseTerms
from tests.runs.scenes import flight, turns, with_faults, without_samples

SECONDS = 100.0
ONE_BLOCK = 1 << 16  # the flight has a thousand rows


@pytest.fixture(scope="module")
def flown() -> FlightInMemory:
    """Turns with carriers, a slip, no satellite for 12 s, no inertial sample for 15 s nor in the last five."""
    base = turns(SECONDS)
    receiver = dataclasses.replace(base.scenario.receiver, carrier_noise=NoiseTerms(floor=0.002))
    faulty = with_faults(base, (cycle_slip(["G04"], 3.0, 30.0, indicated=True), outage(None, 70.0, 82.0)))
    faulty.scenario = dataclasses.replace(faulty.scenario, receiver=receiver)
    log = faulty.draw(np.random.default_rng(7))
    imu = without_samples(without_samples(log.imu, 40.0, 55.0), SECONDS - 5.0, SECONDS + 1.0)
    return flight(faulty, log, imu=imu)


def in_blocks(monkeypatch: pytest.MonkeyPatch, most_rows: int, flown: FlightInMemory, **options: Any) -> Run:
    """Return the run of a flight whose rows come in blocks of that size."""
    with monkeypatch.context() as patched:
        patched.setattr(sys.modules["insgnss.runs.replay"], "MOST_ROWS", most_rows)
        return replay(flown, **options)


def tight17(**measurements: Any) -> FilterConfig:
    """Return the library's filter with other settings of its measurements."""
    config = filter_config("tight17")
    return config.model_copy(update={"measurements": config.measurements.model_copy(update=measurements)})


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"output": 7.0},
        {"smooth": True},
        {"aiding": 10.0, "supervise": True},
        {"filter": tight17(ionosphere="own")},  # delays computed beforehand, for the whole log
        {"filter": tight17(carrier=False)},
    ],
)
def test_blocks_change_no_bit(
    flown: FlightInMemory, options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = in_blocks(monkeypatch, ONE_BLOCK, flown, **options)

    assert {"used", "used_for_start", "no_imu"} <= set(whole.measurements["status"])
    assert {"start", "imu_gap", "no_measurements"} <= set(whole.events["kind"])
    for most_rows in (1, 64, 333):
        parts = in_blocks(monkeypatch, most_rows, flown, **options)
        for name in TABLES:
            before, after, told = getattr(whole, name), getattr(parts, name), f"{name}, blocks of {most_rows}"
            if before is None:
                assert after is None, told
            else:
                pd.testing.assert_frame_equal(after, before, check_exact=True, obj=told)


def test_carriers_at_the_edge_of_a_block_are_differenced(
    flown: FlightInMemory, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = in_blocks(monkeypatch, 1, flown)
    carriers = run.measurements[run.measurements["kind"] == "carrier_difference"]
    assert {"used", "slip_indicated", "no_epoch_before"} <= set(carriers["status"])
    assert (carriers["status"] == "used").mean() > 0.6


def test_filter_gives_up_the_blocks_behind_it_and_keeps_their_ledger(flown: FlightInMemory) -> None:
    logs = flown.read()
    setup = setup_filter(flown, logs, filter_config("tight17"))
    blocks, _ = row_blocks(setup, logs, flown, 100)
    sizes = [len(rows.observation) for rows in blocks]
    out, ledger, _ = run_blocks(setup, logs.imu, blocks, "gnss")

    assert len(sizes) > 5 and sum(sizes) == len(logs.gnss.t_ns)
    assert blocks == [] and len(out.ledger) == 0
    assert [len(part.entries) for part in ledger] == [len(part.carriers) for part in ledger] == sizes


@pytest.mark.parametrize(
    ("epochs", "most_rows", "cuts"),
    [
        ([3, 3, 3, 3], 100, [0, 12]),
        ([3, 3, 3, 3], 12, [0, 12]),
        ([3, 3, 3, 3], 6, [0, 6, 12]),
        ([3, 3, 3, 3], 5, [0, 3, 9, 12]),  # an epoch is never cut
        ([3, 3, 3, 3], 1, [0, 3, 6, 9, 12]),
        ([3, 9, 1, 1, 1], 4, [0, 3, 12, 15]),  # nor one larger than a block
        ([], 4, [0, 0]),
    ],
)
def test_blocks_end_with_an_epoch(epochs: list[int], most_rows: int, cuts: list[int]) -> None:
    t_ns = np.repeat(np.arange(len(epochs), dtype=np.int64), epochs)
    assert block_cuts(t_ns, most_rows) == cuts


def test_order_of_rows_with_carriers_matters_by_rounding_only(
    flown: FlightInMemory, rng: np.random.Generator
) -> None:
    """An even number of carriers has two rows in the middle; which of them the others are held against is no chance."""
    gnss = flown.logs.gnss
    order = np.lexsort((rng.random(len(gnss.t_ns)), gnss.t_ns))
    shuffled = dataclasses.replace(flown, logs=dataclasses.replace(flown.logs, gnss=gnss.take(order)))
    keys = ["time_s", "sv", "signal", "kind"]
    runs = [replay(one) for one in (flown, shuffled)]
    first, second = (
        run.measurements.astype(dict.fromkeys([*keys[1:], "status"], "str")).sort_values(keys) for run in runs
    )
    assert first["status"].tolist() == second["status"].tolist()
    for name in ("lat_deg", "lon_deg"):
        assert (runs[0].nav[name] - runs[1].nav[name]).abs().max() < 1e-6 / 111_000.0
