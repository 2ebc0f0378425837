"""Speeds that ``make bench`` follows beside those of single rooms: reading, the filter's loop, command, receiver."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insgnss.config.library import filter_config, imu_grade
from insgnss.filter.whole_log import run_filter
from insgnss.log.flight import Flight
from insgnss.log.imu.csv_log import read_imu
from insgnss.runs.gnss_rows import corrected_rows
from insgnss.runs.setup import setup_filter
from insgnss.studies import ReceiverOptions
from insgnss.studies.receiver.runs import run_many
from insgnss.studies.receiver.scene import scene_of
from insgnss.studies.receiver.variants import VARIANTS
from tests.benchmarks.bench_replay import SAMPLE, command
from tests.benchmarks.long_log import LongLog, write_log
from tests.log.writing import WEEK, imu_config

ROUNDS = 5


@pytest.fixture(scope="module")
def hour(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the flight file of an hour: IMU at 200 Hz, 12 satellites at 1 Hz."""
    return write_log(LongLog(gnss_hz=1.0, satellites=12), tmp_path_factory.mktemp("hour"))


def test_reading_an_hour_of_inertial_samples(hour: Path, benchmark: Any) -> None:
    settings, grade = imu_config(hour.parent / "imu.csv"), imu_grade("tactical")
    log = benchmark.pedantic(lambda: read_imu(settings, WEEK, grade), rounds=ROUNDS, warmup_rounds=1)

    assert log is not None


def test_loop_over_an_hour_with_12_satellites_a_second(hour: Path, benchmark: Any) -> None:
    flight = Flight.load(hour)
    logs = flight.read()
    setup = setup_filter(flight, logs, filter_config("tight"))
    rows, _ = corrected_rows(setup, logs, flight)
    result = benchmark.pedantic(
        lambda: run_filter(setup, logs.imu, rows, "gnss"), rounds=ROUNDS, warmup_rounds=1
    )

    assert result is not None


def test_replay_of_the_sample_flight_as_a_command(tmp_path: Path, benchmark: Any) -> None:
    benchmark.pedantic(lambda: command(SAMPLE, tmp_path / "run"), rounds=ROUNDS, warmup_rounds=1)

    assert (tmp_path / "run" / "nav.parquet").exists()


def test_one_stage_receiver_of_eight_channels_for_ten_seconds_at_a_millisecond(benchmark: Any) -> None:
    options = ReceiverOptions(duration_s=10.0, settle_s=5.0, average_s=5.0, step_s=1e-3)
    of = scene_of("manoeuvring_5g", "coherent", "industrial", "tcxo", options).setting
    runs = benchmark.pedantic(
        lambda: run_many(of, VARIANTS["one_stage"], np.asarray(40.0), 1, 1, 1), rounds=ROUNDS, warmup_rounds=1
    )

    assert not runs[0].lost
