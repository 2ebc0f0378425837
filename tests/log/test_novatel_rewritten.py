"""NovAtel's ASCII messages and RANGECMP4, turned by NovAtel's own library, give the tables of the binary messages."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np
import pytest

from insgnss.errors import InputError
from insgnss.log.detect import detect_format
from insgnss.log.novatel import rewritten as novatel_rewritten
from insgnss.log.novatel.reader import read_novatel
from tests.log.novatel_encoder import (
    TOW_S,
    Channel,
    bestpos,
    bestvel,
    bestxyz,
    inspvas,
    message,
    range_b,
    rawimus,
    rawimusx,
)
from tests.log.test_convert import same
from tests.log.test_novatel import C_MPS, LOG, SKY, read

BINARY = LOG + b"".join(
    [
        bestpos(TOW_S),
        bestvel(TOW_S, 10.0, 90.0, 0.5),
        bestxyz(TOW_S, (0.0, 6_378_137.0, 0.0), (0.0, 0.0, 0.0)),
        inspvas(TOW_S + 9),
        rawimus(TOW_S, (1, 2, 3), (4, 5, 6)),
    ]
)


def as_ascii(data: bytes) -> bytes:
    """Return the messages in ASCII, as NovAtel's library writes them."""
    oem = pytest.importorskip("novatel_edie.oem", reason="NovAtel's own library is not installed")
    parser = oem.Parser()
    parser.write(data)
    return b"".join(m.to_ascii().message for m in parser)


def rangecmp4(prn: int, channel: Channel, block: int = 0) -> bytes:
    """Return RANGECMP4 with one full measurement of GPS L1 C/A, bit by bit from the lowest."""
    per_m = 1575.42e6 / C_MPS
    range_half_mm = round(channel.range_m / 0.0005)
    fields = [
        *((1, 16), (1 << prn - 1, 64), (1 << 1, 16), (1, 1)),  # systems, satellites, signals, which of them
        *((0, 1), (block, 3), (channel.parity, 1), (channel.half, 1), (round(channel.cn0 / 0.05), 11)),
        *((15, 4), (0, 4), (0, 4), (range_half_mm, 37)),
        *((round((channel.cycles / per_m - range_half_mm * 0.0005) / 0.0001), 23),),
        *((round(-channel.doppler_hz / per_m / 0.0001), 26),),
    ]
    value = place = 0
    for number, bits in fields:
        value |= (int(number) % (1 << bits)) << place
        place += bits
    body = value.to_bytes((place + 7) // 8, "little")
    return message(2050, struct.pack("<I", len(body)) + body)


NMEA = b"$GPGGA,no message of theirs*00"


@pytest.mark.parametrize("line_end", [b"\r\n", b"\n", b"\r\n" + NMEA + b"\r\n"])
def test_ascii_gives_the_tables_of_the_binary_log(tmp_path: Path, line_end: bytes) -> None:
    text = as_ascii(BINARY).replace(b"\r\n", line_end)
    (tmp_path / "log.asc").write_bytes(text)
    assert detect_format(tmp_path / "log.asc") == "novatel"
    theirs, ours = read_novatel([tmp_path / "log.asc"]), read(tmp_path, BINARY)
    same(ours.gnss, theirs.gnss)
    assert theirs.imu is not None and ours.imu is not None
    assert np.array_equal(theirs.imu.t_ns, ours.imu.t_ns) and np.array_equal(theirs.imu.f_b, ours.imu.f_b)
    assert theirs.solution is not None and ours.solution is not None
    assert theirs.solution.rpy_deg == pytest.approx(ours.solution.rpy_deg, abs=1e-9)
    assert theirs.navigation.ephemerides.sv_names == ours.navigation.ephemerides.sv_names
    told = {event.kind for event in theirs.events}
    assert ("novatel_foreign_bytes" in told) == (NMEA in line_end) and "novatel_compressed" not in told


def test_binary_messages_among_ascii_are_read_without_the_library(tmp_path: Path) -> None:
    data = range_b(SKY) + as_ascii(range_b(SKY, TOW_S + 1)) + range_b(SKY, TOW_S + 2)[:-1] + b"?" + bytes(9)
    log = read(tmp_path, data)
    assert len(np.unique(log.gnss.t_ns)) == 2 and len(log.gnss.t_ns) == 2 * len(SKY)
    told = {event.kind: event.detail for event in log.events}
    assert (
        "novatel_checksum" in told
        and f"of {len(data)} bytes are not NovAtel" in told["novatel_foreign_bytes"]
    )
    assert "novatel_compressed" not in told


def test_rangecmp4_is_the_range_that_it_was_made_of(tmp_path: Path) -> None:
    pytest.importorskip("novatel_edie.oem", reason="NovAtel's own library is not installed")
    sent = Channel(5, 22_000_010.25, 22_000_011.5 * 1575.42e6 / C_MPS, -1234.5, 41.05)
    gnss = read(tmp_path, rangecmp4(5, sent)).gnss
    assert gnss.sv_names == ("G05",) and gnss.signal_names == ("C1C",) and gnss.carrier_cycles is not None
    assert gnss.pseudorange_m[0] == pytest.approx(sent.range_m, abs=1e-3)
    assert gnss.carrier_cycles[0] == pytest.approx(sent.cycles, abs=1e-3)
    assert gnss.doppler_hz[0] == pytest.approx(sent.doppler_hz, abs=1e-3)
    assert gnss.cn0_dbhz[0] == pytest.approx(sent.cn0, abs=0.051)


def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str) -> None:
    (tmp_path / "library.py").write_text(program)
    monkeypatch.setattr(novatel_rewritten, "_PROGRAM", tmp_path / "library.py")


ASCII = b"#RANGEA,COM1,0,70.5,FINESTEERING,1919,228459.000,00000020,b1f6,32768;0*00000000\r\n"


@pytest.mark.parametrize(
    "program, told",
    [
        (
            "raise ImportError(\"No module named 'novatel_edie'\")",
            "is not installed: pip install 'insgnss[novatel]'",
        ),
        ("import os; os.abort()", "ended"),
    ],
)
def test_without_the_library_what_it_would_read_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str, told: str
) -> None:
    library(tmp_path, monkeypatch, program)
    log = read(tmp_path, range_b(SKY) + ASCII)
    assert len(log.gnss.t_ns) == len(SKY)
    assert [
        e.detail
        for e in log.events
        if e.kind == "novatel_compressed" and told in e.detail and "1 ASCII" in e.detail
    ]
    with pytest.raises(InputError, match=rf"1 ASCII(.|\n)*{re.escape(told)}(.|\n)*RANGEB"):
        read(tmp_path, ASCII)


def test_library_that_ends_early_leaves_what_it_wrote(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = tmp_path / "written"
    written.write_bytes(rawimusx(TOW_S, (1, 2, 3), (4, 5, 6)) * 2 + range_b(SKY))
    library(tmp_path, monkeypatch, f"import os; os.write(1, open({str(written)!r}, 'rb').read()); os.abort()")
    log = read(tmp_path, ASCII * 2)
    assert len(log.gnss.t_ns) == len(SKY)
    assert "the rest is not read" in "".join(e.detail for e in log.events)
