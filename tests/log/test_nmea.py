"""NMEA becomes a reference, or the fixes of a replay: numbers by hand, by another parser, and of our own export."""

from __future__ import annotations

import datetime as dt
import functools
import gzip
import operator
import re
from pathlib import Path

import numpy as np
import pynmea2
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insgnss.constants import NS_PER_WEEK
from insgnss.errors import InputError, TimeError
from insgnss.geodesy.sea_level import geoid_height
from insgnss.gpstime import ns_to_week_seconds, utc_to_ns
from insgnss.log.convert import convert
from insgnss.log.detect import detect_format
from insgnss.log.flight import Flight
from insgnss.log.nmea import read_nmea
from insgnss.log.receiver import LogDeclarations, ReceiverLog
from insgnss.log.receiver_files import read_receiver
from insgnss.log.ubx.reader import read_ubx
from insgnss.report.nmea import as_nmea
from insgnss.tables import ReferenceTable
from tests.log.test_ubx_solution import pvt
from tests.log.ubx_writing import frame, rawx
from tests.report.runs import WEEK, made_run

NOON = dt.datetime(2025, 8, 28, 12, 0, 0)


def sentence(body: str) -> str:
    return f"${body}*{functools.reduce(operator.xor, body.encode()):02X}\r\n"


def gga(clock: str = "120000.00", quality: str = "1", geoid: str = "47.5", lat: str = "4807.038,N") -> str:
    return sentence(f"GNGGA,{clock},{lat},01131.000,W,{quality},12,0.8,545.4,M,{geoid},M,,")


def rmc(clock: str = "120000.00", day: str = "280825", motion: str = "10.0,090.0", status: str = "A") -> str:
    return sentence(f"GNRMC,{clock},{status},4807.038,N,01131.000,W,{motion},{day},,,A")


def gst(clock: str = "120000.00", sigmas: str = "0.6,0.4,1.1") -> str:
    return sentence(f"GNGST,{clock},1.5,0.7,0.4,45.0,{sigmas}")


EPOCHS = "".join(
    text for k in range(4) for text in (rmc(f"12000{k}.00"), gga(f"12000{k}.00"), gst(f"12000{k}.00"))
).encode()


def resealed(data: bytes) -> bytes:
    """Return sentences with the checksums that they ought to have."""
    return re.sub(
        rb"\$([^$*\r\n]*)\*[^\r\n]*",
        lambda match: b"$%b*%02X" % (match[1], functools.reduce(operator.xor, match[1], 0)),
        data,
    )


def read(folder: Path, *sentences: str, date: dt.date | None = None) -> ReceiverLog:
    (folder / "log.nmea").write_text("".join(sentences), newline="")
    return read_nmea([folder / "log.nmea"], date)


def fixes(folder: Path, *sentences: str, date: dt.date | None = None) -> ReferenceTable:
    found = read(folder, *sentences, date=date).solution
    assert found is not None
    return found


def told(log: ReceiverLog) -> dict[str, str]:
    return {event.kind: event.detail for event in log.events}


def test_epoch_of_three_sentences_has_place_velocity_and_sigmas(tmp_path: Path) -> None:
    found = fixes(tmp_path, rmc(), gga(), gst(), gga("120000.25"), rmc("120000.25", motion="0.02,"))
    assert found.t_ns.tolist() == [utc_to_ns(NOON) + k * 250_000_000 for k in range(2)]
    assert (found.lat_deg[0], found.lon_deg[0]) == pytest.approx(
        (48.0 + 7.038 / 60, -(11.0 + 31.0 / 60)), abs=1e-12
    )
    assert found.h_m.tolist() == pytest.approx([592.9] * 2)  # above the sea, and the sea above the ellipsoid
    assert found.v_n[0, :2] == pytest.approx([0.0, 10.0 * 1852.0 / 3600.0], abs=1e-12)
    assert found.v_n[1, :2].tolist() == [0.0, 0.0]  # too slow for a direction
    assert np.isnan(found.v_n[:, 2]).all() and (found.quality == 2.0).all()
    assert found.sigma is not None and found.sigma[0, :3].tolist() == [0.6, 0.4, 1.1]
    assert np.isnan(found.sigma[1]).all()


