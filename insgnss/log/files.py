"""Log files as bytes: unpacked when packed by gzip, zip or compress (.Z), decoded, hashed for the record."""

from __future__ import annotations

import gzip
import io
import os
import re
import zipfile
import zlib
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Final

import ncompress
import numpy as np
import pyarrow as pa

from insgnss.config.files import existing_file
from insgnss.errors import InputError
from insgnss.results.record import file_digest
from insgnss.tables import Int64

GZIP_MAGIC = b"\x1f\x8b"
COMPRESS_MAGIC = b"\x1f\x9d"
ZIP_MAGIC = b"PK\x03\x04"
_MAGIC_BYTES: Final = 4
_UNPACK: Final = "unpack it (gzip, zip and .Z are read as they are)"
_SAVE: Final = "save its table as CSV"
_FOREIGN: Final = {
    b"BZh": ("packed by bzip2", _UNPACK),
    b"\xfd7zXZ": ("packed by xz", _UNPACK),
    b"7z\xbc\xaf": ("a 7z archive", _UNPACK),
    b"Rar!": ("a RAR archive", _UNPACK),
    b"\x28\xb5\x2f\xfd": ("packed by Zstandard", _UNPACK),
    b"\xd0\xcf\x11\xe0": ("a spreadsheet or document of an office program", _SAVE),
    b"%PDF": ("a PDF document", _SAVE),
}
_WEB_PAGE: Final = re.compile(rb"(?:\xef\xbb\xbf)?\s*<(?:!doctype\s+html|html\b)", re.IGNORECASE)
_HEAD_BYTES: Final = 256  # of a file, in which a web page says that it is one
_UTF16_MARKS: Final = (b"\xff\xfe", b"\xfe\xff")
# Logs shrink to a third or a twentieth; a file of zeros to a thousandth
MOST_TIMES: Final = 100
_ALWAYS_ALLOWED_BYTES: Final = 1 << 26
_PIECE_BYTES: Final = 1 << 22


def largest_unpacked(packed_bytes: int) -> int:
    """Return the largest size that a packed part of a log may unpack to."""
    return max(MOST_TIMES * packed_bytes, _ALWAYS_ALLOWED_BYTES)


def file_buffer(path: Path) -> pa.Buffer:
    """Return the file's bytes without reading them yet (memory map), or unpacked when gzip, zip or compress packed it.

    A zip archive has to hold one file.

    Raises
    ------
    MissingFileError : no such file
    InputError : empty file, unreadable file, a packed file that is cut or damaged, or no log: a web page, for example
    """
    existing_file(path)
    try:
        if path.stat().st_size == 0:
            raise InputError("the file is empty", file=path, advice="check how it was recorded or copied")
        with path.open("rb") as stream:
            head = stream.read(_HEAD_BYTES)
        magic = head[:_MAGIC_BYTES]
        if magic.startswith(COMPRESS_MAGIC):
            return _uncompressed(path)
        if magic.startswith(GZIP_MAGIC):
            return _unpacked(path)
        if magic == ZIP_MAGIC:
            return _from_archive(path)
        _refuse_foreign(head, path)
        return pa.memory_map(os.fsencode(path)).read_buffer()
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise InputError(
            f"the gzip file is damaged or cut short: {error}", file=path, advice="copy it again"
        ) from error
    # not supported: another packing; a run-time error: a password
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
        raise InputError(
            f"the zip archive cannot be unpacked: {error}", file=path, advice="unpack it, or copy it again"
        ) from error
    except OSError as error:
        raise InputError(f"cannot be read: {error}", file=path) from error


def _refuse_foreign(head: bytes, path: Path) -> None:
    """Raise InputError for what a download or a program leaves in place of a log."""
    if _WEB_PAGE.match(head):
        raise InputError(
            "this is a web page, not a log",
            file=path,
            advice="the server answered with a page, because the address is wrong or asks for a login: download the"
            " file again",
        )
    for magic, (what, action) in _FOREIGN.items():
        if head.startswith(magic):
            raise InputError(
                f"the file is {what}", file=path, advice=f"{action}, and name the file that results"
            )


def first_bytes(path: Path, most: int) -> bytes:
    """Return up to ``most`` bytes from the beginning of a file; of a gzip file no more is unpacked.

    Raises
    ------
    MissingFileError, InputError : as ``file_buffer``
    """
    existing_file(path)
    with suppress(OSError, EOFError, zlib.error), gzip.open(path) as stream:
        data = stream.read(most)
        if data:
            return data
    # another packing or none, or a damaged file, of which this says what is wrong
    buffer = file_buffer(path)
    return bytes(buffer.slice(0, min(len(buffer), most)).to_pybytes())


