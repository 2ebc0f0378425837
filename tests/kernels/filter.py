"""Sample calls of the kernels in ``insgnss.filter``: a short log through the whole compiled loop."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from insgnss.antenna.equipment import limits_of
from insgnss.config.filter import FilterConfig, Visibility
from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.constants import C_MPS, NS_PER_S, NS_PER_WEEK, STANDARD_GRAVITY_MPS2, WGS84_OMEGA_RADPS
from insgnss.filter.headings.headings import heading_variance, turn_about
from insgnss.filter.headings.motion import velocity_changed
from insgnss.filter.headings.sideslip import note_sideslip
from insgnss.filter.imu.screen_state import EDIT_DTYPE, new_screen
from insgnss.filter.imu.screening import screen
from insgnss.filter.layout import Coupling, GaussMarkov, Layout, StateBlock, diagonal
from insgnss.filter.loop import DONE, ImuSamples, run_epochs, run_to
from insgnss.filter.output.trace_rows import new_trace_room
from insgnss.filter.output.writing import new_output
from insgnss.filter.parameters import resolve_parameters
from insgnss.filter.rows.lines import Lines
from insgnss.filter.state import (
    BA,
    BG,
    CLOCK,
    DR,
    DRIFT,
    DV,
    OFFSETS,
    PSI,
    Bank,
    new_bank,
    select_members,
)
from insgnss.filter.states.wanted import SlowSizes
from insgnss.filter.update.adaptation import adapt_noise, raise_level
from insgnss.filter.update.closed_loop import turn_force_errors
from insgnss.filter.update.creeping import follow_satellites
from insgnss.filter.update.epoch_space import new_epoch, new_workspace
from insgnss.filter.update.integrity import follow_explained
from insgnss.filter.update.judging import UpdateOutcome, counted_again
from insgnss.filter.update.lasting_errors import follow_lasting_errors
from insgnss.filter.update.masking import MASK, OFF, deweight
from insgnss.filter.update.satellite_noise import widen_noisy_rates
from insgnss.filter.update.wrong_rates import refuse_repeated
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix, up_direction
from insgnss.geodesy.rotations import matrix_to_quaternion
from insgnss.gnss.line_of_sight import line_of_sight
from insgnss.gnss.observation_rows import N_BANDS, OBSERVATION_DTYPE, RANGE_RATE, GnssRows, prepare_rows
from insgnss.status import GATED, USED
from insgnss.tables import Float64, GnssTable
from tests.filter.scene import at_rest, new_filter, perfect_rows, place, run
from tests.filter.scene import parameters as scene_parameters
from tests.filter.scene import rows_of as scene_rows_of
from tests.filter.scene import sky as scene_sky
from tests.kernels import KernelCase
from tests.layouts import layout_with

LAT, LON, H = math.radians(60.0), math.radians(30.0), 120.0
START_NS = 2268 * NS_PER_WEEK + 200_000 * NS_PER_S
LEVER_ARM_M = (0.4, -0.2, -1.1)
CLOCK_M, DRIFT_MPS, OFFSET_M = 1200.0, 3.0, 15.0
# azimuth and elevation [deg]; the last one stands below the mask
SKY = {
    "G01": (20, 30),
    "G07": (110, 55),
    "G12": (200, 25),
    "G19": (290, 70),
    "E05": (60, 40),
    "E11": (330, 3),
}
EPOCHS = 5
NO_NOISE = {"elevation": 0.0, "cn0_at_45_dbhz": 0.0}
GRADE = ImuGrade(
    gyro_bias_deg_per_h=1.0,
    gyro_bias_instability_deg_per_h=0.5,
    gyro_correlation_time_s=1000.0,
    gyro_arw_deg_per_sqrt_h=0.1,
    accel_bias_mg=1.0,
    accel_bias_instability_mg=0.3,
    accel_correlation_time_s=1000.0,
    accel_vrw_mps_per_sqrt_h=0.06,
)
L1_M = C_MPS / 1_575.42e6


def level_state() -> tuple[Float64, Float64, Float64]:
    """Return position (3,), C_ne (3, 3) and specific force (3,) in n of a user at rest, heading north."""
    r_e, C_ne, g_e = np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    geodetic_to_ecef(LAT, LON, H, r_e)
    ecef_to_ned_matrix(LAT, LON, C_ne)
    normal_gravity_ecef(r_e, g_e)
    return r_e, C_ne, -C_ne @ g_e


def sky() -> Float64:
    """Return (n, 8) satellite states: 22 000 km away at the angles of ``SKY``, 3 km/s across the line of sight."""
    r_e, C_ne, _ = level_state()
    states = np.zeros((len(SKY), 8))
    for row, (azimuth, elevation) in zip(states, np.radians(list(SKY.values())), strict=True):
        u_n = [
            math.cos(elevation) * math.cos(azimuth),
            math.cos(elevation) * math.sin(azimuth),
            -math.sin(elevation),
        ]
        u_e = C_ne.T @ np.array(u_n)
        row[0:3] = r_e + 22e6 * u_e
        row[3:6] = 3e3 * np.cross(u_e, [0.3, -0.5, 0.8])
        row[6:8] = 5000.0, 0.01
    return states


def observed(clock_m: float, offset_m: float) -> GnssTable:
    """Return the log of an antenna at rest whose receiver clock jumps by 1 ms at the fourth epoch."""
    r_e, C_ne, _ = level_state()
    r_a = r_e + C_ne.T @ np.array(LEVER_ARM_M)
    satellites, names = sky(), tuple(SKY)
    u, g = np.zeros(3), np.zeros(3)
    ranges, rates = np.zeros((EPOCHS, len(names))), np.zeros((EPOCHS, len(names)))
    for k in range(EPOCHS):
        for s, name in enumerate(names):
            distance, rate = line_of_sight(satellites, s, r_a, np.zeros(3), u, g)
            bias = clock_m + DRIFT_MPS * k * 0.2 + (offset_m if name[0] == "E" else 0.0) - satellites[s, 6]
            ranges[k, s] = distance + bias + (299_792.458 if k >= 3 else 0.0)
            rates[k, s] = rate + DRIFT_MPS - satellites[s, 7]
    ranges[0, 1] += 5000.0  # refused by the gate
    ranges[1, :] = math.nan  # an epoch without measurements
    rates[1, :] = math.nan
    satellite_index = np.tile(np.arange(len(names)), EPOCHS).astype(np.int16)
    states = np.tile(satellites, (EPOCHS, 1))
    states[2] = math.nan  # one row without a satellite state
    n = ranges.size
    return GnssTable(
        t_ns=START_NS + np.repeat(np.arange(EPOCHS), len(names)) * (NS_PER_S // 5) + NS_PER_S // 8,
        sv=satellite_index,
        signal=np.zeros(n, np.int16),
        pseudorange_m=ranges.ravel(),
        doppler_hz=np.full(n, math.nan),
        range_rate_mps=rates.ravel(),
        cn0_dbhz=np.where(np.arange(n) % 7 == 3, math.nan, 44.0),
        sv_names=names,
        signal_names=("C1C",),
        sat=states,
        sigma_pseudorange_m=np.where(np.arange(n) % 5 == 1, 2.0, math.nan),
        sigma_range_rate_mps=np.where(np.arange(n) % 5 == 2, 0.1, math.nan),
        carrier_cycles=ranges.ravel() / L1_M,
    )


def parameters(layout: Layout) -> npt.NDArray[Any]:
    """Return the filter's numbers for a tactical sensor."""
    config = FilterConfig.model_validate(
        {
            "pseudorange_noise_m": {"floor": 0.5, "elevation": 0.6, "cn0_at_45_dbhz": 0.7},
            "range_rate_noise_mps": {"floor": 0.03, "elevation": 0.02, "cn0_at_45_dbhz": 0.03},
        }
    )
    return resolve_parameters(
        *(config, GRADE, Oscillator(h0_s=2e-19, h_minus2_per_s=2e-20), LEVER_ARM_M, True, layout),
        slow=SLOW,
    )


