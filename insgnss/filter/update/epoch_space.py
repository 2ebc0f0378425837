"""The work space of the loop: of an epoch, of the prediction, of an output between epochs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from insgnss.antenna.installation import Installation
from insgnss.antenna.visibility import VisibilityLimits
from insgnss.filter.layout import Layout
from insgnss.filter.prediction import Scratch, new_scratch
from insgnss.filter.rows.lines import ANTENNA_DTYPE, FIT_ROWS, GAIN_ROWS, LINE_DTYPE, EpochWorkspace
from insgnss.filter.state import ABSENT_STATE, OFFSETS, Bank, new_bank
from insgnss.filter.update.masking import NO_LIMITS, MaskingStage, new_masking
from insgnss.filter.update.predictions import columns_of
from insgnss.gnss.range_model import AIR_DTYPE
from insgnss.tables import Float64


class FilterWorkspace(NamedTuple):
    """All work space of the loop, allocated once per log."""

    epoch: EpochWorkspace
    scratch: Scratch
    spare: Bank  # one member: the leader carried on to an output time
    P_out: Float64  # (n, n)
    masking: MaskingStage


def new_workspace(
    rows_per_epoch: int,
    layout: Layout,
    installation: Installation | None = None,
    limits: VisibilityLimits = NO_LIMITS,
) -> FilterWorkspace:
    """Return work space for epochs of at most ``rows_per_epoch`` rows and the error states of ``layout``.

    ``installation`` and ``limits`` are those of the visibility stage.
    """
    n = OFFSETS + layout.n_optional
    epoch = new_epoch(rows_per_epoch, n, layout.at_clone)
    masking = new_masking(installation, limits)
    return FilterWorkspace(epoch, new_scratch(n), new_bank(1, layout.n_optional), np.zeros((n, n)), masking)


def new_epoch(k: int, n: int, at_clone: int = ABSENT_STATE) -> EpochWorkspace:
    """Return work space for epochs of at most ``k`` rows and ``n`` error states, the clone from ``at_clone`` on."""
    lines = np.zeros(k, LINE_DTYPE)
    for kind, columns in enumerate(columns_of(at_clone)):
        lines["columns"][:, kind, : len(columns)] = columns
        lines["count"][:, kind] = len(columns)
    lines["gain"] = math.nan
    return EpochWorkspace(
        lines,
        np.zeros(1, ANTENNA_DTYPE),
        np.zeros(2, AIR_DTYPE),
        np.zeros((GAIN_ROWS + 2 * k, max(k, n))),
        np.zeros((FIT_ROWS, 4)),
    )
