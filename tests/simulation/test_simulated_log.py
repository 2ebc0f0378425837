"""A simulated flight in memory: logs, truth and repeatability."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest

from insgnss.constants import C_MPS
from insgnss.simulation.oscillator import MILLISECOND_M
from insgnss.simulation.sample_flight import TACTICAL, TCXO, sample_scenario
from insgnss.simulation.simulated_log import ClockStart, Scenario, SimulatedLog, Simulator, simulate
from insgnss.tables import GnssTable


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return Simulator(sample_scenario(120.0))


def same(a: GnssTable, b: GnssTable) -> bool:
    return all(
        np.array_equal(getattr(a, f.name), getattr(b, f.name), equal_nan=True)
        for f in fields(GnssTable)
        if isinstance(getattr(a, f.name), np.ndarray) and getattr(a, f.name).dtype.kind == "f"
    )


def draw(simulator: Simulator, seed: int) -> SimulatedLog:
    return simulator.draw(np.random.default_rng(seed))


def test_the_same_seed_gives_the_same_log_and_another_seed_another(simulator: Simulator) -> None:
    a, b, c = draw(simulator, 1), draw(simulator, 1), draw(simulator, 2)
    again = simulate(sample_scenario(120.0), np.random.default_rng(1))
    for other in (b, again):
        assert np.array_equal(a.imu.f_b, other.imu.f_b) and same(a.gnss, other.gnss)
        assert np.array_equal(a.at_gnss.gyro_bias, other.at_gnss.gyro_bias)
    assert not np.array_equal(a.imu.f_b, c.imu.f_b) and not same(a.gnss, c.gnss)


def test_without_a_generator_the_logs_are_the_truth(simulator: Simulator) -> None:
    log = simulator.draw(None)
    assert np.array_equal(log.imu.w_ib_b, simulator.rate_b)
    assert np.all(log.at_imu.accel_bias == 0.0)
    assert log.clock.bias_m == pytest.approx(0.3e-3 * C_MPS + 50.0 * (log.clock.tag_s - 1.0))


def test_tables_and_truth_share_their_times(simulator: Simulator) -> None:
    log, start = draw(simulator, 3), simulator.scenario.start_ns
    assert len(log.imu.t_ns) == 12_000
    assert np.array_equal(log.imu.t_ns, log.at_imu.t_ns)
    assert np.all(np.diff(log.imu.t_ns) == 10_000_000)
    assert np.array_equal(np.unique(log.gnss.t_ns), log.at_gnss.t_ns)
    assert log.at_gnss.t_ns[0] == start + 1_000_000_000
    row = np.searchsorted(log.at_imu.t_ns, log.at_gnss.t_ns)
    for name in ("r_e", "v_e", "C_eb", "gyro_bias", "accel_bias"):
        assert getattr(log.at_gnss, name) == pytest.approx(getattr(log.at_imu, name)[row], abs=1e-9), name


def test_sensor_errors_are_bias_noise_and_scale(simulator: Simulator) -> None:
    log = draw(simulator, 4)
    left = log.imu.f_b - simulator.force_b * (1.0 + log.accel_scale_factor) - log.at_imu.accel_bias
    assert np.std(left) == pytest.approx(0.06 / 60.0 * 10.0, rel=0.03)
    left = log.imu.w_ib_b - simulator.rate_b * (1.0 + log.gyro_scale_factor) - log.at_imu.gyro_bias
    assert np.std(left) == pytest.approx(np.deg2rad(0.1) / 60.0 * 10.0, rel=0.03)


def test_a_further_draw_is_made(simulator: Simulator, benchmark: Callable[..., SimulatedLog]) -> None:
    log = benchmark(draw, simulator, 1)  # two minutes at 100 Hz: 7 ms
    assert len(log.imu.t_ns) > 0


def scenario(**changes: object) -> Scenario:
    base = sample_scenario(60.0)
    return replace(base, **changes)  # type: ignore[arg-type]


def test_rates_that_do_not_divide_a_second_keep_true_times() -> None:
    log = simulate(scenario(imu_rate_hz=128.0), np.random.default_rng(0))
    assert len(log.imu.t_ns) == 60 * 128
    assert log.imu.t_ns[127] - scenario().start_ns == 1_000_000_000


def test_gnss_epochs_may_lie_between_imu_samples() -> None:
    base = scenario()
    log = simulate(
        replace(base, receiver=replace(base.receiver, first_tag_s=0.5037, rate_hz=5.0)),
        np.random.default_rng(0),
    )
    assert log.at_gnss.t_ns[0] - base.start_ns == 503_700_000
    assert len(log.at_gnss.t_ns) == 298


def test_clock_jumps_reach_clock_and_pseudoranges() -> None:
    jumping = scenario(clock=ClockStart(jumps=((30.0, MILLISECOND_M),)))
    a, b = (simulate(s, np.random.default_rng(5)) for s in (scenario(clock=ClockStart()), jumping))
    late = a.gnss.t_ns >= a.at_gnss.t_ns[29]
    step = b.gnss.pseudorange_m - a.gnss.pseudorange_m
    assert step[~late] == pytest.approx(0.0, abs=1e-6)
    assert step[late] == pytest.approx(
        MILLISECOND_M, abs=1.0
    )  # the satellite moves on by up to 0.8 m in a millisecond
    assert b.clock.bias_m[29] - a.clock.bias_m[29] == pytest.approx(MILLISECOND_M)


def test_resolution_makes_counts() -> None:
    log = simulate(scenario(gyro_resolution_rad=1e-6, accel_resolution_mps=1e-4), np.random.default_rng(0))
    for values, resolution in ((log.imu.w_ib_b, 1e-6), (log.imu.f_b, 1e-4)):
        counts = values * 0.01 / resolution
        assert counts == pytest.approx(np.rint(counts), abs=1e-5)


def test_the_scenario_is_that_of_the_sample_flight() -> None:
    assert scenario().grade is TACTICAL and scenario().oscillator is TCXO