SLOW = SlowSizes(1.5, 0.05, {"G": 0.5, "E": 0.3})


def rows(layout: Layout) -> GnssRows:
    """Return the log as the filter reads it."""
    klobuchar = np.array([1.2e-8, 7.5e-9, -6e-8, -6e-8, 9e4, 3.3e4, -2e5, -6.5e4])
    return prepare_rows(
        observed(CLOCK_M, OFFSET_M),
        None,
        klobuchar,
        clock_groups=("G", "E"),
        signals={"G": ("C1C",), "E": ("C1C",)},
        carrier=True if layout.clone else None,
        slow_sigma_m=SLOW.satellite,
    )


def imu() -> ImuSamples:
    """Return 1.2 s of a sensor at rest at 100 Hz, with uneven steps and one gap."""
    _, C_ne, f_n = level_state()
    t_ns = START_NS + np.arange(0, 1_200_000_000, 10_000_000) + np.arange(120) % 3 * 1_000_000
    keep = np.abs(np.arange(120) - 70) > 4
    w_b = C_ne @ np.array([0.0, 0.0, WGS84_OMEGA_RADPS])
    ripple = 1e-3 * np.sin(np.arange(120))[:, None]
    return ImuSamples(t_ns[keep], (w_b + ripple)[keep], (f_n + ripple)[keep])


