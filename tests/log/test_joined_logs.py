"""Files of two makers in one conversion: measurements of one, inertial samples of the other, or an error."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insgnss.config.files import existing_file
from insgnss.errors import InputError, MissingFileError, TimeError
from insgnss.log.convert import convert
from insgnss.log.flight import Flight
from insgnss.log.further_samples import FurtherSamples
from insgnss.log.joined_logs import FormatLog, join_logs
from insgnss.log.own_solution import own_reference
from insgnss.log.receiver import ReceiverLog, no_measurements
from insgnss.tables import ImuTable
from tests.log.sbf_encoder import WEEK, ins_solution, sensor
from tests.log.test_convert import read_again, same, sbf_file
from tests.log.test_rinex_navigation import HEADER as NAV_HEADER
from tests.log.test_rinex_navigation import message
from tests.log.test_rinex_observations import HEADER as OBS_HEADER
from tests.log.test_rinex_observations import epoch as rinex_epoch
from tests.log.test_ubx_solution import NOON_MS, pvt
from tests.log.test_ulog import flown
from tests.log.ubx_writing import rawx

TOW_S = 408_639.0  # of the ULog's first sample, in week 2381


def receiver(folder: Path, week: int = 2381, first_s: float = TOW_S) -> Path:
    path = folder / "receiver.ubx"
    path.write_bytes(b"".join(rawx(first_s + k, week=week) for k in range(20)))
    return path


def autopilot(folder: Path) -> Path:
    pytest.importorskip("pyulog", reason="the extra 'ulog' is not installed")
    path = folder / "autopilot.ulg"
    path.write_bytes(flown(dump=False).data)
    return path


def inertial_unit(folder: Path, first_s: float = 340_000.0, solution: bool = True) -> Path:
    path = folder / "unit.sbf"
    parts = [sensor(first_s + k / 100, (1.0, 0.0, -k), (0.5, 0.0, -9.8)) for k in range(200)]
    parts += [ins_solution(first_s + k / 10) for k in range(20)] if solution else []
    path.write_bytes(b"".join(parts))
    return path


def test_autopilots_samples_and_its_receivers_measurements_become_one_flight(tmp_path: Path) -> None:
    done = convert([autopilot(tmp_path), receiver(tmp_path)], tmp_path / "out")
    assert [p.name for p in done.written] == ["gnss_obs.csv", "imu.csv", "reference.csv", "flight.toml"]
    one = convert([receiver(tmp_path)], tmp_path / "gnss").log
    other = convert([autopilot(tmp_path)], tmp_path / "imu").log
    flight, table = read_again(tmp_path / "out")
    same(one.gnss, table)
    for name in ("imu.csv", "reference.csv"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "imu" / name).read_bytes()
    assert done.log.imu_is_mean and done.log.solution_point == "imu"
    assert flight.config.imu is not None and flight.config.imu.sampling == "mean"
    assert flight.config.reference is not None and flight.config.reference.point == "imu"
    details = [event.detail for event in done.events]
    assert all(event.detail in details for event in (*one.events, *other.events))


def test_inertial_units_solution_with_attitude_is_the_reference(tmp_path: Path) -> None:
    done = convert([receiver(tmp_path, WEEK, 340_000.0), inertial_unit(tmp_path)], tmp_path / "out")
    assert done.log.imu is not None and len(done.log.imu.t_ns) == 200 and not done.log.imu_is_mean
    assert done.log.solution is not None and np.isfinite(done.log.solution.rpy_deg).all()
    assert len(read_again(tmp_path / "out")[1].t_ns) == 20


def test_rinex_observations_take_any_inertial_log_and_navigation_files(tmp_path: Path) -> None:
    text = (OBS_HEADER + rinex_epoch()).replace(
        "2023 06 29 11 11", "2025 05 21 22 26"
    )  # 340 002 s of the week
    (tmp_path / "obs").write_text(
        text.replace("2023     6    29    11    11", "2025     5    21    22    26")
    )
    (tmp_path / "brdc.rnx").write_text(NAV_HEADER + message())
    unit = inertial_unit(tmp_path, 340_001.0, solution=False)
    done = convert([tmp_path / "obs", unit, tmp_path / "brdc.rnx"], tmp_path / "out")
    assert [p.name for p in done.written] == ["gnss_obs.csv", "brdc.rnx", "imu.csv", "flight.toml"]


def test_measurements_in_files_of_two_formats_are_refused(tmp_path: Path) -> None:
    (tmp_path / "obs").write_text(OBS_HEADER + rinex_epoch())
    with pytest.raises(InputError, match="measurements are in files of 2 formats") as found:
        convert([tmp_path / "obs", sbf_file(tmp_path)], tmp_path / "out")
    assert "obs (RINEX observation: 4 measurements)" in found.value.message
    assert "receiver.bin (Septentrio SBF: 160 measurements, 200 inertial samples)" in found.value.message
    assert "leave one of them out" in found.value.advice
    assert not (tmp_path / "out").exists()


def test_samples_in_files_of_two_formats_are_refused(tmp_path: Path) -> None:
    inputs = [receiver(tmp_path), autopilot(tmp_path), inertial_unit(tmp_path)]
    with pytest.raises(InputError, match="inertial samples are in files of 2 formats"):
        convert(inputs, tmp_path / "out")


def test_two_formats_without_measurements_and_fixes_are_refused(tmp_path: Path) -> None:
    (tmp_path / "receiver.ubx").write_bytes(pvt(fix=4) + pvt(1000, fix=4))
    with pytest.raises(
        InputError, match=r"none of the files holds raw measurements or fixes.*receiver\.ubx.*unit\.sbf"
    ):
        convert([tmp_path / "receiver.ubx", inertial_unit(tmp_path)], tmp_path / "out")


def test_fixes_of_one_file_and_samples_of_another_become_one_flight(tmp_path: Path) -> None:
    first_s = NOON_MS / 1000
    thursday = (2025, 5, 22)  # of the unit's week
    (tmp_path / "receiver.ubx").write_bytes(b"".join(pvt(250 * k, date=thursday) for k in range(9)))
    convert([tmp_path / "receiver.ubx", inertial_unit(tmp_path, first_s, solution=False)], tmp_path / "a")
    flight = Flight.load(tmp_path / "a" / "flight.toml")
    assert flight.config.imu is not None and flight.config.reference is None
    assert [[path.name for path in each.files] for each in flight.config.sensor] == [["fixes.csv"]] * 2
    # the other file's solution is the reference then
    done = convert([tmp_path / "receiver.ubx", inertial_unit(tmp_path, first_s)], tmp_path / "b")
    flight = Flight.load(tmp_path / "b" / "flight.toml")
    assert flight.config.reference is not None and done.log.solution_from == "filter"
    assert [[path.name for path in each.files] for each in flight.config.sensor] == [["fixes.csv"]] * 2
    assert done.log.fixes is not None and len(done.log.fixes.t_ns) == 9


def test_files_of_different_days_are_refused_with_both_spans(tmp_path: Path) -> None:
    with pytest.raises(TimeError, match="do not overlap") as found:
        convert([autopilot(tmp_path), receiver(tmp_path, 2381, TOW_S + 86_400.0)], tmp_path / "out")
    assert "receiver.ubx from 2025-08-29 17:30:39" in found.value.message
    assert "autopilot.ulg from 2025-08-28 17:30:39" in found.value.message
    assert "time.offset_s" in found.value.advice


def test_solutions_and_further_samples_that_are_not_taken_are_named() -> None:
    none = np.full((2, 3), np.nan)
    t_ns = np.array([10**18, 10**18 + 10**9])
    place = np.full((2, 3), 45.0)
    fixes = own_reference(t_ns, place, np.full((2, 9), 1.0), attitude=none)
    filtered = own_reference(t_ns, place, np.full((2, 9), 1.0), attitude=np.zeros((2, 3)))
    field = (FurtherSamples("magnetometer", "Mag", t_ns, np.zeros((2, 3))),)
    gnss = replace(no_measurements(), t_ns=t_ns)
    imu = ImuTable(t_ns, np.zeros((2, 3)), np.zeros((2, 3)))
    phone = FormatLog("android", (Path("phone.txt"),), ReceiverLog(gnss, solution=fixes, further=field))
    unit = FormatLog("sbf", (Path("unit.sbf"),), ReceiverLog(no_measurements(), imu=imu, solution=filtered))
    log = join_logs([phone, unit])
    assert log.solution is filtered and log.imu is imu and log.further == () and log.gnss is gnss
    assert [event.kind for event in log.events] == ["reference_not_used", "sensor_samples_not_used"]
    assert all(event.detail.startswith("phone.txt: ") for event in log.events)
    bare = FormatLog(
        "sbf", (Path("unit.sbf"),), ReceiverLog(no_measurements(), solution=filtered, further=field)
    )
    assert join_logs([replace(phone, log=ReceiverLog(gnss)), bare]).further == field


def test_heading_of_the_receiver_joins_the_further_samples_of_the_inertial_log() -> None:
    t_ns = np.array([10**18, 10**18 + 10**9])
    gnss = replace(no_measurements(), t_ns=t_ns)
    imu = ImuTable(t_ns, np.zeros((2, 3)), np.zeros((2, 3)))
    pressure = (FurtherSamples("barometer", "Baro", t_ns, np.full((2, 1), 1000.0)),)
    heading = (FurtherSamples("heading", "AttEuler", t_ns, np.full((2, 2), 1.0)),)
    receiver = FormatLog("sbf", (Path("receiver.sbf"),), ReceiverLog(gnss, further=heading))
    autopilot = ReceiverLog(no_measurements(), imu=imu, further=pressure)

    log = join_logs([receiver, FormatLog("ulog", (Path("log.ulg"),), autopilot)])

    assert log.further == (*pressure, *heading) and log.events == []


def test_navigation_files_alone_are_refused(tmp_path: Path) -> None:
    (tmp_path / "brdc.rnx").write_text(NAV_HEADER + message())
    with pytest.raises(InputError, match="only navigation files"):
        convert([tmp_path / "brdc.rnx"], tmp_path / "out")


def test_nearest_name_of_a_missing_file_is_never_a_hidden_one(tmp_path: Path) -> None:
    for name in (".insgnss.json", ".gnss_obs.csv.swp", "gnss_log.csv"):
        (tmp_path / name).write_text("x")
    with pytest.raises(MissingFileError) as found:
        existing_file(tmp_path / "gnss_obs.csv")
    assert found.value.advice == "nearest in that folder: gnss_log.csv"


def test_file_in_a_folder_that_is_not_there_says_where_paths_start(tmp_path: Path) -> None:
    with pytest.raises(
        MissingFileError, match=r"no folder.*in a flight file.*its own folder.*on the command line"
    ):
        existing_file(tmp_path / "nowhere" / "log.ubx")
