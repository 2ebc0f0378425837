"""RXM-RAWX field by field: names, times, validity, slips, half cycles and what contradicts itself."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.gnss.signals import reason_unsupported, signal_of
from insgnss.log.receiver import ReceiverLog
from insgnss.log.ubx.observations import SIGNALS
from insgnss.log.ubx.reader import read_ubx
from tests.log.ubx_writing import TOW_S, WEEK, frame, measurement, rawx

START_NS = WEEK * NS_PER_WEEK + round(TOW_S * 1000) * 1_000_000


def read(folder: Path, *frames: bytes) -> ReceiverLog:
    path = folder / "log.ubx"
    path.write_bytes(b"".join(frames))
    return read_ubx([path])


def track(folder: Path, *values: dict[str, int], step_s: float = 1.0) -> list[int]:
    """Return the loss-of-lock indicators of one satellite's signal over epochs with these fields."""
    frames = [rawx(TOW_S + k * step_s, [measurement(**v)]) for k, v in enumerate(values)]
    lli = read(folder, *frames).gnss.lli
    assert lli is not None
    return lli.tolist()


def test_values_of_a_measurement_stand_in_its_row(tmp_path: Path) -> None:
    gnss = read(
        tmp_path, rawx(measurements=[measurement(pr=2.2e7 + 1e-9, cp=-1.5, dop=2048.25, cno=51)])
    ).gnss

    assert (gnss.sv_names, gnss.signal_names) == (("G05",), ("C1C",))
    assert gnss.pseudorange_m[0] == 2.2e7 + 1e-9
    assert gnss.carrier_cycles is not None and gnss.carrier_cycles[0] == -1.5
    assert (gnss.doppler_hz[0], gnss.cn0_dbhz[0]) == (2048.25, 51.0)
    assert np.isnan(gnss.range_rate_mps[0])


@pytest.mark.parametrize(
    ("gnss", "sv", "sig", "name", "code"),
    [
        (0, 32, 3, "G32", "C2L"),
        (0, 1, 7, "G01", "C5Q"),
        (1, 131, 0, "S31", "C1C"),
        (2, 36, 0, "E36", "C1C"),
        (2, 4, 6, "E04", "C7Q"),
        (2, 4, 8, "E04", "C6B"),
        (3, 60, 1, "C60", "C2I"),
        (3, 21, 5, "C21", "C1P"),
        (3, 21, 7, "C21", "C5P"),
        (3, 5, 10, "C05", "C6I"),
        (5, 3, 5, "J03", "C2L"),
        (6, 24, 2, "R24", "C2C"),
        (7, 6, 0, "I06", "C5A"),
    ],
)
def test_identifiers_become_names_and_codes_of_rinex(
    tmp_path: Path, gnss: int, sv: int, sig: int, name: str, code: str
) -> None:
    table = read(tmp_path, rawx(measurements=[measurement(gnss=gnss, sv=sv, sig=sig)])).gnss

    assert (table.sv_names, table.signal_names) == ((name,), (code,))


def test_every_signal_is_one_of_the_table_of_signals_or_has_a_reason() -> None:
    for system, codes in SIGNALS.items():
        for code in codes.values():
            assert signal_of(system, code) is not None or "no signal" not in reason_unsupported(system, code)


@pytest.mark.parametrize(("gnss", "sv", "sig"), [(4, 1, 0), (6, 255, 0), (0, 5, 9), (9, 1, 0), (0, 0, 0)])
def test_unknown_satellites_and_signals_are_left_out_and_counted(
    tmp_path: Path, gnss: int, sv: int, sig: int
) -> None:
    log = read(tmp_path, rawx(measurements=[measurement(), measurement(gnss=gnss, sv=sv, sig=sig)]))

    assert len(log.gnss.t_ns) == 1
    assert any(e.kind == "ubx_unknown_signal" and "1 measurements" in e.detail for e in log.events)


@pytest.mark.parametrize("tow_s", [0.0, 0.25, 17_144.553_800_509, 345_678.012_345_678, 604_799.999_999_999])
def test_time_tag_is_exact_to_a_nanosecond(tmp_path: Path, tow_s: float) -> None:
    ns = round(tow_s * 1e9) if tow_s < 1 else int(f"{tow_s:.9f}".replace(".", ""))

    assert read(tmp_path, rawx(tow_s)).gnss.t_ns[0] == WEEK * NS_PER_WEEK + ns


def test_week_end_is_crossed(tmp_path: Path) -> None:
    gnss = read(tmp_path, rawx(604_799.5), rawx(0.5, week=WEEK + 1)).gnss

    assert np.diff(gnss.t_ns).tolist() == [NS_PER_S]


def test_value_that_is_not_valid_is_no_number(tmp_path: Path) -> None:
    log = read(
        tmp_path, rawx(measurements=[measurement(sv=k, status=status) for k, status in ((1, 6), (2, 5))])
    )
    carrier = log.gnss.carrier_cycles

    assert np.isnan(log.gnss.pseudorange_m).tolist() == [True, False]
    assert carrier is not None and np.isnan(carrier).tolist() == [False, True]
    assert not len(log.gnss.bad_cells)