# errors of the sensors that are no biases, one of which returns to zero
ACCEL_SCALE = StateBlock("accel_scale", ("sx", "sy", "sz"), "-", 1e-3, couples=diagonal("accelerometer"))
GYRO_OVER_FORCE = StateBlock(
    "gyro_over_force",
    ("gx", "one"),
    "s/m",
    1e-6,
    GaussMarkov(1e-6, 60.0),
    (Coupling("gyro", "x", "f_z"), Coupling("gyro", "y")),
)


def bank(layout: Layout) -> Bank:
    """Return two hypotheses 2 deg of heading apart, with one inter-system offset."""
    r_e, C_ne, _ = level_state()
    made = new_bank(2, layout.n_optional)
    sigma = np.zeros(OFFSETS + layout.n_optional)
    for at, value in ((DR, 5.0), (DV, 0.5), (PSI, 0.03), (BA, 0.01), (BG, 5e-6)):
        sigma[at : at + 3] = value
    sigma[[CLOCK, DRIFT, OFFSETS]] = 50.0, 5.0, 20.0
    for block in layout.blocks[1:]:  # behind the offset
        sigma[layout.at(block.name) : layout.at(block.name) + block.size] = math.sqrt(block.variance)
    for i, heading in enumerate(np.radians([-1.0, 1.0])):
        c, s = math.cos(heading), math.sin(heading)
        made.state["C_eb"][i] = C_ne.T @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        matrix_to_quaternion(made.state["C_eb"][i], made.state["q_eb"][i])
        made.state["r_e"][i] = r_e + 1.0
        made.state["clock"][i] = CLOCK_M - 10.0, DRIFT_MPS
        made.P[i] = np.diag(sigma**2)
    made.head["now_ns"], made.head["next"], made.head["from_fix"] = START_NS, 1, 1
    return made


def short_log(
    output_between: bool,
    with_carrier: bool,
    with_masking: bool = False,
    motion_sigma: float = 0.0,
    further: tuple[StateBlock, ...] = (),
    traced: bool = False,
) -> list[Any]:
    """Return everything the loop changes or writes for the short log, with output at the epochs or between them.

    The loop stops where a hypothesis has become negligible; it goes on with both.
    """
    layout = layout_with(n_offsets=1, ionosphere=with_carrier, clone=with_carrier)
    layout = replace(layout, blocks=(*layout.blocks, *further))
    made, log, par = bank(layout), rows(layout), parameters(layout)
    times = START_NS + np.arange(1, 22) * 50_000_000 + 3_000_000 if output_between else np.zeros(0)
    trace = new_trace_room(imu().t_ns[1:], 0.1, EPOCHS, layout.n_offsets) if traced else None
    out = new_output(log, 40, 20, times.astype(np.int64), layout.n_values, trace)
    work = new_workspace(len(SKY), layout, None, limits_of(Visibility()))
    par["visibility"] = MASK if with_masking else OFF
    par["motion_gate2"] = motion_sigma**2
    ended = [(DONE, 0)]
    while ended[-1][1] < EPOCHS:
        ended.append(run_epochs(made, (ended[-1][1], EPOCHS), log, imu(), par, -30.0, out, work))
    if output_between:
        run_to(made, int(times[-1]), imu(), par, out, work)
    return [ended, made, out]


