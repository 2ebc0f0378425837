"""Epochs in which several headings were open, rerun with the one that was found.

While a bank is open its hypotheses share the epochs, and none is smoothed: which one is right is not known yet. Once it
is, the gyros say how the vehicle stood when the bank was opened. The hypothesis nearest to that, turned to it, goes
over the same epochs alone, with the sigma of its heading as it was. It is then a filter like any other, smoothed
from the rest of the log at the epoch at which one heading was left. The information of the rest enters its first
heading, about which its equations are linear, but not its covariance.

Where it comes to something else than the smoothed filter, the epochs stay as the open bank had them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.filter.diagnosis.supposed_faults import quiet
from insgnss.filter.headings.heading_bank import set_attitude, turn_member
from insgnss.filter.headings.headings import turn_about, yaw_variance
from insgnss.filter.loop import COVARIANCE_LOST
from insgnss.filter.output.writing import CLOCK_STEP, DRIFT_STEP, new_output
from insgnss.filter.own_update import OwnUpdate, run_beside
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.setup import FilterSetup
from insgnss.filter.smoothing.smoother_step import (
    FilteredEpoch,
    SmoothedEpoch,
    apart,
    attitude_before,
    keep,
    keep_own,
    kept_as_opened,
    stepped_tags,
)
from insgnss.filter.state import CLOCK, DR, DRIFT, PSI, Bank, select_members
from insgnss.gnss.observation_rows import GnssRows

_STEPPED: Final = {int(CLOCK_STEP): CLOCK, int(DRIFT_STEP): DRIFT}
_COMPARED: Final = slice(DR, PSI + 3)  # position, velocity, attitude
_AGREES: Final = 40.0  # squared sigmas of nine states: by chance more in one of 10^5


@dataclass
class OpenPhase:
    """The bank as it was opened, and the epochs until one heading was left."""

    bank: Bank
    linked: bool  # whether the filter of one heading before it was kept, at the same time
    epochs: list[GnssRows] = field(default_factory=list)  # each alone


def gone_over_alone(
    phase: OpenPhase, epoch: SmoothedEpoch, setup: FilterSetup, imu: ImuSamples, parameters: npt.NDArray[Any]
) -> list[FilteredEpoch]:
    """Return the epochs of a phase as the hypothesis left at its last ``epoch`` goes over them, the last one too.

    Empty where that does not come to what was found.
    """
    bank = _opened_right(phase.bank, epoch, setup, imu, parameters)
    chain = [kept_as_opened(bank)]
    calm, layout = quiet(parameters), setup.layout
    largest = max((len(rows.observation) for rows in phase.epochs), default=0)
    work = setup.workspace(max(largest, 1))

    def own_step(step: OwnUpdate) -> None:
        chain.append(keep_own(bank, step, linked=True, fits=True))

    for rows in phase.epochs:
        out = new_output(rows, 1, 32, np.zeros(0, np.int64), layout.n_shown)
        code = run_beside(bank, rows, imu, calm, out, work, setup, own_step)
        if code == COVARIANCE_LOST:
            return []
        kinds = map(int, out.events["kind"][: out.counts[0].events])
        stepped = tuple(_STEPPED[kind] for kind in kinds if kind in _STEPPED)
        stepped += stepped_tags(bank, layout, int(rows.epoch_ns[0]))
        chain.append(keep(bank, work.epoch, layout, linked=True, stepped=stepped))
    d = apart(epoch.state(), bank.state[0], layout)[_COMPARED]
    P = bank.P[0][_COMPARED, _COMPARED]
    return chain if float(d @ np.linalg.solve(P, d)) < _AGREES else []


def _opened_right(
    bank: Bank, epoch: SmoothedEpoch, setup: FilterSetup, imu: ImuSamples, parameters: npt.NDArray[Any]
) -> Bank:
    """Return the hypothesis of a bank nearest to the attitude that was found, turned to it."""
    smoothed = epoch.state()
    then = smoothed.copy()
    then.r_e[:] = bank.state["r_e"][bank.head[0].leader]
    set_attitude(then, attitude_before(bank, epoch.kept.t_ns, smoothed, imu, parameters))
    turns = [turn_about(m, then) for m in bank.state]
    nearest = int(np.argmin(np.abs(turns)))
    one = select_members(bank, np.array([nearest], np.int64))
    m, P = one.state[0], one.P[0]
    sigma = math.sqrt(yaw_variance(m, P))
    turn_member(m, P, turns[nearest], sigma, parameters[0].lever_b, setup.layout)
    return one
