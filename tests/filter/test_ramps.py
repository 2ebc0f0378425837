"""What the rows of a satellite that is left out are worth: a ramp fits them, noise does not."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.filter.diagnosis.ramps import Ramp, WrittenRows, ramp_evidence, ramps
from insgnss.filter.diagnosis.witnesses import EpochLog
from insgnss.filter.output.writing import CARRIER_LEDGER_DTYPE, LEDGER_DTYPE
from insgnss.filter.parameters import PARAMETERS_DTYPE
from insgnss.gnss.observation_rows import N_BANDS, PSEUDORANGE, RANGE_RATE
from insgnss.tables import Float64

SATELLITES = 8
LIAR = 3
SIGMA = (2.0, 0.1)
EPOCHS = 30


def written(rng: np.random.Generator, rate_mps: float, noise: float, moved: Float64) -> list[EpochLog]:
    """Return what a filter wrote whose velocity and drift are off by ``moved`` (4,), one satellite running away."""
    azimuth, elevation = (
        2.0 * np.pi * np.arange(SATELLITES) / SATELLITES,
        np.radians([20.0, 60.0] * (SATELLITES // 2)),
    )
    u_n = np.column_stack(
        (np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), -np.sin(elevation))
    )
    G = np.column_stack((-u_n, np.ones(SATELLITES)))
    epochs = []
    for k in range(EPOCHS):
        ledger = np.zeros(SATELLITES, LEDGER_DTYPE)
        ledger["u_n"] = u_n
        for kind, ramp in ((PSEUDORANGE, rate_mps * k), (RANGE_RATE, rate_mps)):
            own = np.ones(SATELLITES)
            own[LIAR] = noise
            y = own * SIGMA[kind] * rng.normal(size=SATELLITES) + (G @ moved if kind == RANGE_RATE else 0.0)
            y[LIAR] += ramp
            ledger["innovation"][:, kind] = y
            ledger["variance"][:, kind] = 1.01 * SIGMA[kind] ** 2
            ledger["predicted"][:, kind] = 0.01 * SIGMA[kind] ** 2
        slot = np.arange(SATELLITES) * N_BANDS
        epochs.append(EpochLog(k * 1_000_000_000, slot, ledger, np.zeros(0, CARRIER_LEDGER_DTYPE)))
    return epochs


def of_liar(rate_mps: float, noise: float = 1.0) -> tuple[Ramp, float]:
    """Return the liar's ramp as the filter without it shows it, and what evidence of one they are."""
    par = np.zeros(1, PARAMETERS_DTYPE)
    par["kind"]["gate2"] = 16.0
    moved = np.array([0.3, -0.2, 0.1, 0.4])  # what leaving it out changes of the state
    base, without = (written(np.random.default_rng(5), rate_mps, noise, x) for x in (moved, 0.0 * moved))
    rows = WrittenRows(without)
    (found,) = ramps(WrittenRows(base), rows, (LIAR,), par[0])
    return found, ramp_evidence(rows, LIAR, par[0])


def test_ramp_is_found_with_its_rate_whatever_the_state_was_before() -> None:
    found, evidence = of_liar(0.4)
    # 30 rates of 0.1 m/s give 0.02 m/s
    assert found.rate_mps == pytest.approx(0.4, abs=0.06)
    assert evidence > 100.0


def test_noise_is_no_ramp() -> None:
    """Its chance rate grows with its own square, not with the number of rows."""
    _, of_noise = of_liar(0.0, noise=5.0)
    _, of_ramp = of_liar(0.5)
    assert of_noise < 0.1 * of_ramp


def test_rows_that_fit_pay_for_a_ramp() -> None:
    """The Occam factor: rows of a sound satellite are worth less as those of a ramp than as they are."""
    _, evidence = of_liar(0.0)
    assert evidence < 0.0
