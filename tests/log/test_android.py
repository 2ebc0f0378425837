"""Android GnssLogger files: measurements and sensors from lines made of known travel times."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from insgnss.config.sensors import Barometer, Magnetometer
from insgnss.errors import InputError
from insgnss.log.android.reader import read_android
from insgnss.log.convert import convert
from insgnss.log.imu.sensor_csv import read_sensor
from insgnss.log.receiver import ReceiverLog
from insgnss.tables import GnssTable
from tests.log.android_generator import (
    BOOT_FULL_BIAS_NS,
    C_MPS,
    COLUMNS,
    ELAPSED_MINUS_TIME_NS,
    HEADER,
    Sat,
    epoch,
    sensor,
    sent_ns,
)

L1, L5, B1, G1 = 1575.42e6, 1176.45e6, 1561.098e6, 1602e6
T = 5_000_000_000
GPS_5 = Sat(1, 5, 70_123_456, L1, "C")


def read(folder: Path, *texts: str, header: str = HEADER) -> ReceiverLog:
    path = folder / "gnss_log.txt"
    path.write_text(header + "".join(texts))
    return read_android(path)


def rows(table: GnssTable) -> dict[tuple[int, str, str], tuple[float, float]]:
    keys = zip(table.t_ns.tolist(), table.sv.tolist(), table.signal.tolist(), strict=True)
    values = zip(table.pseudorange_m.tolist(), table.doppler_hz.tolist(), strict=True)
    return {
        (t, table.sv_names[s], table.signal_names[c]): v for (t, s, c), v in zip(keys, values, strict=True)
    }


SKY = {
    ("G05", "C1C"): GPS_5,
    ("G08", "C5Q"): Sat(1, 8, 80_000_001, 1176450048.0, "Q"),
    ("R02", "C1C"): Sat(3, 2, 66_000_007, G1 - 4 * 562.5e3, "C", 0x1 | 0x80),
    ("C21", "C2I"): Sat(5, 21, 75_000_003, B1, "I"),
    ("C30", "C1P"): Sat(5, 30, 75_000_003, L1, ""),
    ("E11", "C1C"): Sat(6, 11, 85_000_005, L1, "C", 0x400 | 0x8),
    ("E12", "C1C"): Sat(6, 12, 92_345_678, L1, "C", 0x400 | 0x800),
    ("E13", "C5Q"): Sat(6, 13, 92_345_678, L5, "Q"),
    ("J02", "C1C"): Sat(4, 194, 120_000_000, L1, "C"),
    ("S33", "C1C"): Sat(2, 133, 125_000_000, L1, "C"),
    ("I05", "C5A"): Sat(7, 5, 125_000_000, L5, "A"),
}


@pytest.mark.parametrize("shift_ns", [0, 345_600 * 10**9 - 41, 86_400 * 10**9 * 3 - 40_000_000])
def test_pseudoranges_are_those_of_the_travel_times_in_every_system(tmp_path: Path, shift_ns: int) -> None:
    # the shifts let weeks and days turn over between transmission and reception
    to_week_end = -(T - BOOT_FULL_BIAS_NS) % (604_800 * 10**9)
    time_ns = T + to_week_end + shift_ns if shift_ns else T
    log = read(tmp_path, epoch(time_ns, SKY.values()), epoch(time_ns + 10**9, SKY.values()))
    found = rows(log.gnss)
    assert len(found) == 2 * len(SKY) and log.events == []
    for key, sat in SKY.items():
        code, doppler = found[time_ns - BOOT_FULL_BIAS_NS, *key]
        assert code == pytest.approx(sat.travel_ns * C_MPS / 1e9, abs=1e-6)
        assert sat.carrier_hz is not None and doppler == pytest.approx(
            -12.5 * sat.carrier_hz / C_MPS, rel=1e-6
        )
    assert log.gnss.glonass_channels == {"R02": -4}


def test_time_tag_and_pseudorange_are_exact_to_the_nanosecond_late_in_the_clocks_life(tmp_path: Path) -> None:
    time_ns = 40_000_000_000_000_001  # more digits than a float64 keeps next to the bias
    found = rows(read(tmp_path, epoch(time_ns, [GPS_5])).gnss)
    assert found[time_ns - BOOT_FULL_BIAS_NS, "G05", "C1C"][0] == pytest.approx(
        70_123_456 * C_MPS / 1e9, abs=1e-6
    )


def test_bias_of_the_first_epoch_is_kept_until_the_clock_is_set_anew(tmp_path: Path) -> None:
    texts = [epoch(T + k * 10**9, [GPS_5], count=k // 2, extra_bias=1000 * k) for k in range(4)]
    log = read(tmp_path, *texts)
    ranges = log.gnss.pseudorange_m / (C_MPS / 1e9) - 70_123_456
    assert np.round(ranges, 3).tolist() == [0.0, 1000.0, 0.0, 1000.0]
    kinds = [(e.t_ns, e.kind) for e in log.events]
    assert kinds == [(T + 2 * 10**9 - BOOT_FULL_BIAS_NS - 2000, "receiver_clock_discontinuity")]


def test_offset_within_the_epoch_moves_the_range_with_its_rate(tmp_path: Path) -> None:
    late = dataclasses.replace(GPS_5, offset_ns=2_000_000.0, rate_mps=-700.0)
    found = rows(read(tmp_path, epoch(T, [late])).gnss)
    expected = 70_123_456 * C_MPS / 1e9 + 700.0 * 2e-3
    assert found[T - BOOT_FULL_BIAS_NS, "G05", "C1C"][0] == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize(
    ("sat", "why"),
    [
        (dataclasses.replace(GPS_5, constellation=0), "unknown satellite"),
        (Sat(3, 92, 66_000_007, G1, "C", 0x1 | 0x80), "unknown satellite"),
        (dataclasses.replace(GPS_5, carrier_hz=1400e6), "unknown satellite or signal"),
        (dataclasses.replace(GPS_5, drop="TimeNanos"), "before the receiver knew"),
    ],
)
def test_line_that_is_no_row_is_told_with_its_reason(tmp_path: Path, sat: Sat, why: str) -> None:
    log = read(tmp_path, epoch(T, [dataclasses.replace(GPS_5, svid=7), sat]))
    assert log.gnss.sv_names == ("G07",) and len(log.gnss.t_ns) == 1
    assert [e.kind for e in log.events] == ["android_not_used"] and why in log.events[0].detail


@pytest.mark.parametrize(
    ("full", "why"),
    [
        (
            "-1.4e+18",
            "1 measurement(s) left out whose TimeNanos or FullBiasNanos is not written as a whole number",
        ),
        (
            "-9.99999999999999E+18",
            "1 measurement(s) left out whose TimeNanos or FullBiasNanos is not written as a whole number",
        ),
        (str(-BOOT_FULL_BIAS_NS), "1 measurement(s) left out whose FullBiasNanos is positive"),
        ("0", "1 measurement(s) before the receiver knew GPS time left out"),
    ],
)
def test_bias_that_dates_nothing_is_told_as_what_it_is(tmp_path: Path, full: str, why: str) -> None:
    # the clock was set anew between the two, so the bias of one does not date the other
    bad = epoch(T, [GPS_5]).replace(str(BOOT_FULL_BIAS_NS), full)
    log = read(tmp_path, bad, epoch(T + 10**9, [GPS_5], count=1))
    assert len(log.gnss.t_ns) == 1 and [e.kind for e in log.events] == ["android_not_used"]
    assert log.events[0].detail.partition(": ")[2].startswith(why) and ";" not in log.events[0].detail


def rewritten(text: str, name: str, form: Callable[[int], str]) -> str:
    """Return an epoch's lines with the integers of one column in another form."""
    place = COLUMNS.split(",").index(name) + 1
    lines = [line.split(",") for line in text.splitlines()]
    return "".join(
        ",".join([*cells[:place], form(int(cells[place])), *cells[place + 1 :]]) + "\n" for cells in lines
    )