def test_numbers_are_those_of_another_parser(tmp_path: Path) -> None:
    texts = [rmc(motion="3.21,213.4"), gga(), gst(), rmc("120001.00"), gga("120001.00", lat="0007.5,S")]
    parsed = [pynmea2.parse(text.strip()) for text in texts]
    found = fixes(tmp_path, *texts)
    for k, place in enumerate((parsed[1], parsed[4])):
        assert (found.lat_deg[k], found.lon_deg[k]) == pytest.approx(
            (place.latitude, place.longitude), abs=1e-12
        )
        assert found.h_m[k] == pytest.approx(place.altitude + float(place.geo_sep))
    speed = parsed[0].spd_over_grnd * 1852.0 / 3600.0
    course = np.radians(parsed[0].true_course)
    assert found.v_n[0, :2] == pytest.approx([speed * np.cos(course), speed * np.sin(course)])
    assert found.sigma is not None
    assert found.sigma[0, :3].tolist() == [
        parsed[2].std_dev_latitude,
        parsed[2].std_dev_longitude,
        parsed[2].std_dev_altitude,
    ]


def test_export_of_a_run_read_again_is_the_run(tmp_path: Path) -> None:
    run = made_run(30.0)
    (tmp_path / "log.nmea").write_bytes(as_nmea(run))
    found, nav = read_nmea([tmp_path / "log.nmea"]).solution, run.nav
    assert found is not None and found.sigma is not None and len(found.t_ns) == len(nav)
    at_s = ns_to_week_seconds(found.t_ns, WEEK)
    assert np.abs(nav["time_s"] - at_s).max() < 1e-3
    assert (
        np.abs(nav["lat_deg"] - found.lat_deg).max() < 2e-8 and np.abs(nav["h_m"] - found.h_m).max() < 0.011
    )
    assert (
        np.abs(nav["vn_mps"] - found.v_n[:, 0]).max() < 0.1
    )  # the course has a hundredth of a degree or less
    assert np.abs(nav["sd_n_m"] - found.sigma[:, 0]).max() < 0.01


def test_fixes_of_no_satellites_and_unknown_times_are_counted(tmp_path: Path) -> None:
    others = [gga("", quality="0"), gga("120001.00", quality="0"), gga("120002.00", quality="6"), rmc("")]
    log = read(tmp_path, rmc(), gga(), *others, gga("120003.00"))
    assert log.solution is not None and len(log.solution.t_ns) == 2
    assert "4 sentences without a time or a fix" in told(log)["nmea_no_fix"]


def test_damaged_and_cut_sentences_are_counted(tmp_path: Path) -> None:
    damaged = [
        gga("120001.00").replace("545.4", "945.4"),  # its checksum does not hold
        gga("120002.00")[:40] + "\r\n",
        sentence("GNGGA,120003.00,4867.038,N,01131.000,W,1,12,0.8,545.4,M,47.5,M,,"),  # 67 minutes
        sentence("GNGGA,120004.00,4807.038,N,01131.000,W,1,12,0.8,nan,M,47.5,M,,"),
        sentence("GNGGA,250005.00,4807.038,N,01131.000,W,1,12,0.8,545.4,M,47.5,M,,"),
        sentence("GNGGA,120006.00"),
        rmc("120007.00", day="310225"),
        rmc("120008.00", motion="inf,1.0"),
    ]
    log = read(
        tmp_path, rmc(), gga(), *damaged, gga("120009.00"), sentence("GPGSV,1,1,00"), sentence("PUBX,00,1")
    )
    assert log.solution is not None and len(log.solution.t_ns) == 2
    assert f"{len(damaged)} sentences" in told(log)["nmea_damaged"]
    assert "1 GSV, 1 PUBX" in told(log)["nmea_not_used"]


def unchecked(text: str) -> str:
    return text.partition("*")[0] + "\r\n"