@pytest.mark.parametrize("values", [{"pr": float("inf")}, {"pr": float("nan")}, {"dop": float("nan")}])
def test_number_that_is_none_though_called_valid_is_a_bad_cell(
    tmp_path: Path, values: dict[str, float]
) -> None:
    gnss = read(tmp_path, rawx(measurements=[measurement(), measurement(sv=6, **values)])).gnss  # type: ignore[arg-type]

    assert gnss.bad_cells.tolist() == [1]
    assert not np.isinf(gnss.pseudorange_m).any()


def test_steady_lock_is_no_slip(tmp_path: Path) -> None:
    assert track(tmp_path, {"lock": 1000}, {"lock": 2000}, {"lock": 3000}) == [0, 0, 0]
    assert track(tmp_path, {"lock": 64_500}, {"lock": 64_500}) == [0, 0]


def test_lock_time_that_falls_or_is_shorter_than_the_gap_is_a_slip(tmp_path: Path) -> None:
    assert track(tmp_path, {"lock": 5000}, {"lock": 400}, {"lock": 1400}) == [0, 1, 0]
    assert track(tmp_path, {"lock": 5000}, {"lock": 1400}) == [0, 1]
    # it rose, but lock was lost in the 30 s between
    assert track(tmp_path, {"lock": 5000}, {"lock": 20_000}, step_s=30.0) == [0, 1]
    assert track(tmp_path, {"lock": 64_500}, {"lock": 64_500}, step_s=70.0) == [0, 1]


def test_slip_during_epochs_without_carrier_is_told_at_the_next_carrier(tmp_path: Path) -> None:
    values = ({"lock": 9000}, {"lock": 0, "status": 1}, {"lock": 900, "status": 7})

    assert track(tmp_path, *values) == [0, 0, 1]


def test_half_cycle_is_open_until_the_receiver_knows_it(tmp_path: Path) -> None:
    lock = [{"lock": 1000 * k} for k in range(1, 5)]
    values = [lock[k] | {"status": status} for k, status in enumerate((3, 3, 7, 7))]

    assert track(tmp_path, *values) == [2, 2, 0, 0]


def test_half_cycle_subtracted_from_now_on_is_a_slip(tmp_path: Path) -> None:
    lock = [{"lock": 1000 * k} for k in range(1, 4)]
    values = [lock[k] | {"status": status} for k, status in enumerate((3, 15, 15))]

    assert track(tmp_path, *values) == [2, 1, 0]


def test_slips_of_two_signals_do_not_mix(tmp_path: Path) -> None:
    frames = [
        rawx(TOW_S, [measurement(lock=9000), measurement(sig=7, lock=100)]),
        rawx(TOW_S + 1.0, [measurement(lock=10_000), measurement(sig=7, lock=1100)]),
    ]
    lli = read(tmp_path, *frames).gnss.lli

    assert lli is not None and lli.tolist() == [0, 0, 0, 0]


def test_slip_is_found_across_files_and_out_of_order_epochs(tmp_path: Path) -> None:
    frames = [rawx(TOW_S + k, [measurement(lock=lock)]) for k, lock in ((2, 900), (0, 5000), (1, 6000))]
    gnss = read(tmp_path, *frames).gnss

    assert (np.diff(gnss.t_ns) > 0).all()
    assert gnss.lli is not None and gnss.lli.tolist() == [0, 0, 1]


def test_glonass_channels_are_told(tmp_path: Path) -> None:
    rows = [measurement(gnss=6, sv=7, freq=12), measurement(gnss=6, sv=10, freq=0), measurement(freq=3)]

    assert read(tmp_path, rawx(measurements=rows)).gnss.glonass_channels == {"R07": 5, "R10": -7}


def test_repeated_epoch_counts_once(tmp_path: Path) -> None:
    log = read(tmp_path, rawx(), rawx(), rawx(TOW_S + 1.0))

    assert len(log.gnss.t_ns) == 2
    assert [e.t_ns for e in log.events if e.kind == "gnss_epoch_repeated"] == [START_NS]


def test_clock_reset_and_empty_epoch_are_told(tmp_path: Path) -> None:
    log = read(tmp_path, rawx(), rawx(TOW_S + 1.0, status=3), rawx(TOW_S + 2.0, measurements=()))

    assert [e.t_ns for e in log.events if e.kind == "clock_reset"] == [START_NS + NS_PER_S]
    assert any(e.kind == "gnss_epoch_empty" for e in log.events)


@pytest.mark.parametrize(
    "bad",
    [
        rawx(float("nan")),
        rawx(-1.0),
        rawx(1e9),
        frame(0x0215, struct.pack("<dHbBBB2x", TOW_S, WEEK, 18, 2, 1, 1) + measurement()),
        frame(0x0215, b"\0" * 5),
    ],
)
def test_epoch_that_contradicts_itself_is_refused_and_told(tmp_path: Path, bad: bytes) -> None:
    log = read(tmp_path, bad, rawx())

    assert log.gnss.t_ns.tolist() == [START_NS]
    assert any(event.kind == "ubx_damaged" for event in log.events)