def errors_of_the_sensors() -> list[Any]:
    """Return what the loop changes and writes where errors of the sensors are states."""
    return short_log(False, False, motion_sigma=3.0, further=(ACCEL_SCALE, GYRO_OVER_FORCE), traced=True)


def corrected_tilt() -> list[Any]:
    """Return covariance and correction after a tilt of a degree was found to be an accelerometer's error."""
    layout = layout_with(n_offsets=1)
    layout = replace(layout, blocks=(*layout.blocks, ACCEL_SCALE))
    made, par = bank(layout), parameters(layout)
    m, n = made.state[0], made.P.shape[1]
    m.f_last[:] = 0.4, -0.2, -9.8
    root = np.sqrt(made.P[0]) @ (np.eye(n) + 0.1 * np.cos(np.arange(n * n)).reshape(n, n))
    P, correction = root @ root.T, 0.1 * np.sin(np.arange(n))
    up = np.array(up_direction(m.r_e))
    correction[PSI : PSI + 3] = np.cross(up, m.C_eb @ correction[BA : BA + 3]) / STANDARD_GRAVITY_MPS2
    turn_force_errors(m, P, par[0], correction)
    return [P, correction]


def lost_log() -> list[Any]:
    """Return what the loop writes of a bank of which one hypothesis, then both, hold a number that is none."""
    layout = layout_with(n_offsets=1, clone=True)
    made, log, par = bank(layout), rows(layout), parameters(layout)
    out = new_output(log, 40, 20, np.zeros(0, np.int64), layout.n_values)
    work = new_workspace(len(SKY), layout, None, limits_of(Visibility()))
    made.P[1, PSI, BG] = math.nan
    ended = [run_epochs(made, (0, EPOCHS), log, imu(), par, -math.inf, out, work)]
    made.state["v_e"][0, 1] = math.nan
    ended.append(run_epochs(made, (1, EPOCHS), log, imu(), par, -30.0, out, work))
    return [ended, made.head, made.state["log_weight"], out]


def one_heading_with_unknown_motion() -> list[Any]:
    """Return everything the loop changes for one hypothesis on the move, inside a gap of the samples."""
    layout = layout_with(n_offsets=1)
    made, log, par = select_members(bank(layout), np.zeros(1, np.int64)), rows(layout), parameters(layout)
    made.state["v_e"] = made.state["C_eb"][:, :, 0] * 12.0
    samples = imu()
    samples = samples._replace(unknown=np.tile([1e-3, 0.1], (len(samples.t_ns), 1)))
    out = new_output(log, 40, 20, np.zeros(0, np.int64), layout.n_values)
    work = new_workspace(len(SKY), layout, None, limits_of(Visibility()))
    ended = [(DONE, 0)]
    for second in range(1, 4):
        note_sideslip(made.head[0], made.state[0], made.P[0], START_NS - (5 - second) * NS_PER_S)
    while ended[-1][1] < EPOCHS:
        ended.append(run_epochs(made, (ended[-1][1], EPOCHS), log, samples, par, -30.0, out, work))
    return [ended, made, out]


def screened_samples() -> list[Any]:
    """Return the verdicts on a log with gaps, wild values, spikes and sensors that are out."""
    t = np.arange(1100) * 0.01
    w = 0.3 * np.sin(t[:, None] * [0.7, 1.1, 0.3]) + 1e-3 * np.sin(1e4 * t[:, None] * [1.0, 1.3, 1.7])
    f = (
        [0.0, 0.0, -9.8]
        + np.sin(t[:, None] * [0.5, 0.8, 1.0])
        + 0.02 * np.sin(1e4 * t[:, None] * [2.0, 2.3, 2.7])
    )
    w[320, 1], f[340, 0], w[360, 2], f[300:302, 1] = math.nan, 1e9, 30.0, 80.0
    w[380:680, 2], f[480:520, 1] = w[380, 2], 0.0
    f[690:700, 0] = 500.0
    keep = np.ones(len(t), np.bool_)
    keep[720:750] = keep[780:1050] = False
    t_ns = START_NS + np.arange(len(t)) * 10_000_000
    config = FilterConfig.model_validate(
        {
            "pseudorange_noise_m": {"floor": 0.5, **NO_NOISE},
            "range_rate_noise_mps": {"floor": 0.03, **NO_NOISE},
        }
    )
    state, edits, count = (
        new_screen(config, GRADE, LEVER_ARM_M),
        np.zeros(2000, EDIT_DTYPE),
        np.zeros(1, np.int64),
    )
    decided = screen(state[0], t_ns[keep], w[keep], f[keep], 0, edits, count, np.zeros(6))
    dead, dead_edits, dead_count = new_screen(config, GRADE, LEVER_ARM_M), edits.copy(), np.zeros(1, np.int64)
    f[:250] = 0.0  # from the beginning on
    screen(dead[0], t_ns[:300], w[:300], f[:300], 0, dead_edits, dead_count, np.zeros(6))
    return [decided, state, edits, count, dead, dead_edits, dead_count]


