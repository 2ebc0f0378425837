"""Range errors that last, in ``sd_*``: flights whose satellites and air really are off, alike for the whole flight."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.config.slow_errors import NO_SLOW_ERRORS, SlowErrorSizes
from insgnss.filter.output.total_sigmas import SLOW_COLUMNS
from insgnss.runs.engine import Engine
from insgnss.runs.replay import replay
from insgnss.runs.result import Run
from insgnss.runs.setup import setup_filter
from insgnss.simulation.signal_errors import Disturbance, MessageErrors, PathErrors, SkyGeometry
from insgnss.tables import PreciseProducts
from tests.filter.test_engine import no_delay, stream
from tests.runs.scenes import disturbed, flight, rows_where, turns
from tests.statistics_bounds import mean_chi_square_bounds

SHELL = 6_378_137.0 / (6_378_137.0 + 350_000.0)
POSITION = ["n_m", "e_m", "d_m"]
SIGMAS = ["sd_n_m", "sd_e_m", "sd_d_m", "sd_clock_bias_m"]
FOREVER = {"air_time_s": 1e7, "satellite_time_s": 1e7}
N_FLIGHTS = 30


def tight17(**sizes: Any) -> FilterConfig:
    """Return the library's filter with slow errors of these sizes alone."""
    config = filter_config("tight17", {"adaptation.reflection_time_s": 0.0, "process.imu_time_sigma_s": 0.0})
    return config.model_copy(update={"slow_errors": NO_SLOW_ERRORS.model_copy(update=sizes)})


def flown(disturbance: Disturbance, config: FilterConfig, seed: int = 3) -> Run:
    """Return the run of such a flight."""
    return replay(disturbed(disturbance, seed), config)


def errors(run: Run, prefix: str) -> np.ndarray:
    assert run.errors is not None
    return run.errors[[f"{prefix}{name}" for name in POSITION]].to_numpy()


def air(ionosphere_m: float, troposphere_m: float) -> Disturbance:
    """Return what delays at the zenith do to the code of every satellite of a flight on L1."""

    def disturbance(sky: SkyGeometry, _: np.random.Generator) -> PathErrors:
        slant = 1.0 / np.cos(np.arcsin(SHELL * np.cos(sky.elevation)))
        delay = ionosphere_m * slant + troposphere_m / np.sin(sky.elevation)
        return PathErrors(delay, delay)

    return disturbance


@pytest.mark.parametrize(("ionosphere_m", "troposphere_m"), [(1.5, 0.0), (0.0, 0.1)])
def test_air_moves_the_position_by_its_sigma(ionosphere_m: float, troposphere_m: float) -> None:
    """An error of one sigma moves the estimate by `sd_slow_*`, at each epoch."""
    sizes = {"ionosphere_zenith_m": ionosphere_m, "troposphere_zenith_m": troposphere_m}
    config = tight17(**sizes, **FOREVER)
    plain = flown(air(0.0, 0.0), config)
    moved = np.abs(errors(flown(air(ionosphere_m, troposphere_m), config), "d_") - errors(plain, "d_"))
    told = errors(plain, "sd_slow_")

    assert (told[1:, 2] > 0.15).all()  # the first row is the start itself
    # what the errors do to velocity and attitude is left out
    assert np.allclose(moved[5:], told[5:], rtol=0.01, atol=0.01)


@pytest.mark.parametrize("outage", [False, True])
def test_clocks_of_satellites_move_the_position_by_its_sigma(outage: bool) -> None:
    """Thirty flights, each with clocks of its own, and with the last third of its epochs or without."""
    config = tight17(satellite_m={"G": 0.7})
    ratios, without = [], []
    for seed in range(N_FLIGHTS):
        made = disturbed(MessageErrors(0.0, 0.0, 0.0, 0.7), seed)
        if outage:
            gnss = made.read().gnss
            kept = rows_where(gnss, gnss.t_ns < gnss.t_ns[0] + 40_000_000_000)
            made = disturbed(MessageErrors(0.0, 0.0, 0.0, 0.7), seed, gnss=kept)
        run = replay(made, config, output=1.0)
        error, sd, slow = (errors(run, prefix)[-1] for prefix in ("d_", "sd_", "sd_slow_"))
        ratios.append(error**2 / sd**2)
        without.append(error**2 / (sd**2 - slow**2))
    low, high = mean_chi_square_bounds(1, N_FLIGHTS, 0.999)
    mean = np.mean(ratios, axis=0)
    assert ((mean > low) & (mean < high)).all(), mean
    assert outage or (np.mean(without, axis=0) > high).all()


