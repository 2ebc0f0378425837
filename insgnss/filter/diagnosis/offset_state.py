"""An installation that is not as declared: the filter goes on with its errors as states.

Of inertial tags that are off and of a wrong lever arm that is the filter of a minute ago, over the minute again; of
GNSS tags, whose jump shows at once, the filter as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy

import numpy as np

from insgnss.filter.diagnosis.hindsight import Hindsight, Verdict
from insgnss.filter.diagnosis.resetting import inflate_bias_covariance
from insgnss.filter.diagnosis.supposed_faults import IMU_TAGS, LEVER, quiet, with_errors_that_last
from insgnss.filter.layout import Layout
from insgnss.filter.setup import FilterSetup
from insgnss.filter.state import OFFSETS, Bank, SlowErrors, new_bank
from insgnss.filter.states.imu_time import doubt_imu_time
from insgnss.filter.states.lever_arm import LEVER_ARM, hang_from_antenna
from insgnss.inertial.sensor_model import sensor_model


def wrong_lever_arm(again: Hindsight) -> list[Verdict]:
    """Return the result for a lever arm whose error is unknown."""
    if not again.setup.may_estimate_lever_arm:
        return []
    run, bank = _widened(again, again.setup.with_lever_arm())
    verdict = run.verdict(LEVER, bank, run.stretches)
    return [] if verdict is None else [verdict]


def with_installation_states(found: Verdict, again: Hindsight, suspects: Mapping[str, Verdict]) -> Verdict:
    """Return a verdict with the filter of the last epoch that estimates the tags' offset, and a suspect lever arm.

    At constant speed an offset of the tags looks like a lever arm along the way: what is found of one is in doubt
    without the other. An offset that is a state already is unknown again: the tags have changed.

    The wrong installation has spoilt attitude and biases: these begin uncertain, as after a reset. If the rerun fails,
    or the filter has no room for the states, the verdict is returned as it is.
    """
    setup = again.setup
    doubted = setup.may_estimate_imu_time
    if doubted:
        setup = setup.with_imu_time(early=IMU_TAGS in suspects and suspects[IMU_TAGS].size < 0.0)
    if LEVER in suspects and setup.may_estimate_lever_arm:
        setup = setup.with_lever_arm()
    elif not doubted:
        return found
    run, bank = _widened(again, setup)
    if doubted:
        doubt_imu_time(bank, setup.layout)
    inflate_bias_covariance(
        bank.state[0], bank.P[0], sensor_model(setup.grade, setup.layout.names), setup.layout
    )
    if run.until(bank, again.now_ns) is None:
        return found
    return found._replace(bank=bank, setup=setup)


def _widened(again: Hindsight, setup: FilterSetup) -> tuple[Hindsight, Bank]:
    """Return a rerun with the states of a wider setup, and its oldest filter."""
    before, layout = again.setup.layout, setup.layout
    bank = with_further_states(again.oldest(), before, layout)
    m, P = bank.state[0], bank.P[0]
    if before.at(LEVER_ARM) < 0:
        hang_from_antenna(m, P, m.w_last, layout)
    run = copy(again)
    run.setup = setup
    run.parameters = with_errors_that_last(quiet(setup.parameters()), again.past.banks[0])
    return run, bank


def with_gnss_time(bank: Bank, setup: FilterSetup) -> tuple[Bank, FilterSetup]:
    """Return a filter and its setup with the unknown offset of the GNSS tags; as they are where that is not possible.

    The epochs that showed the jump have used no pseudorange.
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
    wide.state["clone_ns"], wide.state["motion_response"][:, n:] = 0, 0.0
    wide.P[:, :n, :n] = bank.P[:, :n, :n]
    at = n
    for block in wider.blocks[len(layout.blocks) :]:
        for _ in range(block.size):
            wide.P[:, at, at] = block.variance
            at += 1
    S, R = np.zeros((len(bank.slow.S), wide.P.shape[1])), np.zeros(wide.P.shape[1:])
    S[:, :n], R[:n, :n] = bank.slow.S[:, :n], bank.slow.R[:n, :n]
    return wide._replace(slow=SlowErrors(S, R))
