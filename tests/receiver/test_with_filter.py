"""D of every satellite against the filter itself: an independent H about its covariance, and its own ledger."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from insgnss.aiding.satellite_arcs import broadcast_arcs
from insgnss.aiding.table import AidingSetup
from insgnss.aiding.trace import FilterTrace, TraceSamples, traced
from insgnss.config.aiding import AidingConfig
from insgnss.constants import C_MPS, NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.filter.loop import ImuSamples
from insgnss.filter.navigator import Navigator
from insgnss.filter.output.trace_rows import new_trace_room
from insgnss.filter.output.writing import Output, new_output
from insgnss.filter.state import BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI
from insgnss.gnss.observation_rows import prepare_rows
from insgnss.gnss.orbits.ephemeris_choice import broadcast_messages
from insgnss.inertial.clock_model import clock_model
from insgnss.inertial.sensor_model import sensor_model
from insgnss.receiver import Outlook, SupervisionSetup, outlook
from insgnss.receiver.sources import epoch_samples
from insgnss.simulation.constellation import satellite_states
from insgnss.simulation.simulated_log import SimulatedLog
from insgnss.tables import Float64, Int64
from tests.runs.matched_runs import (
    CLOCK_TYPE,
    GRADE,
    LEVER_ARM_B,
    matched_setup,
    matched_simulator,
    opened_bank,
)
from tests.runs.scenes import START_NS, paper_sky

LAST_EPOCH = 60
OMEGA_E = np.array([0.0, 0.0, WGS84_OMEGA_RADPS])


@dataclass(frozen=True)
class FilterRun:
    log: SimulatedLog
    out: Output
    found: FilterTrace
    epoch_ns: Int64
    view: Outlook


@cache
def filter_run() -> FilterRun:
    """Return a run through turns, state and covariance before the update of each epoch, and the outlook."""
    rng = np.random.default_rng(7)
    log, setup = matched_simulator().draw(rng), matched_setup()
    signals = dict(setup.config.measurements.signals)
    rows = prepare_rows(log.gnss, setup.navigation, None, clock_groups=setup.clock_groups, signals=signals)
    samples_ns, epoch_ns = epoch_samples(log.imu.t_ns, rows.epoch_ns[1:LAST_EPOCH])
    room = new_trace_room(samples_ns, 10.0, LAST_EPOCH, 0, samples_ns)
    out = new_output(rows, len(rows.epoch_ns), 64, np.zeros(0, np.int64), 0, room)
    imu = ImuSamples(log.imu.t_ns, log.imu.w_ib_b, log.imu.f_b)
    navigator = Navigator(setup)
    navigator.bank = opened_bank(log, rng)
    navigator.started_ns = int(log.at_gnss.t_ns[0])
    navigator.run(imu, rows, 1, LAST_EPOCH, out)
    found = traced(out.trace, TraceSamples(*imu[:3]))
    config = AidingConfig(signals={"G": "C1C"}, slope_samples=1)
    aiding = AidingSetup(config, sensor_model(GRADE), clock_model(CLOCK_TYPE), LEVER_ARM_B, troposphere=False)
    satellites = broadcast_arcs(
        broadcast_messages(paper_sky()), {"G": "C1C"}, START_NS, START_NS + 120 * NS_PER_S
    )
    view = outlook(SupervisionSetup(aiding), satellites, found, epoch_ns)
    return FilterRun(log, out, found, epoch_ns, view)


def rows_of_h(run: FilterRun, k: int) -> tuple[Float64, Float64]:
    """Return the rows of H (11, 17) of range and range rate at a row of the trace, from the simulation's satellites.

    In axes of ECEF at reception: R = r + C l, V = v + omega x r + C (w x l); u towards the satellite where it was
    sent from, W = V_s - V; rho' = u.W, d rho'/dR = (u (u.W) - W) / rho, d rho'/dV = -u, and the clock as it is.
    """
    trace, imu = run.found.trace, run.found.samples
    r, v, C = trace.r_e[k], trace.v_e[k], trace.C_eb[k]
    i, l_b = trace.sample[k], np.array(LEVER_ARM_B)
    # the angular rate at the instant: half an interval on from the mean over the last
    w = 1.5 * imu.w_ib_b[i] - 0.5 * imu.w_ib_b[i - 1] - trace.b_g[k]
    R, V = r + C @ l_b, v + np.cross(OMEGA_E, r) + C @ np.cross(w, l_b)
    t_s, eph = (trace.t_ns[k] - START_NS) / NS_PER_S, paper_sky().ephemerides
    rho = np.full(len(eph.sv_names), 2.2e7)
    for _ in range(5):
        sent = satellite_states(eph, START_NS, (t_s - rho / C_MPS)[None])
        turn = WGS84_OMEGA_RADPS * rho / C_MPS
        R_s = _turned(sent.r_e[0], turn)
        rho = np.linalg.norm(R_s - R, axis=1)
    V_s = _turned(sent.v_e[0] + np.cross(OMEGA_E, sent.r_e[0]), turn)
    u, W = (R_s - R) / rho[:, None], V_s - V
    g = (u * np.sum(u * W, axis=1)[:, None] - W) / rho[:, None]
    h, h_rate = np.zeros((2, len(rho), OFFSETS))
    # an attitude error psi moves C a by psi x a: b . (psi x a) = psi . (a x b)
    h[:, DR : DR + 3], h[:, PSI : PSI + 3], h[:, CLOCK] = -u, np.cross(C @ l_b, -u), 1.0
    h_rate[:, DR : DR + 3] = g + np.cross(-u, OMEGA_E)  # -u . (omega x dr)
    h_rate[:, DV : DV + 3], h_rate[:, DRIFT] = -u, 1.0
    h_rate[:, PSI : PSI + 3] = np.cross(C @ l_b, g) + np.cross(C @ np.cross(w, l_b), -u)
    # an error of the bias, estimate minus truth, is one of the rate with the other sign: -u . C (-db x l)
    h_rate[:, BG : BG + 3] = np.cross(l_b, u @ C)
    return h, h_rate


def _turned(vectors: Float64, angle: Float64) -> Float64:
    """Return vectors (s, 3) in the axes that the Earth has turned to by ``angle`` (s,)."""
    c, s, (x, y, z) = np.cos(angle), np.sin(angle), vectors.T
    return np.column_stack([c * x + s * y, c * y - s * x, z])


def columns(run: FilterRun) -> list[int]:
    """Return the place of each satellite of the messages in the outlook."""
    return [run.view.sv_names.index(name) for name in paper_sky().ephemerides.sv_names]


def test_trace_has_a_covariance_just_before_the_update_of_each_epoch() -> None:
    run = filter_run()

    # the receiver's tags stand at inertial samples here
    np.testing.assert_array_equal(run.found.trace.t_ns, run.epoch_ns)
    np.testing.assert_array_equal(run.found.covariances.t_ns, run.epoch_ns)


@pytest.mark.parametrize("kind", [0, 1], ids=["range", "range_rate"])
def test_d_is_h_p_h_of_an_independent_h_about_the_filters_covariance(kind: int) -> None:
    run = filter_run()
    predicted = run.view.predicted
    found = (predicted.d_range_m2, predicted.d_rate_m2ps2)[kind][:, columns(run)]
    for k in range(len(run.epoch_ns)):
        h = rows_of_h(run, k)[kind]
        expected = np.einsum("si,ij,sj->s", h, run.found.covariances.P[k, :OFFSETS, :OFFSETS], h)
        np.testing.assert_allclose(found[k], expected, rtol=1e-9)


@pytest.mark.parametrize("kind", [0, 1], ids=["range", "range_rate"])
def test_d_is_what_the_filter_itself_wrote_into_its_ledger(kind: int) -> None:
    run = filter_run()
    epoch, sv = run.log.gnss.t_ns, run.log.gnss.sv
    names = run.log.gnss.sv_names
    rows = np.flatnonzero(np.isin(epoch, run.epoch_ns) & np.isfinite(run.out.ledger["predicted"][:, kind]))
    place = np.array([run.view.sv_names.index(names[i]) for i in sv[rows]])
    predicted = run.view.predicted
    found = (predicted.d_range_m2, predicted.d_rate_m2ps2)[kind]

    assert len(rows) > 11 * 50
    # the ledger has single precision; for the lever arm's velocity the filter takes the mean rate of the last interval
    expected = run.out.ledger["predicted"][rows, kind]
    at = np.searchsorted(run.epoch_ns, epoch[rows]), place
    np.testing.assert_allclose(found[at], expected, rtol=(1e-6, 3e-4)[kind])
