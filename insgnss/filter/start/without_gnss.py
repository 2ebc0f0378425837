"""The start of a filter that has no raw GNSS data: from a given state or position fixes, no clock in it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from insgnss.config.flight import GivenStart
from insgnss.filter.parameters import Parameters
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.setup import FilterSetup
from insgnss.filter.start.start import StartAttitude, given_attitudes, given_kinematics, open_bank
from insgnss.filter.state import Bank


class TimedStart(NamedTuple):
    """A state to start from."""

    t_ns: int
    state: GivenStart
    source: str  # in words
    attitudes: tuple[StartAttitude, ...] = ()  # where something shows more than the state says


def opened_at(start: TimedStart, setup: FilterSetup, imu: ImuSamples, par: Parameters) -> Bank:
    """Return the bank of a start inside the inertial samples; the receiver clock means nothing in it."""
    w = imu.w_ib_b[int(np.searchsorted(imu.t_ns, start.t_ns, side="right")) - 1]
    unknown = np.full(len(setup.clock_groups), math.nan)
    kin = given_kinematics(start.state, start.t_ns, unknown, 0.0, w, par)
    attitudes = list(start.attitudes) or given_attitudes(start.state, setup.config)
    bank = open_bank(kin, attitudes, w, par, setup.config, setup.grade, imu.t_ns, setup.layout)
    bank.head["renewed_ns"] = start.t_ns
    return bank