def _from_archive(path: Path) -> pa.Buffer:
    """Return the content of the one file of a zip archive.

    Raises
    ------
    InputError : it holds another number of files, or grows more than a hundredfold
    OSError, EOFError, zlib.error, zipfile.BadZipFile, NotImplementedError, RuntimeError : it cannot be unpacked
    """
    with zipfile.ZipFile(path) as archive:
        files = [entry for entry in archive.infolist() if not entry.is_dir()]
        if len(files) != 1:
            listed = ", ".join(entry.filename for entry in files[:5]) + (", ..." if len(files) > 5 else "")
            raise InputError(
                f"the zip archive holds {len(files)} files{': ' if listed else ''}{listed}",
                file=path,
                advice="unpack it and name the files that you want; save a spreadsheet as CSV",
            )
        unpacked = _UnpackedBytes(path, "zip", files[0].compress_size)
        with archive.open(files[0]) as stream:
            while piece := stream.read(_PIECE_BYTES):
                unpacked.write(piece)
    return unpacked.buffer()


def _unpacked(path: Path) -> pa.Buffer:
    """Return the content of a gzip file, read in pieces; a file that expands too much is not a log.

    Raises
    ------
    InputError : it holds nothing, or grows more than a hundredfold
    OSError, EOFError, zlib.error : it is damaged or cut
    """
    unpacked = _UnpackedBytes(path, "gzip")
    with path.open("rb") as packed, gzip.GzipFile(fileobj=packed) as stream:
        while piece := stream.read(_PIECE_BYTES):
            unpacked.packed_bytes = packed.tell()
            unpacked.write(piece)
    return unpacked.buffer()


def _uncompressed(path: Path) -> pa.Buffer:
    """Return the content of a file of Unix' compress (LZW); it has no checksum, its reader detects a cut.

    Raises
    ------
    InputError : it is damaged, holds nothing, or grows more than a hundredfold
    """
    unpacked = _UnpackedBytes(path, "compressed (.Z)", path.stat().st_size)
    try:
        with path.open("rb") as packed:
            ncompress.decompress(packed, unpacked)
    except ValueError as error:
        raise InputError(
            "the compressed (.Z) file is damaged", file=path, advice="copy it again, or unpack it with gunzip"
        ) from error
    return unpacked.buffer()


class _UnpackedBytes:
    """The growing contents of a packed file."""

    def __init__(self, path: Path, kind: str, packed_bytes: int = 0) -> None:
        self.path, self.kind, self.packed_bytes = path, kind, packed_bytes
        self._pieces = bytearray()

    def write(self, piece: bytes) -> int:
        """Add a piece; refuse a file that expands too much to be a log."""
        self._pieces += piece
        if len(self._pieces) > largest_unpacked(self.packed_bytes):
            raise InputError(
                f"the {self.kind} file expands to more than {MOST_TIMES} times its size, which no log does",
                file=self.path,
                advice="if it is one, unpack it and name the unpacked file",
            )
        return len(piece)

    def buffer(self) -> pa.Buffer:
        """Return the contents; none is an error."""
        if not self._pieces:
            raise InputError(f"the {self.kind} file holds nothing", file=self.path)
        return pa.py_buffer(self._pieces)


def byte_stream(path: Path, buffer: pa.Buffer) -> BinaryIO:
    """Return the bytes of ``buffer``, that of a file, as a stream.

    Of a plain file it is the file itself: pages of a memory map would stay with the process, however often they are
    read once only.
    """
    stream = path.open("rb")
    if stream.read(_MAGIC_BYTES).startswith((GZIP_MAGIC, COMPRESS_MAGIC, ZIP_MAGIC)):
        stream.close()
        unpacked: BinaryIO = io.BufferedReader(pa.BufferReader(buffer))
        return unpacked
    stream.seek(0)
    return stream


def records(
    data: bytes, starts: list[int] | Int64, layout: np.dtype[np.void]
) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    """Return the records of a layout that begin at ``starts``, one for each."""
    if not len(starts):
        return np.zeros(0, layout)
    at = np.asarray(starts, dtype=np.int64)[:, None] + np.arange(layout.itemsize)
    return np.ascontiguousarray(np.frombuffer(data, np.uint8)[at]).view(layout)[:, 0]


def file_text(path: Path) -> str:
    """Return the file's text, unpacked when packed; bytes that are not UTF-8 are read as Latin-1.

    A byte order mark names UTF-16, in which some shells write what a program prints.
    """
    data: bytes = file_buffer(path).to_pybytes()
    try:
        if data.startswith(_UTF16_MARKS):
            return data.decode("utf-16")
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def sha256(path: Path) -> str:
    """Return the SHA-256 of the file as it lies on the disk, in hexadecimal digits."""
    return file_digest(existing_file(path))
