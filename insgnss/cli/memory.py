"""Return freed memory to the operating system, so that a large log does not stay in it after it was read."""

from __future__ import annotations

import ctypes
import gc
from typing import Final

import pyarrow as pa

_M_MMAP_THRESHOLD: Final = -3  # mallopt(3) of the GNU C library
_LARGE_BYTES: Final = 4 << 20


def give_back_what_is_freed() -> None:
    """Return freed memory to the operating system: large arrays of the C library, and Arrow's parsed pieces.

    By default the GNU library learns from the first large array that it frees to keep all of that size, and Arrow's own
    allocator keeps its segments: 150 MB on an hour of a big log. The collector need not look at modules.
    """
    gc.freeze()
    pa.set_memory_pool(pa.system_memory_pool())
    try:
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
    except (AttributeError, OSError, TypeError):
        return
