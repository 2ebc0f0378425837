"""Sample calls of the kernels behind the rows that users ask for: between epochs, and of points of the body."""

from __future__ import annotations

from typing import Any

import numpy as np

from insgnss.filter.diagnosis.offset_state import with_further_states
from insgnss.filter.layout import GaussMarkov, Layout, StateBlock
from insgnss.filter.loop import note_tag_jump
from insgnss.filter.output.writing import N_NAV, NAV_DTYPE, new_output
from insgnss.filter.rows.late_rates import carry_late_velocity
from insgnss.filter.smoothing.between import NextEpoch, filtered, smoothed, write_smoothed
from insgnss.filter.smoothing.body_points import PointColumns, further_values
from insgnss.filter.state import ABSENT_STATE, BG, DR, OFFSETS, select_members
from insgnss.filter.states.gnss_time import UNKNOWN_GNSS_TIME
from insgnss.filter.states.imu_time import IMU_TIME
from insgnss.filter.states.lever_arm import LEVER_ARM
from insgnss.filter.states.range_biases import RANGE_BIASES
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.prior_rows import predict_measurements
from insgnss.filter.update.range_biases import place_range_biases
from insgnss.filter.update.reflections import write_reflections
from insgnss.filter.update.satellite_memory import RANGE_S, REFLECTION, REFLECTION_VARIANCE
from insgnss.filter.update.slow_errors import correct_by_row_without
from insgnss.filter.update.tag_jumps import UNSTEADY, follow_tag_jump, late_apart
from insgnss.gnss.observation_rows import N_BANDS
from tests.filter.test_tag_jumps import tagged_epoch
from tests.kernels import KernelCase
from tests.kernels.filter import SKY, START_NS, bank, imu, parameters, rows, short_log
from tests.layouts import layout_with


def uncertain_lever_arm() -> list[Any]:
    """Return what the loop changes and writes where the antenna's lever arm is a state, with carriers."""
    columns = ("lever_arm_x_m", "lever_arm_y_m", "lever_arm_z_m")
    return short_log(False, True, motion_sigma=3.0, further=(StateBlock(LEVER_ARM, columns, "m", 0.3),))


def uncertain_imu_time() -> list[Any]:
    """Return what the loop changes and writes where the IMU's tags are off by a time that is a state."""
    offset = StateBlock(IMU_TIME, ("imu_time_offset_s",), "s", 0.02)
    return short_log(True, True, motion_sigma=3.0, further=(offset,))


def uncertain_gnss_time() -> list[Any]:
    """Return what the loop changes and writes where the GNSS tags are off by a time that is a state."""
    return short_log(True, True, motion_sigma=3.0, further=(UNKNOWN_GNSS_TIME,))


def jumped_tags() -> list[Any]:
    """Return what becomes of epochs whose tags have jumped, at a right or a wrong place, with the state or not."""
    found: list[Any] = []
    for moved_m, at in ((0.0, ABSENT_STATE), (80.0, ABSENT_STATE), (0.0, OFFSETS)):
        made, log, (par, work) = tagged_epoch(0.05, 0.3 * np.sin(np.arange(12.0)), moved_m)
        if at == OFFSETS:
            made = with_further_states(made, Layout(), Layout((UNKNOWN_GNSS_TIME,)))
        par.at_gnss_time, par.tag_jump_odds = at, 1.0
        follow_tag_jump(made, 0, par, log, 0, work)
        out, made.head[0].tag_jumps = new_output(log, 1, 4, np.zeros(0, np.int64)), UNSTEADY
        note_tag_jump(made.head[0], made.state[0], par, out, START_NS)
        found += [out.events["a"].copy(), made, work.lines["status"].copy(), work.lines["predicted"].copy()]
    return found


def late_tag() -> list[Any]:
    """Return what epochs say of their tag without a place known before: late, in time, too few."""
    angle = np.arange(1.0, 12.0)
    u = np.column_stack([np.cos(angle), np.sin(angle), 0.5 + 0.4 * np.cos(3.0 * angle)])
    growth = 700.0 * np.sin(5.0 * angle)
    found = []
    for late_s, n in ((0.05, 11), (0.0, 11), (0.05, 7)):
        residual = u @ [30.0, -20.0, 50.0] + late_s * growth + np.cos(7.0 * angle)
        found.append(np.array(late_apart(np.column_stack([u, np.ones(11), growth, residual])[:n])))
    return found


def late_rates() -> list[Any]:
    """Return what the two smoothings of range rates lag by, and the rows that lag."""
    layout = layout_with(n_offsets=1)
    made, par, log = bank(layout), parameters(layout), rows(layout)
    made.state["rates_late_s"] = 0.2
    m, w, work = made.state[0], np.array([0.1, -0.2, 0.3]), new_epoch(len(SKY), OFFSETS + 1)
    for _ in range(5):
        before_e = (m.v_e[0] - 0.1, m.v_e[1] + 0.2, m.v_e[2] - 0.3)
        carry_late_velocity(m, par[0], w, before_e, 0.02)
    predict_measurements(m, made.P[0], par[0], log, 0, w, np.array([0.2, 0.1, -9.8]), work)
    return [made, work.lines]