def test_sizes_change_nothing_but_sigmas() -> None:
    off = air(1.5, 0.05)
    none, default = flown(off, tight17()), flown(off, tight17(ionosphere_zenith_m=1.5))
    assert (none.nav[list(SLOW_COLUMNS)] == 0.0).all(axis=None)
    assert (default.nav[list(SLOW_COLUMNS)].iloc[5:] > 0.01).all(axis=None)
    rest = default.nav.columns.difference([*SLOW_COLUMNS, *SIGMAS])
    pd.testing.assert_frame_equal(none.nav[rest], default.nav[rest], check_exact=True)
    pd.testing.assert_frame_equal(none.measurements, default.measurements, check_exact=True)
    for axis in "ned":
        total = default.nav[f"sd_{axis}_m"] ** 2
        share = default.nav[f"sd_slow_{axis}_m"] ** 2
        np.testing.assert_allclose(none.nav[f"sd_{axis}_m"] ** 2, total - share, rtol=1e-9)
    assert (default.nav["sd_clock_bias_m"] > none.nav["sd_clock_bias_m"]).iloc[1:].all()


def test_summary_tells_the_ratio_with_and_without_them(tmp_path: Path) -> None:
    run = flown(air(1.5, 0.05), tight17(ionosphere_zenith_m=1.5))
    run.save(tmp_path)
    summary = Run.load(tmp_path).error_summary(from_s=-np.inf)
    d, sd, slow = (errors(run, prefix)[:, 2] for prefix in ("d_", "sd_", "sd_slow_"))
    assert summary["rms_over_noise"]["d_m"] == pytest.approx(np.sqrt(np.mean(d**2 / (sd**2 - slow**2))))
    assert summary["rms_over_sigma"]["d_m"] == pytest.approx(np.sqrt(np.mean(d**2 / sd**2)))
    assert summary["rms_over_noise"]["vn_mps"] == pytest.approx(
        summary["rms_over_sigma"]["vn_mps"], rel=1e-12
    )


def test_covariance_and_points_hold_them() -> None:
    run = replay(
        disturbed(air(0.0, 0.0)),
        tight17(ionosphere_zenith_m=1.5, satellite_m={"G": 0.5}),
        point=(1.0, 0.0, 0.0),
        covariance=True,
    )
    for axis in "ned":
        np.testing.assert_allclose(run.nav[f"cov_{axis}_{axis}_m2"], run.nav[f"sd_{axis}_m"] ** 2, rtol=1e-9)
        assert (run.nav[f"sd_point_{axis}_m"] > run.nav[f"sd_slow_{axis}_m"]).all()
    correlation = run.nav["cov_n_d_m2"] / (run.nav["sd_n_m"] * run.nav["sd_d_m"])
    assert (correlation.abs() <= 1.0).all()


def test_aiding_predicts_what_the_receiver_measures() -> None:
    """The ranges that it predicts have the slow errors as the state has: its sigmas stay."""
    sizes = {"ionosphere_zenith_m": 1.5, "satellite_m": {"G": 0.5}}
    told = [replay(disturbed(air(0.0, 0.0)), tight17(**chosen), aiding=1.0).aiding for chosen in ({}, sizes)]
    assert told[0] is not None and told[1] is not None
    pd.testing.assert_frame_equal(told[0], told[1])


