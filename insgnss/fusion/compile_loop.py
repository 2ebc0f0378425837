"""Compiles the filter's loop into the cache, in a process of its own: ``python -m insgnss.fusion.compile_loop``.

``replay`` starts it where the cache is empty (``insgnss.jit.compiled_beside``). The kernels are called with the types
that a log gives them, on no epochs; the update of an epoch, half of the work, is compiled in one more process.
"""

from __future__ import annotations

import sys
from typing import NamedTuple

import numpy as np

from insgnss.fusion.epoch_update import update_epoch
from insgnss.fusion.loop import Imu, Workspace, advance, new_workspace, run_epochs
from insgnss.fusion.output import Output, Table, new_output
from insgnss.fusion.parameters import PARAMETERS_DTYPE
from insgnss.fusion.state import Bank, Layout, new_bank
from insgnss.gnss.carrier_rows import no_carriers
from insgnss.gnss.observation_rows import OBSERVATION_DTYPE, Rows
from insgnss.jit import compiled_beside, end_with_parent, is_compiled

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
    """Compile the update of one epoch."""
    a = arguments()
    par, w_ib_b, f_b = a.parameters[0], a.imu.w_ib_b[0], a.imu.f_b[0]
    update_epoch(
        a.bank.state[0],
        a.bank.P[0],
        par,
        a.rows,
        0,
        w_ib_b,
        f_b,
        a.work.epoch,
        a.work.scratch,
        a.bank.seen[0],
        a.bank.memory[0],
        0.0,
    )


def compile_loop() -> None:
    """Compile the whole loop, its prediction first, or fetch it from the cache."""
    a = arguments()
    if not is_compiled(run_epochs):
        with compiled_beside(update_epoch, MODULE, UPDATE_ONLY) as update_is_there:
            advance(a.bank, 0, a.imu, a.parameters[0], a.out, a.work)
            update_is_there()
    run_epochs(a.bank, 0, 0, a.rows, a.imu, a.parameters, 0.0, a.out, a.work)


def main() -> None:
    """Compile what the command line asks for."""
    end_with_parent()
    if sys.argv[1:] == [UPDATE_ONLY]:
        compile_update()
    else:
        compile_loop()


if __name__ == "__main__":
    main()
