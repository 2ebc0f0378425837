"""NovAtel's own library as a program: a log on standard input, all its messages in binary on standard output.

It runs in a process of its own, because the library ends its process on some damaged messages, and knows nothing of
the package, so that it starts at once. ASCII becomes binary and RANGECMP to RANGECMP5 become RANGE. Standard error gets
the library's output.
"""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, BinaryIO, Final

if TYPE_CHECKING:
    from novatel_edie.oem import Parser

_MOST_FAILURES: Final = 1000  # in a row, without a message between them


def main() -> None:
    """Rewrite standard input."""
    from novatel_edie.oem import Parser

    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # the library prints
    parser = Parser()
    parser.decompress_range_cmp = parser.ignore_abbreviated_ascii_responses = True
    data, at = sys.stdin.buffer.read(), 0
    while at < len(data):
        written = parser.write(data[at : at + parser.available_space])
        at += written
        _convert(parser, out, at == len(data))
        if not written:
            break
    out.close()


def _convert(parser: Parser, out: BinaryIO, last: bool) -> None:
    """Write the messages that the parser holds."""
    from novatel_edie import ENCODE_FORMAT, BufferEmptyException, NovatelEdieException

    failures = 0
    while failures < _MOST_FAILURES:
        try:
            out.write(parser.convert(ENCODE_FORMAT.BINARY, last).message)
            failures = 0
        except BufferEmptyException:
            return
        except NovatelEdieException:
            failures += 1


if __name__ == "__main__":
    main()
