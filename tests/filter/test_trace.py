"""The trace of states and covariances: it changes nothing, and holds what the filter held at that moment."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

import numpy as np
import pytest

from insgnss.aiding.trace import FilterTrace, TraceSamples, traced
from insgnss.config.library import filter_config
from insgnss.filter.output.trace_rows import output_samples
from insgnss.filter.output.writing import NAV_COLUMNS, Output
from insgnss.filter.state import BA, BG, CLOCK, DRIFT
from insgnss.filter.whole_log import TraceIntervals, run_filter
from insgnss.runs.setup import setup_filter
from insgnss.simulation.oscillator import MILLISECOND_M
from tests.runs.scenes import (
    START_NS,
    FlightInMemory,
    flight,
    rows_where,
    turns,
    with_faults,
    without_samples,
)

SECONDS = 60.0


@cache
def flown() -> FlightInMemory:
    """Return a flight whose receiver clock steps by a millisecond at 44 s, epochs at whole seconds."""
    base = turns(SECONDS)
    clock = dataclasses.replace(base.scenario.clock, jumps=((44.0, MILLISECOND_M),))
    return flight(with_faults(base, (), clock))


def filtered(
    of: FlightInMemory,
    trace: TraceIntervals | None,
    output: Any = "gnss",
    settings: dict[str, Any] | None = None,
) -> tuple[Output, list[Any]]:
    """Return the loop's output and the events."""
    setup = setup_filter(of, of.logs, filter_config("tight17", settings))
    rows = setup.rows(of.logs.gnss, setup.navigation)
    return run_filter(setup, of.logs.imu, rows, output, trace=trace)


def trace_of(out: Output, of: FlightInMemory) -> FilterTrace:
    """Return what the loop left behind."""
    return traced(out.trace, TraceSamples(of.logs.imu.t_ns, of.logs.imu.w_ib_b, of.logs.imu.f_b))


@pytest.mark.parametrize("output", ["gnss", "imu", 7.3])
@pytest.mark.parametrize("between", [False, True], ids=["epochs at samples", "epochs between samples"])
def test_trace_changes_no_bit_of_what_the_filter_gives(output: Any, between: bool) -> None:
    of = flight(turns(SECONDS, 1.003)) if between else flown()
    plain, plain_events = filtered(of, None, output)
    beside, events = filtered(of, TraceIntervals(37.0, 0.1), output)

    assert len(trace_of(beside, of).trace.t_ns) > 1500
    for name in ("nav", "optional", "ledger", "carrier"):
        assert getattr(plain, name).tobytes() == getattr(beside, name).tobytes(), name
    assert plain_events == events


def test_trace_is_the_state_at_samples_and_its_covariance_the_one_of_navigation_rows() -> None:
    """Of sensors without further errors: the trace has their whole error in the place of the bias."""
    bias_alone = {"process.sensor_error_states": []}
    out, _ = filtered(flown(), TraceIntervals(50.0, 0.25), "imu", bias_alone)
    found = trace_of(out, flown())
    nav = {int(row["t_ns"]): row["value"] for row in out.nav[: out.counts[0].nav]}
    epochs = set(flown().logs.gnss.t_ns.tolist())
    at = {name: NAV_COLUMNS.index(name) for name in NAV_COLUMNS}
    compared = 0
    for t_ns, P in zip(found.covariances.t_ns.tolist(), found.covariances.P, strict=True):
        if t_ns in epochs:
            continue  # a navigation row is from after the update
        values = nav[t_ns]
        assert np.sqrt(P[CLOCK, CLOCK]) == values[at["sd_clock_bias_m"]]
        assert np.sqrt(P[DRIFT, DRIFT]) == values[at["sd_clock_drift_mps"]]
        assert np.sqrt(P[BA, BA]) == values[at["sd_accel_bias_x_mps2"]]
        assert np.sqrt(P[BG, BG]) == values[at["sd_gyro_bias_x_radps"]]
        row = int(np.searchsorted(found.trace.t_ns, t_ns))
        assert found.trace.clock[row, 0] == values[at["clock_bias_m"]]
        compared += 1
    assert compared > 200
    np.testing.assert_array_equal(flown().logs.imu.t_ns[found.trace.sample], found.trace.t_ns)


def test_row_at_an_epoch_is_from_before_its_update() -> None:
    logs = flown().logs
    epoch_ns = int(np.unique(logs.gnss.t_ns)[30])
    cut = dataclasses.replace(
        flown(), logs=dataclasses.replace(logs, gnss=rows_where(logs.gnss, logs.gnss.t_ns < epoch_ns))
    )
    whole = trace_of(filtered(flown(), TraceIntervals(100.0, 0.25))[0], flown())
    without = trace_of(filtered(cut, TraceIntervals(100.0, 0.25))[0], cut)
    row = int(np.searchsorted(whole.trace.t_ns, epoch_ns))

    assert whole.trace.t_ns[row] == epoch_ns
    for mine, other in zip(whole.trace, without.trace, strict=True):
        np.testing.assert_array_equal(mine[: row + 1], other[: row + 1])
    assert (whole.trace.r_e[row + 1] != without.trace.r_e[row + 1]).any()


def test_covariance_comes_in_each_tick_after_slow_epochs_and_when_the_state_was_set_anew() -> None:
    found = trace_of(filtered(flown(), TraceIntervals(50.0, 0.25))[0], flown()).covariances
    ticks = set((found.t_ns // 250_000_000).tolist())
    assert ticks == set(range(min(ticks), max(ticks) + 1))
    epoch_ns = np.unique(flown().logs.gnss.t_ns)[5:-1]
    gap_ns = found.t_ns[np.searchsorted(found.t_ns, epoch_ns, side="right")] - epoch_ns
    assert gap_ns.max() <= 20_000_000  # the very next row
    # ticks longer than the epochs' interval: only the clock's step brings one of its own
    rare = trace_of(filtered(flown(), TraceIntervals(50.0, 10.0))[0], flown()).covariances
    own = rare.t_ns[1:][np.diff(rare.t_ns // 10_000_000_000) == 0]
    # the first update after the start, and the step
    np.testing.assert_array_equal(own - START_NS, np.array([3_010_000_000, 44_010_000_000]))


def test_trace_goes_on_after_a_gap_that_ends_a_stretch() -> None:
    imu = without_samples(flown().logs.imu, 20.0, 30.0)
    of = dataclasses.replace(flown(), logs=dataclasses.replace(flown().logs, imu=imu))
    found = trace_of(filtered(of, TraceIntervals(50.0, 0.25))[0], of)
    since_s = (found.trace.t_ns - imu.t_ns[0]) / 1e9

    assert ((since_s > 3.0) & (since_s < 19.9)).any()
    assert not ((since_s > 20.0) & (since_s < 30.0)).any()
    assert (since_s > 40.0).any()
    np.testing.assert_array_equal(imu.t_ns[found.trace.sample], found.trace.t_ns)


def test_outputs_are_the_first_samples_of_each_period() -> None:
    t_ns = np.arange(0, 1_000_000_000, 7_500_000) + 5
    rows = output_samples(t_ns, 20.0)

    assert len(rows) == 20
    assert np.all(np.diff(t_ns[rows]) <= 57_500_000)
    np.testing.assert_array_equal(output_samples(t_ns, 1e4), np.arange(len(t_ns)))
    assert len(output_samples(np.zeros(0, np.int64), 20.0)) == 0