@pytest.mark.parametrize("form", ["{}.0", "{}.000", "{:.14e}", "{:.15g}"])
def test_integers_that_a_table_wrote_as_floats_are_exact(tmp_path: Path, form: str) -> None:
    sats = [GPS_5, dataclasses.replace(GPS_5, svid=7, travel_ns=70_123_450)]
    text, wanted = epoch(T, sats), rows(read(tmp_path, epoch(T, sats)).gnss)
    for name in ("ReceivedSvTimeNanos", "State", "Svid", "ConstellationType"):
        text = rewritten(text, name, lambda value: form.format(value))
    log = read(tmp_path, text)
    assert rows(log.gnss) == wanted and not log.events


def test_time_of_transmission_without_its_last_digits_keeps_the_rate_and_is_told(tmp_path: Path) -> None:
    text = rewritten(epoch(T, [GPS_5]), "ReceivedSvTimeNanos", lambda value: f"{value:.5e}")
    log = read(tmp_path, epoch(T, [dataclasses.replace(GPS_5, svid=7)]) + text)
    assert (
        np.isnan(log.gnss.pseudorange_m).tolist() == [False, True] and np.isfinite(log.gnss.doppler_hz).all()
    )
    assert "1 pseudorange(s) left out whose ReceivedSvTimeNanos" in log.events[0].detail


@pytest.mark.parametrize(
    ("sat", "why"),
    [
        (dataclasses.replace(GPS_5, state=0x1 | 0x2), "ambiguous"),
        (dataclasses.replace(GPS_5, state=0x1 | 0x8 | 0x10), "ambiguous"),
        (Sat(6, 11, 85_000_005, L1, "C", 0x400), "ambiguous"),
        (Sat(3, 2, 66_000_007, G1, "C", 0x1 | 0x8), "ambiguous"),
        (dataclasses.replace(GPS_5, travel_ns=900_000_000), "impossible travel time"),
        (dataclasses.replace(GPS_5, drop="ReceivedSvTimeNanos"), "ambiguous"),
    ],
)
def test_measurement_without_a_travel_time_keeps_its_rate_and_is_told(
    tmp_path: Path, sat: Sat, why: str
) -> None:
    log = read(tmp_path, epoch(T, [dataclasses.replace(GPS_5, svid=7), sat]))
    odd = np.flatnonzero(np.isnan(log.gnss.pseudorange_m))
    assert len(log.gnss.t_ns) == 2 and len(odd) == 1
    assert sat.carrier_hz is not None
    assert log.gnss.doppler_hz[odd[0]] == pytest.approx(-12.5 * sat.carrier_hz / C_MPS, rel=1e-6)
    assert [e.kind for e in log.events] == ["android_range_not_used"] and why in log.events[0].detail


