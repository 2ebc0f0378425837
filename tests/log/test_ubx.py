"""UBX files: frames among foreign bytes and damage, and the real log against its published decoding and ``pyubx2``."""

from __future__ import annotations

import gzip
import struct
from pathlib import Path

import numpy as np
import pandas as pd
import pymap3d
import pytest
from pyubx2 import UBXReader

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import InputError, MissingFileError
from insgnss.log.receiver import ReceiverLog
from insgnss.log.rinex.navigation import read_navigation
from insgnss.log.ubx.frames import frames_in
from insgnss.log.ubx.reader import read_ubx
from insgnss.tables import EphemerisTable, Float64
from tests.log.ubx_writing import TOW_S, WEEK, frame, measurement, rawx

SET = "walk_boulder_20250828"
NMEA = b"$GNGLL,4005.8,N,10508.8,W,173039.75,A,D*67\r\n"
RTCM = bytes.fromhex("d300133ed7d30202980edeef34b4bd62ac0941986f33360b98")
# an hour of it is as long; in the test only so much that pyubx2 needs a second
ORACLE_BYTES = 300_000


def write(folder: Path, *pieces: bytes, name: str = "log.ubx") -> Path:
    path = folder / name
    path.write_bytes(b"".join(pieces))
    return path


def kinds(log: ReceiverLog) -> set[str]:
    return {event.kind for event in log.events}


@pytest.fixture(scope="module")
def real_path(data_root: Path) -> Path:
    path = data_root / SET / "raw" / "gnss_1730.ubx"
    if not path.is_file():
        pytest.skip(f"no real UBX file: {path} does not exist")
    return path


@pytest.fixture(scope="module")
def real(real_path: Path) -> ReceiverLog:
    return read_ubx([real_path])


# --------------------------------------------------------------------------------------------------- the real log


@pytest.mark.real_data
def test_real_observations_equal_the_published_table_to_its_printed_digits(
    real: ReceiverLog, data_root: Path
) -> None:
    gnss = real.gnss
    ours = pd.DataFrame(
        {
            "t_ns": gnss.t_ns,
            "sv": np.array(gnss.sv_names)[gnss.sv],
            "signal": np.array(gnss.signal_names)[gnss.signal],
            "pseudorange_m": gnss.pseudorange_m,
            "doppler_hz": gnss.doppler_hz,
            "cn0_dbhz": gnss.cn0_dbhz,
            "carrier_phase_cycles": gnss.carrier_cycles,
        }
    )
    ours = ours[ours.sv.str[0] != "S"]  # the table leaves SBAS out
    table = pd.read_csv(data_root / SET / "gnss_obs.csv")
    table["t_ns"] = (table.time_s * 1000).round().astype(np.int64) * 1_000_000 + WEEK * NS_PER_WEEK
    keys = ["t_ns", "sv", "signal"]
    both = table.merge(ours, on=keys, how="outer", suffixes=("", "_ours"), indicator=True)

    assert (both["_merge"] == "both").all() and len(both) == len(table) == 36_271
    half_digit = {
        "pseudorange_m": 5e-4,
        "doppler_hz": 5e-4,
        "cn0_dbhz": 0.0,
        "carrier_phase_cycles": 5e-5,
    }
    for name, half in half_digit.items():
        difference = (both[name] - both[name + "_ours"]).abs()
        assert (both[name].isna() == both[name + "_ours"].isna()).all()
        assert difference.max() <= half * 1.001, name  # half of the last printed digit, and rounding


@pytest.mark.real_data
def test_real_ephemerides_equal_an_independent_decoding_of_the_same_log(
    real: ReceiverLog, data_root: Path
) -> None:
    published = read_navigation([data_root / SET / "nav_decoded_from_ubx.rnx"])[0].ephemerides
    assert real.navigation is not None
    ours = real.navigation.ephemerides
    row = {
        key: k for k, key in enumerate(zip(ours.sv_names, ours.message, ours.toe_ns.tolist(), strict=True))
    }
    rows = [
        row[key] for key in zip(published.sv_names, published.message, published.toe_ns.tolist(), strict=True)
    ]

    assert len(rows) == 11  # GPS and Galileo I/NAV: the published file holds no BeiDou
    kinds_of = [(sv[0], message) for sv, message in zip(ours.sv_names, ours.message, strict=True)]
    assert kinds_of.count(("G", "LNAV")) == 4 and kinds_of.count(("E", "INAV")) == 7
    assert kinds_of.count(("C", "D1")) == 8
    for name in EphemerisTable.__dataclass_fields__:
        if name not in ("sv_names", "message"):
            expected, found = getattr(published, name), getattr(ours, name)[rows]
            # RINEX prints 13 digits
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=0.0, err_msg=name)
    assert real.navigation.leap_seconds == 18


