"""PVTGeodetic of SBF files becomes a reference, or the fixes beside the solution of satellites and inertial sensor."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
import pymap3d
import pytest
from pysbf2 import SBFReader

from insgnss.config.flight import Gnss
from insgnss.constants import NS_PER_WEEK
from insgnss.errors import InputError
from insgnss.log.convert import convert
from insgnss.log.flight import Flight
from insgnss.log.gnss_log import read_receiver
from insgnss.log.receiver import ReceiverLog
from insgnss.log.sbf.reader import read_sbf
from tests.log.sbf_encoder import (
    WEEK,
    Channel,
    block,
    cartesian_covariances,
    cartesian_fix,
    covariances,
    epoch,
    fix,
    ins_solution,
    satellite,
    sensor,
)


def read(folder: Path, *blocks: bytes) -> ReceiverLog:
    (folder / "log.sbf").write_bytes(b"".join(blocks))
    return read_sbf(folder / "log.sbf")


def test_fixes_have_place_velocity_and_the_sigmas_of_their_covariances(tmp_path: Path) -> None:
    blocks = [
        fix(340_000.0, accuracies_cm=(200, 300)),
        covariances(5906, 340_000.0, (0.25, 0.09, 0.64)),
        covariances(5908, 340_000.0, (0.0016, 0.0025, 0.0036)),
        fix(340_000.5, accuracies_cm=(200, 300)),
    ]
    log = read(tmp_path, *blocks)
    own = log.solution
    assert (
        own is not None and own.sigma is not None and log.solution_from == "satellites" and log.fixes is None
    )
    assert own.t_ns.tolist() == [WEEK * NS_PER_WEEK + 340_000 * 10**9 + k * 500_000_000 for k in range(2)]
    assert (own.lat_deg[0], own.lon_deg[0], own.h_m[1]) == pytest.approx(
        (math.degrees(0.5), math.degrees(-1.5), 100.5), abs=1e-12
    )
    assert own.v_n.tolist() == [[4.0, 3.0, -0.5]] * 2 and (own.quality == 2.0).all()
    assert own.sigma[0, :6] == pytest.approx([0.5, 0.3, 0.8, 0.04, 0.05, 0.06], rel=1e-6)
    # without covariances: twice the rms of the distance is 2 m, twice the sigma of the height 3 m
    assert own.sigma[1, :3] == pytest.approx([1.0 / math.sqrt(2.0)] * 2 + [1.5])
    assert np.isnan(own.sigma[1, 3:]).all()
    assert "receiver's fixes" in {event.kind: event.detail for event in log.events}["reference_own"]


def test_blocks_that_are_not_read_are_told_with_their_numbers(tmp_path: Path) -> None:
    base, ends = block(4028, bytes(34)), block(5921, bytes(6))
    log = read(tmp_path, fix(340_000.0), base, ends, fix(340_000.5), base)
    told = {event.kind: event.detail for event in log.events}["sbf_not_used"]
    assert told.endswith("blocks not read, by number: 2 of 4028 (BaseVectorGeod), 1 of 5921")


def test_log_whose_measurements_are_compressed_says_what_to_do(tmp_path: Path) -> None:
    compressed = block(4109, bytes(40)) + block(4111, bytes(20))
    log = read(tmp_path, fix(340_000.0), compressed, fix(340_000.5), compressed)
    told = {event.kind: event.detail for event in log.events}["sbf_measurements_not_read"]
    assert "4 compressed block(s)" in told and "(Meas3Ranges, Meas3Doppler)" in told
    assert "+MeasEpoch" in told and "sbf2rin" in told
    with pytest.raises(InputError) as error:
        read_receiver(Gnss(files=(tmp_path / "log.sbf",), format="sbf"), 0)
    assert "Meas3Ranges" in error.value.advice
    with pytest.raises(InputError) as error:
        read(tmp_path, compressed)
    assert "Meas3Ranges" in error.value.advice

    measured = epoch(340_000.0, [satellite(5, [Channel(0, 1575.42e6, 2.2e7, 0.0, None, 45.0)])])
    kinds = [event.kind for event in read(tmp_path, measured, compressed).events]
    assert "sbf_measurements_not_read" not in kinds and "sbf_not_used" in kinds


def test_fields_are_those_of_another_parser() -> None:
    data = fix(340_000.0, accuracies_cm=(200, 300)) + covariances(5908, 340_000.0, (0.0016, 0.0025, 0.0036))
    found = {parsed.identity: parsed for _, parsed in SBFReader(io.BytesIO(data))}
    pvt, velocity = found["PVTGeodetic"], found["VelCovGeodetic"]
    assert (pvt.Latitude, pvt.Longitude, pvt.Height, pvt.Vn, pvt.Ve, pvt.Vu) == (
        0.5,
        -1.5,
        100.0,
        4.0,
        3.0,
        0.5,
    )
    assert (pvt.HAccuracy, pvt.VAccuracy) == pytest.approx((2.0, 3.0))
    assert (velocity.Cov_VnVn, velocity.Cov_VeVe, velocity.Cov_VuVu) == pytest.approx(
        (0.0016, 0.0025, 0.0036)
    )


def test_fixes_along_the_axes_of_the_earth_are_read_where_there_are_no_others(tmp_path: Path) -> None:
    lat, lon, h_m = 53.45, -2.24, 81.5
    r_e = pymap3d.geodetic2ecef(lat, lon, h_m)
    v_e = pymap3d.enu2uvw(3.0, 4.0, -0.5, lat, lon)  # east, north, up
    # axes north, east, up as columns
    axes = np.column_stack([pymap3d.enu2uvw(*enu, lat, lon) for enu in ((0, 1, 0), (1, 0, 0), (0, 0, 1))])

    def covariance(*variances: float) -> tuple[tuple[float, ...], ...]:
        return tuple(map(tuple, axes @ np.diag(variances) @ axes.T))

    blocks = [
        cartesian_fix(340_000.0, r_e, v_e),
        cartesian_covariances(5905, 340_000.0, covariance(0.25, 0.09, 0.64)),
        cartesian_covariances(5907, 340_000.0, covariance(0.0016, 0.0025, 0.0036)),
        cartesian_fix(340_000.5, r_e, (-2e10,) * 3),
        cartesian_fix(340_001.0, r_e, v_e, mode=0),
        cartesian_fix(340_001.5, (-2e10,) * 3, v_e),
        cartesian_fix(340_002.0, (math.nan,) * 3, v_e),
    ]
    log = read(tmp_path, *blocks)
    own = log.solution
    assert own is not None and own.sigma is not None and len(own.t_ns) == 2
    assert (own.lat_deg[0], own.lon_deg[0]) == pytest.approx((lat, lon), abs=1e-9)
    assert own.h_m[0] == pytest.approx(h_m, abs=1e-4)
    assert own.v_n[0] == pytest.approx([4.0, 3.0, 0.5], abs=1e-6) and np.isnan(own.v_n[1]).all()
    assert own.sigma[0, :6] == pytest.approx([0.5, 0.3, 0.8, 0.04, 0.05, 0.06], rel=1e-4)
    told = {event.kind: event.detail for event in log.events}
    assert "PVTCartesian" in told["reference_own"] and "3 PVTCartesian block(s)" in told["sbf_no_solution"]
    others = read(tmp_path, *blocks, fix(340_000.0), fix(341_000.0)).solution
    assert others is not None and others.lat_deg[0] == pytest.approx(math.degrees(0.5))


def test_blocks_that_are_no_fix_in_three_dimensions_are_counted(tmp_path: Path) -> None:
    others = [fix(340_001.0, mode=0), fix(340_002.0, mode=0x84), fix(340_003.0, error=2)]
    log = read(tmp_path, fix(340_000.0), *others, fix(340_004.0))
    own = log.solution
    assert own is not None and len(own.t_ns) == 2 and own.sigma is not None and np.isnan(own.sigma).all()
    told = {event.kind: event.detail for event in log.events}
    assert "3 PVTGeodetic block(s) without a fix in three dimensions" in told["sbf_no_solution"]
    with pytest.raises(InputError, match="no measurement, no inertial sample and no solution"):
        read(tmp_path, *others)


def test_covariances_in_error_or_without_a_number_state_nothing(tmp_path: Path) -> None:
    none = (-2e10, -2e10, -2e10)
    blocks = [
        fix(340_000.0),
        covariances(5906, 340_000.0, (0.25, 0.09, 0.64), error=1),
        covariances(5908, 340_000.0, none),
        fix(340_001.0, accuracies_cm=(65_535, 65_534)),
    ]
    own = read(tmp_path, *blocks).solution
    assert own is not None and own.sigma is not None and np.isnan(own.sigma).all()


def test_fixes_beside_the_solution_with_an_inertial_sensor_carry_the_replay(tmp_path: Path) -> None:
    times = [340_000.0 + k for k in range(3)]
    samples = [sensor(340_000.0 + k / 50, (0.0, 0.0, 0.0), (0.0, 0.0, -9.8)) for k in range(150)]
    solutions = [ins_solution(t) for t in times]
    log = read(tmp_path, *samples, *solutions, *(fix(t) for t in times))
    assert log.solution_from == "filter" and log.fixes is not None and log.satellite_fixes() is log.fixes
    assert "reference_own" not in {event.kind for event in log.events}
    convert([tmp_path / "log.sbf"], tmp_path / "out")
    flight = Flight.load(tmp_path / "out" / "flight.toml")
    assert [[path.name for path in each.files] for each in flight.config.sensor] == [["fixes.csv"]] * 2
    assert flight.config.reference is not None and flight.config.reference.file.name == "reference.csv"
    text = (tmp_path / "out" / "flight.toml").read_text()
    assert (
        "sigma_m = [5.0, 5.0, 10.0]  # DECLARE" in text and "sigma_mps = [0.3, 0.3, 0.5]  # DECLARE" in text
    )
    # without fixes the solution does not take the place of measurements: it holds the samples already
    alone = read(tmp_path, *samples, *solutions)
    assert alone.satellite_fixes() is None