def wrong_rows() -> tuple[Float64, Lines]:
    """Return a wide covariance and ten pseudoranges at its prior, two of which the others contradict."""
    n = OFFSETS
    P = np.diag(np.repeat([1e4, 1.0, 1e-4, 1e-4, 1e-10, 1e5, 1.0], [3, 3, 3, 3, 3, 1, 1]))
    work = new_epoch(10, n)
    for j, line in enumerate(work.lines):
        line["status"] = USED
        line["h"][0, :3] = math.cos(2.1 * j), math.sin(2.1 * j), -0.3 - 0.06 * j
        line["h"][0, 6] = 1.0
        line["innovation"][0], line["variance"][0] = 12.0 + 0.5 * math.sin(5.0 * j), 1.0 + 0.1 * j
    work.lines["innovation"][[2, 7], 0] += 40.0, -35.0
    return P, work.lines


def crowd(noise: float) -> list[Any]:
    """Return what twenty seconds of ten satellites leave of levels and means: one runs away, or all are noisy."""
    P, lines = wrong_rows()
    made, par = new_bank(1, 0), parameters(layout_with())[0]
    work = new_epoch(10, OFFSETS)._replace(lines=lines)
    par["drift_gate"], par["rate_memory_s"], m, fit = 4.0, 8.0, made.state[0], work.fit
    par["rate_error_s"] = 3.0
    observation = np.zeros(10, OBSERVATION_DTYPE)
    observation["slot"] = np.arange(10) * N_BANDS
    found = []
    for second in range(1, 21):
        for j, line in enumerate(lines):
            line["status"][:2] = USED, GATED if noise > 1.0 else USED
            line["h"][1, 3:6] = line["h"][0, :3]
            line["variance"][:2], line["predicted"][:2] = (1.0, 0.01), (0.1, 1e-4)
            line["weakness"], line["weak"] = 0.2 * (j % 3), 0.1 * (j % 3)
            line["innovation"][:2] = (
                noise * math.sin(5.0 * j + second),
                0.1 * noise * math.cos(3.0 * j + second),
            )
        lines["innovation"][4, :2] += second, 1.0
        t_ns = START_NS + second * NS_PER_S
        widen_noisy_rates(P, made.memory[0], lines, observation, t_ns, fit, np.zeros(10), par)
        follow_lasting_errors(m, P, made.memory[0], work, observation, RANGE_RATE, t_ns, par)
        follow_satellites(m, made.memory[0], lines, observation, t_ns, fit, np.zeros(10), par)
        adapt_noise(m, P, P, par, work, len(lines), t_ns)
        follow_explained(m, P, par, lines, fit, t_ns)
        again = counted_again(UpdateOutcome(0.0, 0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0), lines, par)
        found += [lines["status"].copy(), lines["extra"].copy(), np.array(again)]
        for kind in range(2):
            lines["status"][:, kind] = USED
            raise_level(m, P, lines, kind, fit, np.zeros(10), par)
        found += [lines["variance"].copy(), m["level_risen"].copy()]
    found += [m["weak_shown"], m["weak_rows"]]
    return [*found, m["noise_factor"], m["lasting"], m["explained"], made.memory[0, observation["slot"]]]


