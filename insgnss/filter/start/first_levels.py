"""The noise levels with which a filter begins."""

from __future__ import annotations

import math

import numpy as np

from insgnss.filter.parameters import KindNumbers, Parameters
from insgnss.filter.rows.row_noise import model_variance, row_variance
from insgnss.filter.start.start_noise import AS_DECLARED, StartNoise
from insgnss.filter.state import Bank
from insgnss.filter.update.tag_jumps import expect_jump
from insgnss.geodesy.local_level import up_direction
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.status import USED
from insgnss.tables import Event, Float64


def begin_as_shown(
    bank: Bank, rows: GnssRows, epoch: int, par: Parameters, shown: StartNoise, noise: Float64
) -> list[Event]:
    """Begin with what the epochs before have shown: tags that are late, or ``noise`` (2,) beyond the declared one.

    Return the events that say so; late tags are found, and reported, by the next epoch.
    """
    late_s = shown.late_s()
    if math.isnan(late_s):
        begin_with_model_noise(bank, rows, epoch, par, noise)
        if not (noise > 1.0).any():
            return []
        detail = (
            "most epochs before the start agree on no solution: the noise of the pseudoranges counts as"
            f" {math.sqrt(noise[PSEUDORANGE]):.1f} times, that of the range rates as"
            f" {math.sqrt(noise[RANGE_RATE]):.1f} times what is declared"
        )
        return [Event(int(rows.epoch_ns[epoch]), "noise_risen", detail)]
    begin_with_model_noise(bank, rows, epoch, par, AS_DECLARED)
    expect_jump(bank, par, int(rows.epoch_ns[epoch]), late_s)
    return []


def begin_with_model_noise(bank: Bank, rows: GnssRows, epoch: int, par: Parameters, noise: Float64) -> None:
    """Set the noise levels of a bank so that most sigmas which the log states too small are the model's at first.

    A level that is too high falls within a few epochs, as the residuals show it. One that is far too low stays: the
    loudest rows are refused, and the others seem as quiet as stated. ``noise`` (2,) is what the epochs before showed.
    """
    if not par.adapt_gain > 0.0:
        return
    for kind in (PSEUDORANGE, RANGE_RATE):
        level = _stated_level(rows, epoch, par, kind, bank.state[0].r_e)
        bank.state["noise_factor"][:, kind] = min(max(level, noise[kind]), float(par.adapt_most))


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
