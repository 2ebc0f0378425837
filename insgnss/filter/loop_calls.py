"""The kernels of the filter's loop, each with arguments of the types it is called with (``runs.kernel_list``)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, Final

import numpy as np

from insgnss.filter.headings.headings import heading_variance, is_prunable, same_heading, weigh_headings
from insgnss.filter.headings.sideslip import note_sideslip, sideslip
from insgnss.filter.imu.screen_state import EDIT_DTYPE, SCREEN_DTYPE
from insgnss.filter.imu.screening import note_mean, screen, take
from insgnss.filter.layout import Layout
from insgnss.filter.loop import advance, run_epochs, update_bank, write_between, write_row
from insgnss.filter.output.writing import mixture_covariance, new_output, write_ledger, write_nav
from insgnss.filter.parameters import PARAMETERS_DTYPE, Parameters
from insgnss.filter.prediction import ImuSamples, carry, carry_bank, predict_covariance, propagate_covariance
from insgnss.filter.rows.lines import EpochWorkspace
from insgnss.filter.state import Bank, copy_state, new_bank
from insgnss.filter.update.adaptation import adapt_noise, raise_level
from insgnss.filter.update.clone import clone_epoch
from insgnss.filter.update.closed_loop import close_loop, turn_attitude_errors, turn_force_errors
from insgnss.filter.update.consistency import (
    few_are_wrong,
    leave_contradicted,
    refuse_inconsistent,
    remove_smallest_set,
)
from insgnss.filter.update.creeping import find_creeping, follow_satellites, stands_out
from insgnss.filter.update.epoch_space import new_workspace
from insgnss.filter.update.epoch_update import update_epoch, use_epoch, use_rows
from insgnss.filter.update.faults import refuse_reflections, weigh_robustly
from insgnss.filter.update.gating import common_step, gate_between, gate_rows
from insgnss.filter.update.integrity import explain, fit_freely, follow_explained
from insgnss.filter.update.judging import judge_rows
from insgnss.filter.update.lasting_errors import follow_lasting_errors
from insgnss.filter.update.lever_swing import swing_lever_arm
from insgnss.filter.update.prior_rows import place_antenna, predict_measurements, predict_row
from insgnss.filter.update.range_biases import place_range_biases
from insgnss.filter.update.satellite_noise import widen_noisy_rates
from insgnss.filter.update.shown_motion import follow_motion, place_motion
from insgnss.filter.update.slow_errors import follow_slow_errors, place_effects_of_fix, place_slow_variances
from insgnss.filter.update.tag_jumps import follow_tag_jump, tag_evidence
from insgnss.filter.update.wrong_rates import refuse_repeated
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.geodesy.rotations import euler_to_matrix, matrix_to_quaternion
from insgnss.gnss.carrier_rows import no_carriers
from insgnss.gnss.observation_rows import OBSERVATION_DTYPE, GnssRows
from insgnss.kernels.compiled_ahead import ANY_N, ANY_X, compile_for

_SINGLE: Final = np.float32(0.0)  # for one of a log's row


def calls() -> dict[Callable[..., Any], tuple[Any, ...]]:
    """Return the kernels that every replay needs, each with arguments of the types that it is called with.

    The longest to compile stand first, so that processes that share the list end together. What only some replays need
    (masking, the trace, a prior that is far off) is compiled where it is first called. A kernel that is handed an array
    in a record has no place here: Python cannot name the type which that has inside a kernel.
    """
    rows = _no_rows()
    imu = ImuSamples(np.zeros(1, np.int64), np.zeros((1, 3)), np.zeros((1, 3)))
    parameters, bank, work = np.zeros(1, PARAMETERS_DTYPE), new_bank(1, 0), new_workspace(1, Layout())
    out = new_output(rows, 1, 1, np.zeros(0, np.int64))
    par, m, P, s, scratch = parameters[0], bank.state[0], bank.P[0], work.epoch, work.scratch
    lines, values = s.lines[:0], s.vectors[0]
    line, row = s.lines[0], np.zeros(1, OBSERVATION_DTYPE)[0]
    w_ib_b, f_b = imu.w_ib_b[0], imu.f_b[0]
    screened, edits, count = np.zeros(1, SCREEN_DTYPE), np.zeros(1, EDIT_DTYPE), np.zeros(1, np.int64)
    return {
        predict_row: (m, par, rows, ANY_N, row, s, line),
        predict_measurements: (m, P, par, rows, ANY_N, w_ib_b, f_b, s),
        run_epochs: (bank, (ANY_N, ANY_N), rows, imu, parameters, ANY_X, out, work),
        carry: (m, P, ANY_N, ANY_N, ANY_N, imu, par, scratch),
        follow_slow_errors: (bank, ANY_N, par, rows, ANY_N, ANY_X, s),
        update_epoch: (bank, ANY_N, par, rows, ANY_N, imu, ANY_N, work),
        propagate_covariance: (m, P, par, scratch),
        update_bank: (bank, ANY_N, rows, imu, ANY_N, par, out, work),
        advance: (bank, ANY_N, imu, par, out, work),
        write_between: (bank, ANY_N, imu, par, out, work),
        write_nav: (out.nav, out.optional, out.counts[0], ANY_N, m, P, par, (ANY_N, ANY_N)),
        place_antenna: (m, par, w_ib_b, f_b, s.antenna[0]),
        close_loop: (m, values, ANY_N),
        copy_state: (m, m),
        weigh_headings: (bank, par, False),
        write_row: (bank, bank, ANY_N, ANY_N, ANY_N, par, out, work),
        mixture_covariance: (bank, P),
        clone_epoch: (m, P, par, s.antenna[0], s.air[0], ANY_N),
        turn_attitude_errors: (m, P, par, values, s.antenna[0]),
        turn_force_errors: (m, P, par, values),
        follow_motion: (m, P, par),
        place_motion: (m, P, par, s.antenna[0]),
        **_judging(bank, par, rows, work.epoch),
        swing_lever_arm: (m, P, par, s.antenna[0], ANY_N),
        place_range_biases: (bank, par, rows, ANY_N, lines),
        place_slow_variances: (bank, ANY_N, par, rows, ANY_N, lines),
        place_effects_of_fix: (bank.slow, ANY_N, par.held[:0], rows, ANY_N, lines),
        is_prunable: (bank, ANY_N, ANY_X),
        note_sideslip: (bank.head[0], m, P, ANY_N),
        sideslip: (m, P),
        screen: (screened[0], *imu[:3], ANY_N, edits, count, values),
        take: (screened[0], ANY_N, values, ANY_N, edits, count),
        note_mean: (screened[0],),
        write_ledger: (out.ledger, out.carrier, ANY_N, lines),
        predict_covariance: (m, P, par, scratch),
        carry_bank: (bank, ANY_N, imu, par, scratch),
        heading_variance: (bank,),
        same_heading: (bank, ANY_N),
        matrix_to_quaternion: (P, values),
        euler_to_matrix: (ANY_X, ANY_X, ANY_X, P),
        geodetic_to_ecef: (ANY_X, ANY_X, ANY_X, values),
    }


def _judging(
    bank: Bank, par: Parameters, rows: GnssRows, s: EpochWorkspace
) -> dict[Callable[..., Any], tuple[Any, ...]]:
    """Return the kernels that judge the rows of an epoch."""
    m, P, memory = bank.state[0], bank.P[0], bank.memory[0]
    lines, vectors, values, places = s.lines[:0], s.vectors, s.vectors[0], np.zeros(0, np.int64)
    return {
        follow_satellites: (m, memory, lines, rows.observation, ANY_N, s.fit, values, par),
        widen_noisy_rates: (P, memory, lines, rows.observation, ANY_N, s.fit, values, par),
        stands_out: (memory, lines, rows.observation, ANY_N, ANY_X, s.fit, ANY_X, ANY_X),
        find_creeping: (memory, lines, rows.observation, ANY_N, ANY_X, ANY_X, True, ANY_X),
        judge_rows: (bank, ANY_N, par, lines, rows.observation, ANY_N, s),
        follow_tag_jump: (bank, ANY_N, par, rows, ANY_N, s),
        tag_evidence: (m, P, par, rows, ANY_N, s),
        follow_lasting_errors: (m, P, memory, s, rows.observation, ANY_N, ANY_N, par),
        use_epoch: (m, P, lines, vectors, par, ANY_X, P, values),
        leave_contradicted: (P, lines, ANY_N, places, places, ANY_X),
        remove_smallest_set: (P, places, ANY_X, ANY_N),
        few_are_wrong: (P, lines, ANY_N, ANY_X),
        adapt_noise: (m, P, P, par, s, ANY_N, ANY_N),
        use_rows: (P, lines, vectors, ANY_N, ANY_X, ANY_X, values),
        explain: (P, lines, ANY_N, s.fit),
        raise_level: (m, P, lines, ANY_N, s.fit, values, par),
        common_step: (lines, ANY_N, values, ANY_X, ANY_X),
        gate_rows: (lines, ANY_N, ANY_X),
        weigh_robustly: (lines, ANY_N, par),
        refuse_repeated: (m, memory, rows, ANY_N, lines),
        refuse_reflections: (m, lines, rows.observation, ANY_N, par),
        fit_freely: (lines, ANY_N, s.fit),
        follow_explained: (m, P, par, lines, s.fit, ANY_N),
        gate_between: (P, lines, vectors, ANY_X),
        refuse_inconsistent: (P, lines, ANY_N, ANY_X),
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


@cache
def fetch_loop() -> None:
    """Load them from the cache, or compile the missing ones; once a process, as to find the types takes 0.1 s."""
    for kernel, arguments in calls().items():
        compile_for(kernel, arguments)