def range_biases() -> list[Any]:
    """Return what the loop changes and writes where range errors are states, fewer than there are satellites."""
    names = tuple(f"range_bias_{i}" for i in range(4))
    block = StateBlock(RANGE_BIASES, names, "sigma", 1.0, GaussMarkov(1.0, 600.0), shown=False)
    layout = Layout((*layout_with(n_offsets=1).blocks, block))
    changed, log, par = bank(layout), rows(layout), parameters(layout)
    log.observation["slot"][log.first[1] :] += 20 * N_BANDS  # other satellites from the second epoch on
    lines = new_epoch(len(SKY), OFFSETS + 5).lines
    for epoch in range(2):
        place_range_biases(changed, par[0], log, epoch, lines)
    return [*short_log(False, True, further=(block,)), changed, lines]


def slow_errors() -> list[Any]:
    """Return bank and lines of a log with more satellites than places for slow errors, reflections, a row without."""
    layout = layout_with(n_offsets=1)
    changed, log, par = bank(layout), rows(layout), parameters(layout)
    changed.slow.S[:, par[0].held[: par[0].n_held]] = np.cos(np.arange(par[0].n_held))
    par["n_slow"] = 4
    log.observation["slot"][log.first[1] :] += 20 * N_BANDS  # other satellites from the second epoch on
    lines = new_epoch(len(SKY), OFFSETS + 1).lines
    for epoch in range(2):
        place_range_biases(changed, par[0], log, epoch, lines)
    memory = changed.memory[0]
    memory[:, RANGE_S], memory[:, REFLECTION_VARIANCE] = log.epoch_ns[1] * 1e-9, 0.1
    memory[:, REFLECTION] = 5.0 * np.cos(np.arange(len(memory)))
    lines["variance"], par["reflection_rate"] = 4.0, 1.0 / 30.0
    write_reflections(memory, par[0], log, 1, lines)
    n, held, at = changed.P.shape[1], par[0].held[: par[0].n_held], np.array([DR, DR + 2])
    correct_by_row_without(changed.slow, 4, np.ones(2), at, held, 0.1 * np.cos(np.arange(n)), np.zeros(n))
    return [changed, lines]


def between_epochs() -> list[Any]:
    """Return what 1.1 s without measurements make of a filter, and what a later epoch tells of it."""
    layout = layout_with(n_offsets=1)
    made, par = select_members(bank(layout), np.zeros(1, np.int64)), parameters(layout)
    times_ns = START_NS + np.array([3, 50, 51, 700, 1_030]) * 1_000_000
    (_, P), *_ = filtered(made, times_ns, imu(), par)
    n, end_ns = OFFSETS + 1, START_NS + 1_100_000_000
    ((_, prior),) = filtered(made, np.array([end_ns]), imu(), par)
    step = np.sqrt(np.diagonal(prior[0])) * np.cos(np.arange(n))
    onward = NextEpoch(end_ns, prior[0], step, -0.9 * prior[0], imu())
    nav, optional = np.zeros(len(times_ns), NAV_DTYPE), np.zeros((len(times_ns), 1))
    for part in smoothed(made, times_ns, onward, par, n):
        write_smoothed(nav, optional, part.rows.start, part, par)
    return [P, nav, optional]


def point_of_the_body() -> list[Any]:
    """Return all that can be asked for beside two rows."""
    value = np.zeros((2, N_NAV))
    value[:, :9] = [59.9, 30.3, 120.0, 30.0, -20.0, 1.0, 20.0, -5.0, 130.0]
    value[1, 1] = -75.0
    P = np.diag(np.repeat([4.0, 0.01, 1e-6, 1e-4, 1e-10], 3))
    P[:3, 6:9] = P[6:9, :3] = 1e-4
    wanted = PointColumns((1.0, -2.0, 3.0), quaternion=True, covariance=True)
    rates = np.array([[0.1, 0.2, 0.3], [0.0, 0.0, 0.0]])
    return [
        further_values(wanted, value, np.stack([P, 2.0 * P])[:, : BG + 3, : BG + 3], rates, np.full(2, 1e-7))
    ]


CASES = [
    KernelCase("tests.kernels.rows:uncertain_lever_arm", rtol=1e-8),
    KernelCase("tests.kernels.rows:uncertain_imu_time", rtol=1e-8),
    KernelCase("tests.kernels.rows:uncertain_gnss_time", rtol=1e-8),
    KernelCase("tests.kernels.rows:jumped_tags", rtol=1e-8),
    KernelCase("tests.kernels.rows:late_tag", rtol=1e-8),
    KernelCase("tests.kernels.rows:late_rates", rtol=1e-10),
    KernelCase("tests.kernels.rows:range_biases", rtol=1e-8),
    KernelCase("tests.kernels.rows:slow_errors", rtol=1e-12),
    # a smoothed variance is a tenth of the difference of two, seen through an inverse
    KernelCase("tests.kernels.rows:between_epochs", rtol=1e-7),
    KernelCase("tests.kernels.rows:point_of_the_body", rtol=1e-11),
]
