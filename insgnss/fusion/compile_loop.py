"""Compiles the filter's loop into the cache, in a process of its own.

``replay`` starts it where the cache is empty (``insgnss.jit.compiled_beside``). The kernels are called with the types
that a log gives them, on no epochs; the update of an epoch, half of the work, is compiled in one more process. What
both need (the covariance's prediction, an epoch's rows) this one compiles while the other is at parts of its own.
"""

from __future__ import annotations

import gc
import sys
from typing import NamedTuple

import numpy as np

from insgnss.fusion.adaptation import adapt_noise
from insgnss.fusion.consistency import refuse_inconsistent
from insgnss.fusion.epoch_update import update_epoch, use_rows
from insgnss.fusion.faults import follow_innovations, refuse_reflections, weigh_robustly
from insgnss.fusion.gating import common_step, gate_between, gate_rows
from insgnss.fusion.loop import Workspace, advance, new_workspace, run_epochs, write_row
from insgnss.fusion.masking import mask_hidden
from insgnss.fusion.measurements import observe
from insgnss.fusion.output import Output, Table, new_output
from insgnss.fusion.parameters import PARAMETERS_DTYPE
from insgnss.fusion.prediction import Imu, propagate_covariance
from insgnss.fusion.state import Bank, Layout, new_bank
from insgnss.fusion.trace_rows import new_trace_room
from insgnss.fusion.tracing import write_trace
from insgnss.gnss.carrier_rows import no_carriers
from insgnss.gnss.observation_rows import OBSERVATION_DTYPE, Rows
from insgnss.jit import collecting_rarely, compiled_beside, end_with_parent, is_compiled, only_linked

MODULE = "insgnss.fusion.compile_loop"
UPDATE_ONLY = "update"


class Arguments(NamedTuple):
    """What the loop is called with: one inertial sample, one epoch without satellites."""

    bank: Bank
    rows: Rows
    imu: Imu
    parameters: Table
    out: Output
    work: Workspace


def arguments() -> Arguments:
    """Return arguments of the types that ``replay`` gives the loop."""
    carrier, before = no_carriers()
    rows = Rows(
        epoch_ns=np.zeros(1, np.int64),
        first=np.zeros(2, np.int64),
        observation=np.zeros(0, OBSERVATION_DTYPE),
        sat=np.zeros((0, 8)),
        klobuchar=np.zeros(8),
        carrier=carrier,
        before=before,
        before_ns=np.zeros(1, np.int64),
    )
    imu = Imu(np.zeros(1, np.int64), np.zeros((1, 3)), np.zeros((1, 3)))
    return Arguments(
        new_bank(1, 0),
        rows,
        imu,
        np.zeros(1, PARAMETERS_DTYPE),
        new_output(rows, 1, 1, np.zeros(0, np.int64)),
        new_workspace(1, Layout()),
    )


def compile_update() -> None:
    """Compile the update of one epoch, first the parts that nobody else compiles at the same moment."""
    a = arguments()
    m, P, par, rows, s = a.bank.state[0], a.bank.P[0], a.parameters[0], a.rows, a.work.epoch
    seen, memory, vector = a.bank.seen[0], a.bank.memory[0], s.vectors[0]
    lines, observation = s.lines[:0], rows.observation[:0]
    write_row(a.bank, a.bank, 0, 0, 0, a.out, a.work)  # the other process needs it late
    refuse_inconsistent(P, lines, 1.0, 0)
    room = new_trace_room(np.zeros(1, np.int64), 1.0, 1, 0)
    write_trace(a.bank, 0, True, par, room, a.work.P_out, a.work.scratch)  # and this one
    adapt_noise(m, P, par, lines, vector, 0, 0.0)
    gate_between(P, lines, s.vectors, 1.0)
    gate_rows(lines, 0, 1.0)
    use_rows(P, lines, s.vectors, 0, 1.0, 1.0)
    refuse_reflections(m, lines, observation, 0, par)
    weigh_robustly(lines, 0, par)
    w_ib_b, f_b = a.imu.w_ib_b[0], a.imu.f_b[0]
    update_epoch(m, P, par, rows, 0, w_ib_b, f_b, s, a.work.scratch, a.work.masking, seen, memory, 0.0)


def compile_prediction() -> None:
    """Compile what lies between epochs, the rows of an epoch, and first what the other process will fetch."""
    a = arguments()
    par, s = a.parameters[0], a.work.epoch
    lines, vector = s.lines[:0], s.vectors[0]
    follow_innovations(a.bank.memory[0], lines, a.rows.observation[:0], 0, vector, par)
    common_step(lines, 0, vector, 1.0, 1.0)
    propagate_covariance(a.bank.state[0], a.bank.P[0], par, a.work.scratch)
    m, P, antenna = a.bank.state[0], a.bank.P[0], s.antenna[0]
    observe(m, P, par, a.rows, 0, a.imu.w_ib_b[0], a.imu.f_b[0], s)
    mask_hidden(m, P, par, a.rows.observation[:0], lines, antenna, a.bank.seen[0], a.work.masking)
    advance(a.bank, 0, a.imu, par, a.out, a.work)


def compile_loop() -> None:
    """Compile the whole loop, its prediction first, or fetch it from the cache."""
    if not is_compiled(run_epochs):
        compile_parts()
    call_loop()


def compile_parts() -> None:
    """Compile what the loop calls: the update of an epoch in one more process, the rest in this one."""
    with compiled_beside(update_epoch, MODULE, UPDATE_ONLY) as update:
        compile_prediction()
        update.wait()


def call_loop() -> None:
    """Call the loop on no epochs."""
    a = arguments()
    run_epochs(a.bank, 0, 0, a.rows, a.imu, a.parameters, 0.0, a.out, a.work)


def main() -> None:
    """Compile what the command line asks for."""
    end_with_parent()
    gc.freeze()  # the modules stay
    with collecting_rarely():
        if sys.argv[1:] == [UPDATE_ONLY]:
            compile_update()
            return
        compile_parts()
        with only_linked():
            call_loop()


if __name__ == "__main__":
    main()
