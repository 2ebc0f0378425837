"""Compiles the filter's kernels into the cache, in two processes of their own.

``replay`` starts the first where the cache is empty (``insgnss.jit.compiled_beside``), and this one the second. As the
kernels do not link each other (``insgnss.apart``), their order is free: one process goes through them from the front,
the other from the back, until they meet. What a start needs is left to the process that waits for them.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from insgnss.filter.headings.headings import is_prunable
from insgnss.filter.headings.sideslip import note_sideslip, sideslip
from insgnss.filter.imu.screen_state import EDIT_DTYPE, SCREEN_DTYPE
from insgnss.filter.imu.screening import note_mean, screen, take
from insgnss.filter.layout import Layout
from insgnss.filter.loop import advance, new_workspace, run_epochs, write_row
from insgnss.filter.output.writing import mixture_covariance, new_output, write_ledger, write_nav
from insgnss.filter.parameters import PARAMETERS_DTYPE
from insgnss.filter.prediction import Imu, carry, propagate_covariance
from insgnss.filter.state import new_bank
from insgnss.filter.update.adaptation import adapt_noise
from insgnss.filter.update.clone import clone_epoch
from insgnss.filter.update.closed_loop import turn_attitude_errors
from insgnss.filter.update.consistency import refuse_inconsistent
from insgnss.filter.update.creeping import find_creeping, follow_satellites
from insgnss.filter.update.epoch_update import update_epoch, use_rows
from insgnss.filter.update.faults import refuse_reflections, weigh_robustly
from insgnss.filter.update.gating import common_step, gate_between, gate_rows
from insgnss.filter.update.integrity import explain, fit_all, fit_freely, follow_explained
from insgnss.filter.update.observe import observe
from insgnss.gnss.carrier_rows import no_carriers
from insgnss.gnss.least_squares import RANGE, FitRows, free_clocks, workspace
from insgnss.gnss.observation_rows import OBSERVATION_DTYPE, Rows
from insgnss.gnss.robust_fit import search
from insgnss.jit import collecting_rarely, compile_for, compiled_beside, end_with_parent, is_compiled

MODULE: Final = "insgnss.filter.compile_loop"
FROM_THE_BACK: Final = "back"
_N: Final = 0  # stands for any whole number
_X: Final = 0.0  # for any other


def calls() -> dict[Callable[..., Any], tuple[Any, ...]]:
    """Return the kernels that every replay needs, each with arguments of the types that it is called with.

    The longest to compile stand at the ends, so that the two that come from there lose little where they meet. What
    only some replays need (masking, the trace) is compiled where it is first called.
    """
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
    parameters, bank, work = np.zeros(1, PARAMETERS_DTYPE), new_bank(1, 0), new_workspace(1, Layout())
    out = new_output(rows, 1, 1, np.zeros(0, np.int64))
    par, m, P, s, scratch = parameters[0], bank.state[0], bank.P[0], work.epoch, work.scratch
    lines, vectors, values = s.lines[:0], s.vectors, s.vectors[0]
    w_ib_b, f_b = imu.w_ib_b[0], imu.f_b[0]
    seen, memory = bank.seen[0], bank.memory[0]
    screened, edits, count = np.zeros(1, SCREEN_DTYPE), np.zeros(1, EDIT_DTYPE), np.zeros(1, np.int64)
    return {
        write_row: (bank, bank, _N, _N, _N, out, work),
        write_nav: (out.nav, out.optional, out.counts[0], _N, m, P, _N, _N),
        mixture_covariance: (bank, P),
        run_epochs: (bank, _N, _N, rows, imu, parameters, _X, out, work),
        advance: (bank, _N, imu, par, out, work),
        carry: (m, P, _N, _N, _N, *imu, par, scratch),
        propagate_covariance: (m, P, par, scratch),
        clone_epoch: (m, P, par, s.antenna[0], s.air[0], _N),
        turn_attitude_errors: (m, P, values, s.antenna[0]),
        common_step: (lines, _N, values, _X, _X),
        is_prunable: (bank, _N, _X),
        note_sideslip: (bank.head[0], m, P, _N),
        sideslip: (m, P),
        screen: (screened[0], *imu[:3], _N, edits, count, values),
        take: (screened[0], _N, values, _N, edits, count),
        note_mean: (screened[0],),
        write_ledger: (out.ledger, out.carrier, _N, lines),
        gate_rows: (lines, _N, _X),
        weigh_robustly: (lines, _N, par),
        refuse_reflections: (m, lines, rows.observation, _N, par),
        follow_satellites: (m, memory, lines, rows.observation, _N, s.fit, par),
        find_creeping: (memory, lines, rows.observation, _N, _X, _X),
        adapt_noise: (m, P, P, par, lines, s.fit, values, values, _N, _X),
        explain: (P, lines, _N, s.fit),
        fit_freely: (lines, _N, s.fit),
        fit_all: (lines, _N, s.fit),
        follow_explained: (m, P, par, lines, s.fit, _N),
        gate_between: (P, lines, vectors, _X),
        use_rows: (P, lines, vectors, _N, _X, _X, values),
        refuse_inconsistent: (P, lines, _X, _N),
        observe: (m, P, par, rows, _N, w_ib_b, f_b, s),
        update_epoch: (m, P, par, rows, _N, w_ib_b, f_b, s, scratch, work.masking, seen, memory, _X, True),
    }


def kernels() -> tuple[Callable[..., Any], ...]:
    """Return the kernels that every replay needs."""
    return tuple(calls())


def is_ready() -> bool:
    """Return whether all of them have machine code."""
    return all(map(is_compiled, kernels()))


def fetch_loop() -> None:
    """Load them from the cache, or compile what it lacks."""
    for kernel, arguments in calls().items():
        compile_for(kernel, arguments)


def compile_rivals() -> None:
    """Compile what finds the rivals of a given start: the fix of an epoch, and the search for what agrees in it."""
    unknowns, used = np.zeros(4), np.zeros(1, np.bool_)
    none, at = np.zeros(1), np.zeros(1, np.int64)
    rows = FitRows(RANGE, np.zeros((1, 8)), none, none, at, free_clocks(1), np.zeros(3))
    compile_for(search, (rows, used, unknowns, workspace(4), unknowns, np.zeros((4, 4)), used))


def main() -> None:
    """Compile from the back, or from the front with another process beside that does that, until they meet."""
    end_with_parent()
    gc.freeze()  # the modules stay
    from_the_back = sys.argv[1:] == [FROM_THE_BACK]
    order = list(calls().items())
    wanted = [] if from_the_back else [kernel for kernel, _ in order]
    if from_the_back:
        order.reverse()
    with collecting_rarely(), compiled_beside(wanted, MODULE, FROM_THE_BACK) as other:
        for kernel, arguments in order:
            if not is_compiled(kernel):
                compile_for(kernel, arguments)
        other.wait()


if __name__ == "__main__":
    main()
