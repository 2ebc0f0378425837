"""Return freed memory to the operating system, so that a large log does not stay in it after it was read."""

from __future__ import annotations

import ctypes
import gc
from typing import Final

import pyarrow as pa

_M_MMAP_THRESHOLD: Final = -3  # mallopt(3) of the GNU C library
_M_ARENA_MAX: Final = -8
_LARGE_BYTES: Final = 1 << 20


def give_back_what_is_freed() -> None:
    """Return freed memory to the operating system: large arrays of the C library, and Arrow's parsed pieces.

    By default the GNU library learns from the first large array that it frees to keep all of that size, and Arrow's own
    allocator keeps its segments: 150 MB on an hour of a big log. One arena for all threads leaves fewer pieces unused;
    the threads rarely allocate. The collector need not look at modules.
    """
    gc.freeze()
    pa.set_memory_pool(pa.system_memory_pool())
    try:
        library = ctypes.CDLL(None)
        library.mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
        library.mallopt(_M_ARENA_MAX, 1)
    except (AttributeError, OSError, TypeError):
        return
