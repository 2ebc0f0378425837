"""Damage as disks, transfers, editors and loggers do it, and numbers that nobody expects."""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable

import numpy as np

Rng = np.random.Generator
_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eEdD][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_]{2,}")
_NUMBERS = (
    *(b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e999", b"1e-320", b"0", b"-0.0", b"-1", b"1"),
    *(b"9223372036854775807", b"-9223372036854775808", b"18446744073709551616", b"9" * 40, b"9" * 400),
    *(
        b"1.7976931348623157e308",
        b"1D+99",
        b"1,5",
        b"0x10",
        b"1_000",
        b"true",
        b"",
        b" ",
        b"*",
        b"99",
        b"1e15",
    ),
)
_PIECES = (
    *(b"\0", b"\xff", b"\xfe\xff", b"\xef\xbb\xbf", b"\x1f\x8b", b"\x1f\x9d", b"\n", b"\r", b"\r\n", b"\t"),
    *(
        b'"',
        b"'",
        b",",
        b";",
        b"#",
        b"[",
        b"]",
        b"{",
        b"}",
        b"=",
        b"[[",
        b"\\",
        b">",
        b"*",
        b"$",
        b"\x1b[31m",
    ),
    *("\ud7ff\u202e".encode(), "é".encode("latin-1"), b"[" * 5000, b"a." * 2000, b"-" * 2000, b" " * 3000),
)


def damaged(rng: Rng, data: bytes) -> bytes:
    """Return the bytes with one to four kinds of damage, now and then gzipped, the archive damaged too."""
    for _ in range(int(rng.integers(1, 5))):
        data = _KINDS[int(rng.integers(len(_KINDS)))](rng, data)
    if rng.random() < 0.03:
        data = gzip.compress(data)
        data = _bits(rng, data) if rng.random() < 0.5 else data
    return data


def _span(rng: Rng, n: int, most: int = 200) -> tuple[int, int]:
    """Return begin and end of a piece."""
    begin = int(rng.integers(0, n + 1))
    return begin, min(n, begin + int(rng.integers(1, most)))


def _bits(rng: Rng, data: bytes) -> bytes:
    changed = bytearray(data)
    for at in rng.integers(0, max(len(data), 1), int(rng.integers(1, 9))).tolist() if data else ():
        changed[at] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _bytes(rng: Rng, data: bytes) -> bytes:
    begin, end = _span(rng, len(data), 16)
    return data[:begin] + rng.bytes(end - begin) + data[end:]


def _cut(rng: Rng, data: bytes) -> bytes:
    return data[: int(rng.integers(0, len(data) + 1))]


def _deleted(rng: Rng, data: bytes) -> bytes:
    begin, end = _span(rng, len(data))
    return data[:begin] + data[end:]


def _twice(rng: Rng, data: bytes) -> bytes:
    begin, end = _span(rng, len(data))
    return data[:end] + data[begin:]


def _inserted(rng: Rng, data: bytes) -> bytes:
    begin, _ = _span(rng, len(data))
    return data[:begin] + _PIECES[int(rng.integers(len(_PIECES)))] + data[begin:]


def _moved_lines(rng: Rng, data: bytes) -> bytes:
    lines = data.split(b"\n")
    a, b = rng.integers(0, len(lines), 2).tolist()
    lines[a], lines[b] = lines[b], lines[a]
    return b"\n".join(lines)


def _line_gone_or_twice(rng: Rng, data: bytes) -> bytes:
    lines = data.split(b"\n")
    at = int(rng.integers(len(lines)))
    return b"\n".join(lines[:at] + [lines[at]] * int(rng.choice([0, 2])) + lines[at + 1 :])


def _replaced(pattern: re.Pattern[bytes], choices: tuple[bytes, ...]) -> Callable[[Rng, bytes], bytes]:
    def replace(rng: Rng, data: bytes) -> bytes:
        found = list(pattern.finditer(data))
        if not found:
            return data
        one = found[int(rng.integers(len(found)))]
        return data[: one.start()] + choices[int(rng.integers(len(choices)))] + data[one.end() :]

    return replace


def _same_width(rng: Rng, data: bytes) -> bytes:
    """Replace a number by another of its width, as formats of fixed columns have them."""
    found = list(_NUMBER.finditer(data))
    if not found:
        return data
    one = found[int(rng.integers(len(found)))]
    if rng.random() < 0.3:  # the year 1, the satellite 0
        number = (b"1", b"0", b"9", b"-1")[int(rng.integers(4))]
        return data[: one.start()] + number.rjust(one.end() - one.start()) + data[one.end() :]
    digits = bytes(
        rng.choice(np.frombuffer(b"0123456789-. E+9", np.uint8), one.end() - one.start()).tobytes()
    )
    return data[: one.start()] + digits + data[one.end() :]


_KINDS = (
    *(_bits, _bytes, _cut, _deleted, _twice, _inserted, _moved_lines, _line_gone_or_twice, _same_width),
    *(_replaced(_NUMBER, _NUMBERS),) * 4,
    _replaced(_WORD, (b"", b"x", b"G99", b"E", "日".encode(), b"time_s", b"nan")),
)
