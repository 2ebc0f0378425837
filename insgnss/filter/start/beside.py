"""A bank of copies and alternatives that takes the same epochs as the filter and runs in parallel.

Its results are written to no table. Its rejected epochs and its divergence are cleared after each epoch: they are the
filter's.
"""

from __future__ import annotations

import numpy as np

from insgnss.antenna.installation import Installation
from insgnss.antenna.visibility import VisibilityLimits
from insgnss.filter.layout import Layout
from insgnss.filter.loop import COVARIANCE_LOST
from insgnss.filter.output.writing import Output, Table, new_output
from insgnss.filter.own_update import run_beside
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.setup import FilterSetup
from insgnss.filter.state import Bank
from insgnss.filter.update.epoch_space import FilterWorkspace, new_workspace
from insgnss.filter.update.masking import NO_LIMITS
from insgnss.gnss.observation_rows import GnssRows

_N_EVENTS = 32  # more than one epoch can have


def roomy(
    work: FilterWorkspace | None,
    epoch: GnssRows,
    layout: Layout,
    installation: Installation | None = None,
    limits: VisibilityLimits = NO_LIMITS,
) -> FilterWorkspace:
    """Return the work space if it holds the rows of an epoch, else a new one that does."""
    n_rows = len(epoch.observation)
    if work is not None and len(work.epoch.lines) >= n_rows:
        return work
    return new_workspace(max(n_rows, 1), layout, installation, limits)


def update_beside(
    bank: Bank, epoch: GnssRows, imu: ImuSamples, parameters: Table, work: FilterWorkspace, setup: FilterSetup
) -> tuple[Output, bool]:
    """Carry a bank to an epoch and update it; return its output, and whether a covariance was lost.

    Parameters
    ----------
    epoch : the rows of one epoch
    parameters : (1,) of ``PARAMETERS_DTYPE``
    setup : of the filter beside which it runs: its states, and a user's own rows, which the bank takes too
    """
    out = new_output(epoch, 1, _N_EVENTS, np.zeros(0, np.int64), setup.layout.n_shown)
    code = run_beside(bank, epoch, imu, parameters, out, work, setup)
    clear_failures(bank)
    return out, code == COVARIANCE_LOST


def clear_failures(bank: Bank) -> None:
    """Clear the rejected epochs and the divergence of a bank that runs in parallel with the filter."""
    bank.head["rejected_epochs"] = 0
    bank.head["diverged_ns"] = 0


def copy_filter(filter_bank: Bank, bank: Bank) -> None:
    """Set the first hypotheses of a bank to the filter's, which may have used an epoch otherwise; weights stay."""
    n = len(filter_bank.state)
    own = bank.state[:n]
    weight = own["log_weight"].copy()
    own[:], bank.P[:n] = filter_bank.state, filter_bank.P
    own["log_weight"] = weight
    bank.memory[:n] = filter_bank.memory
