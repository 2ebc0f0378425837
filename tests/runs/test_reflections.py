"""Reflections that stay: what satellites that are off for a whole minute do to the position is in its sigma."""

from __future__ import annotations

import numpy as np
import pandas as pd

from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.filter.output.total_sigmas import SLOW_COLUMNS
from insgnss.runs.engine import Engine
from insgnss.runs.replay import replay
from insgnss.runs.result import Run
from insgnss.runs.setup import setup_filter
from insgnss.simulation.signal_errors import Disturbance, PathErrors, SkyGeometry
from insgnss.tables import Float64
from tests.filter.test_engine import no_delay, stream
from tests.runs.scenes import disturbed

POSITION = ["n_m", "e_m", "d_m"]
N_FLIGHTS = 8
FIRST_SEED = 700


def steady(size_m: float, share: float) -> Disturbance:
    """Return pseudoranges that are off by ``size_m`` rms for the whole flight, of so many of the satellites."""

    def disturbance(sky: SkyGeometry, rng: np.random.Generator) -> PathErrors:
        n = sky.elevation.shape[-1]
        off = size_m * rng.standard_normal(n) * (rng.random(n) < share)
        code = np.broadcast_to(off, sky.elevation.shape)
        return PathErrors(code, np.zeros_like(code))

    return disturbance


def settings_of(time_s: float, **further: object) -> FilterConfig:
    """Return the library's filter without slow errors of message and air, but for ``slow_errors`` in ``further``."""
    sizes = {
        "adaptation.reflection_time_s": time_s,
        "slow_errors.satellite_m": {"G": 0.01},
        "slow_errors.ionosphere_zenith_m": 0.0,
        "slow_errors.no_ionosphere_zenith_m": 0.0,
        "slow_errors.troposphere_zenith_m": 0.0,
    }
    return filter_config(
        "tight", {**sizes, **{f"slow_errors.{key}": value for key, value in further.items()}}
    )


def flown(size_m: float, share: float, seed: int, time_s: float) -> Run:
    return replay(disturbed(steady(size_m, share), seed), settings_of(time_s))


def squares(size_m: float, share: float, time_s: float) -> Float64:
    """Return the mean square of the position's error over sigma 30, 15 and 1 s before the end."""
    found = []
    for seed in range(FIRST_SEED, FIRST_SEED + N_FLIGHTS):
        errors = flown(size_m, share, seed, time_s).errors
        assert errors is not None
        at = np.searchsorted(errors["time_s"], errors["time_s"].iloc[-1] - np.array([30.0, 15.0, 1.0]))
        d, sd = (errors[[f"{kind}{axis}" for axis in POSITION]].to_numpy()[at] for kind in ("d_", "sd_"))
        found.append((d**2 / sd**2).mean(axis=1))
    return np.asarray(np.mean(found, axis=0))


def test_reflections_of_four_in_ten_are_in_the_sigma() -> None:
    """Error over sigma is 1.9 with them, 6 without; one would be right, but gates choose what seems to agree."""
    with_them, without = squares(10.0, 0.4, 30.0), squares(10.0, 0.4, 0.0)
    assert (with_them < 6.0).all(), with_them
    assert (without > 4.0 * with_them).all(), without


def test_engine_gives_the_sigmas_of_replay_with_reflections() -> None:
    made, config = disturbed(steady(10.0, 0.4), FIRST_SEED), settings_of(30.0)
    logs = made.read()
    engine = Engine(setup_filter(made, logs, config))
    stream(engine, logs, no_delay())
    results = engine.take_results(all_of_them=True)
    live = np.array([result.out.nav[0]["slow"] for result in results if result.out.counts[0].nav == 1])
    replayed = replay(made, config).nav[list(SLOW_COLUMNS)]
    assert (replayed.max() > 2.0).all()  # m: reflections of 10 m, that would be 0.01 m without
    np.testing.assert_allclose(np.sqrt(live[:, [0, 3, 5]]), replayed, rtol=1e-6, atol=1e-9)


def test_white_noise_has_no_reflections() -> None:
    """Estimates are the same bit for bit; the sigma of the end is wider by less than a tenth."""
    with_them, without = (flown(0.0, 1.0, 900, time_s).nav for time_s in (30.0, 0.0))
    same = [
        name
        for name in without
        if not name.startswith(("sd_slow", "sd_n_", "sd_e_", "sd_d_", "sd_clock_bias"))
    ]
    pd.testing.assert_frame_equal(with_them[same], without[same], check_exact=True)
    for axis in POSITION:
        assert 1.0 <= with_them[f"sd_{axis}"].iloc[-1] / without[f"sd_{axis}"].iloc[-1] < 1.1


def test_errors_of_stated_size_are_no_reflections_beside() -> None:
    """Ranges 3 m off for the whole flight, which ``slow_errors`` state: what reflections add to the sigma is little.

    Counted both as the stated error and as a reflection they widen the northing's sigma by a tenth and more.
    """
    made = disturbed(steady(3.0, 1.0), FIRST_SEED)
    with_them, without = (
        replay(made, settings_of(time_s, satellite_m={"G": 3.0}, satellite_time_s=60.0)).nav
        for time_s in (30.0, 0.0)
    )
    wider = (with_them["sd_n_m"] / without["sd_n_m"]).iloc[-30:].mean()
    assert 1.0 <= wider < 1.05