@pytest.mark.real_data
def test_real_fnav_and_inav_of_one_issue_hold_the_same_orbit(real: ReceiverLog) -> None:
    assert real.navigation is not None
    table = real.navigation.ephemerides
    row = {key: k for k, key in enumerate(zip(table.sv_names, table.message, table.issue, strict=True))}
    pairs = [
        (row[sv, "INAV", issue], k)
        for (sv, kind, issue), k in row.items()
        if kind == "FNAV" and (sv, "INAV", issue) in row
    ]

    assert len(pairs) == 7
    for name in ("toe_ns", "sqrt_a", "e", "m0", "i0", "omega0", "omega", "delta_n", "crs", "cuc", "cis"):
        values = getattr(table, name)
        assert all(values[i] == values[f] for i, f in pairs), name
    # the clocks refer to different pairs of signals: they differ by nanoseconds, not more
    assert all(0.0 < abs(table.af0[i] - table.af0[f]) < 20e-9 for i, f in pairs)


def satellite_position_m(table: EphemerisTable, k: int, t_ns: int) -> tuple[Float64, float]:
    """Return ECEF position and clock [s] by the textbook's steps, for satellites that are not geostationary."""
    mu, rate = (3.986005e14 if table.sv_names[k][0] == "G" else 3.986004418e14), 7.292115e-5
    t = (t_ns - int(table.toe_ns[k])) / 1e9
    a = table.sqrt_a[k] ** 2
    mean = table.m0[k] + (np.sqrt(mu / a**3) + table.delta_n[k]) * t
    anomaly = mean
    for _ in range(20):
        anomaly = mean + table.e[k] * np.sin(anomaly)
    true = np.arctan2(np.sqrt(1 - table.e[k] ** 2) * np.sin(anomaly), np.cos(anomaly) - table.e[k])
    phi = true + table.omega[k]
    s2, c2 = np.sin(2 * phi), np.cos(2 * phi)
    u = phi + table.cus[k] * s2 + table.cuc[k] * c2
    r = a * (1 - table.e[k] * np.cos(anomaly)) + table.crs[k] * s2 + table.crc[k] * c2
    i = table.i0[k] + table.idot[k] * t + table.cis[k] * s2 + table.cic[k] * c2
    node = table.omega0[k] + (table.omega_dot[k] - rate) * t - rate * table.toe_sow_s[k]
    x, y = r * np.cos(u), r * np.sin(u)
    position = np.array(
        [
            x * np.cos(node) - y * np.cos(i) * np.sin(node),
            x * np.sin(node) + y * np.cos(i) * np.cos(node),
            y * np.sin(i),
        ]
    )
    dt = (t_ns - int(table.toc_ns[k])) / 1e9
    relativity = -2 * np.sqrt(mu) / 299_792_458.0**2 * table.e[k] * table.sqrt_a[k] * np.sin(anomaly)
    return position, float(table.af0[k] + table.af1[k] * dt + table.af2[k] * dt**2 + relativity)


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("system", "signal", "satellites"), [("G", "C5Q", 3), ("E", "C5Q", 6), ("C", "C6I", 6)]
)
def test_real_ephemerides_predict_the_measured_ranges(
    real: ReceiverLog, data_root: Path, system: str, signal: str, satellites: int
) -> None:
    """BeiDou has no published decoding: each field of a message moves the satellite by far more than the bound."""
    assert real.navigation is not None
    table, gnss = real.navigation.ephemerides, real.gnss
    reference = pd.read_csv(data_root / SET / "reference.csv").iloc[0]
    receiver = np.array(
        pymap3d.geodetic2ecef(reference["lat_deg"], reference["lon_deg"], reference["h_m"]), dtype=np.float64
    )
    first = gnss.t_ns == gnss.t_ns[0]
    residual = {}
    for k, sv in enumerate(table.sv_names):
        rows = np.flatnonzero(
            first
            & (np.array(gnss.sv_names)[gnss.sv] == sv)
            & (gnss.signal == gnss.signal_names.index(signal))
        )
        if sv[0] != system or not len(rows) or table.message[k] == "FNAV":
            continue
        measured = float(gnss.pseudorange_m[rows[0]])
        flight_s = measured / 299_792_458.0
        position, clock_s = satellite_position_m(table, k, int(gnss.t_ns[0]) - round(flight_s * 1e9))
        turn = 7.292115e-5 * flight_s
        x, y, z = position
        turned = np.array([x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn), z])
        residual[sv] = measured - float(np.linalg.norm(turned - receiver)) + 299_792_458.0 * clock_s
    spread = np.array(list(residual.values())) - np.median(list(residual.values()))

    assert len(residual) >= satellites
    # ionosphere and troposphere at low elevations, group delays and 10 m of the reference: 12 m here
    assert np.abs(spread).max() < 30.0, residual


