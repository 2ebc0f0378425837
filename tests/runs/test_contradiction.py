"""A replay of wrongly declared logs sends its reader to the check; one of sound logs does not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest

import insgnss
from insgnss.runs.contradiction import KIND, MOST_RESETS, contradiction
from insgnss.simulation.simulated_log import SimulatedLog
from insgnss.tables import ImuTable
from tests.runs.scenes import flight, kinds, turns


@pytest.fixture(scope="module")
def log() -> SimulatedLog:
    return turns().draw(np.random.default_rng(4))


def with_gyros(imu: ImuTable, turned: np.ndarray) -> ImuTable:
    return dataclasses.replace(imu, w_ib_b=imu.w_ib_b * turned)


@pytest.mark.parametrize(
    "turned", [np.array([1.0, 1.0, -1.0]), np.full(3, 180.0 / np.pi)], ids=["z sign", "unit"]
)
def test_gyros_of_a_wrong_sign_or_unit_are_told_at_the_end(log: SimulatedLog, turned: np.ndarray) -> None:
    run = insgnss.replay(flight(turns(), log, imu=with_gyros(log.imu, turned)))
    last = run.events.iloc[-1]
    assert last["kind"] == KIND and "insgnss check" in last["detail"]
    assert last["time_s"] == pytest.approx(run.nav["time_s"].iloc[-1])


def test_sound_logs_are_not_doubted(log: SimulatedLog) -> None:
    assert KIND not in kinds(insgnss.replay(flight(turns(), log)))


def test_resets_and_refusals_are_signs_each() -> None:
    counts = pd.DataFrame({"range_rate": [60, 40], "pseudorange": [100, 0]}, index=["used", "gated"])
    none = pd.DataFrame({"kind": ["start", "restart", *["reset"] * MOST_RESETS]})
    (told,) = contradiction(none, counts, 7)
    assert (
        told.t_ns == 7 and "it refused 40% of the range rates" in told.detail and "pseudo" not in told.detail
    )
    assert contradiction(none, counts // 2, 7) == [], "50 rows are few"
    often = pd.DataFrame({"kind": ["reset", "restart", *["reset"] * MOST_RESETS]})
    (told,) = contradiction(often, counts // 2, 7)
    assert told.detail.startswith("the filter was reset 3 times: ")