def test_sentences_of_a_talker_that_never_states_a_check_sum_are_read_and_told(tmp_path: Path) -> None:
    texts = [unchecked(text) for k in range(3) for text in (rmc(f"12000{k}.00"), gga(f"12000{k}.00"))]
    log = read(tmp_path, "$not a sentence\r\n", *texts, unchecked(sentence("GPGSV,1,1,00")))

    plain = [text for k in range(3) for text in (rmc(f"12000{k}.00"), gga(f"12000{k}.00"))]
    assert detect_format(tmp_path / "log.nmea") == "nmea"
    assert log.solution is not None
    assert log.solution.lat_deg.tolist() == fixes(tmp_path, *plain).lat_deg.tolist()
    assert "6 sentences without a checksum read" in told(log)["nmea_unchecked"]
    assert "nmea_damaged" not in told(log) and told(log)["nmea_not_used"].endswith("not read: 1 GSV")


def test_sentence_without_check_sum_is_cut_where_others_of_its_kind_have_one(tmp_path: Path) -> None:
    texts = [rmc(), gga(), unchecked(gga("120001.00")), gga("120002.00"), unchecked(gst("120002.00"))]
    log = read(tmp_path, *texts, unchecked(gst())[:20] + "\r\n", gst("120003.00")[:-5])

    assert log.solution is not None and len(log.solution.t_ns) == 2
    assert "3 sentences" in told(log)["nmea_damaged"]
    assert "1 sentences without a checksum" in told(log)["nmea_unchecked"]


def test_date_goes_on_over_midnight_and_back_to_the_first_epoch(tmp_path: Path) -> None:
    texts = [
        gga("235959.50"),
        gga("000000.00"),
        gga("000000.50"),
        rmc("000000.50", day="290825"),
        gga("235959.00"),
    ]
    found = fixes(tmp_path, *texts, gga("000001.00"))
    begin = utc_to_ns(dt.datetime(2025, 8, 29))
    assert ((found.t_ns - begin) / 1e9).tolist() == [-0.5, 0.0, 0.5, 86_399.0, 86_401.0]


def test_date_is_declared_where_no_sentence_states_it(tmp_path: Path) -> None:
    texts = [gga(), gga("120001.00")]
    assert fixes(tmp_path, *texts, date=NOON.date()).t_ns[0] == utc_to_ns(NOON)
    with pytest.raises(TimeError, match=r"states the date(.|\n)*--date"):
        read(tmp_path, *texts)
    with pytest.raises(InputError, match="fewer than two GNSS fixes"):
        read(tmp_path, rmc(), gga())


def test_places_that_no_satellites_gave_are_named_in_the_error(tmp_path: Path) -> None:
    texts = [rmc(), gga(), *(gga(f"12000{k}.00", quality="7") for k in range(1, 4)), gga(quality="0")]
    with pytest.raises(InputError, match="3 GGA state a position that is typed in") as caught:
        read(tmp_path, *texts)
    assert "write quality 1 into GGA" in caught.value.advice


def test_height_of_the_geoid_that_is_not_stated_is_that_of_the_model(tmp_path: Path) -> None:
    log = read(tmp_path, rmc(), gga(geoid=""), gga("120001.00"))
    assert log.solution is not None
    place = log.solution.lat_deg[:1], log.solution.lon_deg[:1]
    assert log.solution.h_m == pytest.approx([545.4 + float(geoid_height(*place)[0]), 592.9])
    assert "1 fixes state no height of the geoid" in told(log)["nmea_geoid"]


def test_format_is_found_by_a_sound_sentence(tmp_path: Path) -> None:
    path = tmp_path / "log"
    path.write_bytes(gzip.compress(("noise\r\n" + gga()).encode()))
    assert detect_format(path) == "nmea"
    path.write_bytes(gga().encode() + pvt())  # a receiver's own format counts before
    assert detect_format(path) == "ubx"


