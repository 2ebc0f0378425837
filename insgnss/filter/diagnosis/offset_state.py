"""Time tags that are off: the filter goes on with their offset as a state.

Of inertial tags that is the filter of a minute ago, over the minute again; of GNSS tags, whose jump shows at once, the
filter as it is.
"""

from __future__ import annotations

from copy import copy

import numpy as np

from insgnss.filter.diagnosis.hindsight import Hindsight, Verdict
from insgnss.filter.diagnosis.resetting import inflate_bias_covariance
from insgnss.filter.diagnosis.supposed_faults import quiet, with_errors_that_last
from insgnss.filter.layout import Layout
from insgnss.filter.setup import FilterSetup
from insgnss.filter.state import OFFSETS, Bank, SlowErrors, new_bank
from insgnss.filter.states.imu_time import to_imu_time
from insgnss.inertial.sensor_model import sensor_model


def with_offset_state(tags: Verdict, again: Hindsight) -> Verdict:
    """Return a verdict on inertial tags with the filter that estimates their offset, at the last epoch.

    The wrong tags have spoilt attitude and biases: these begin uncertain, as after a reset. If the rerun fails, or the
    filter has no room for the state, the verdict is returned as it is.
    """
    if not again.setup.may_estimate_imu_time:
        return tags
    setup = again.setup.with_imu_time(early=tags.size < 0.0)
    bank = with_further_states(again.oldest(), again.setup.layout, setup.layout)
    m, P = bank.state[0], bank.P[0]
    inflate_bias_covariance(m, P, sensor_model(setup.grade, setup.layout.names), setup.layout)
    to_imu_time(m, P, setup.layout)
    run = copy(again)
    run.setup = setup
    run.parameters = with_errors_that_last(quiet(setup.parameters()), again.past.banks[0])
    if run.until(bank, again.now_ns) is None:
        return tags
    return tags._replace(bank=bank, setup=setup)


def with_gnss_time(bank: Bank, setup: FilterSetup) -> tuple[Bank, FilterSetup]:
    """Return a filter and its setup with the unknown offset of the GNSS tags; as they are where that is not possible.

    The epochs that showed the jump have used no row.
    """
    if not setup.may_estimate_gnss_time:
        return bank, setup
    wider = setup.with_gnss_time()
    return with_further_states(bank, setup.layout, wider.layout), wider


def with_further_states(bank: Bank, layout: Layout, wider: Layout) -> Bank:
    """Return a filter that has further states, zero and as uncertain as their blocks say; its clone is forgotten.

    ``wider`` has the blocks of ``layout`` first.
    """
    n, members = OFFSETS + layout.n_values, len(bank.state)
    wide = new_bank(members, wider.n_optional)
    for name in ("state", "head", "seen", "memory"):
        getattr(wide, name)[:] = getattr(bank, name)
    wide.state["clone_ns"], wide.state["motion_response"] = 0, 0.0
    wide.P[:, :n, :n] = bank.P[:, :n, :n]
    at = n
    for block in wider.blocks[len(layout.blocks) :]:
        for _ in range(block.size):
            wide.P[:, at, at] = block.variance
            at += 1
    S, R = np.zeros((len(bank.slow.S), wide.P.shape[1])), np.zeros(wide.P.shape[1:])
    S[:, :n], R[:n, :n] = bank.slow.S[:, :n], bank.slow.R[:n, :n]
    return wide._replace(slow=SlowErrors(S, R))