def test_engine_has_them_live() -> None:
    made = disturbed(air(0.0, 0.0))
    logs, config = made.read(), tight17(ionosphere_zenith_m=1.5, satellite_m={"G": 0.5})
    engine = Engine(setup_filter(made, logs, config))
    stream(engine, logs, no_delay())
    results = engine.take_results(all_of_them=True)
    live = [result.out.nav[0]["slow"] for result in results if result.out.counts[0].nav == 1]
    run = replay(made, config)
    np.testing.assert_allclose(
        np.sqrt(np.array(live)[:, [0, 3, 5]]), run.nav[list(SLOW_COLUMNS)], rtol=1e-6, atol=1e-9
    )
    newest = engine.state.values
    assert newest["sd_slow_d_m"] > 0.1
    assert newest["sd_d_m"] > newest["sd_slow_d_m"]


def test_smoothed_rows_hold_the_share_of_their_time() -> None:
    made, config = disturbed(air(0.0, 0.0)), tight17(ionosphere_zenith_m=1.5)
    filtered, smoothed = (replay(made, config, smooth=smooth) for smooth in (False, True))
    pd.testing.assert_frame_equal(filtered.nav[list(SLOW_COLUMNS)], smoothed.nav[list(SLOW_COLUMNS)])
    assert (smoothed.nav["sd_d_m"] > smoothed.nav["sd_slow_d_m"]).all()
    assert (smoothed.nav["sd_d_m"] <= filtered.nav["sd_d_m"] * 1.001).all()


def test_flight_tells_its_own_sizes_unless_the_filter_is_changed() -> None:
    made = disturbed(air(0.0, 0.0))
    of_log = SlowErrorSizes(ionosphere_zenith_m=4.0)
    gnss = made.config.gnss.model_copy(update={"slow_errors": of_log})
    made = replace(made, config=made.config.model_copy(update={"gnss": gnss}))
    logs = made.read()
    assert setup_filter(made, logs, filter_config("tight17")).slow_sizes.ionosphere == 4.0
    changed = filter_config("tight17", {"slow_errors.ionosphere_zenith_m": 2.0})
    assert setup_filter(made, logs, changed).slow_sizes.ionosphere == 2.0
    gnss = made.config.gnss.model_copy(update={"slow_errors": None})
    made = replace(made, config=made.config.model_copy(update={"gnss": gnss}))
    assert setup_filter(made, logs, filter_config("tight17")).slow_sizes.ionosphere == 1.5


def test_sizes_follow_models_products_and_base() -> None:
    logs = flight(turns(60.0)).read()
    default = filter_config(
        "tight17", {"slow_errors.with_base_share": 0.1001}
    )  # no default: the filter's count
    setup = setup_filter(flight(turns(60.0)), logs, default)
    sizes = setup.config.slow_errors

    def of(ionosphere: str, **changes: Any) -> Any:
        use = setup.config.measurements.model_copy(update={"ionosphere": ionosphere})
        config = setup.config.model_copy(update={"measurements": use})
        return replace(setup, config=config, **changes)

    klobuchar = of("klobuchar").slow_sizes
    assert [klobuchar.satellite[letter] for letter in "GERS"] == [0.5, 0.3, 2.0, 3.0]
    assert klobuchar.ionosphere == of("nequick").slow_sizes.ionosphere == sizes.ionosphere_zenith_m
    without = of("klobuchar", navigation=None).slow_sizes
    assert without.ionosphere == of("none").slow_sizes.ionosphere == 5.0
    par = of("klobuchar").parameters()[0]
    assert par.slow_gradient == pytest.approx(0.6 * 1.5)
    free = of("ionosphere_free").parameters()[0]
    assert free.slow_ionosphere == free.slow_gradient == 0.0
    assert free.slow_troposphere == 0.05
    corrected = of("klobuchar", with_base=True).slow_sizes
    assert corrected.satellite["G"] == pytest.approx(0.05, rel=0.01)
    assert corrected.ionosphere == pytest.approx(0.15, rel=0.01)
    no_times = np.zeros(0, np.int64)
    products = PreciseProducts((), no_times, np.zeros((0, 0, 3)), no_times, np.zeros((0, 0)))
    assert set(of("klobuchar", products=products).slow_sizes.satellite.values()) == {0.05}
