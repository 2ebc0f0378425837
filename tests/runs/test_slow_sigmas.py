"""``sd_slow_*`` against flights whose satellites and air really are off, alike for the whole flight."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.runs.replay import replay
from insgnss.runs.result import Run
from insgnss.runs.result_tables import LogNames
from insgnss.runs.setup import setup_filter
from insgnss.runs.slow_sigmas import COLUMNS, SlowVariances, slow_columns, slow_sigmas
from insgnss.simulation.disturbance import Disturbance, PathErrors, SkyGeometry
from insgnss.simulation.signal_errors import MessageErrors
from insgnss.tables import PreciseProducts
from tests.runs.scenes import flight, turns, with_faults

SHELL = 6_378_137.0 / (6_378_137.0 + 350_000.0)
POSITION = ["n_m", "e_m", "d_m"]
NOTHING = {
    "satellite_m": {"G": 0.0},
    "ionosphere_zenith_m": 0.0,
    "ionosphere_gradient_per_1000_km": 0.0,
    "troposphere_zenith_m": 0.0,
}


def tight17(**sizes: Any) -> FilterConfig:
    """Return the library's filter with slow errors of these sizes alone."""
    config = filter_config("tight17")
    return config.model_copy(update={"slow_errors": config.slow_errors.model_copy(update=NOTHING | sizes)})


def flown(disturbance: Disturbance, config: FilterConfig, seed: int = 3) -> Run:
    """Return the run of a minute of turns with satellites or air disturbed."""
    base = with_faults(turns(60.0))
    receiver = replace(base.scenario.receiver, disturbances=(disturbance,))
    base.scenario = replace(base.scenario, receiver=receiver)
    return replay(flight(base, seed=seed), config)


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
    config = tight17(ionosphere_zenith_m=ionosphere_m, troposphere_zenith_m=troposphere_m)
    plain = flown(air(0.0, 0.0), config)
    moved = np.abs(errors(flown(air(ionosphere_m, troposphere_m), config), "d_") - errors(plain, "d_"))
    told = errors(plain, "sd_slow_")

    assert (told[:, 2] > 0.15).all()
    # the filter remembers epochs with other weights; banked, it sees other satellites than a moment before
    assert np.allclose(moved, told, rtol=0.1, atol=0.05)


def test_satellites_clocks_move_the_position_within_sigma_and_slow_sigma() -> None:
    """Sixty flights, each with clocks of its own: the mean squared ratio of each axis is chi-square over sixty."""
    config = tight17(satellite_m={"G": 0.7})
    ratios, without = [], []
    for seed in range(60):
        run = flown(MessageErrors(0.0, 0.0, 0.0, 0.7), config, seed)
        error, sd, slow = (errors(run, prefix)[-1] for prefix in ("d_", "sd_", "sd_slow_"))
        ratios.append(error**2 / (sd**2 + slow**2))
        without.append(error**2 / sd**2)
    mean = np.mean(ratios, axis=0)
    # 0.1 and 99.9 % of chi-square with 60 degrees of freedom are 31.7 and 99.6
    assert ((mean > 31.7 / 60.0) & (mean < 99.6 / 60.0)).all(), mean
    assert (np.mean(without, axis=0) > 2.0).all()


def test_sizes_change_nothing_but_the_slow_columns() -> None:
    off = air(1.5, 0.05)
    none, default = flown(off, tight17()), flown(off, filter_config("tight17"))
    assert (none.nav[list(COLUMNS)] == 0.0).all(axis=None)
    assert (default.nav[list(COLUMNS)] > 0.1).all(axis=None)
    rest = default.nav.columns.difference(COLUMNS)
    pd.testing.assert_frame_equal(none.nav[rest], default.nav[rest], check_exact=True)
    pd.testing.assert_frame_equal(none.measurements, default.measurements, check_exact=True)


def test_total_is_root_of_the_sum_of_squares(tmp_path: Path) -> None:
    run = flown(air(1.5, 0.05), filter_config("tight17"))
    run.save(tmp_path)
    summary = Run.load(tmp_path).error_summary(from_s=-np.inf)
    d, sd, slow = (errors(run, prefix)[:, 2] for prefix in ("d_", "sd_", "sd_slow_"))
    assert summary["rms_over_total"]["d_m"] == pytest.approx(np.sqrt(np.mean(d**2 / (sd**2 + slow**2))))
    assert summary["rms_over_sigma"]["d_m"] == pytest.approx(np.sqrt(np.mean(d**2 / sd**2)))
    assert summary["rms_over_total"]["vn_mps"] == pytest.approx(
        summary["rms_over_sigma"]["vn_mps"], rel=1e-12
    )


def test_sizes_follow_models_products_and_base() -> None:
    logs = flight(turns(60.0)).read()
    setup = setup_filter(flight(turns(60.0)), logs, filter_config("tight17"))
    names = LogNames(("G05", "E11", "R07", "X01"), ("C1C",))
    sizes = setup.config.slow_errors

    def of(ionosphere: str, **changes: Any) -> Any:
        use = setup.config.measurements.model_copy(update={"ionosphere": ionosphere})
        config = setup.config.model_copy(update={"measurements": use})
        return slow_sigmas(replace(setup, config=config, **changes), names)

    klobuchar = of("klobuchar")
    assert klobuchar.satellite_m.tolist() == [0.5, 0.3, 2.0, 3.0]  # of an unknown system the largest
    assert klobuchar.ionosphere_m == of("nequick").ionosphere_m == sizes.ionosphere_zenith_m
    assert of("klobuchar", navigation=None).ionosphere_m == of("none").ionosphere_m == 5.0
    assert klobuchar.gradient_m == pytest.approx(0.6 * 1.5)
    free = of("ionosphere_free")
    assert free.ionosphere_m == free.gradient_m == 0.0 and free.troposphere_m == 0.05
    corrected = of("klobuchar", with_base=True)
    assert corrected.satellite_m[0] == pytest.approx(0.05) and corrected.ionosphere_m == pytest.approx(0.15)
    no_times = np.zeros(0, np.int64)
    empty = np.zeros((0, 0))
    products = PreciseProducts((), no_times, np.zeros((0, 0, 3)), no_times, empty)
    assert of("klobuchar", products=products).satellite_m.tolist() == [0.05] * 4


def test_rows_before_the_first_epoch_take_its_sigma_and_none_without_an_epoch() -> None:
    found = SlowVariances(np.array([10, 20]), np.array([[1.0, 4.0, 9.0], [16.0, 25.0, 36.0]]))
    columns = slow_columns(found, np.array([5, 10, 19, 20, 99]))
    assert np.column_stack([columns[name] for name in COLUMNS])[:, 0].tolist() == [1.0, 1.0, 1.0, 4.0, 4.0]
    nothing = slow_columns(SlowVariances(np.zeros(0, np.int64), np.zeros((0, 3))), np.array([5, 10]))
    assert all(np.isnan(values).all() for values in nothing.values())
