"""The fix of one epoch, for start and recovery: the point solution with the filter's rows."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.config.library import filter_config
from insgnss.filter.parameters import Parameters
from insgnss.filter.setup import FilterSetup
from insgnss.filter.start.fix import fix_epoch
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.log.flight import Flight
from insgnss.runs.point import read_logs, solve_rows
from insgnss.runs.setup import setup_filter
from insgnss.status import USED
from tests.conftest import REPOSITORY

EPOCH, MAX_GDOP = 40, 12.0


@pytest.fixture(scope="module")
def sample() -> tuple[FilterSetup, GnssRows, Parameters]:
    """Return setup, rows and parameters of the sample flight."""
    flight = Flight.load(REPOSITORY / "data" / "sample_flight" / "flight.toml")
    logs = read_logs(flight)
    setup = setup_filter(flight, logs, filter_config("tight"), several=False)
    return setup, setup.rows(logs.gnss, setup.navigation), setup.parameters()[0]


def changed(rows: GnssRows, kind: int, at: int, by: float) -> GnssRows:
    """Return rows with one value of an epoch's usable ones off."""
    observation = rows.observation.copy()
    usable = rows.first[EPOCH] + np.flatnonzero(
        observation["status"][rows.first[EPOCH] : rows.first[EPOCH + 1], kind] == USED
    )
    observation["value"][usable[at], kind] += by
    return rows._replace(observation=observation)


def test_fix_is_the_point_solution_of_the_epoch(sample: tuple[FilterSetup, GnssRows, Parameters]) -> None:
    setup, rows, par = sample
    _, _, out = solve_rows(setup, rows)
    for epoch in range(0, 200, 20):
        fix = fix_epoch(rows, epoch, par, setup.ties, MAX_GDOP)
        assert fix is not None and fix.checked and fix.v_a is not None
        np.testing.assert_array_equal(fix.r_a, out.r_e[epoch])
        np.testing.assert_array_equal(fix.v_a, out.v_e[epoch])
        np.testing.assert_array_equal(fix.clocks, out.clock_m[epoch])
        np.testing.assert_allclose(fix.P, out.P[epoch], rtol=1e-12)
        np.testing.assert_allclose(fix.P_v, out.P_v[epoch], rtol=1e-12)
        first, last = rows.first[epoch], rows.first[epoch + 1]
        np.testing.assert_array_equal(fix.used.T & fix.tried.T, fix.used.T)
        np.testing.assert_array_equal(fix.used.T, fix.tried.T & (out.status[first:last] == USED))


def test_scatter_that_passes_the_test_widens_the_covariance(
    sample: tuple[FilterSetup, GnssRows, Parameters],
) -> None:
    setup, rows, par = sample
    good = fix_epoch(rows, EPOCH, par, setup.ties, MAX_GDOP)
    _, _, out = solve_rows(setup, rows)
    rough_rows = rows
    for at, sigma in enumerate(out.sigma[rows.first[EPOCH] : rows.first[EPOCH + 1], PSEUDORANGE]):
        rough_rows = changed(rough_rows, PSEUDORANGE, at, (1.3 if at % 2 else -1.3) * float(sigma))
    rough = fix_epoch(rough_rows, EPOCH, par, setup.ties, MAX_GDOP)
    assert good is not None and rough is not None
    assert rough.used[PSEUDORANGE].sum() == good.used[PSEUDORANGE].sum()
    assert np.trace(rough.P) > 1.2 * np.trace(good.P)


@pytest.mark.parametrize(("kind", "per_db"), [(PSEUDORANGE, 2.0), (RANGE_RATE, 0.2)])
def test_weak_signal_has_a_larger_sigma_unless_the_log_states_one(
    sample: tuple[FilterSetup, GnssRows, Parameters], kind: int, per_db: float
) -> None:
    setup, rows, _ = sample
    row, weakness = int(rows.first[EPOCH]) + 2, 10.0
    for stated, added in ((math.nan, per_db * weakness), (0.3, 0.0)):
        observation = rows.observation.copy()
        observation["sigma"][:, kind], observation["weakness"] = stated, 0.0
        strong = solve_rows(setup, rows._replace(observation=observation))[2].sigma[row, kind]
        observation["weakness"][row] = weakness
        weak = solve_rows(setup, rows._replace(observation=observation))[2].sigma[row, kind]
        assert weak**2 - strong**2 == pytest.approx(added**2, rel=1e-6)


@pytest.mark.parametrize(("kind", "by"), [(PSEUDORANGE, 900.0), (PSEUDORANGE, -5e4), (RANGE_RATE, 30.0)])
def test_false_row_is_left_out_of_the_fix(
    sample: tuple[FilterSetup, GnssRows, Parameters], kind: int, by: float
) -> None:
    setup, rows, par = sample
    good = fix_epoch(rows, EPOCH, par, setup.ties, MAX_GDOP)
    fix = fix_epoch(changed(rows, kind, 2, by), EPOCH, par, setup.ties, MAX_GDOP)
    assert good is not None and fix is not None and fix.checked
    lost = good.used & ~fix.used
    assert lost[kind].sum() == 1 and lost.sum() == 1
    assert np.linalg.norm(fix.r_a - good.r_a) < 10.0


def test_dilution_beyond_the_limit_gives_no_fix(sample: tuple[FilterSetup, GnssRows, Parameters]) -> None:
    setup, rows, par = sample
    _, _, out = solve_rows(setup, rows)
    gdop = float(out.dop[EPOCH, 0])
    assert fix_epoch(rows, EPOCH, par, setup.ties, 1.01 * gdop) is not None
    assert fix_epoch(rows, EPOCH, par, setup.ties, 0.99 * gdop) is None