@pytest.mark.parametrize(
    ("sat", "period_ns"),
    [
        (dataclasses.replace(GPS_5, state=0x1 | 0x2 | 0x4), 6 * 10**9),  # subframe
        (Sat(3, 2, 66_000_007, G1, "C", 0x1 | 0x40), 2 * 10**9),  # string
        (Sat(6, 11, 85_000_005, L1, "C", 0x400 | 0x1000), 2 * 10**9),  # page
        (Sat(2, 133, 125_000_000, L1, "C", 0x1 | 0x2000), 10**9),  # message of SBAS
        (Sat(6, 11, 85_000_005, L1, "C", 0x400 | 0x800), 10**8),  # secondary code
    ],
)
def test_time_within_a_subframe_string_page_or_secondary_code_gives_the_range(
    tmp_path: Path, sat: Sat, period_ns: int
) -> None:
    text = epoch(T, [sat])
    whole = sent_ns(dataclasses.replace(sat, state=0x1 | 0x8), T - BOOT_FULL_BIAS_NS, 18)
    stated = sent_ns(sat, T - BOOT_FULL_BIAS_NS, 18)
    log = read(tmp_path, text.replace(f",{stated},", f",{whole % period_ns},"))
    assert log.events == []
    assert log.gnss.pseudorange_m.tolist() == pytest.approx([sat.travel_ns * C_MPS / 1e9], abs=1e-6)


def test_code_type_that_the_band_does_not_have_is_the_usual_one_and_told(tmp_path: Path) -> None:
    pilot = Sat(5, 30, 75_000_003, L5, "Q")  # as many phones call the pilot of BeiDou's B2a
    both = dataclasses.replace(pilot, svid=31, code="X")
    regulated = Sat(6, 11, 85_000_005, L1, "A", 0x400 | 0x8)  # as a phone calls the open signal of E1
    known = dataclasses.replace(GPS_5, carrier_hz=L5, code="Q")
    log = read(tmp_path, epoch(T, [pilot, both, regulated, known]))
    named = {("C30", "C5P"), ("C31", "C5X"), ("E11", "C1C"), ("G05", "C5Q")}
    assert {key[1:] for key in rows(log.gnss)} == named
    (event,) = log.events
    assert event.kind == "android_code_type"
    assert event.detail.endswith("the usual code taken: 1 A of E C1C, 1 Q of C C5P")


@pytest.mark.parametrize("step", [-0.5, 0.0])
def test_glonass_carriers_half_a_channel_low_are_of_the_next_channel(tmp_path: Path, step: float) -> None:
    channels = {2: -4, 10: -7, 1: 1, 8: 6}
    carriers = {k: np.float32(G1 + (n + step) * 562.5e3) for k, n in channels.items()}  # as phones round them
    sats = [Sat(3, k, 66_000_007, float(hz), "C", 0x1 | 0x80) for k, hz in carriers.items()]
    log = read(tmp_path, epoch(T, sats))
    assert log.gnss.glonass_channels == {f"R{k:02d}": n for k, n in channels.items()}
    assert len(log.gnss.t_ns) == len(channels) and log.events == []


def test_line_of_state_0_is_no_measurement_whatever_its_uncertainties(tmp_path: Path) -> None:
    nothing = dataclasses.replace(
        GPS_5, state=0, sent_uncertainty_ns=7.0, rate_uncertainty_mps=0.1, rate_mps=563.1
    )
    tracked = dataclasses.replace(GPS_5, svid=7, sent_uncertainty_ns=7.0)
    log = read(tmp_path, epoch(T, [nothing, tracked]))
    assert log.gnss.sv_names == ("G05", "G07")
    assert (
        np.isnan(log.gnss.doppler_hz).tolist() == np.isnan(log.gnss.pseudorange_m).tolist() == [True, False]
    )
    assert "1 signal(s) that the phone was searching for" in log.events[0].detail


@pytest.mark.parametrize(
    ("state", "period_ns"), [(0x1 | 0x10, 10**6), (0x1 | 0x2, 20 * 10**6), (0x1 | 0x8 | 0x10, 10**6)]
)
@pytest.mark.parametrize("seconds", [1, 50])
def test_whole_milliseconds_are_those_of_another_epoch_of_the_satellite(
    tmp_path: Path, state: int, period_ns: int, seconds: int
) -> None:
    """The range changes by 0.9 km/s meanwhile: the sum of a satellite's, a phone's and its clock's rate."""
    after = T + seconds * 10**9
    early = dataclasses.replace(GPS_5, travel_ns=70_123_456 - seconds * 3000, state=state)
    stated = sent_ns(early, T - BOOT_FULL_BIAS_NS, 18)
    first = epoch(T, [early]).replace(f",{stated},", f",{stated % period_ns},")
    log = read(tmp_path, first, epoch(after, [GPS_5]))
    travel_ns = log.gnss.pseudorange_m / C_MPS * 1e9
    assert (
        travel_ns.tolist() == pytest.approx([early.travel_ns, GPS_5.travel_ns], abs=1e-3) and log.events == []
    )


@pytest.mark.parametrize(("seconds", "count"), [(70, 0), (1, 1)])
def test_epochs_that_are_far_or_of_another_clock_do_not_tell_the_milliseconds(
    tmp_path: Path, seconds: int, count: int
) -> None:
    early = dataclasses.replace(GPS_5, state=0x1 | 0x10)
    log = read(tmp_path, epoch(T, [early]), epoch(T + seconds * 10**9, [GPS_5], count=count))
    assert np.isnan(log.gnss.pseudorange_m).tolist() == [True, False]
    assert "ambiguous" in " ".join(event.detail for event in log.events)


