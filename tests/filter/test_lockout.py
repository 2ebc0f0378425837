"""Steps of the clock read off what the gates refused: which rows count as witnesses, and what absorbing one leaves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from insgnss.filter.diagnosis.lockout import ClockStep, apply_clock_step, clock_steps
from insgnss.filter.rows.lines import LINE_DTYPE, Lines
from insgnss.filter.state import CLOCK, DR, DRIFT, OFFSETS, Bank, new_bank
from insgnss.filter.update.predictions import RANGE_COLUMNS, RATE_COLUMNS
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE
from insgnss.status import GATED, SWITCHED_OFF, USED
from insgnss.tables import Float64, Int16

GATE2 = (25.0, 25.0)
RANGE_SIGMA_M, RATE_SIGMA_MPS = 1.0, 0.05
FLOOR_M = 3.0  # what a step leaves at least
LEVER_B = np.array([0.5, 0.2, -1.0])


class Seen(NamedTuple):
    """What one satellite shows."""

    sv: int
    range_m: float
    range_status: int = GATED
    rate_mps: float = 0.0
    rate_status: int = USED


def lines_of(rows: list[Seen]) -> tuple[Lines, Int16]:
    """Return the lines of satellites in different directions, and which satellite each is of."""
    lines = np.zeros(len(rows), LINE_DTYPE)
    for line, row in zip(lines, rows, strict=True):
        u = np.random.default_rng(row.sv).normal(size=3)
        u /= np.linalg.norm(u)
        for kind, columns, own in ((PSEUDORANGE, RANGE_COLUMNS, DR), (RANGE_RATE, RATE_COLUMNS, DR + 3)):
            line["columns"][kind, : len(columns)] = columns
            line["count"][kind] = len(columns)
            line["h"][kind, np.searchsorted(columns, own) : np.searchsorted(columns, own) + 3] = -u
            line["h"][kind, len(columns) - 1] = 1.0
        line["innovation"][:2] = row.range_m, row.rate_mps
        line["status"][:2] = row.range_status, row.rate_status
        line["variance"][:2] = RANGE_SIGMA_M**2, RATE_SIGMA_MPS**2
    return lines, np.array([row.sv for row in rows], np.int16)


def covariance(rng: np.random.Generator) -> Float64:
    """Return some covariance with correlations between all states: metres of position, a clock known as well."""
    root = rng.normal(size=(OFFSETS, OFFSETS))
    sigma = np.full(OFFSETS, 0.01)
    sigma[DR : DR + 3], sigma[CLOCK], sigma[DRIFT] = 2.0, 2.0, 0.05
    root *= (sigma / np.linalg.norm(root, axis=1))[:, None]
    return root @ root.T


def steps_of(rows: list[Seen], rng: np.random.Generator) -> list[ClockStep]:
    lines, sv = lines_of(rows)
    return clock_steps(lines, sv, covariance(rng), np.zeros(OFFSETS), GATE2)


@pytest.mark.parametrize("ranges_m", [(80.0,), (81.0, 79.0), (80.0, 81.0, 30.0), (30.0, 80.0, 81.0, 79.0)])
def test_step_that_two_thirds_of_the_satellites_show_is_found(
    rng: np.random.Generator, ranges_m: tuple[float, ...]
) -> None:
    (step,) = steps_of([Seen(i, y) for i, y in enumerate(ranges_m)], rng)
    assert step.kind == PSEUDORANGE
    assert step.size == pytest.approx(80.0, abs=2.0)
    assert step.judged == len(ranges_m)
    assert step.witnesses == sum(y > 70.0 for y in ranges_m)


@pytest.mark.parametrize(
    "rows",
    [
        [Seen(0, 80.0), Seen(1, -80.0)],
        [Seen(0, 80.0), Seen(1, 0.0, USED)],
        [Seen(0, 80.0), Seen(0, 80.0), Seen(1, 0.0, USED)],
        [Seen(0, 80.0), Seen(0, 80.0), Seen(1, 30.0)],
        [Seen(0, 0.0, USED, 9.0, GATED)],
    ],
    ids=[
        "two contradict each other",
        "one beside a used one",
        "two bands of one beside a used one",
        "two bands of one against another",
        "one range rate beside a used pseudorange",
    ],
)
def test_what_may_be_a_satellites_own_error_is_no_step(rng: np.random.Generator, rows: list[Seen]) -> None:
    assert steps_of(rows, rng) == []


def test_bias_and_drift_that_step_at_once_are_both_found(rng: np.random.Generator) -> None:
    steps = steps_of([Seen(i, 50.0, GATED, 10.0, GATED) for i in range(3)], rng)
    assert [(step.kind, round(step.size)) for step in steps] == [(PSEUDORANGE, 50), (RANGE_RATE, 10)]


def test_range_rates_alone_show_a_step_of_the_drift(rng: np.random.Generator) -> None:
    (step,) = steps_of([Seen(i, 0.0, SWITCHED_OFF, -10.0, GATED) for i in range(2)], rng)
    assert step.kind == RANGE_RATE and step.size == pytest.approx(-10.0, abs=0.5)


def bank_of(P: Float64, n_hypotheses: int = 1) -> Bank:
    bank = new_bank(n_hypotheses, 0)
    bank.state["C_eb"] = np.eye(3)
    bank.state["clone_ns"] = 1
    bank.P[:] = P
    return bank


def test_absorbed_step_of_one_satellite_is_the_update_of_a_clock_that_nobody_knows(
    rng: np.random.Generator,
) -> None:
    """Oracle: Kalman's update by that row, its prior's clock wide and without correlations; no other state moves."""
    P = covariance(rng)
    lines, sv = lines_of([Seen(0, 80.0)])
    (step,) = clock_steps(lines, sv, P, np.zeros(OFFSETS), GATE2)
    bank = bank_of(P)
    apply_clock_step(bank, step, LEVER_B)
    wide = P.copy()
    wide[CLOCK], wide[:, CLOCK] = 0.0, 0.0
    wide[CLOCK, CLOCK] = 1e10
    h = np.zeros(OFFSETS)
    h[RANGE_COLUMNS] = lines["h"][0, PSEUDORANGE, : len(RANGE_COLUMNS)]
    variance = RANGE_SIGMA_M**2 + (2e-5 * 80.0) ** 2 + FLOOR_M**2
    gain = wide @ h / (h @ wide @ h + variance)
    wanted = wide - np.outer(gain, h @ wide)
    assert bank.state["clock"][0, 0] == pytest.approx(gain[CLOCK] * 80.0, abs=1e-6)
    assert bank.P[0] == pytest.approx(wanted, abs=1e-4)  # of 1e10, what doubles and a finite width leave
    assert np.linalg.eigvalsh(bank.P[0]).min() > -1e-12
    assert np.array_equal(bank.P[0], bank.P[0].T)
    assert bank.state["clone_ns"][0] == 0


def test_every_hypothesis_gets_the_clock_that_its_own_position_asks_for(rng: np.random.Generator) -> None:
    lines, sv = lines_of([Seen(0, 80.0)])
    (step,) = clock_steps(lines, sv, covariance(rng), np.zeros(OFFSETS), GATE2)
    bank = bank_of(covariance(rng), 2)
    bank.head["leader"] = 1
    bank.state["clock"][:, 0] = 5.0, 7.0
    bank.state["r_e"][0] = 10.0, -4.0, 3.0
    apply_clock_step(bank, step, LEVER_B)
    assert bank.state["clock"][1, 0] == pytest.approx(87.0)
    # the other one's range is longer by -u . dr, so its clock is smaller by as much
    farther = lines["h"][0, PSEUDORANGE, :3] @ bank.state["r_e"][0]
    assert bank.state["clock"][0, 0] == pytest.approx(87.0 - farther)
