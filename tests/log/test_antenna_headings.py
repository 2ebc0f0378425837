"""The heading of a receiver's antennas, SBF's AttEuler and NovAtel's HEADING2, becomes the log of a [[sensor]]."""

from __future__ import annotations

import io
import tomllib
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter
from pysbf2 import SBFReader

from insgnss.config.flight import Gnss
from insgnss.config.sensors import HeadingSensor
from insgnss.log.convert import convert
from insgnss.log.gnss_log import read_receiver
from insgnss.log.imu.sensor_csv import read_sensor
from insgnss.log.novatel.reader import read_novatel
from insgnss.log.sbf.reader import read_sbf
from insgnss.tables import SensorTable
from tests.log.novatel_encoder import TOW_S, bestpos, heading2
from tests.log.sbf_encoder import Channel, attitude, attitude_covariance, epoch, fix, satellite
from tests.log.test_novatel_rewritten import as_ascii

T0 = 340_000.0
SBF = (
    fix(T0) + fix(T0 + 1.0) + attitude(T0, 359.5) + attitude_covariance(T0, 0.0625) + attitude(T0 + 1.0, 0.5)
)
FLOAT, NOT_ASKED = attitude(T0 + 2.0, 90.0, mode=1), attitude(T0 + 3.0, 90.0, error=0x80)
NOVATEL = b"".join(bestpos(TOW_S + k) + heading2(TOW_S + k, 45.0 + k) for k in range(3))


def written(folder: Path, data: bytes) -> Path:
    path = folder / "receiver.log"
    path.write_bytes(data)
    return path


def declared(folder: Path) -> tuple[SensorTable, str]:
    """Return the sensor of the written flight file, its marks removed, as a replay reads it, and its entry."""
    text = (folder / "flight.toml").read_text()
    lines = text[text.index("# The log has a heading") :].splitlines()[1:]
    entry = "\n".join(line.removeprefix("# ") for line in lines)
    (keys,) = tomllib.loads(entry)["sensor"]
    keys["files"] = [folder / name for name in keys["files"]]
    config = TypeAdapter(HeadingSensor).validate_python(keys)
    table, events = read_sensor(config, tomllib.loads(text)["gps_week"])
    assert not events
    return table, entry


def test_fixed_headings_of_sbf_have_the_sigma_of_their_covariance(tmp_path: Path) -> None:
    log = read_sbf(written(tmp_path, SBF + FLOAT + NOT_ASKED))
    (samples,) = log.further
    assert (samples.kind, samples.source) == ("heading", "AttEuler")
    np.testing.assert_array_equal(samples.values, [[359.5, 0.25], [0.5, np.nan]])
    told = {event.kind: event.detail for event in log.events}
    assert "2 AttEuler block(s) without a heading by fixed" in told["sbf_no_heading"]
    assert "sbf_not_used" not in told


def test_fields_of_the_attitude_are_those_of_another_parser() -> None:
    data = attitude(T0, 359.5) + attitude_covariance(T0, 0.0625)
    euler, covariance = (parsed for _, parsed in SBFReader(io.BytesIO(data)))
    assert (euler.identity, euler.Heading, euler.Pitch, euler.Mode) == ("AttEuler", 359.5, 1.5, 2)
    assert (covariance.identity, covariance.Cov_HeadHead) == ("AttCovEuler", 0.0625)


def test_fixed_headings_of_novatel_have_their_sigma(tmp_path: Path) -> None:
    others = heading2(TOW_S + 3, 90.0, kind=34) + heading2(TOW_S + 4, 90.0, status=1)
    log = read_novatel([written(tmp_path, NOVATEL + others)])
    (samples,) = log.further
    assert samples.source == "HEADING2"
    np.testing.assert_array_equal(samples.values, [[45.0 + k, 0.25] for k in range(3)])
    told = {event.kind: event.detail for event in log.events}
    assert "2 HEADING2 message(s) without a heading by fixed" in told["novatel_no_heading"]
    assert "novatel_not_used" not in told


def test_heading_in_ascii_is_that_of_the_binary_message(tmp_path: Path) -> None:
    text = as_ascii(b"".join(heading2(TOW_S + k, 45.0 + k) for k in range(3)))
    assert b"#HEADING2A" in text
    (samples,) = read_novatel([written(tmp_path, bestpos(TOW_S) + bestpos(TOW_S + 1) + text)]).further
    np.testing.assert_array_equal(samples.values, [[45.0 + k, 0.25] for k in range(3)])


@pytest.mark.parametrize("data", [SBF, NOVATEL], ids=["sbf", "novatel"])
def test_converted_log_has_a_heading_that_a_flight_file_can_take(tmp_path: Path, data: bytes) -> None:
    done = convert([written(tmp_path, data)], tmp_path / "out")
    (samples,) = done.log.further
    table, entry = declared(tmp_path / "out")
    np.testing.assert_array_equal(table.t_ns, samples.t_ns)
    np.testing.assert_allclose(np.degrees(np.column_stack([table.values, table.sigma])), samples.values)
    assert "offset_deg" in entry and "sigma_deg" not in entry


def test_heading_without_sigmas_asks_for_one(tmp_path: Path) -> None:
    data = fix(T0) + fix(T0 + 1.0) + attitude(T0, 10.0) + attitude(T0 + 1.0, 11.0)
    convert([written(tmp_path, data)], tmp_path / "out")
    table, entry = declared(tmp_path / "out")
    assert "sigma_deg = 1.0  # DECLARE" in entry and np.isnan(table.sigma).all()


def test_heading_in_a_file_that_a_flight_reads_itself_is_told(tmp_path: Path) -> None:
    path = written(tmp_path, epoch(T0, [satellite(5, [Channel(0, 1575.42e6, 2.2e7, 0.0, None, 45.0)])]) + SBF)
    log = read_receiver(Gnss(files=(path,), format="sbf"), 0)
    told = {event.kind: event.detail for event in log.events}["sensor_samples_not_used"]
    assert "2 heading samples (AttEuler)" in told and "heading.csv for a [[sensor]]" in told
