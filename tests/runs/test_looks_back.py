"""A look back on a log without a fault, ten epochs a second: nothing explains it better than a sound filter.

A ratio of likelihoods exceeds K with a probability of 1 / K at most where nothing is wrong (Markov's inequality).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from insgnss.config.library import filter_config
from insgnss.filter.diagnosis.hindsight import Hindsight
from insgnss.filter.diagnosis.jumps import ACCELEROMETER, GYRO
from insgnss.filter.diagnosis.supposed_faults import IMU_TAGS, LOG_PRIOR, SATELLITES
from insgnss.filter.diagnosis.suspects import Explanation, every_fault, explanations
from insgnss.filter.imu.inertial_stream import screened
from insgnss.filter.navigator import Navigator
from insgnss.filter.output.writing import new_output
from insgnss.log.flight import Flight
from insgnss.runs.gnss_rows import corrected_rows
from insgnss.runs.setup import setup_filter
from tests.benchmarks.long_log import LongLog, write_log

EPOCHS_A_LOOK = 600  # a minute: what one look judges, no other judges again
FIRST_LOOK = 700  # the oldest filter of the past is a minute old then
CHANCE = 1e-3  # of a failure where all is well, over all looks
SEEDS = (21,)


@pytest.fixture(scope="module")
def looks(tmp_path_factory: pytest.TempPathFactory) -> list[list[Explanation]]:
    """Return what may have failed in some logs, each time that the filter looks back on its last minute."""
    return [
        explanations(every_fault(again), again.as_it_was)
        for seed in SEEDS
        for again in reruns(seed, tmp_path_factory)
    ]


def reruns(seed: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hindsight]:
    log = LongLog(hours=0.04, imu_hz=100.0, gnss_hz=10.0, satellites=12, seed=seed)
    flight = Flight.load(write_log(log, tmp_path_factory.mktemp("log")))
    logs = flight.read()
    setup = setup_filter(flight, logs, filter_config("tight17"))
    rows, _ = corrected_rows(setup, logs, flight)
    ((imu, _),) = screened(logs.imu, setup).stretches()
    navigator = Navigator(setup)
    out = new_output(rows, len(rows.epoch_ns), 64, np.zeros(0, np.int64), setup.layout.n_shown)
    ends = range(FIRST_LOOK, len(rows.epoch_ns), EPOCHS_A_LOOK)
    assert len(ends) == 2
    begin = 0
    for end in ends:
        navigator.run(imu, rows, begin, end, out)
        past, span = navigator.health.past.judged()
        assert span is not None
        yield Hindsight(past, setup, imu, navigator.parameters, span)
        begin = end


@pytest.mark.parametrize("suspect", [SATELLITES, IMU_TAGS, "all"])
def test_no_fault_is_likelier_than_chance_allows(looks: list[list[Explanation]], suspect: str) -> None:
    told = [each for look in looks for each in look if suspect in (each.suspect, "all")]
    gains = [
        each.log_odds - LOG_PRIOR * max(len(each.best.satellites), len(each.best.axes), 1) for each in told
    ]
    assert max(gains, default=-math.inf) < math.log(max(len(gains), 1) / CHANCE)


def test_every_number_of_cores_judges_alike(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    again, found = next(reruns(24, tmp_path_factory)), []
    for cores in (1, 5):
        monkeypatch.setattr("insgnss.filter.setup.usable_cores", lambda cores=cores: cores)
        found.append(
            [
                (v.suspect, v.satellites, v.axes, v.log_likelihood, v.bank.P.tobytes())
                for v in every_fault(again)
            ]
        )
    assert {suspect for suspect, *_ in found[0]} >= {SATELLITES, IMU_TAGS, ACCELEROMETER, GYRO}
    assert found[0] == found[1]