def test_level_velocity_makes_a_sensor_of_two_components(tmp_path: Path) -> None:
    read(tmp_path, *(text for k in range(9) for text in (rmc(f"12000{k}.00"), gga(f"12000{k}.00"))))
    convert([tmp_path / "log.nmea"], tmp_path / "out")
    text = (tmp_path / "out" / "flight.toml").read_text()
    assert 'columns = { velocity = ["vn", "ve", "none"] }' in text
    flight = Flight.load(tmp_path / "out" / "flight.toml")
    assert [sensor.kind for sensor in flight.config.sensor] == ["position", "velocity"]


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=60), st.integers(0, 400), st.integers(0, 400))
def test_any_damage_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, noise: bytes, at: int, end: int
) -> None:
    path = tmp_path_factory.mktemp("nmea") / "log"
    path.write_bytes(resealed(EPOCHS[:at] + noise + EPOCHS[end:]))
    try:
        found = read_nmea([path]).solution
    except InputError:
        return
    assert found is not None and np.isfinite([found.lat_deg, found.lon_deg, found.h_m]).all()


@pytest.mark.parametrize("dated", (True, False))
def test_sentences_between_a_receivers_own_messages_are_its_solution(tmp_path: Path, dated: bool) -> None:
    path = tmp_path / "log.ubx"
    sentences = EPOCHS if dated else re.sub(rb"\$GNRMC[^$]*", b"", EPOCHS)
    noon = utc_to_ns(NOON)
    raw = rawx(noon % NS_PER_WEEK / 1e9, week=noon // NS_PER_WEEK)
    path.write_bytes(raw + sentences)
    log = read_receiver("ubx", [path], LogDeclarations())
    assert len(log.gnss.t_ns) == 1 and log.solution is not None and len(log.solution.t_ns) == 4
    assert log.solution.t_ns[0] == noon and log.satellite_fixes() is log.solution
    assert "GGA and RMC" in told(log)["reference_own"]
    # the receiver's binary solution counts more
    path.write_bytes(raw + sentences + pvt() + pvt(250) + pvt(500))
    own = read_receiver("ubx", [path], LogDeclarations()).solution
    assert own is not None and len(own.t_ns) == 3


def test_fixes_of_a_log_whose_own_messages_hold_nothing(tmp_path: Path) -> None:
    path = tmp_path / "log.ubx"
    acknowledged = frame(0x0501, b"\x06\x8a")
    path.write_bytes(acknowledged + EPOCHS + acknowledged)
    assert detect_format(path) == "ubx"
    log = read_receiver("ubx", [path], LogDeclarations())
    assert log.solution is not None and len(log.solution.t_ns) == 4 and not len(log.gnss.t_ns)
    path.write_bytes(acknowledged + gga(quality="0").encode() * 3)
    with pytest.raises(InputError, match="the UBX file holds no raw measurement"):
        read_receiver("ubx", [path], LogDeclarations())


@pytest.mark.real_data
def test_real_sentences_state_what_the_receivers_own_messages_state(data_root: Path, tmp_path: Path) -> None:
    raw = data_root / "walk_boulder_20250828" / "raw" / "gnss_1730.ubx"
    # the same receiver wrote both into one file
    (tmp_path / "log").write_bytes(
        b"".join(re.findall(rb"\$G[^$\r\n]{5,100}\*[0-9A-F]{2}\r\n", raw.read_bytes()))
    )
    found, own = read_nmea([tmp_path / "log"]).solution, read_ubx([raw]).solution
    assert found is not None and own is not None and len(found.t_ns) == 536
    assert np.array_equal(found.t_ns, own.t_ns)
    assert (
        np.abs(found.lat_deg - own.lat_deg).max() < 1e-7 and np.abs(found.lon_deg - own.lon_deg).max() < 1e-7
    )
    assert np.abs(found.h_m - own.h_m).max() < 2e-3  # two heights of a millimetre each
    # speeds of a thousandth of a knot, courses of a hundredth of a degree; without a course below 0.1 m/s
    moving = np.hypot(own.v_n[:, 0], own.v_n[:, 1]) > 0.5
    assert moving.sum() > 100
    assert np.nanmax(np.abs(found.v_n[moving, :2] - own.v_n[moving, :2])) < 0.01