def test_signals_that_the_phone_searches_for_keep_their_cn0_alone(tmp_path: Path) -> None:
    searched = dataclasses.replace(GPS_5, state=0x4000, sent_uncertainty_ns=1e9, rate_uncertainty_mps=C_MPS)
    tracked = dataclasses.replace(GPS_5, svid=7, sent_uncertainty_ns=20.0, rate_uncertainty_mps=0.3)
    coarse = dataclasses.replace(GPS_5, svid=9, sent_uncertainty_ns=60.0, rate_uncertainty_mps=299.792458)
    log = read(tmp_path, epoch(T, [searched, tracked, coarse]))
    assert log.gnss.sv_names == ("G05", "G07", "G09") and log.gnss.cn0_dbhz.tolist() == [35.5] * 3
    assert np.isnan(log.gnss.pseudorange_m).tolist() == [True, False, False]
    assert np.isnan(log.gnss.doppler_hz).tolist() == [True, False, True]
    assert [e.detail.split(": ")[1] for e in log.events] == ["1 signal(s) that the phone was searching for"]


# ------------------------------------------------------------------------------------------------ the receiver's clock


@pytest.mark.parametrize(
    "junk", [{"full": 0}, {"full": 1_400_000_000 * 10**9}, {"extra_bias": 0, "bias_uncertainty_ns": 2e9}]
)
def test_rows_before_gps_time_is_known_take_the_bias_that_comes_later(
    tmp_path: Path, junk: dict[str, float]
) -> None:
    early = {**junk}
    if "bias_uncertainty_ns" in junk:  # it wanders by half a second, as one phone's does
        early["full"] = BOOT_FULL_BIAS_NS + 470_000_000
    texts = [
        epoch(T, [GPS_5], **early),
        *(epoch(T + k * 10**9, [GPS_5], bias_uncertainty_ns=9.0) for k in (1, 2)),
    ]  # type: ignore[arg-type]
    log = read(tmp_path, *texts)
    assert log.events == []
    assert log.gnss.t_ns.tolist() == [T + k * 10**9 - BOOT_FULL_BIAS_NS for k in range(3)]
    assert log.gnss.pseudorange_m.tolist() == pytest.approx([70_123_456 * C_MPS / 1e9] * 3, abs=1e-6)


