"""The kernels of the filter's loop, each with arguments of the types it is called with (``runs.kernel_list``)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from insgnss.filter.headings.headings import heading_variance, is_prunable, same_heading
from insgnss.filter.headings.sideslip import note_sideslip, sideslip
from insgnss.filter.imu.screen_state import EDIT_DTYPE, SCREEN_DTYPE
from insgnss.filter.imu.screening import note_mean, screen, take
from insgnss.filter.layout import Layout
from insgnss.filter.loop import advance, run_epochs, write_row
from insgnss.filter.output.writing import mixture_covariance, new_output, write_ledger, write_nav
from insgnss.filter.parameters import PARAMETERS_DTYPE
from insgnss.filter.prediction import ImuSamples, carry, carry_bank, predict_covariance, propagate_covariance
from insgnss.filter.state import new_bank
from insgnss.filter.update.adaptation import adapt_noise
from insgnss.filter.update.clone import clone_epoch
from insgnss.filter.update.closed_loop import turn_attitude_errors
from insgnss.filter.update.consistency import refuse_inconsistent
from insgnss.filter.update.creeping import find_creeping, follow_satellites
from insgnss.filter.update.epoch_space import new_workspace
from insgnss.filter.update.epoch_update import update_epoch, use_rows
from insgnss.filter.update.faults import refuse_reflections, weigh_robustly
from insgnss.filter.update.gating import common_step, gate_between, gate_rows
from insgnss.filter.update.integrity import explain, fit_all, fit_freely, follow_explained
from insgnss.filter.update.lever_swing import swing_lever_arm
from insgnss.filter.update.observe import observe
from insgnss.filter.update.range_biases import place_range_biases
from insgnss.filter.update.shown_motion import follow_motion, place_motion
from insgnss.filter.update.wrong_rates import refuse_repeated
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.geodesy.rotations import euler_to_matrix, matrix_to_quaternion
from insgnss.gnss.carrier_rows import no_carriers
from insgnss.gnss.observation_rows import OBSERVATION_DTYPE, GnssRows
from insgnss.kernels.compiled_ahead import compile_for

_N: Final = 0  # stands for any whole number
_X: Final = 0.0  # for any other
_SINGLE: Final = np.float32(0.0)  # for one of a log's row


def calls() -> dict[Callable[..., Any], tuple[Any, ...]]:
    """Return the kernels that every replay needs, each with arguments of the types that it is called with.

    The longest to compile stand first, so that processes that share the list end together. What only some replays need
    (masking, the trace) is compiled where it is first called.
    """
    rows = _no_rows()
    imu = ImuSamples(np.zeros(1, np.int64), np.zeros((1, 3)), np.zeros((1, 3)))
    parameters, bank, work = np.zeros(1, PARAMETERS_DTYPE), new_bank(1, 0), new_workspace(1, Layout())
    out = new_output(rows, 1, 1, np.zeros(0, np.int64))
    par, m, P, s, scratch = parameters[0], bank.state[0], bank.P[0], work.epoch, work.scratch
    lines, vectors, values = s.lines[:0], s.vectors, s.vectors[0]
    w_ib_b, f_b = imu.w_ib_b[0], imu.f_b[0]
    memory = bank.memory[0]
    screened, edits, count = np.zeros(1, SCREEN_DTYPE), np.zeros(1, EDIT_DTYPE), np.zeros(1, np.int64)
    return {
        observe: (m, P, par, rows, _N, w_ib_b, f_b, s),
        propagate_covariance: (m, P, par, scratch),
        run_epochs: (bank, (_N, _N), rows, imu, parameters, _X, out, work),
        carry: (m, P, _N, _N, _N, imu, par, scratch),
        update_epoch: (bank, _N, par, rows, _N, imu, _N, work),
        find_creeping: (memory, lines, rows.observation, _N, _X, _X, True),
        follow_satellites: (m, memory, lines, rows.observation, _N, s.fit, par),
        advance: (bank, _N, imu, par, out, work),
        write_nav: (out.nav, out.optional, out.counts[0], _N, m, P, par, (_N, _N)),
        adapt_noise: (m, P, P, par, s, _N, _N, _X),
        use_rows: (P, lines, vectors, _N, _X, _X, values),
        explain: (P, lines, _N, s.fit),
        write_row: (bank, bank, _N, _N, _N, par, out, work),
        mixture_covariance: (bank, P),
        clone_epoch: (m, P, par, s.antenna[0], s.air[0], _N),
        turn_attitude_errors: (m, P, par, values, s.antenna[0]),
        follow_motion: (m, P, par),
        place_motion: (m, P, par, s.antenna[0]),
        swing_lever_arm: (m, P, par, s.antenna[0], _N),
        place_range_biases: (bank, par, rows, _N, lines),
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
        refuse_repeated: (m, memory, rows, _N, lines),
        refuse_reflections: (m, lines, rows.observation, _N, par),
        fit_freely: (lines, _N, s.fit),
        fit_all: (lines, _N, s.fit),
        follow_explained: (m, P, par, lines, s.fit, _N),
        gate_between: (P, lines, vectors, _X),
        refuse_inconsistent: (P, lines, _X, _N),
        predict_covariance: (m, P, par, scratch),
        carry_bank: (bank, _N, imu, par, scratch),
        heading_variance: (bank,),
        same_heading: (bank, _N),
        matrix_to_quaternion: (P, values),
        euler_to_matrix: (_X, _X, _X, P),
        geodetic_to_ecef: (_X, _X, _X, values),
    }


def _no_rows() -> GnssRows:
    """Return a log of one epoch without a row."""
    carrier, before = no_carriers()
    return GnssRows(
        epoch_ns=np.zeros(1, np.int64),
        first=np.zeros(2, np.int64),
        observation=np.zeros(0, OBSERVATION_DTYPE),
        sat=np.zeros((0, 8)),
        klobuchar=np.zeros(8),
        carrier=carrier,
        before=before,
        before_ns=np.zeros(1, np.int64),
    )


def fetch_loop() -> None:
    """Load them from the cache, or compile what it lacks."""
    for kernel, arguments in calls().items():
        compile_for(kernel, arguments)
