"""Sample calls of the kernels in ``insgnss.aiding``."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from insgnss.aiding.satellite_arcs import broadcast_arcs
from insgnss.aiding.table import compute_aiding
from insgnss.filter.loop import run_epochs
from insgnss.filter.output.trace_rows import new_trace_room, output_samples
from insgnss.filter.output.writing import new_output
from insgnss.filter.state import select_members
from insgnss.filter.update.epoch_space import new_workspace
from insgnss.gnss.orbits.ephemeris_choice import broadcast_messages
from insgnss.tables import Float64
from tests.aiding.exact import (
    correlated_covariance,
    exact_run,
    one_covariance,
    setup,
    sky_arcs,
    spinning,
)
from tests.gnss.glonass_sample import FIRST_NS, glonass_navigation
from tests.kernels import KernelCase
from tests.kernels.filter import EPOCHS, SKY, bank, imu, parameters, rows
from tests.layouts import layout_with
from tests.runs.scenes import WEEK


def aided() -> tuple[Float64, ...]:
    """Return values, sigma and delays of a rolling body, with air and an offset's group."""
    run = exact_run(spinning(), np.array([1.0, 1.01, 2.5]))
    run = replace(run, trace=run.trace._replace(offset=np.full((3, 1), 12.0)))
    of = replace(
        setup(latency_s=0.02),
        troposphere=True,
        klobuchar=np.array([1.1e-8, 1.5e-8, -6e-8, -6e-8, 9e4, 1.6e4, -1.97e5, -6.6e4]),
        clock_groups=("E", "G"),
    )
    P = correlated_covariance(18)
    table = compute_aiding(of, sky_arcs(), run.trace, run.imu, one_covariance(run, P, age_s=0.2))
    return (*table.values, table.sigma, table.spans.delay_m, table.spans.drift_mps)


def columns_of_a_table() -> tuple[Float64, ...]:
    """Return the columns of a table with latency."""
    run = exact_run(spinning(), np.array([1.0, 1.01, 2.5]))
    covariances = one_covariance(run, correlated_covariance(), age_s=0.2)
    table = compute_aiding(setup(latency_s=0.02), sky_arcs(), run.trace, run.imu, covariances)
    return tuple(table.columns(WEEK, parts=True).values())


def traced_log() -> list[Any]:
    """Return what the loop leaves behind of a short log of two hypotheses, the second half of it with one."""
    layout = layout_with(n_offsets=1)
    samples, log, made = imu(), rows(layout), bank(layout)
    room = new_trace_room(samples.t_ns[output_samples(samples.t_ns, 50.0)], 0.1, EPOCHS, 1)
    out = new_output(log, 40, 20, np.zeros(0, np.int64), layout.n_values, room)
    work = new_workspace(len(SKY), layout)
    run_epochs(made, (0, 2), log, samples, parameters(layout), -1e9, out, work)
    one = select_members(made, np.array([0]))
    run_epochs(one, (2, EPOCHS), log, samples, parameters(layout), -1e9, out, work)
    return [room, one]


def glonass_pieces() -> Float64:
    """Return the pieces of satellites whose messages are integrated."""
    with tempfile.TemporaryDirectory() as folder:
        messages = broadcast_messages(glonass_navigation(Path(folder)))
    return broadcast_arcs(messages, {"R": "C1C"}, FIRST_NS, FIRST_NS).arcs.pieces[..., :3]


CASES = [
    KernelCase("tests.kernels.aiding:glonass_pieces", rtol=1e-12),
    # of 32 bits: the acceleration, the jerk and the sigma
    KernelCase("tests.kernels.aiding:aided", rtol=2e-7),
    KernelCase("tests.kernels.aiding:columns_of_a_table", rtol=2e-7),
    KernelCase("tests.kernels.aiding:traced_log", rtol=1e-10),
]