@pytest.mark.real_data
def test_real_measurements_equal_those_of_another_parser(real_path: Path, tmp_path: Path) -> None:
    data = real_path.read_bytes()[:ORACLE_BYTES]
    path = write(tmp_path, data)
    frames = frames_in(path, path.read_bytes())
    expected: dict[str, int] = {}
    rows = []
    with path.open("rb") as stream:
        for _, parsed in UBXReader(stream, protfilter=2, quitonerror=0):
            expected[parsed.identity] = expected.get(parsed.identity, 0) + 1
            if parsed.identity == "RXM-RAWX":
                for k in range(1, parsed.numMeas + 1):
                    names = ("prMes", "cpMes", "doMes", "gnssId", "svId", "cno", "prValid", "cpValid")
                    rows.append([getattr(parsed, f"{name}_{k:02d}") for name in names])
    found = {"RXM-RAWX": 0x0215, "RXM-SFRBX": 0x0213, "NAV-PVT": 0x0107}

    assert {name: len(frames.of(kind)) for name, kind in found.items()} == expected
    oracle = np.array(rows, dtype=np.float64)
    gnss = read_ubx([path]).gnss
    assert len(gnss.t_ns) == len(oracle)
    letters = {0.0: "G", 1.0: "S", 2.0: "E", 3.0: "C"}
    numbers = oracle[:, 4] - 100.0 * (oracle[:, 3] == 1.0)
    names = [f"{letters[system]}{int(n):02d}" for system, n in zip(oracle[:, 3], numbers, strict=True)]
    assert np.array(gnss.sv_names)[gnss.sv].tolist() == names
    np.testing.assert_array_equal(gnss.pseudorange_m, np.where(oracle[:, 6] > 0, oracle[:, 0], np.nan))
    np.testing.assert_array_equal(gnss.carrier_cycles, np.where(oracle[:, 7] > 0, oracle[:, 1], np.nan))
    np.testing.assert_array_equal(gnss.doppler_hz, oracle[:, 2])
    np.testing.assert_array_equal(gnss.cn0_dbhz, oracle[:, 5])


