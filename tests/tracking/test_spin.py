"""The spinning vehicle: amplitudes and limits, and loops closed with and without the axial gyro."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.errors import ConfigError
from insgnss.tracking.aiding_source import aid_from
from insgnss.tracking.channels import ChannelDesign, ChannelHistory, ChannelSimulation, scene
from insgnss.tracking.lock_and_cn0 import slip_time_s
from insgnss.tracking.loop_filters import continuous_gains, digital_filter, filter_from_continuous
from insgnss.tracking.spin import (
    Spin,
    continuous_error_response,
    frequency_limit_hz,
    loop_error_rad,
    spin_limit_hz,
    spin_source,
)

F0 = 1602e6
T = 1e-3


def test_swing_of_the_phase_centre() -> None:
    # recalculated independently of this project, at 1602 MHz
    assert [Spin(r, 15.0, F0).amplitude_rad for r in (0.05, 0.08, 0.10)] == pytest.approx(
        [1.68, 2.69, 3.36], abs=5e-3
    )
    spin = Spin(0.08, 15.0, F0)
    assert (spin.doppler_hz, spin.speed_mps) == (pytest.approx(40.3, abs=0.05), pytest.approx(7.5, abs=0.05))
    assert spin.acceleration_radps2 == pytest.approx(2.4e4, rel=0.01)
    assert Spin(0.08, 15.0, F0, theta_rad=0.0).amplitude_rad == 0.0  # along the axis nothing swings


@pytest.mark.parametrize(("radius", "limit"), [(0.05, 4.4), (0.08, 3.3), (0.10, 2.9)])
def test_loop_of_twenty_hertz_stays_below_an_eighth_of_a_turn_up_to_its_limit(
    radius: float, limit: float
) -> None:
    K = continuous_gains(2, 20.0)
    found = spin_limit_hz(radius, F0, K)
    assert found == pytest.approx(limit, abs=0.05)
    assert Spin(radius, 1.0, F0).amplitude_rad * abs(continuous_error_response(K, found)) == pytest.approx(
        math.pi / 4
    )


def test_residual_of_the_compensation_does_not_depend_on_the_spin_rate() -> None:
    five = math.radians(5.0)
    assert [Spin(r, 15.0, F0).residual_rad(five) for r in (0.05, 0.10)] == pytest.approx(
        [0.15, 0.29], abs=5e-3
    )
    assert Spin(0.08, 50.0, F0).residual_rad(five) == Spin(0.08, 1.0, F0).residual_rad(five)


@pytest.mark.parametrize(("radius", "integration"), [(0.05, 0.010), (0.10, 0.005)])
def test_frequency_loop_ends_where_the_doppler_reaches_its_range(radius: float, integration: float) -> None:
    assert frequency_limit_hz(radius, F0, integration) == pytest.approx(14.9, abs=0.02)


def test_digital_loop_answers_the_spin_as_the_continuous_one() -> None:
    spin, K = Spin(0.05, 3.0, F0), continuous_gains(2, 20.0)
    continuous = spin.amplitude_rad * abs(continuous_error_response(K, 3.0))
    assert loop_error_rad(spin, filter_from_continuous(K, 1e-5)) == pytest.approx(continuous, rel=2e-3)


def gyro_sources(spin: Spin, seconds: float, angle_error_rad: float, scale: float = 0.0):  # type: ignore[no-untyped-def]
    """Return the compensation by an axial gyro of 1 kHz with an error of the start angle and a scale factor error."""
    t = np.arange(0.0, seconds + 2e-3, T)
    rate = np.full(len(t), 2.0 * math.pi * spin.rate_hz * (1.0 + scale))
    return [spin_source(spin, t, rate, spin.start_rad + angle_error_rad)]


def loops(spin: Spin, seconds: float, sources: list | None, bandwidth: float = 20.0) -> ChannelHistory:  # type: ignore[type-arg]
    n = round(seconds / T)
    phase = spin.phase_rad(T * np.arange(n + 1))
    of = ChannelDesign(digital_filter(2, bandwidth, T), digital_filter(1, 1.0, T), 50.0, "atan")
    wide = np.repeat(phase[:, None], 8, 1)
    aid = None if sources is None else aid_from([sources] * 8, n, T)
    return ChannelSimulation(of, scene(wide, 50.0), aid).run(2)


def swing_of(errors: np.ndarray, spin: Spin) -> float:
    """Return the amplitude of the errors at the spin rate."""
    t = (np.arange(len(errors)) + 0.5) * T
    turn = np.exp(-2j * np.pi * spin.rate_hz * t)
    return float(2.0 * abs(np.mean(errors.mean(axis=1) * turn)))


def test_slow_spin_leaves_the_linear_error_in_a_closed_loop() -> None:
    spin = Spin(0.05, 2.0, F0)
    found = loops(spin, 5.0, None).phase_error_rad[1000:]
    expected = loop_error_rad(spin, digital_filter(2, 20.0, T))
    assert expected < math.pi / 8
    assert swing_of(found, spin) == pytest.approx(expected, rel=0.03)  # atan is straight there


@pytest.mark.parametrize("rate_hz", [8.0, 15.0, 25.0])
def test_fast_spin_is_lost_without_the_gyro_and_held_with_it(rate_hz: float) -> None:
    spin = Spin(0.10, rate_hz, F0, start_rad=0.4)
    lost = loops(spin, 3.0, None)
    assert np.all(np.abs(lost.prompt.real[1000:]).mean(axis=0) < 0.8 * np.abs(lost.prompt[1000:]).max())
    outside = np.abs(lost.phase_error_rad[500:]) > math.pi / 2
    assert np.all(outside.any(axis=0))  # beyond the unstable point
    held = loops(spin, 3.0, gyro_sources(spin, 3.0, math.radians(5.0)))
    assert not np.any(np.isfinite(slip_time_s(held.phase_error_rad, T, math.pi)))
    assert np.max(np.abs(held.phase_error_rad[500:])) < math.pi / 4


@pytest.mark.parametrize("rate_hz", [15.0, 40.0])
def test_compensated_loop_has_the_residual_of_its_angle_error(rate_hz: float) -> None:
    spin, error = Spin(0.08, rate_hz, F0), math.radians(5.0)
    found = loops(spin, 4.0, gyro_sources(spin, 4.0, error), bandwidth=5.0).phase_error_rad[1000:]
    residual = spin.residual_rad(error)
    expected = loop_error_rad(spin, digital_filter(2, 5.0, T), residual)
    # steps of 1 ms of 40 Hz: (w T)^2 / 6 = 1 % of the swing of 2.7 rad, across the residual of 0.23 rad: 0.6 % of it
    assert swing_of(found, spin) == pytest.approx(expected, rel=0.05)
    assert expected == pytest.approx(residual, rel=0.15)  # the narrow loop hardly touches it


def test_scale_factor_error_of_the_gyro_runs_the_angle_off() -> None:
    # 0.1 % at 15 Hz: 5.4 deg each second; after 3 s the residual is three times that of 5 deg
    spin = Spin(0.08, 15.0, F0)
    found = loops(spin, 4.0, gyro_sources(spin, 4.0, 0.0, 1e-3), 5.0).phase_error_rad
    early, late = np.std(found[300:700]), np.std(found[-400:])
    assert late > 4.0 * early


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Spin(-0.1, 15.0, F0), "above 0"),
        (lambda: Spin(0.1, 15.0, F0, theta_rad=90.0), "radians"),
        (lambda: spin_source(Spin(0.1, 15.0, F0), np.arange(5.0), np.zeros(4), 0.0), "4 rates at 5"),
        (lambda: spin_limit_hz(0.01, F0, continuous_gains(2, 20.0)), "no limit"),
    ],
)
def test_senseless_spins_are_refused(make: object, word: str) -> None:
    with pytest.raises(ConfigError, match=word):
        make()  # type: ignore[operator]
