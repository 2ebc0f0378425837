"""A replay of wrongly declared logs sends its reader to the check; one of sound logs does not."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import insgnss
from insgnss.config.flight import MountedAntenna
from insgnss.constants import NS_PER_S, STANDARD_GRAVITY_MPS2
from insgnss.runs.contradiction import KIND, MOST_RESETS, contradiction
from insgnss.simulation.simulated_log import SimulatedLog
from insgnss.tables import ImuTable
from tests.runs.scenes import START_NS, after, flight, kinds, position_error_m, turns

SAMPLE = Path(__file__).resolve().parents[2] / "data" / "sample_flight" / "flight.toml"
NO_ROWS = pd.DataFrame({"time_s": [0.0], "sv": ["G01"], "kind": ["range_rate"], "status": ["used"]})


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


def test_filter_that_wrong_samples_lead_astray_does_not_run_away_from_all_satellites(
    log: SimulatedLog,
) -> None:
    """Accelerometers in g from a minute on: three satellites of eleven go on fitting a filter kilometres away."""
    f_b = log.imu.f_b.copy()
    f_b[log.imu.t_ns > START_NS + 60 * NS_PER_S] /= STANDARD_GRAVITY_MPS2
    run = insgnss.replay(flight(turns(), log, imu=dataclasses.replace(log.imu, f_b=f_b)))
    assert position_error_m(after(run, 0.0)).max() < 1000.0
    assert run.events["kind"].iloc[-1] == KIND


def test_sound_logs_are_not_doubted(log: SimulatedLog) -> None:
    assert KIND not in kinds(insgnss.replay(flight(turns(), log)))


def test_resets_and_refusals_are_signs_each() -> None:
    counts = pd.DataFrame({"range_rate": [60, 40], "pseudorange": [100, 0]}, index=["used", "gated"])
    none = pd.DataFrame({"kind": ["start", "restart", *["reset"] * MOST_RESETS]})
    (told,) = contradiction(none, NO_ROWS, counts, 7)
    assert (
        told.t_ns == 7 and "it refused 40% of the range rates" in told.detail and "pseudo" not in told.detail
    )
    assert contradiction(none, NO_ROWS, counts // 2, 7) == [], "50 rows are few"
    often = pd.DataFrame({"kind": ["reset", "restart", *["reset"] * MOST_RESETS]})
    (told,) = contradiction(often, NO_ROWS, counts // 2, 7)
    assert told.detail.startswith("the filter was reset 3 times: ")


def test_imu_upside_down_that_hides_all_satellites_is_told_at_the_end() -> None:
    """A receiver does not track what its antenna cannot see."""
    log = turns().draw(np.random.default_rng(5))
    flipped = np.array([1.0, -1.0, -1.0])
    imu = dataclasses.replace(log.imu, w_ib_b=log.imu.w_ib_b * flipped, f_b=log.imu.f_b * flipped)
    told = []
    for samples in (log.imu, imu):
        flown = flight(turns(), log, imu=samples)
        gnss = flown.config.gnss.model_copy(update={"antenna": (MountedAntenna(pattern="patch_l1"),)})
        config = flown.config.model_copy(update={"gnss": gnss})
        last = insgnss.replay(dataclasses.replace(flown, config=config)).events.iloc[-1]
        told.append(last["detail"] if last["kind"] == KIND else "")
    assert told[0] == ""
    assert "the antenna cannot see" in told[1] and "antenna may not be as declared" in told[1]


def test_rows_that_the_filter_refuses_are_not_hidden_ones() -> None:
    none = pd.DataFrame({"kind": ["start"]})
    counts = pd.DataFrame({"range_rate": [30, 70, 900]}, index=["used", "masked_gain", "gated"])
    (told,) = contradiction(none, NO_ROWS, counts, 7)
    assert "refused 97%" in told.detail and "cannot see" not in told.detail
    (told,) = contradiction(none, NO_ROWS, counts.iloc[:2], 7)
    assert told.detail.startswith("by its attitude 70% of the range rates")


def test_most_satellites_that_drift_and_many_suspicions_are_signs() -> None:
    events = pd.DataFrame({"kind": ["sensor_suspect", "time_tag_suspect"] * 2})
    counts = pd.DataFrame({"range_rate": [60], "pseudorange": [100]}, index=["used"])
    (told,) = contradiction(events, NO_ROWS, counts, 7)
    assert "suspected the inertial sensors or the time tags 4 times" in told.detail
    assert contradiction(events.iloc[1:], NO_ROWS, counts, 7) == []
    names = [f"G{k:02d}" for k in range(1, 9)]
    rows = pd.DataFrame({"sv": names, "kind": "range_rate"})
    parts = [
        rows.assign(time_s=10.0, status="used"),
        rows[:4].assign(time_s=20.0, status="drifting"),
        rows[4:].assign(time_s=700.0, status="drifting"),
        rows.assign(time_s=710.0, status="used"),
    ]
    assert contradiction(events[:0], pd.concat(parts, ignore_index=True), counts, 7) == [], (
        "four in each five minutes"
    )
    five = pd.concat([*parts, rows[4:5].assign(time_s=30.0, status="drifting")], ignore_index=True)
    (told,) = contradiction(events[:0], five, counts, 7)
    assert "left out 5 of 8 satellites within five minutes" in told.detail
