"""Inertial samples far noisier than their grade: vibration, folded by sampling or not, and a grade that is too good."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

import insgnss
from insgnss.config.library import filter_config
from insgnss.filter.engine import FilterEngine
from insgnss.log.flight import FlightInMemory
from insgnss.runs.result import Run
from insgnss.runs.setup import setup_filter
from tests.filter.test_engine import assert_same_bits, no_delay, stream
from tests.runs.scenes import START_S, assert_honest, assert_sound, flight, kinds, turns
from tests.sensors.scenes import city_car, flown

FROM_S = 50.0
# amplitudes of gyros [deg/s] and accelerometers [m/s^2], frequency that is left [Hz], time until which it lasts [s]
SHAKES = {
    "gyros": (60.0, 0.0, None, 60.0),
    "accelerometers": (0.0, 20.0, None, 60.0),
    "both, for half a minute": (5.0, 2.0, None, 80.0),
    "folded to 0.2 Hz": (3.0, 2.0, 0.2, 80.0),
}


def shaken(
    flown: FlightInMemory, amplitudes: tuple[float, float], hz: float | None, from_s: float, to_s: float
) -> FlightInMemory:
    """Return a flight with vibration in its samples: of a random phase in each, or folded to ``hz``."""
    rng, imu = np.random.default_rng(5), flown.logs.imu
    t_s = (imu.t_ns - imu.t_ns[0]) * 1e-9
    there = (t_s > from_s) & (t_s < to_s)
    w, f = imu.w_ib_b.copy(), imu.f_b.copy()
    for values, amplitude in ((w, np.radians(amplitudes[0])), (f, amplitudes[1])):
        phase = rng.uniform(0.0, 2.0 * np.pi, (int(there.sum()), 3))
        if hz is not None:
            phase = phase[0] + 2.0 * np.pi * hz * t_s[there, None]
        values[there] += amplitude * np.sin(phase)
    imu = dataclasses.replace(imu, w_ib_b=w, f_b=f)
    return dataclasses.replace(flown, logs=dataclasses.replace(flown.logs, imu=imu))


def found_s(run: Run) -> float:
    """Return when the noise was found [s], before anything was reset."""
    assert "reset" not in kinds(run)
    (found,) = run.events.loc[run.events["kind"] == "imu_distrusted", "time_s"]
    return float(found) - START_S


def shaken_turns(which: str) -> FlightInMemory:
    *amplitudes, hz, to_s = SHAKES[which]
    return shaken(sound(), (amplitudes[0], amplitudes[1]), hz, FROM_S, to_s)


@cache
def sound() -> FlightInMemory:
    return flight(turns(130.0), seed=23)


@pytest.mark.parametrize("which", list(SHAKES))
def test_vibration_is_found_within_seconds_and_the_sigmas_hold_from_then_on(which: str) -> None:
    """Resets, biases that had jumped and drifting satellites explained it before: 26 to 160 m, 100 to 600 sigma."""
    flown = shaken_turns(which)
    run = insgnss.replay(flown)
    assert_sound(run, flown)
    at_s = found_s(run)
    assert FROM_S < at_s <= FROM_S + 15.0
    assert_honest(run, at_s + 2.0, sigmas=8.0)
    assert "restart" not in kinds(run)


def test_noise_of_the_grade_counts_again_when_the_vibration_is_over() -> None:
    run = insgnss.replay(shaken_turns("gyros"))
    assert kinds(run).count("imu_trusted") == 1
    usual = insgnss.replay(sound())
    for name in ("sd_yaw_deg", "sd_roll_deg", "sd_vn_mps"):
        assert run.nav[name].iloc[-1] < 1.5 * usual.nav[name].iloc[-1]


def test_grade_that_is_thirty_times_too_good_is_found() -> None:
    """White noise of 3.5 deg/s and 1.4 m/s^2 in each sample of a tactical sensor: up to 64 m, 98 sigma of yaw.

    As its attitude was found by such samples, the filter restarts.
    """
    run = insgnss.replay(shaken(flight(turns(), seed=24), (5.0, 2.0), None, 0.0, np.inf))
    assert_honest(run, found_s(run) + 2.0, sigmas=8.0)


def test_vibration_of_a_car_is_not_blamed_on_its_satellites() -> None:
    """Six of eight were left out as drifting away. Multipath that lasts makes 7.2 sigma of the sound drive, too."""
    run = insgnss.replay(shaken(flown(city_car(), 23), (5.0, 2.0), None, FROM_S, 80.0))
    assert "satellite_suspect" not in kinds(run)
    assert_honest(run, found_s(run) + 2.0, sigmas=10.0)


def test_engine_gives_the_bits_of_replay_with_more_noise_and_after_it() -> None:
    flown, config = shaken_turns("gyros"), filter_config("tight")
    logs = flown.read()
    engine = FilterEngine(setup_filter(flown, logs, config))
    stream(engine, logs, no_delay())
    assert_same_bits(engine.take_results(all_of_them=True), logs, flown)
    assert {"imu_distrusted", "imu_trusted"} <= {event.kind for event in engine.events}
