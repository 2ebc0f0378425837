"""Packed files: what gzip and Unix' compress (.Z, of the older archives) made is read, damage and bombs are told."""

from __future__ import annotations

import bz2
import gzip
import hashlib
import io
import lzma
import zipfile
from collections.abc import Callable
from pathlib import Path

import ncompress
import pytest

from insgnss.errors import InputError
from insgnss.log.files import byte_stream, file_buffer, file_text, first_bytes
from insgnss.log.rinex.navigation import read_navigation

TEXT = "time_s,x,y,name\n1,2,3,a\n"
# compress 4.2.4 of Debian: printf 'time_s,x,y,name\\n1,2,3,a\\n' | compress -c | xxd -p
BY_COMPRESS = bytes.fromhex("1f9d9074d2b429f3650e0b3c2cf2b0701366a082182c64b098c1228c02")


def zipped(data: bytes, *further: str) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.mkdir("logs")
        archive.writestr("logs/brdc0010.21n", data)
        for name in further:
            archive.writestr(name, data)
    return stream.getvalue()


PACKERS = {"gz": gzip.compress, "Z": ncompress.compress, "zip": zipped}


def written(tmp_path: Path, data: bytes, name: str = "brdc0010.21n.Z") -> Path:
    path = tmp_path / name
    path.write_bytes(data)
    return path


def test_file_that_compress_made_is_read(tmp_path: Path) -> None:
    path = written(tmp_path, BY_COMPRESS)
    assert file_text(path) == TEXT
    assert byte_stream(path, file_buffer(path)).read() == TEXT.encode()


@pytest.mark.parametrize("data", [b"\x1f\x9d", b"\x1f\x9d\xff" + BY_COMPRESS[3:], b"\x1f\x9d\x90abc"])
def test_damaged_compressed_file_is_told(tmp_path: Path, data: bytes) -> None:
    path = written(tmp_path, data)
    with pytest.raises(InputError, match=r"(?s)brdc0010\.21n\.Z.*damaged.*gunzip"):
        file_buffer(path)


def test_compressed_file_of_nothing_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds nothing"):
        file_buffer(written(tmp_path, BY_COMPRESS[:3]))


@pytest.mark.parametrize("pack", PACKERS.values(), ids=PACKERS.keys())
def test_file_that_grows_beyond_belief_is_refused(tmp_path: Path, pack: Callable[[bytes], bytes]) -> None:
    path = written(tmp_path, pack(bytes(80_000_000)))
    with pytest.raises(InputError, match="more than 100 times its size"):
        file_buffer(path)


@pytest.mark.parametrize("pack", PACKERS.values(), ids=PACKERS)
def test_first_bytes_are_those_of_the_unpacked_file(tmp_path: Path, pack: Callable[[bytes], bytes]) -> None:
    assert first_bytes(written(tmp_path, pack(TEXT.encode())), 6) == b"time_s"
    assert first_bytes(written(tmp_path, TEXT.encode()), 6) == b"time_s"


def test_gzip_file_damaged_behind_its_first_bytes_gives_these_alone(tmp_path: Path) -> None:
    noise = b"".join(hashlib.sha256(bytes([k])).digest() for k in range(256)) * 100
    cut = written(tmp_path, gzip.compress(noise)[:-20])
    assert first_bytes(cut, 100) == noise[:100]
    with pytest.raises(InputError, match="cut short"):
        first_bytes(cut, len(noise))


def test_the_one_file_of_an_archive_is_read(tmp_path: Path) -> None:
    path = written(tmp_path, zipped(TEXT.encode()), "log.zip")
    assert file_text(path) == TEXT
    assert byte_stream(path, file_buffer(path)).read() == TEXT.encode()


def test_archives_that_cannot_be_read_are_told(tmp_path: Path) -> None:
    several = zipped(TEXT.encode(), "second.21n")
    with pytest.raises(InputError, match=r"holds 2 files: logs/brdc0010\.21n, second\.21n"):
        file_buffer(written(tmp_path, several))
    whole = zipped(TEXT.encode() * 100)
    for damaged in (whole[:40], whole[:-10], whole[:60] + b"xx" + whole[62:]):
        with pytest.raises(InputError, match=r"zip archive cannot be unpacked|damaged"):
            file_buffer(written(tmp_path, damaged))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_text_with_a_byte_order_mark_is_read(tmp_path: Path, encoding: str) -> None:
    assert file_text(written(tmp_path, TEXT.encode(encoding))) == TEXT


@pytest.mark.parametrize(
    ("head", "words"),
    [
        (b"<!DOCTYPE html>\n<html><body>Log in</body></html>", "web page.*login: download"),
        (b"\xef\xbb\xbf\n <HTML>\n<h1>404</h1>", "web page"),
        (bz2.compress(TEXT.encode()), "packed by bzip2.*unpack it"),
        (lzma.compress(TEXT.encode()), "packed by xz.*unpack it"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(500), "spreadsheet.*as CSV"),
    ],
)
def test_what_a_download_leaves_in_place_of_a_log_is_named(tmp_path: Path, head: bytes, words: str) -> None:
    path = written(tmp_path, head, "brdc2350.16n.gz")
    for read in (file_buffer, lambda own: first_bytes(own, 10), lambda own: read_navigation([own])):
        with pytest.raises(InputError, match=rf"(?s)brdc2350\.16n\.gz.*{words}"):
            read(path)