def test_clock_that_is_never_certain_is_set_by_the_satellites(tmp_path: Path) -> None:
    wrong = BOOT_FULL_BIAS_NS - 470_000_000
    sats = [dataclasses.replace(GPS_5, svid=k, travel_ns=76_000_000 + k * 10**6) for k in (1, 2, 3)]
    log = read(tmp_path, *(epoch(T + k * 10**9, sats, full=wrong, bias_uncertainty_ns=5e8) for k in range(3)))
    assert [e.kind for e in log.events] == ["receiver_time_mended"]
    assert (
        np.abs(log.gnss.t_ns - [T + k // 3 * 10**9 - BOOT_FULL_BIAS_NS for k in range(9)]).max() < 10_000_000
    )
    # one clock for all: the differences between satellites stay
    ranges = log.gnss.pseudorange_m.reshape(3, 3) / (C_MPS / 1e9)
    assert np.allclose(np.diff(ranges, axis=1), 1e6, atol=1e-3) and 60e6 < ranges.min() < 100e6


def test_clock_that_starts_anew_without_a_count_begins_a_stretch(tmp_path: Path) -> None:
    # the phone's counter jumps by a day, its bias with it, and the count of discontinuities stays
    day = 86_400 * 10**9
    after = epoch(T + 10**9, [GPS_5]).replace(f",{T + 10**9},", f",{T + 10**9 + day},")
    after = after.replace(f",{BOOT_FULL_BIAS_NS},", f",{BOOT_FULL_BIAS_NS + day},")
    log = read(tmp_path, epoch(T, [GPS_5]), after)
    assert [e.kind for e in log.events] == ["receiver_clock_discontinuity"]
    assert log.gnss.t_ns.tolist() == [T - BOOT_FULL_BIAS_NS, T + 10**9 - BOOT_FULL_BIAS_NS]
    assert log.gnss.pseudorange_m.tolist() == pytest.approx([70_123_456 * C_MPS / 1e9] * 2, abs=1e-6)


# -------------------------------------------------------------------------------------------- writers of other versions


def test_columns_in_any_order_case_and_number_are_found(tmp_path: Path) -> None:
    names = ["svid", "CONSTELLATIONTYPE", "TimeNanos", "State", "ReceivedSvTimeNanos", "FullBiasNanos"]
    sent = sent_ns(GPS_5, T - BOOT_FULL_BIAS_NS, 18)
    row = f"Raw,5,1,{T},{GPS_5.state},{sent},{BOOT_FULL_BIAS_NS}\r\n"
    found = read(tmp_path, row, header="# Raw," + ",".join(names) + "\r\n").gnss
    assert found.sv_names == ("G05",) and np.isnan(found.cn0_dbhz).all() and np.isnan(found.doppler_hz).all()
    assert found.pseudorange_m.tolist() == pytest.approx([70_123_456 * C_MPS / 1e9], abs=1e-6)


@pytest.mark.parametrize(("digits", "most_ns"), [(14, 5000), (17, 300)])
def test_bias_that_a_spreadsheet_has_cut_moves_the_receiver_clock_alone(
    tmp_path: Path, digits: int, most_ns: float
) -> None:
    """All pseudoranges of a stretch are off by the same, which is the clock's offset."""
    text = epoch(T, SKY.values()) + epoch(T + 10**9, SKY.values())
    whole = read(tmp_path, text)
    biases = {cell for cell in re.split(r"[,\n]", text) if re.fullmatch(r"-1\d{18}", cell)}
    assert biases
    for bias in biases:
        text = text.replace(bias, f"{float(bias):.{digits}E}".replace("E+", "E+0"))

    log = read(tmp_path, text)

    assert [event.kind for event in log.events] == ["android_bias_cut"]
    off_m = log.gnss.pseudorange_m - whole.gnss.pseudorange_m
    assert len(log.gnss.t_ns) == len(whole.gnss.t_ns) and np.isfinite(off_m).all()
    assert np.ptp(off_m) < 1e-6 and np.abs(off_m).max() < most_ns * 1e-9 * C_MPS
    assert np.abs(log.gnss.t_ns - whole.gnss.t_ns).max() <= most_ns


@pytest.mark.parametrize(("extra", "events"), [(",", []), (",1,2,3", [])])
def test_cells_without_a_name_at_the_end_are_passed_over(
    tmp_path: Path, extra: str, events: list[str]
) -> None:
    lines = [line + extra for line in epoch(T, SKY.values()).splitlines()]
    log = read(tmp_path, "\n".join(lines) + "\n")
    assert len(log.gnss.t_ns) == len(SKY) and [e.kind for e in log.events] == events


def test_header_whose_comment_mark_was_taken_off_names_the_columns(tmp_path: Path) -> None:
    text = epoch(T, SKY.values())
    found = read(tmp_path, text, header=HEADER.replace("# Raw,", "Raw,"))
    assert len(found.gnss.t_ns) == len(SKY) and found.events == read(tmp_path, text).events


def test_last_columns_that_the_rows_lack_are_absent(tmp_path: Path) -> None:
    lines = [line.rsplit(",", 1)[0] for line in epoch(T, SKY.values()).splitlines()]
    log = read(tmp_path, "\n".join(lines) + "\n" + lines[0][:90])
    assert len(log.gnss.t_ns) == len(SKY) and [e.kind for e in log.events] == ["bad_row"]


def test_column_that_stands_twice_is_one(tmp_path: Path) -> None:
    # version 1.4 named the carrier twice, and filled the second cell
    header = HEADER.replace(",CodeType,", ",CarrierFrequencyHz,CodeType,")
    text = epoch(T, [SKY["G08", "C5Q"]]).replace(",1176450048.0,", ",,").replace(",Q,", ",1176450048.0,Q,")
    assert read(tmp_path, text, header=header).gnss.signal_names == ("C5Q",)


def test_table_with_one_header_for_all_kinds_is_read(tmp_path: Path) -> None:
    header = "MessageType," + HEADER.split("# Raw,")[1].split("\n")[0] + "\n"
    assert len(read(tmp_path, epoch(T, SKY.values()), header=header).gnss.t_ns) == len(SKY)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_table_of_raw_lines_alone_is_read(tmp_path: Path, end: str) -> None:
    lines = epoch(T, SKY.values()).replace("Raw,", "").splitlines()
    text = end.join([COLUMNS, *lines, "1,2,3"]) + end
    log = read(tmp_path, text, header="\ufeff")
    whole = read(tmp_path, epoch(T, SKY.values()))
    assert rows(log.gnss) == rows(whole.gnss) and len(log.gnss.t_ns) == len(SKY)
    assert [e.detail.partition(": ")[2] for e in log.events] == [
        "1 Raw line(s) with a wrong number of cells refused"
    ]


def test_satellite_states_of_newer_phones_are_read(tmp_path: Path) -> None:
    names = [f"SvPositionEcef{a}Meters" for a in "XYZ"] + [f"SvVelocityEcef{a}MetersPerSecond" for a in "XYZ"]
    names += ["SvClockBiasMeters", "SvClockDriftMetersPerSecond"]
    header = HEADER.replace(",ChipsetElapsedRealtimeNanos", ",ChipsetElapsedRealtimeNanos," + ",".join(names))
    first, second = epoch(T, [GPS_5, dataclasses.replace(GPS_5, svid=7)]).splitlines()
    numbers = "-13141427.5,18506243.25,13644837.125,-1563.5,749.25,-2562.125,185005.5,0.0011"
    gnss = read(tmp_path, f"{first},{numbers}\n{second}{',' * 8}\n", header=header).gnss
    assert gnss.sat is not None
    assert gnss.sat[0].tolist() == [float(n) for n in numbers.split(",")] and np.isnan(gnss.sat[1]).all()


# ------------------------------------------------------------------------------------- GLONASS without slot or carrier


def test_glonass_satellite_known_by_its_channel_alone_has_a_name_of_its_own(tmp_path: Path) -> None:
    sat = Sat(3, 97, 66_000_007, None, "", 0x1 | 0x80)
    gnss = read(tmp_path, epoch(T, [sat])).gnss
    assert gnss.sv_names == ("R47",) and gnss.glonass_channels == {"R47": -3}
    assert gnss.pseudorange_m.tolist() == pytest.approx([66_000_007 * C_MPS / 1e9], abs=1e-6)
    assert gnss.doppler_hz.tolist() == pytest.approx([-12.5 * (G1 - 3 * 562.5e3) / C_MPS], rel=1e-12)


def test_rate_of_a_wavelength_that_is_not_known_stays_a_rate(tmp_path: Path) -> None:
    gnss = read(tmp_path, epoch(T, [Sat(3, 7, 66_000_007, None, "", 0x1 | 0x80)])).gnss
    assert gnss.sv_names == ("R07",) and gnss.range_rate_mps.tolist() == [12.5]
    assert np.isnan(gnss.doppler_hz).all()


@pytest.mark.parametrize(
    ("state", "valid", "lli"),
    [(0, False, 0), (1, True, 0), (1 | 2, True, 1), (1 | 4, True, 1), (1 | 16, True, 2)],
)
def test_carrier_phase_follows_the_state_of_the_delta_range(
    tmp_path: Path, state: int, valid: bool, lli: int
) -> None:
    good = dataclasses.replace(GPS_5, svid=7, adr_state=1 | 8 | 16, adr_m=-100.0)
    log = read(tmp_path, epoch(T, [dataclasses.replace(GPS_5, adr_state=state, adr_m=12345.678), good]))
    assert log.gnss.carrier_cycles is not None and log.gnss.lli is not None
    expected = 12345.678 * L1 / C_MPS if valid else np.nan
    assert log.gnss.carrier_cycles[0] == pytest.approx(expected, nan_ok=True)
    assert log.gnss.lli.tolist() == [lli, 0]


def test_clock_set_anew_marks_a_slip(tmp_path: Path) -> None:
    sat = dataclasses.replace(GPS_5, adr_state=1, adr_m=5.0)
    log = read(tmp_path, *(epoch(T + k * 10**9, [sat], count=k // 2) for k in range(4)))
    assert log.gnss.lli is not None and log.gnss.lli.tolist() == [0, 0, 1, 0]


def test_log_without_carrier_frequencies_is_the_first_band(tmp_path: Path) -> None:
    sats = [dataclasses.replace(sat, carrier_hz=None, code="") for sat in SKY.values()]
    found = read(tmp_path, epoch(T, sats)).gnss
    assert set(found.signal_names) == {"C1C", "C2I", "C5A"} and found.glonass_channels == {}


def test_log_of_signals_that_the_phone_searched_for_alone_is_refused(tmp_path: Path) -> None:
    nothing = [dataclasses.replace(GPS_5, svid=k, state=0, rate_mps=0.0) for k in (1, 2)]
    with pytest.raises(InputError, match="that the phone was searching for") as found:
        read(tmp_path, epoch(T, nothing))
    assert "until the phone has a fix" in found.value.advice
    gravity = [
        sensor(kind, T + ELAPSED_MINUS_TIME_NS, (0.0, 0.0, 9.8)) for kind in ("UncalGyro", "UncalAccel")
    ]
    log = read(tmp_path, epoch(T, nothing), *gravity)
    assert not len(log.gnss.t_ns) and log.imu is not None


@pytest.mark.parametrize(
    ("name", "reference"), [("UtcTimeInMs", True), ("(UTC)TimeInMs", True), ("When", False)]
)
def test_fixes_of_older_versions_have_another_name_of_the_time(
    tmp_path: Path, name: str, reference: bool
) -> None:
    header = HEADER.replace(
        "AltitudeMeters\n", f"AltitudeMeters,SpeedMps,AccuracyMeters,bearingDegrees,{name}\n"
    )
    utc_ms = (T - BOOT_FULL_BIAS_NS) // 10**6 + 315_964_800_000 - 18_000
    lines = [f"Fix,GPS,47.5,8.25,400.0,2.0,3.02,90.0,{utc_ms + 1000 * k}\n" for k in range(3)]
    log = read(tmp_path, epoch(T, [GPS_5]), *lines, header=header)
    assert (log.solution is not None) == reference
    events = [e.detail for e in log.events if e.kind == "android_fixes_not_used"]
    assert [text.split(":")[1][:29] for text in events] == (
        [] if reference else [" 3 Fix line(s) give no refere"]
    )


def test_fixes_become_a_reference_with_sigmas(tmp_path: Path) -> None:
    header = HEADER.replace(
        "AltitudeMeters\n",
        "AltitudeMeters,SpeedMps,AccuracyMeters,BearingDegrees,UnixTimeMillis,SpeedAccuracyMps,"
        "BearingAccuracyDegrees,elapsedRealtimeNanos,VerticalAccuracyMeters\n",
    )
    utc_ms = (T - BOOT_FULL_BIAS_NS) // 10**6 + 315_964_800_000 - 18_000
    lines = [f"Fix,GPS,47.5,8.25,{400 + k},2.0,3.02,90.0,{utc_ms + 1000 * k},0.5,,7,6.0\n" for k in range(3)]
    lines += ["Fix,FLP,48.0,9.0,1.0,,,,1,,,,\n", f"Fix,GPS,,,,,,,{utc_ms},,,,\n"]
    own = read(tmp_path, epoch(T, [GPS_5]), *lines, header=header).solution
    assert own is not None and own.h_m.tolist() == [400.0, 401.0, 402.0] and own.quality.tolist() == [2.0] * 3
    assert np.abs(own.t_ns - (T - BOOT_FULL_BIAS_NS) - np.arange(3) * 10**9).max() < 10**6
    assert np.allclose(own.v_n[:, :2], [0.0, 2.0], atol=1e-12) and np.isnan(own.v_n[:, 2]).all()
    assert own.sigma is not None and own.sigma[0, :5].tolist() == pytest.approx([2.0, 2.0, 6.0, 0.5, 0.5])


def test_old_fixes_without_units_in_their_names_are_read(tmp_path: Path) -> None:
    header = HEADER.replace(
        "LatitudeDegrees,LongitudeDegrees,AltitudeMeters",
        "Latitude,Longitude,Altitude,Speed,Accuracy,(UTC)TimeInMs",
    )
    utc_ms = (T - BOOT_FULL_BIAS_NS) // 10**6 + 315_964_800_000 - 18_000
    lines = [f"Fix,gps,47.5,8.25,400,0.0,3.0,{utc_ms + 1000 * k}\n" for k in range(2)]
    own = read(tmp_path, epoch(T, [GPS_5]), *lines, header=header).solution
    assert own is not None and own.lat_deg.tolist() == [47.5, 47.5] and own.v_n[0, 0] == 0.0


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("name", "kept", "ranges"),
    [
        ("pseudoranges_log_2016_06_30_21_26_07", 1379, 1379),
        ("pseudoranges_log_2016_08_22_14_45_50", 5041, 4400),
    ],
)
def test_real_phone_keeps_its_lines_and_most_of_its_ranges(
    data_root: Path, name: str, kept: int, ranges: int
) -> None:
    log = read_android(data_root / "phone_static_2016" / f"{name}.txt.gz")
    assert len(log.gnss.t_ns) == kept
    assert np.isfinite(log.gnss.pseudorange_m).sum() >= ranges
    assert log.solution is not None and abs(np.median(log.solution.lat_deg) - 37.422578) < 1e-4


def test_sensors_are_put_on_gps_time_and_the_accelerometer_on_the_gyros_times(tmp_path: Path) -> None:
    start = T + ELAPSED_MINUS_TIME_NS
    gyro = [sensor("UncalGyro", start + k * 5_000_000, (0.01 * k, 0.0, -0.5)) for k in range(40)]
    # specific force linear in time, sampled elsewhere and less often: interpolation must give it exactly
    force = [
        sensor("UncalAccel", start - 3_000_000 + k * 7_000_000, (0.25 * (7 * k - 3), 9.81, 0.0))
        for k in range(29)
    ]
    texts = [epoch(T + k * 10**9, [GPS_5]) for k in range(3)]
    log = read(tmp_path, texts[0], *gyro, *force, *texts[1:])
    assert log.imu is not None and [e.kind for e in log.events] == ["imu_unpaired"]  # the last gyro sample
    since_ms = (log.imu.t_ns - (T - BOOT_FULL_BIAS_NS)) / 1e6
    assert np.allclose(since_ms, 5.0 * np.arange(len(since_ms))) and len(since_ms) == 39
    assert np.allclose(log.imu.w_ib_b[:, 0], 0.01 * np.arange(39))
    assert np.allclose(log.imu.f_b[:, 0], 0.25 * since_ms) and np.allclose(log.imu.f_b[:, 1], 9.81)


@pytest.mark.parametrize(
    ("drift", "told"), [((-0.01, -0.035, 0.068), True), ((0.0, 0.0, 0.0), False), ((0.0, 0.0, 3.0), False)]
)
def test_drift_that_a_phone_states_of_its_gyros_is_taken_off_as_one_number(
    tmp_path: Path, drift: tuple[float, float, float], told: bool
) -> None:
    """Its steps stay out of the rates; a drift of 170 deg/s is none."""
    start = T + ELAPSED_MINUS_TIME_NS
    texts = [epoch(T + k * 10**9, [GPS_5]) for k in range(3)]
    for k in range(40):
        now = start + k * 5_000_000
        estimate = drift if k > 5 else (0.0, 0.0, 0.0)
        texts.insert(-2, sensor("UncalGyro", now, (0.01 * k, 0.2, -0.5), estimate))
        texts.insert(-2, sensor("UncalAccel", now, (0.0, 9.81, 0.0)))
    log = read(tmp_path, *texts)

    assert log.imu is not None
    taken_off = np.array(drift) if told else np.zeros(3)
    assert np.allclose(log.imu.w_ib_b, np.array([[0.01 * k, 0.2, -0.5] for k in range(40)]) - taken_off)
    told_events = [e.detail for e in log.events if e.kind == "imu_drift_taken_off"]
    assert ["-0.573 -2.005 +3.896 deg/s" in detail for detail in told_events] == [True] * told


def test_gap_of_one_sensor_is_not_bridged(tmp_path: Path) -> None:
    start = T + ELAPSED_MINUS_TIME_NS
    gyro = [sensor("UncalGyro", start + k * 10_000_000, (0.1, 0.0, 0.0)) for k in range(100)]
    force = [
        sensor("UncalAccel", start + k * 10_000_000, (0.0, 0.0, 9.8)) for k in range(100) if not 30 < k < 60
    ]
    log = read(tmp_path, epoch(T, [GPS_5]), *gyro, *force)
    assert log.imu is not None and len(log.imu.t_ns) == 71
    assert [e.kind for e in log.events] == ["imu_unpaired"] and "29 angular" in log.events[0].detail


def test_drift_of_the_phones_clock_is_followed(tmp_path: Path) -> None:
    drift = 20e-6
    texts, start = [], T + ELAPSED_MINUS_TIME_NS
    for k in range(0, 600, 5):
        text = epoch(T + k * 10**9, [GPS_5])
        texts.append(text.replace(str(start + k * 10**9), str(start + round(k * 1e9 * (1 + drift)))))
    late = start + round(590e9 * (1 + drift))
    for kind in ("UncalGyro", "UncalAccel"):
        texts.append(sensor(kind, late, (0.0, 0.0, 9.8)))
    imu = read(tmp_path, *texts).imu
    assert imu is not None and abs(imu.t_ns[0] - (T + 590 * 10**9 - BOOT_FULL_BIAS_NS)) < 1000


def test_sensors_without_the_chipsets_time_carry_utc_and_an_event(tmp_path: Path) -> None:
    start = T + ELAPSED_MINUS_TIME_NS
    samples = [
        sensor(kind, start + k * 10_000_000, (0.0, 0.0, 9.8))
        for k in range(5)
        for kind in ("UncalGyro", "UncalAccel")
    ]
    log = read(tmp_path, epoch(T, [dataclasses.replace(GPS_5, drop="ChipsetElapsedRealtimeNanos")]), *samples)
    assert log.imu is not None and [e.kind for e in log.events] == ["imu_time_uncertain"]
    assert abs(log.imu.t_ns[0] - (T - BOOT_FULL_BIAS_NS)) <= 10**6


def test_lines_with_a_wrong_number_of_cells_and_other_kinds_are_told(tmp_path: Path) -> None:
    text = epoch(T, [GPS_5])
    log = read(tmp_path, text, text[:120] + "\n", "Agc,47.0,8.0\n", "Nav,1,2\n", "garbage\n")
    assert len(log.gnss.t_ns) == 1
    assert [e.kind for e in log.events] == ["bad_row", "android_lines_not_read"]
    assert "1 Agc, 1 Nav" in log.events[1].detail


def test_table_whose_columns_were_renamed_is_an_error_that_names_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no column ReceivedSvTimeNanos") as error:
        read(tmp_path, epoch(T, SKY.values()), header=HEADER.replace("ReceivedSvTimeNanos,", "tTxNanos,"))
    assert "Raw measurements" not in str(error.value.advice)


@pytest.mark.parametrize("text", ["", "# Raw,a,b\nRaw,1,2\n", HEADER, "Raw,1,2,3\n", HEADER + "Raw,,,\n"])
def test_file_without_raw_measurements_is_a_typed_error(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError):
        read(tmp_path, header=text)


MORE = (
    "# UncalMag,utcTimeMillis,elapsedRealtimeNanos,UncalMagXMicroT,UncalMagYMicroT,UncalMagZMicroT,BiasXMicroT,"
    "BiasYMicroT,BiasZMicroT\n# Mag,utcTimeMillis,elapsedRealtimeNanos,MagXMicroT,MagYMicroT,MagZMicroT\n"
    "# Pressure,utcTimeMillis,elapsedRealtimeNanos,PressureHpa\n"
)


def test_pressure_and_field_are_the_logs_further_samples(tmp_path: Path) -> None:
    start = T + ELAPSED_MINUS_TIME_NS
    field = [sensor("UncalMag", start + k * 20_000_000, (21.0 + k, -4.5, -38.25)) for k in range(5)]
    field += [sensor("UncalMag", start + 20_000_000, (9.0, 9.0, 9.0)), f"UncalMag,1,{start},nan,1,2,0,0,0\n"]
    calibrated = [f"Mag,1,{start},1.0,2.0,3.0\n"]
    pressure = [f"Pressure,1,{start + k * 40_000_000},{950.125 + k}\n" for k in (2, 0, 1)]
    log = read(tmp_path, epoch(T, [GPS_5]), *field, *calibrated, *pressure, header=HEADER + MORE)
    found = {samples.kind: samples for samples in log.further}
    since_ms = {kind: (each.t_ns - (T - BOOT_FULL_BIAS_NS)) / 1e6 for kind, each in found.items()}
    assert since_ms["magnetometer"].tolist() == [0, 20, 40, 60, 80]
    assert found["magnetometer"].values[1].tolist() == [22.0, -4.5, -38.25]
    assert since_ms["barometer"].tolist() == [0, 40, 80]
    assert found["barometer"].values[:, 0].tolist() == [950.125, 951.125, 952.125]
    told = {event.kind: event.detail for event in log.events}
    assert "UncalMag: 1 sample(s) without" in told["sensor_samples_left_out"]
    assert "1 with the time of another" in told["sensor_samples_left_out"]
    assert told["android_lines_not_read"].endswith("lines of other kinds: 1 Mag")


def test_pressure_without_its_column_is_named_as_not_read(tmp_path: Path) -> None:
    log = read(tmp_path, epoch(T, [GPS_5]), "Pressure,1,2,950.0\n")
    assert not log.further and "1 Pressure" in log.events[-1].detail


def test_further_samples_are_written_with_an_entry_that_a_flight_file_takes(tmp_path: Path) -> None:
    start = T + ELAPSED_MINUS_TIME_NS
    lines = [f"Pressure,1,{start + k * 200_000_000},{950.125 + k / 64}\n" for k in range(8)]
    lines += [sensor("UncalMag", start + k * 200_000_000, (21.0, -4.5 - k, -38.25)) for k in range(8)]
    path = tmp_path / "gnss_log.txt"
    path.write_text(HEADER + MORE + epoch(T, [GPS_5]) + epoch(T + 10**9, [GPS_5]) + "".join(lines))
    done = convert([path], tmp_path / "out")
    names = {written.name for written in done.written}
    assert {"barometer.csv", "magnetometer.csv"} <= names
    folder = tmp_path / "out"
    text = (folder / "flight.toml").read_text()
    entries = text[text.index("# The log has a") :].splitlines()
    entry_text = "\n".join(line.removeprefix("# ") for line in entries if "The log has a" not in line)
    entries_by_kind = {entry["kind"]: entry for entry in tomllib.loads(entry_text)["sensor"]}
    week = tomllib.loads(text)["gps_week"]
    for samples in done.log.further:
        entry = entries_by_kind[samples.kind]
        entry["files"] = [folder / name for name in entry["files"]]
        adapter: TypeAdapter[Barometer | Magnetometer] = TypeAdapter(Barometer | Magnetometer)
        table, events = read_sensor(adapter.validate_python(entry), week)
        assert not events and np.abs(table.t_ns - samples.t_ns).max() < 1000
        if samples.kind == "magnetometer":  # to forward, right, down of a flat phone
            assert table.values[3].tolist() == [-7.5, 21.0, 38.25]
        else:
            level_m = 44_330.77 * (1.0 - (950.125 / 1013.25) ** 0.190263)  # standard atmosphere, geopotential
            assert table.values[0, 0] == pytest.approx(level_m * (1.0 + level_m / 6_356_766.0), abs=0.01)
