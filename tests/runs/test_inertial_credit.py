"""Inertial samples in a wrong unit or along wrong axes: after a few failures the filter follows the satellites."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from insgnss.config.library import filter_config
from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.health import FilterHealth, Remedy
from insgnss.filter.diagnosis.inertial_credit import NEVER_NS, InertialCredit
from insgnss.filter.engine import FilterEngine
from insgnss.log.flight import FlightInMemory
from insgnss.runs.replay import replay
from insgnss.runs.result import Run
from insgnss.runs.setup import setup_filter
from insgnss.simulation.sample_trajectories import airborne_turns
from insgnss.simulation.simulated_log import SimulatedLog, Simulator
from insgnss.tables import Float64, ImuTable
from tests.filter.test_engine import assert_same_bits, no_delay, stream
from tests.runs.scenes import START_NS, START_S, after, flight, ratios, rows_where, simulator

DURATION_S = 460.0  # five minutes after a failure sensors are tried again
SWAPPED = [1, 0, 2]
Spoil = Callable[[Float64, Float64], tuple[Float64, Float64]]
WRONG: dict[str, Spoil] = {
    "half of the rate": lambda w, f: (0.5 * w, f),
    "rates of the other sign": lambda w, f: (-w, f),
    "axes of the gyros": lambda w, f: (w[:, SWAPPED], f),
    "axes of both": lambda w, f: (w[:, SWAPPED], f[:, SWAPPED]),
    "accelerations in g": lambda w, f: (w, f / 9.80665),
}


@cache
def truth() -> Simulator:
    return simulator(airborne_turns(DURATION_S), DURATION_S, imu_rate_hz=50.0)


@cache
def drawn() -> SimulatedLog:
    return truth().draw(np.random.default_rng(11))


def spoilt(which: str, to_s: float, *, from_s: float = 0.0, end_s: float = DURATION_S) -> FlightInMemory:
    """Return the flight up to ``end_s`` with its samples spoilt from one time to another."""
    imu, end_ns = drawn().imu, START_NS + round(end_s * NS_PER_S)
    n = int(np.searchsorted(imu.t_ns, end_ns))
    imu = ImuTable(imu.t_ns[:n], imu.w_ib_b[:n], imu.f_b[:n])
    t_s = (imu.t_ns - imu.t_ns[0]) * 1e-9
    there = ((t_s >= from_s) & (t_s <= to_s))[:, None]
    w, f = WRONG[which](imu.w_ib_b, imu.f_b)
    samples = ImuTable(imu.t_ns, np.where(there, w, imu.w_ib_b), np.where(there, f, imu.f_b))
    return flight(truth(), drawn(), imu=samples, gnss=rows_where(drawn().gnss, drawn().gnss.t_ns < end_ns))


def distrusted(run: Run) -> pd.DataFrame:
    return run.events[run.events["kind"] == "imu_distrusted"]


# axes of both: the sensors that recover had them
@pytest.mark.parametrize("which", [which for which in WRONG if which != "axes of both"])
def test_wrong_samples_end_in_a_solution_that_follows_the_satellites(which: str) -> None:
    """From ten seconds after the event on all errors are within 5 sigma; without it positions 0.1 to 10 km off."""
    run = replay(spoilt(which, 185.0, end_s=185.0))
    lost = distrusted(run)
    assert len(lost) == 1
    assert "insgnss check" in lost["detail"].iloc[0]
    later = after(run, lost["time_s"].iloc[0] - START_S + 10.0)
    assert len(later) > 100
    assert ratios(later).to_numpy().max() < 5.0
    assert (
        later[[f"sd_{axis}" for axis in ("n_m", "e_m", "d_m")]].to_numpy().max() < 6.0
    )  # m: 11 pseudoranges


def test_sensors_that_recover_are_trusted_again() -> None:
    """Axes are swapped for a minute: five minutes after the last failure the filter restarts and finds its attitude."""
    run = replay(spoilt("axes of both", 120.0, from_s=60.0))
    (lost_s,) = distrusted(run)["time_s"]
    restarts = run.events[run.events["kind"] == "restart"]
    (again_s,) = restarts["time_s"][restarts["detail"].str.contains("tried again")]
    assert 300.0 <= again_s - lost_s <= 302.0
    later = after(run, again_s - START_S + 40.0)
    assert ratios(later).to_numpy().max() < 5.0
    assert later["sd_yaw_deg"].max() < 0.5


def test_engine_gives_the_bits_of_replay_while_the_sensors_are_distrusted() -> None:
    flown, config = spoilt("axes of both", 90.0, from_s=30.0, end_s=90.0), filter_config("tight")
    logs = flown.read()
    engine = FilterEngine(setup_filter(flown, logs, config))
    stream(engine, logs, no_delay())
    assert_same_bits(engine.take_results(all_of_them=True), logs, flown)
    assert "imu_distrusted" in {event.kind for event in engine.events}


def test_second_look_that_restarts_the_filter_does_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """It left the same filter in place, and the reset went on instead."""
    monkeypatch.setattr(
        FilterHealth, "_second_look", lambda health, bank, *rest: Remedy(bank, [], "second look")
    )
    run = replay(spoilt("rates of the other sign", 60.0, end_s=60.0))
    restarts = run.events.loc[run.events["kind"] == "restart", "detail"]
    assert restarts.str.startswith("second look").any()
    assert "reset" not in set(run.events["kind"])


def test_vibration_that_comes_and_goes_doubles_no_wait() -> None:
    credit = InertialCredit()
    for t_s in (0, 100, 200):
        credit.found_noise(t_s * NS_PER_S, 1e4, False)
        credit.trust_again((t_s + 60) * NS_PER_S)
    assert (credit.excess, credit.wait_s, credit.look_ns) == (0.0, 300.0, NEVER_NS)


def test_a_single_fault_is_no_reason_to_distrust_a_sensor() -> None:
    credit = InertialCredit()
    losses = [credit.is_lost_by_jump(round(t_s * NS_PER_S), 1e-4, 1e-8) for t_s in (0.0, 12.0, 200.0)]
    losses.append(credit.is_lost_by_jump(round(301.0 * NS_PER_S), 1e-4, 1e-8))  # the first has gone by then
    assert not any(losses)
    assert credit.excess == 0.0


def test_noise_explains_the_largest_failure() -> None:
    """1 m/s within 10 s is what 1/30 m^2/s^3 does, 0.01 rad/s for 10 s what 1e-3/3 rad^2/s does to an angle."""
    par = SimpleNamespace(accel_density=1e-6)
    credit = InertialCredit()
    for t_s, dv2 in ((0.0, 0.25), (1.0, 1.0), (2.0, 0.01)):
        assert not credit.is_lost_by_reset(round(t_s * NS_PER_S), dv2, par)
    assert credit.is_lost_by_jump(3 * NS_PER_S, 0.0, 1e-8)
    np.testing.assert_allclose(credit.excess, 1.0 / 30.0 / 1e-6)
    assert credit.is_lost_by_jump(4 * NS_PER_S, 1e-4, 1e-9)
    np.testing.assert_allclose(credit.excess, 1e-3 / 3.0 / 1e-9)
    assert not credit.is_lost_by_jump(5 * NS_PER_S, 1e-5, 1e-9)


def test_after_a_new_trial_one_failure_is_enough_and_the_wait_doubles() -> None:
    credit = InertialCredit()
    for t_s in range(4):
        credit.is_lost_by_jump(t_s * NS_PER_S, 1e-4, 1e-8)
    assert credit.retry_ns == 303 * NS_PER_S
    assert not credit.is_lost_by_jump(302 * NS_PER_S, 0.0, 1e-8)  # no more noise, but a longer wait
    assert credit.retry_ns == 602 * NS_PER_S
    credit.try_again(credit.retry_ns)
    assert (credit.excess, credit.retry_ns) == (0.0, NEVER_NS)
    assert credit.is_lost_by_jump(700 * NS_PER_S, 0.0, 1e-8)
    assert credit.retry_ns == 1300 * NS_PER_S
    np.testing.assert_allclose(credit.excess, 1e-3 / 3.0 / 1e-8)
