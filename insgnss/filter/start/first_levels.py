"""The noise levels with which a filter begins."""

from __future__ import annotations

import numpy as np

from insgnss.filter.parameters import KindNumbers, Parameters
from insgnss.filter.rows.row_noise import model_variance, row_variance
from insgnss.filter.state import Bank
from insgnss.geodesy.local_level import up_direction
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.status import USED
from insgnss.tables import Float64


def begin_with_model_noise(bank: Bank, rows: GnssRows, epoch: int, par: Parameters) -> None:
    """Set the noise levels of a bank so that most sigmas which the log states too small are the model's at first.

    A level that is too high falls within a few epochs, as the residuals show it. One that is far too low stays: the
    loudest rows are refused, and the others seem as quiet as stated.
    """
    if not par.adapt_gain > 0.0:
        return
    for kind in (PSEUDORANGE, RANGE_RATE):
        level = _stated_level(rows, epoch, par, kind, bank.state[0].r_e)
        bank.state["noise_factor"][:, kind] = min(max(level, 1.0), float(par.adapt_most))


def _stated_level(rows: GnssRows, epoch: int, par: Parameters, kind: int, r_e: Float64) -> float:
    """Return the median ratio of the model's variance to that which the log states, of the rows of one kind."""
    of: KindNumbers = par.kind[kind]
    part = slice(int(rows.first[epoch]), int(rows.first[epoch + 1]))
    offered = rows.observation["status"][part, kind] == USED
    row, sight = rows.observation[part][offered], rows.sat[part, :3][offered] - r_e
    stated = row["sigma"][:, kind]
    if not (stated > 0.0).any():
        return 1.0
    sine = sight @ np.array(up_direction(r_e)) / np.linalg.norm(sight, axis=1)
    ratios = [
        model_variance(s, thermal, of) / row_variance(sigma, s, thermal, of)
        for s, thermal, sigma in zip(sine, row["thermal"], stated, strict=True)
    ]
    return float(np.median(ratios))
