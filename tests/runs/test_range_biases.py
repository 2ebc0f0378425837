"""Range errors that last for an hour: with a state each, the sigma of the position is its whole error."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest

import insgnss
from insgnss.config.library import filter_config
from insgnss.constants import NS_PER_S
from insgnss.filter.setup import LIVE_SATELLITES
from insgnss.filter.whole_log import run_filter
from insgnss.log.flight import FlightInMemory
from insgnss.runs.engine import Engine
from insgnss.runs.setup import setup_filter
from insgnss.tables import ImuTable
from tests.benchmarks.trust.flying import drawn
from tests.benchmarks.trust.motions import scenario, straight
from tests.benchmarks.trust.rows import Row
from tests.filter.test_engine import no_delay, stream
from tests.statistics_bounds import mean_chi_square_bounds

SETTINGS = {"process.range_bias_states": True}
POSITION = ("n_m", "e_m", "d_m")
SEEDS = range(700, 708)
LASTING = """rate_hz = 0.5
air_errors = { ionosphere_m = 1.5, troposphere_m = 0.05, correlation_time_s = 3600.0 }
ephemeris_errors = { radial_m = 0.2, along_m = 0.5, cross_m = 0.5, clock_m = 0.43 }"""


def row(carrier: bool) -> Row:
    name = f"lasting{carrier}"
    text = scenario(name, straight(450.0), rate_hz=10.0, carrier=carrier, gnss=LASTING)
    return Row(name, name, text, (), "industrial", start="given", looks={"end": 448.0})


@cache
def flights(carrier: bool) -> list[FlightInMemory]:
    return [drawn(row(carrier), seed)[2] for seed in SEEDS]


@cache
def runs(carrier: bool, *, states: bool, smooth: bool = False) -> list[insgnss.Run]:
    settings = SETTINGS if states else {}
    return [insgnss.replay(flight, settings=settings, smooth=smooth) for flight in flights(carrier)]


def mean_squares(found: list[insgnss.Run], noise_alone: bool = False) -> np.ndarray:
    """Return the mean over the runs of the squared error over sigma at the end, north, east, down.

    ``noise_alone`` leaves the slow errors out of sigma.
    """
    last = pd.DataFrame([run.errors.iloc[-1] for run in found])
    error, sigma = (last[[f"{kind}_{n}" for n in POSITION]].to_numpy() for kind in ("d", "sd"))
    slow = last[[f"sd_slow_{n}" for n in POSITION]].to_numpy() if noise_alone else 0.0
    return np.asarray((error**2 / (sigma**2 - slow**2)).mean(axis=0))


@pytest.mark.parametrize("carrier", [False, True])
def test_position_is_as_good_as_it_claims(carrier: bool) -> None:
    low, high = mean_chi_square_bounds(1, len(SEEDS), 0.9999)
    found = mean_squares(runs(carrier, states=True))
    assert (found < high).all()
    assert found.mean() > low
    followed = runs(carrier, states=False)
    assert (mean_squares(followed) < high).all()
    assert mean_squares(followed, noise_alone=True)[2] > high  # the height


def test_innovations_are_as_they_were() -> None:
    """What lasts is in position, clock and biases alike: it is not in an innovation."""
    with_states, without = (
        np.mean([run.nis_summary()["mean_nis"].iloc[0] for run in runs(False, states=states)])
        for states in (True, False)
    )
    assert with_states == pytest.approx(without, abs=0.03)


def test_slow_errors_are_not_told_twice() -> None:
    run = runs(False, states=True)[0]
    assert "sd_slow_n_m" not in run.nav
    assert "ionosphere_m" in run.nav
    summary = run.error_summary()
    np.testing.assert_allclose(summary["rms_over_noise"], summary["rms_over_sigma"])


def test_smoother_keeps_them() -> None:
    """The whole log tells more of the position than its past; the sigma stays what the errors leave."""
    smoothed, filtered = runs(False, states=True, smooth=True), runs(False, states=True)
    low, high = mean_chi_square_bounds(1, len(SEEDS), 0.9999)
    found = mean_squares(smoothed)
    assert (found < high).all()
    assert found.mean() > low
    sigma = [np.mean([run.nav["sd_d_m"].iloc[100:].mean() for run in each]) for each in (smoothed, filtered)]
    assert 0.5 * sigma[1] < sigma[0] < 1.01 * sigma[1]


def test_streaming_engine_has_them_too() -> None:
    """It does not know how many satellites will come, and has more states than the log needs."""
    flight = flights(False)[0]
    logs = flight.read()
    seen = logs.imu.t_ns <= logs.imu.t_ns[0] + 120 * NS_PER_S
    imu = ImuTable(logs.imu.t_ns[seen], logs.imu.w_ib_b[seen], logs.imu.f_b[seen])
    logs = replace(logs, imu=imu, gnss=logs.gnss.take(np.flatnonzero(logs.gnss.t_ns <= imu.t_ns[-1])))
    setup = setup_filter(flight, logs, filter_config("tight", SETTINGS))
    engine = Engine(replace(setup, n_satellites=LIVE_SATELLITES))
    stream(engine, logs, no_delay())
    live = [r.out.nav[0] for r in engine.take_results(all_of_them=True) if r.out.counts[0].nav == 1]
    out, _ = run_filter(setup, logs.imu, setup.rows(logs.gnss, setup.navigation), "gnss")
    whole = out.nav[: out.counts[0].nav]
    assert len(live) == len(whole) > 50
    np.testing.assert_allclose([each["value"] for each in live], whole["value"], rtol=1e-7, atol=1e-8)