@pytest.mark.real_data
@pytest.mark.parametrize("parts", [2, 5])
def test_real_log_cut_into_files_reads_as_the_whole(
    real_path: Path, real: ReceiverLog, tmp_path: Path, parts: int
) -> None:
    data = real_path.read_bytes()
    frames = frames_in(real_path, data)
    starts = [offset - 6 for offset, _ in frames.of(0x0215)][:: 536 // parts + 1]
    pieces = [data[a:b] for a, b in zip([0, *starts[1:]], [*starts[1:], len(data)], strict=True)]
    files = [write(tmp_path, piece, name=f"{k}.ubx") for k, piece in enumerate(pieces)]
    log = read_ubx(files)

    assert len(files) == parts
    assert log.navigation is not None and real.navigation is not None
    for name in ("t_ns", "sv", "signal", "pseudorange_m", "carrier_cycles", "lli"):
        np.testing.assert_array_equal(getattr(log.gnss, name), getattr(real.gnss, name))
    assert log.navigation.ephemerides.sv_names == real.navigation.ephemerides.sv_names


@pytest.mark.real_data
def test_real_log_is_read_at_several_megabytes_a_second(real_path: Path, benchmark: object) -> None:
    assert callable(benchmark)
    log = benchmark(read_ubx, [real_path])

    assert len(log.gnss.t_ns) == 37_850


# ------------------------------------------------------------------------------------------------ frames and damage


def test_frames_are_found_among_nmea_and_rtcm(tmp_path: Path) -> None:
    path = write(tmp_path, NMEA, rawx(), RTCM, NMEA, rawx(TOW_S + 1.0), NMEA)
    log = read_ubx([path])

    assert len(log.gnss.t_ns) == 2
    told = next(event for event in log.events if event.kind == "ubx_foreign_bytes")
    assert str(3 * len(NMEA) + len(RTCM)) in told.detail


def test_wrong_check_sum_is_told_with_its_place_and_the_next_frame_is_read(tmp_path: Path) -> None:
    broken = bytearray(rawx())
    broken[30] ^= 4
    log = read_ubx([write(tmp_path, NMEA, bytes(broken), rawx(TOW_S + 1.0))])

    assert log.gnss.t_ns.tolist() == [round((TOW_S + 1.0) * 1000) * 1_000_000 + WEEK * NS_PER_WEEK]
    assert [f"byte {len(NMEA)}:" in e.detail for e in log.events if e.kind == "ubx_checksum"] == [True]


def test_exchanged_bytes_are_found_by_the_second_sum(tmp_path: Path) -> None:
    broken = bytearray(rawx())
    assert broken[6] != broken[13]
    broken[6], broken[13] = broken[13], broken[6]
    log = read_ubx([write(tmp_path, bytes(broken), rawx(TOW_S + 1.0))])

    assert len(log.gnss.t_ns) == 1 and "ubx_checksum" in kinds(log)


def test_frame_that_begins_inside_a_damaged_one_is_found(tmp_path: Path) -> None:
    # the length of the first was hit: it seems to reach over the second
    broken = bytearray(rawx())
    broken[4] = 90
    log = read_ubx([write(tmp_path, bytes(broken), rawx(TOW_S + 1.0), rawx(TOW_S + 2.0))])

    assert len(log.gnss.t_ns) == 2


@pytest.mark.parametrize("kept", [1, 5, 7, 20])
def test_file_that_ends_within_a_frame_tells_where(tmp_path: Path, kept: int) -> None:
    whole = rawx()
    log = read_ubx([write(tmp_path, whole, rawx(TOW_S + 1.0)[:kept])])

    assert len(log.gnss.t_ns) == 1
    if kept > 1:
        assert f"byte {len(whole)}:" in next(e.detail for e in log.events if e.kind == "ubx_cut")
    else:
        assert "ubx_foreign_bytes" in kinds(log)


def test_length_beyond_the_end_hides_no_frame_behind_it(tmp_path: Path) -> None:
    log = read_ubx([write(tmp_path, b"\xb5\x62\x02\x15\xff\xff", rawx())])

    assert len(log.gnss.t_ns) == 1 and "ubx_cut" not in kinds(log)


def test_many_wrong_check_sums_are_summed_up(tmp_path: Path) -> None:
    broken = bytearray(rawx())
    broken[30] ^= 4
    log = read_ubx([write(tmp_path, bytes(broken) * 50, rawx())])
    told = [event for event in log.events if event.kind == "ubx_checksum"]

    assert len(told) == 21 and "50 in all; frames refused" in told[-1].detail


def test_many_epochs_without_a_date_are_summed_up(tmp_path: Path) -> None:
    log = read_ubx([write(tmp_path, rawx(-1.0) * 50, rawx())])
    told = [event for event in log.events if event.kind == "ubx_damaged"]

    assert len(told) == 21 and "50 in all; epochs refused" in told[-1].detail


def test_messages_of_other_kinds_are_listed(tmp_path: Path) -> None:
    log = read_ubx([write(tmp_path, rawx(), frame(0x0A09, b"\0" * 60), frame(0x0A09, b"\0" * 60))])

    assert "2 of 0A 09" in next(event.detail for event in log.events if event.kind == "ubx_not_used")


def test_gzipped_file_reads_as_the_plain_one(tmp_path: Path) -> None:
    path = write(tmp_path, gzip.compress(rawx()), name="log.ubx.gz")

    assert len(read_ubx([path]).gnss.t_ns) == 1


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (NMEA * 3, "no UBX frame"),
        (frame(0x0A09, b"\0" * 60), "no raw measurement"),
        (rawx(measurements=()), "no raw measurement"),
        (b"", "empty"),
    ],
)
def test_file_without_measurements_is_an_error_with_advice(tmp_path: Path, data: bytes, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        read_ubx([write(tmp_path, data)])
    assert caught.value.advice and "log.ubx" in str(caught.value)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="absent"):
        read_ubx([tmp_path / "absent.ubx"])


def test_time_mark_becomes_an_event_at_its_edge(tmp_path: Path) -> None:
    def mark(flags: int) -> bytes:
        payload = struct.pack("<BBHHH", 0, flags, 3, WEEK, WEEK)
        return frame(0x0D03, payload + struct.pack("<5I", 408_640_123, 456_789, 408_640_200, 5, 40))

    log = read_ubx([write(tmp_path, rawx(), mark(64 + 128), mark(64 + 4 + 16), mark(128))])
    marks = [event.t_ns for event in log.events if event.kind == "time_mark"]
    start_ns = WEEK * NS_PER_WEEK + 408_640 * NS_PER_S

    # the second is in UTC, the third has no valid time
    assert marks == [start_ns + 123_456_789, start_ns + 18 * NS_PER_S + 200_000_005]


def test_measurements_of_two_files_are_put_in_order(tmp_path: Path) -> None:
    late = write(tmp_path, rawx(TOW_S + 10.0, [measurement(sv=7)]), name="late.ubx")
    early = write(tmp_path, rawx(TOW_S, [measurement(sv=5)]), name="early.ubx")
    log = read_ubx([late, early])

    assert [log.gnss.sv_names[k] for k in log.gnss.sv] == ["G05", "G07"]
    assert "gnss_time_order" in kinds(log)
