"""Frequency loops on their own: design, stability, noise, what they follow, and a spinning antenna."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import pytest

from insgnss.constants import C_MPS
from insgnss.errors import ConfigError
from insgnss.tables import Float64
from insgnss.tracking.aiding_source import AidingSource, aid_from
from insgnss.tracking.channels import (
    ChannelDesign,
    ChannelHistory,
    ChannelSimulation,
    InitialLoopErrors,
    scene,
)
from insgnss.tracking.frequency_loop import (
    FrequencyLoop,
    frequency_filter,
)
from insgnss.tracking.loop_filters import LoopFilter, digital_filter
from insgnss.tracking.spin import Spin, spin_source
from insgnss.tracking.trial import assess

T: Final = 5e-3
CARRIER_HZ: Final = 1602e6
CHANNELS: Final = 4


def run(
    loop: FrequencyLoop,
    phase_rad: Float64,
    cn0_dbhz: float = 40.0,
    start_radps: float | None = None,
    sources: list[AidingSource] | None = None,
) -> ChannelHistory:
    """Return four channels on one phase (n + 1,)."""
    n = len(phase_rad) - 1
    design = ChannelDesign(loop, digital_filter(1, 1.0, loop.step_s), cn0_dbhz, frequency_kind="atan")
    aid = None if sources is None else aid_from([sources] * CHANNELS, n, loop.step_s)
    wide = np.repeat(phase_rad[:, None], CHANNELS, axis=1)
    return ChannelSimulation(
        design, scene(wide, cn0_dbhz), aid, InitialLoopErrors(rate_radps=start_radps)
    ).run(1)


@pytest.mark.parametrize(("order", "bt"), [(1, 0.01), (1, 0.2), (1, 0.45), (2, 0.01), (2, 0.3), (2, 1.5)])
def test_bandwidth_is_that_of_the_response(order: int, bt: float) -> None:
    loop = frequency_filter(order, bt / T, T)
    f = (np.arange(40_000) + 0.5) / 40_000 * 0.5 / T

    assert loop.noise_bandwidth_hz() == pytest.approx(bt / T, rel=1e-9)
    assert np.sum(np.abs(loop.response(f)) ** 2) * (f[1] - f[0]) == pytest.approx(bt / T, rel=1e-3)


@pytest.mark.parametrize(("order", "limit"), [(1, 0.5), (2, 2.5)])
def test_too_large_a_bandwidth_is_refused_with_its_limit(order: int, limit: float) -> None:
    assert frequency_filter(order, 0.99 * limit / T, T).chain.is_stable()
    with pytest.raises(ConfigError, match=f"{limit:g}"):
        frequency_filter(order, 1.01 * limit / T, T)


@pytest.mark.parametrize(("order", "bandwidth_hz"), [(1, 2.5), (1, 30.0), (2, 4.0), (2, 60.0)])
def test_noise_of_a_closed_loop_is_that_of_the_linear_theory(order: int, bandwidth_hz: float) -> None:
    loop = frequency_filter(order, bandwidth_hz, T)
    found = run(loop, np.zeros(8001), 55.0).rate_error_radps[1000:]

    P = loop.rate_covariance(1.0 / (2.0 * 10.0**5.5 * T))
    # the channel's frequency stands half a step beyond the middle of the turn that the chain predicts
    ahead = np.array([1.0, 0.5 * T])[:order]
    wanted = math.sqrt(float(ahead @ P @ ahead))
    assert np.std(found) == pytest.approx(wanted, rel=0.03)


def test_slow_loop_takes_most_of_its_noise_back() -> None:
    loop, variance = frequency_filter(1, 2.5, T), 0.01
    white = 2.0 * variance / T**2 * 2.0 * T * loop.noise_bandwidth_hz()
    g = loop.chain.gains[0]

    # closed form of a first-order recursion that differenced white noise drives: the share g of the white one
    assert loop.rate_covariance(variance)[0, 0] == pytest.approx(g * white, rel=1e-9)


def test_first_order_lags_behind_a_drift_and_second_order_does_not() -> None:
    t, drift = np.arange(2001) * T, 40.0
    phase = np.asarray(0.5 * drift * t**2)
    first, second = frequency_filter(1, 5.0, T), frequency_filter(2, 5.0, T)

    lag = run(first, phase, 75.0, 0.0).rate_error_radps[1000:].mean()
    none = run(second, phase, 75.0, 0.0).rate_error_radps[1000:].mean()
    # the observed turn is complete half a step before the middle of the integration
    assert lag == pytest.approx(-drift * T * (1.0 / first.chain.gains[0] + 0.5), rel=0.005)
    assert none == pytest.approx(0.0, abs=0.02)


def test_loop_with_data_pulls_in_below_a_quarter_of_1_over_t_and_not_above() -> None:
    loop, still = frequency_filter(1, 5.0, T), np.zeros(1001)
    quarter = 0.5 * math.pi / T

    pulled = run(loop, still, 60.0, 0.9 * quarter).rate_error_radps[-200:].mean()
    lost = run(loop, still, 60.0, 1.1 * quarter).rate_error_radps[-200:].mean()
    assert pulled == pytest.approx(0.0, abs=1.0)
    assert lost == pytest.approx(2.0 * quarter, abs=1.0)  # half a turn in each integration looks like data


# Computed independently of this project: antenna 5 cm from the axis, 40 dBHz, gyro angle wrong by 5 deg, a narrow loop;
# rms of the frequency as range rate [m/s] without and with compensation
@pytest.mark.parametrize(
    ("spin_hz", "plain", "compensated"),
    [(2.5, 0.49, 0.053), (5.0, 1.11, 0.103), (10.0, 2.29, 0.21), (14.0, 3.2, 0.30)],
)
def test_axial_gyro_takes_nine_tenths_of_the_spin_out_of_a_frequency_loop(
    spin_hz: float, plain: float, compensated: float
) -> None:
    spin, seconds = Spin(0.05, spin_hz, CARRIER_HZ, start_rad=0.3), 40.0
    loop = frequency_filter(1, 2.5, T)  # the narrow loop that has all eight numbers
    phase = spin.phase_rad(np.arange(round(seconds / T) + 1) * T)
    t = np.arange(0.0, seconds + 4.0 * T, 1e-3)
    gyro = spin_source(spin, t, np.full(len(t), 2.0 * math.pi * spin_hz), 0.3 + math.radians(5.0))
    per_radps = C_MPS / (2.0 * math.pi * CARRIER_HZ)

    found = [np.std(run(loop, phase, sources=s).rate_error_radps[2000:]) * per_radps for s in (None, [gyro])]
    assert found == pytest.approx([plain, compensated], rel=0.025)
    assert 9.0 < found[0] / found[1] < 11.0


def test_design_needs_a_frequency_discriminator() -> None:
    with pytest.raises(ConfigError, match="incomplete"):
        ChannelDesign(frequency_filter(1, 2.5, T), digital_filter(1, 1.0, T), 40.0)


def test_phase_of_a_frequency_loop_is_not_assessed() -> None:
    design = ChannelDesign(
        frequency_filter(1, 2.5, T), digital_filter(1, 1.0, T), 40.0, frequency_kind="cross"
    )
    simulation = ChannelSimulation(design, scene(np.zeros((101, 1)), 40.0))

    with pytest.raises(ConfigError, match="no phase error"):
        assess(simulation, simulation.run(1))


@pytest.mark.parametrize(
    ("make", "key"),
    [
        (lambda: frequency_filter(3, 1.0, T), "order"),
        (lambda: frequency_filter(0, 1.0, T), "order"),
        (lambda: frequency_filter(1, math.nan, T), "bandwidth_hz"),
        (lambda: frequency_filter(1, 1.0, 0.0), "step_s"),
        (lambda: frequency_filter(1, 1.0, T).rate_covariance(-1.0), "phase_variance"),
        (lambda: FrequencyLoop(LoopFilter(np.array([2.5]), np.zeros(1), T)), "chain"),
        (lambda: FrequencyLoop(LoopFilter(np.array([0.1, 0.1]), np.array([0.0, 0.1]), T)), "chain"),
    ],
)
def test_loops_that_make_no_sense_are_refused(make: object, key: str) -> None:
    with pytest.raises(ConfigError) as refused:
        make()  # type: ignore[operator]

    assert refused.value.key == key
    assert refused.value.advice