def repeated_rates() -> list[Any]:
    """Return what is refused of ten range rates of which some stay the same while their satellites accelerate."""
    _, lines = wrong_rows()
    made = new_bank(1, 0)
    found = []
    for second in range(8):
        value = np.zeros((1, 10, 2))
        value[0, :, 1] = np.where(np.arange(10) < 7, 3.0, 0.1 * second)
        sat = np.zeros((10, 8))
        sat[:, 3:6] = 0.2 * second
        rows = scene_rows_of([START_NS + second * NS_PER_S], sat, value)
        rows.observation["slot"] = np.arange(10) * N_BANDS
        for line in lines:
            line["status"][1], line["variance"][1] = USED, 0.01
            line["h"][1, 3:6] = line["h"][0, :3]
        refuse_repeated(made.state[0], made.memory[0], rows, 0, lines)
        found.append(lines["status"][:, 1].copy())
    return [*found, made.state["stuck_ns"], made.state["stuck_since_ns"], made.memory[0]]


def far_epoch() -> list[Any]:
    """Return what an epoch makes of a filter that an outage has carried 40 km away."""
    at = place()
    made = new_filter(at, sigmas={DR: 4e4, CLOCK: 3e3})
    log = perfect_rows(made, scene_parameters(), [START_NS + NS_PER_S], scene_sky(at))
    made.state["r_e"][0] += at.C_ne.T @ np.array([3e4, -2e4, 1e4])
    run(made, log, at_rest(at, made.state[0].C_eb, 1.0, 10.0, start_ns=START_NS), scene_parameters())
    return [made.state["r_e"], made.state["v_e"], made.state["clock"], np.diag(made.P[0])]


# The update adds and subtracts numbers of very different size (a clock variance of 1e7 m^2 after its jump), so a last
# digit of a sine may grow.
def two_headings() -> list[Any]:
    """Return what two hypotheses say of their heading and motion, and a row of a satellite that may be hidden."""
    made = bank(layout_with(n_offsets=1))
    first, second = made.state[0], made.state[1]
    first.v_e[:], first.v_mean_variance = [3.0, -1.0, 2.0], 0.01
    line = new_epoch(1, OFFSETS).lines[0]
    line.variance[:] = 1.0
    deweight(line, 0.3, 1.0, limits_of(Visibility())._replace(false_range2=3600.0, false_rate2=9.0))
    changed = velocity_changed(first, made.P[0], 25.0)
    return [heading_variance(made), turn_about(first, second), changed, line.variance, line.doubt]


CASES = [
    KernelCase("tests.kernels.filter:two_headings", rtol=1e-11),
    KernelCase("tests.kernels.filter:short_log", (False, False), rtol=1e-10, label="at epochs"),
    KernelCase("tests.kernels.filter:short_log", (True, False), rtol=1e-10, label="between"),
    # differences of a prior of 1e4 m^2 and a clock of 1e5 m^2 against rows of 1 m^2
    KernelCase("insgnss.filter.update.consistency:refuse_inconsistent", (*wrong_rows(), 0, 9.0), rtol=1e-9),
    KernelCase("insgnss.filter.update.consistency:few_are_wrong", (*wrong_rows(), 0, 9.0), rtol=1e-9),
    KernelCase("tests.kernels.filter:one_heading_with_unknown_motion", rtol=1e-10),
    # a prior of 1e9 m^2 and a clock of 1e12 m^2 against rows of 1 m^2
    KernelCase("tests.kernels.filter:far_epoch", rtol=1e-7),
    KernelCase("tests.kernels.filter:screened_samples", rtol=1e-11),
    KernelCase("tests.kernels.filter:repeated_rates"),
    KernelCase("tests.kernels.filter:crowd", (0.5,), rtol=1e-9, label="one runs away"),
    KernelCase("tests.kernels.filter:crowd", (40.0,), rtol=1e-9, label="all are noisy"),
    KernelCase("tests.kernels.filter:short_log", (False, True), rtol=1e-10, label="with carrier"),
    KernelCase("tests.kernels.filter:errors_of_the_sensors", rtol=1e-8),
    KernelCase("tests.kernels.filter:corrected_tilt", rtol=1e-11),
    KernelCase("tests.kernels.filter:lost_log", (), rtol=1e-10),
    KernelCase("tests.kernels.filter:short_log", (False, False, True), rtol=1e-10, label="with masking"),
    # what counts of a force hardly above its noise is a small difference: 1 - k^2 sigma^2 / |f|^2
    KernelCase(
        "tests.kernels.filter:short_log", (False, False, False, 3.0), rtol=1e-8, label="with motion told"
    ),
]
