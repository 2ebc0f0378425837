"""Errors of inertial samples between sensor and file: time tags that jitter, samples that are lost."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.tables import Bool, ImuTable

_MOST_OF_A_STEP: Final = 0.45  # the largest jitter: tags never change their order


@dataclass(frozen=True)
class ImuRecord:
    """How a log is written: deviation of its tags, and how many of its samples are missing."""

    tag_jitter_s: float = 0.0  # one sigma, white
    lost_share: float = 0.0  # of the samples, on average
    lost_at_once: int = 1  # neighbouring samples that are lost together

    def log(self, imu: ImuTable, rng: np.random.Generator) -> tuple[ImuTable, Bool]:
        """Return the samples that reach the file, with its tags, and which ones they are.

        The first and the last sample are always kept, so that the span of a log is that of its scenario.
        """
        count = len(imu.t_ns)
        kept = np.ones(count, np.bool_)
        if self.lost_share > 0.0:
            begins = rng.random(count) < self.lost_share / self.lost_at_once
            for later in range(self.lost_at_once):
                kept[later:] &= ~begins[: count - later]
            kept[[0, -1]] = True
        t_ns = imu.t_ns
        if self.tag_jitter_s > 0.0:
            most = _MOST_OF_A_STEP * float(np.min(np.diff(t_ns))) / NS_PER_S
            off = np.clip(self.tag_jitter_s * rng.standard_normal(count), -most, most)
            t_ns = t_ns + np.rint(off * NS_PER_S).astype(np.int64)
        return replace(imu, t_ns=t_ns[kept], w_ib_b=imu.w_ib_b[kept], f_b=imu.f_b[kept]), kept
