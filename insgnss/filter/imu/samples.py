"""The streaming engine's memory of inertial samples: contiguous, growing at the end, let go at the front."""

from __future__ import annotations

import numpy as np

from insgnss.filter.prediction import ImuSamples
from insgnss.tables import Float64

_FIRST_ROOM = 4096


class ImuBuffer:
    """Inertial samples in three arrays with room to grow; ``view`` gives the part in use without a copy."""

    def __init__(self) -> None:
        """Make an empty buffer."""
        self.clear()

    def clear(self) -> None:
        """Forget all samples."""
        self._t_ns = np.zeros(_FIRST_ROOM, np.int64)
        self._w = np.zeros((_FIRST_ROOM, 3))
        self._f = np.zeros((_FIRST_ROOM, 3))
        self._unknown = np.zeros((_FIRST_ROOM, 2))
        self._first = 0
        self._end = 0

    @property
    def last_ns(self) -> int | None:
        """Time of the newest sample."""
        return int(self._t_ns[self._end - 1]) if self._end > self._first else None

    @property
    def first_ns(self) -> int | None:
        """Time of the oldest sample."""
        return int(self._t_ns[self._first]) if self._end > self._first else None

    def append(self, t_ns: int, w_ib_b: Float64, f_b: Float64, unknown: Float64) -> None:
        """Add the newest sample."""
        if self._end == len(self._t_ns):
            self._make_room()
        self._t_ns[self._end] = t_ns
        self._w[self._end] = w_ib_b
        self._f[self._end] = f_b
        self._unknown[self._end] = unknown
        self._end += 1

    def _make_room(self) -> None:
        """Move what is in use to the front of arrays twice as long as it needs."""
        n = self._end - self._first
        room = max(_FIRST_ROOM, 2 * n)
        for name in ("_t_ns", "_w", "_f", "_unknown"):
            old = getattr(self, name)
            new = np.zeros((room, *old.shape[1:]), old.dtype)
            new[:n] = old[self._first : self._end]
            setattr(self, name, new)
        self._first, self._end = 0, n

    def view(self) -> ImuSamples:
        """Return the samples as the compiled loop reads them."""
        used = slice(self._first, self._end)
        return ImuSamples(self._t_ns[used], self._w[used], self._f[used], self._unknown[used])

    def last_before(self, t_ns: int) -> int:
        """Return the time of the newest sample at or before ``t_ns``."""
        t = self._t_ns[self._first : self._end]
        return int(t[max(int(np.searchsorted(t, t_ns, side="right")) - 1, 0)])

    def drop_before(self, t_ns: int) -> int:
        """Let go of the samples before ``t_ns``, many at a time; return how many."""
        n = int(np.searchsorted(self._t_ns[self._first : self._end], t_ns))
        if n < _FIRST_ROOM // 4:
            return 0
        self._first += n
        return n
