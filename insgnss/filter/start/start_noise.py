"""Epochs before a start that agree on no place: how noisy their rows are, or how late their tags."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from insgnss.filter.update.tag_jumps import late_apart
from insgnss.tables import Bool, Float64

_EPOCHS: Final = 300  # that are remembered
_LEAST: Final = 10  # epochs that say anything
# Beyond 30 times the noise it is not noise: wrong tags, another day's ephemerides
_MOST: Final = 900.0

AS_DECLARED: Final = np.ones(2)


class Misfit(NamedTuple):
    """How far the rows of an epoch disagree."""

    # (2,) per kind: chi-square by degree of freedom with the declared variances, NaN where the rows agree
    square: Float64
    X: Float64 | None  # as ``late_apart`` takes the pseudoranges; None where all of them agree


@dataclass
class StartNoise:
    """The epochs tried so far: how far those disagree whose rows have no solution."""

    misfits: list[Misfit] = field(default_factory=list)

    def note(self, misfit: Misfit) -> None:
        """Take an epoch."""
        self.misfits = [*self.misfits[1 - _EPOCHS :], misfit]

    @property
    def disagrees(self) -> Bool:
        """Whether most epochs have no solution, per kind (2,)."""
        failed = np.sum(~np.isnan(self._squares), axis=0)
        return np.asarray(failed > 0.5 * len(self.misfits))

    @property
    def _squares(self) -> Float64:
        return np.array([misfit.square for misfit in self.misfits]).reshape(-1, 2)

    def late_s(self) -> float:
        """Return by how much the tags are late if most epochs say so, else NaN."""
        some = [misfit.X for misfit in self.misfits if misfit.X is not None]
        if not len(some) > 0.5 * len(self.misfits):
            return math.nan
        late = np.array([late_apart(X.copy()).late_s for X in some])
        return float(np.nanmedian(late)) if np.sum(~np.isnan(late)) > 0.5 * len(self.misfits) else math.nan

    def factor(self) -> Float64:
        """Return the factor on the variances (2,): the median of the misfits of a kind that disagrees.

        One where something other than noise is wrong.
        """
        factor = AS_DECLARED.copy()
        if len(self.misfits) < _LEAST:
            return factor
        for kind in np.flatnonzero(self.disagrees):
            median = float(np.nanmedian(self._squares[:, kind]))
            if median <= _MOST:
                factor[kind] = max(median, 1.0)
        return factor

    def snapshot(self) -> StartNoise:
        """Return a copy; the epochs themselves do not change."""
        return StartNoise(list(self.misfits))
