"""The filter finds by how much the pseudoranges of weak signals are wrong, in metres per dB."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.filter.parameters import PARAMETERS_DTYPE
from insgnss.filter.rows.usual_variance import foreseen_variance, usual_variance
from insgnss.filter.rows.weak_signals import ASSUMED_ROWS, weak_signal_level
from insgnss.filter.state import OFFSETS, new_bank
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.integrity import explain
from insgnss.filter.update.weak_signals import follow_weak_signals
from insgnss.gnss.observation_rows import PSEUDORANGE
from insgnss.gnss.signal_weakness import weakness_db
from insgnss.status import GATED, INCONSISTENT, USED
from insgnss.tables import Float64
from tests.filter.scene import geometry

SIGMA, ASSUMED, N = 1.0, 2.0, 24
WEAKNESS = np.where(np.arange(N) % 2 == 0, 0.0, 4.0 + np.arange(N) % 9)
FORGOTTEN_S = 30.0


class Receiver:
    """24 satellites all over the sky, half of them weak, and a prior of 10 m."""

    def __init__(self) -> None:
        self.par = np.zeros(1, PARAMETERS_DTYPE)[0]
        self.par["weak_signal2"], self.par["adapt_gain"] = ASSUMED**2, 1.0 / FORGOTTEN_S
        self.m = new_bank(1, 0).state[0]
        self.P = 100.0 * np.eye(OFFSETS)
        self.work = new_epoch(N, OFFSETS)
        self.G = geometry(2.4 * np.arange(N), np.arcsin(0.1 + 0.85 * (np.arange(N) % 5) / 4.0))

    @property
    def slope(self) -> float:
        """Metres per dB."""
        return ASSUMED * math.sqrt(weak_signal_level(self.m))

    def see(
        self, error: Float64, gated: tuple[int, ...] = (), status: int = GATED, since_s: float = 1.0
    ) -> None:
        """Take an epoch with the errors (n,) of its pseudoranges [m]."""
        lines = self.work.lines
        lines["status"][:, PSEUDORANGE] = USED
        lines["status"][list(gated), PSEUDORANGE] = status
        lines["weakness"], lines["weak"] = WEAKNESS, (self.slope * WEAKNESS) ** 2
        lines["innovation"][:, PSEUDORANGE], lines["variance"][:, PSEUDORANGE] = (
            error,
            SIGMA**2 + lines["weak"],
        )
        lines["h"][:, PSEUDORANGE, :3] = self.G[:, :3]
        lines["h"][:, PSEUDORANGE, 3:7] = [0.0, 0.0, 0.0, 1.0]
        assert explain(self.P, lines, PSEUDORANGE, self.work.fit)
        follow_weak_signals(self.m, self.par, lines, self.work.fit, since_s)


def drawn(rng: np.random.Generator, slope: float) -> Float64:
    """Return errors of a sky whose weak signals are wrong by ``slope`` metres per dB."""
    return np.asarray(rng.normal(0.0, np.hypot(SIGMA, slope * WEAKNESS)))


def share_without_largest(n: int) -> float:
    """Return the mean square of n normal errors without the largest, over the n - 1 others."""
    squares = np.sort(np.random.default_rng(1).normal(size=(20_000, n)) ** 2, axis=1)
    return float(np.mean(squares[:, :-1]))


@pytest.mark.parametrize("slope", [1.0, 3.0, 6.0])
def test_metres_per_db_are_found(slope: float) -> None:
    """Within three sigmas of the mean of twelve runs: each rests on twelve rows an epoch over half a minute."""
    squares = []
    for seed in range(7100, 7112):
        receiver, rng = Receiver(), np.random.default_rng(seed)
        for _ in range(120):
            receiver.see(drawn(rng, slope))
        squares.append(receiver.slope**2)
    expected = share_without_largest(np.count_nonzero(WEAKNESS)) * slope**2
    spread = 3.0 * math.sqrt(2.0 / (12 * 12 * FORGOTTEN_S))
    assert np.mean(squares) == pytest.approx(
        expected, rel=spread + 0.05
    )  # what was assumed still counts 0.05


def test_under_an_open_sky_weak_signals_count_as_others_within_seconds() -> None:
    receiver, rng = Receiver(), np.random.default_rng(7200)
    assert receiver.slope == ASSUMED
    slopes = []
    for _ in range(30):
        receiver.see(drawn(rng, 0.0))
        slopes.append(receiver.slope)
    assert slopes[0] < 0.6 * ASSUMED
    assert slopes[4] < 0.3 * ASSUMED
    assert slopes[-1] < 0.06 * ASSUMED


def test_a_street_after_an_open_sky_is_found_though_its_rows_are_refused() -> None:
    receiver, rng = Receiver(), np.random.default_rng(7300)
    for _ in range(120):
        receiver.see(drawn(rng, 0.0))
    for _ in range(10):
        error = drawn(rng, 4.0)
        outside = 25.0 * (SIGMA**2 + (receiver.slope * WEAKNESS) ** 2)
        receiver.see(error, tuple(np.flatnonzero(error**2 > outside)))
    assert receiver.slope > 1.0


def test_one_satellite_that_is_wrong_is_no_weakness() -> None:
    """Refused or not; and one that another test has found counts as little."""
    for gated, status in (((), GATED), ((11,), GATED), ((11,), INCONSISTENT)):
        receiver, rng = Receiver(), np.random.default_rng(7400)
        for _ in range(60):
            error = drawn(rng, 0.0)
            error[11] += 40.0 if gated else 15.0
            receiver.see(error, gated, status)
        assert receiver.slope < 0.35 * ASSUMED


def test_what_was_learnt_fades_and_the_assumption_returns() -> None:
    receiver, rng = Receiver(), np.random.default_rng(7500)
    for _ in range(60):
        receiver.see(drawn(rng, 0.0))
    learnt = receiver.m.weak_rows
    receiver.see(np.zeros(N), tuple(np.flatnonzero(WEAKNESS)), INCONSISTENT, since_s=10.0 * FORGOTTEN_S)
    assert receiver.m.weak_rows == pytest.approx(learnt * math.exp(-10.0), rel=1e-9)
    assert receiver.slope == pytest.approx(ASSUMED, rel=learnt * math.exp(-10.0) / ASSUMED_ROWS)


def test_ledger_has_the_whole_variance_of_a_weak_signal_and_the_foreseen_one_of_a_rate() -> None:
    work = new_epoch(1, OFFSETS)
    line = work.lines[0]
    line["variance"], line["weak"], line["extra"], line["foreseen"] = [5.0, 3.0, 1.0], 2.0, 1.5, 0.5
    assert [foreseen_variance(line, kind) for kind in range(3)] == [5.0, 2.0, 1.0]
    assert [usual_variance(line, kind) for kind in range(3)] == [3.0, 1.5, 1.0]


def test_weakness_is_that_below_the_third_strongest_of_its_band_and_epoch() -> None:
    cn0 = np.array([50.0, 30.0, 48.0, 46.0, 44.0, 40.0, math.nan, 35.0, 45.0, 41.9])
    band = np.array([0, 0, 0, 0, 0, 1, 0, 1, 0, 0])
    first = np.array([0, 8, 8, 10])
    # band 0: the third of 50, 48, 46, 44, 30; band 1: the weaker of two; the last epoch has two of band 0
    expected = [0.0, 13.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(weakness_db(cn0, band, first), expected)
    np.testing.assert_allclose(weakness_db(cn0[:0], band[:0], np.array([0])), [])
    np.testing.assert_allclose(
        weakness_db(np.full(3, math.nan), np.zeros(3, np.int64), np.array([0, 3])), np.zeros(3)
    )


def test_weakness_does_not_depend_on_the_order_of_the_rows() -> None:
    rng = np.random.default_rng(7600)
    cn0, band, first = rng.uniform(20.0, 50.0, 40), rng.integers(0, 3, 40), np.array([0, 25, 40])
    order = np.concatenate([rng.permutation(25), 25 + rng.permutation(15)])
    np.testing.assert_allclose(
        weakness_db(cn0[order], band[order], first), weakness_db(cn0, band, first)[order]
    )
