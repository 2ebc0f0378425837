"""The workspace of a receiver study's loop: design, signals, states of filter and channels, history."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy.typing as npt

from insgnss.filter.prediction import Scratch
from insgnss.filter.state import CLOCK, DR, DRIFT, StateArray
from insgnss.inertial.error_state import N_MOTION
from insgnss.tables import Float64, Int64

# which receiver
SCALAR, TWO_STAGE, INTERVAL_MESSAGE, ONE_STAGE = range(4)
NO_SIGNAL: Final = -1  # the level of a channel that has nothing to see
HELD: Final = -1
NO_STATE: Final = -1  # among those that noise disturbs: an offset of a message that no state makes
# states whose covariance is kept: motion and clock
RECORDED: Final = (*range(DR, DR + N_MOTION), CLOCK, DRIFT)


class ReceiverDesign(NamedTuple):
    """The design of a receiver."""

    kind: int
    interval: int  # integrations between two updates of the second stage
    inflation: float  # of the variances of the channels' running estimates, as rows
    F: Float64  # (p, p) transition of a channel's range, rate (and acceleration) over an integration
    walk: Float64  # (p, p) what is added to their covariance
    back: Float64  # (p, p) F^-1
    noise: Float64  # (1 or 2, p, p) what clock, and motion without INS, add to a path's covariance over an integration
    record_every: int  # integrations
    settle: int  # integrations whose offsets do not count
    # beyond which a channel is lost: range [m], rate [m/s], and for how long
    limits: tuple[float, float, int]
    # in which oscillators set replicas: range [m], rate [m/s]; 0: no steps
    steps: tuple[float, float]


class SignalArrivals(NamedTuple):
    """The signals that arrive over n integrations at m channels."""

    ranges: Float64  # (n, m) with the receiver's clock [m]
    rates: Float64  # (n, m) with its drift [m/s]
    level: Int64  # (n, m) of C/N0, ``NO_SIGNAL`` where none arrives
    apart: Float64  # (n, m) ranges by the phase less those by the code [m]


class AidingInputs(NamedTuple):
    """The receiver's aiding over n integrations."""

    satellites: Float64  # (n, m, 6)
    rate_b: Float64  # (n, 3)
    force_b: Float64  # (n, 3)
    ahead_b: Float64  # (n, 6) errors of replicas that are led on: place [m] and velocity [m/s], body axes
    level: Int64  # (n, m) of the C/N0 that it takes for true, ``NO_SIGNAL``: the channel's rows are left out
    unknown: Float64  # (n, 2) densities of turning and acceleration that no sample shows [rad^2/s], [m^2/s^3]


class FilterRoom(NamedTuple):
    """The filter and its work space."""

    state: StateArray  # (1,)
    P: Float64  # (n, n)
    par: npt.NDArray[Any]  # (1,) of PARAMETERS_DTYPE
    scratch: Scratch
    v: Float64  # (4, n)
    h: Float64  # (3, 13)
    columns: Int64  # (8,), or (9,) where phases have states of their own: the last one is a channel's
    phase_columns: Int64  # (5,) scratch
    # (12,) or (13,): those, with the accelerometers' biases and what all accelerations share in front of a phase's own
    acceleration_columns: Int64
    # (k,) states that noise within an interval drives, if the filter takes messages of intervals; as many states stand
    # behind all others, for what this noise does to the messages
    disturbed: Int64


class ChannelRoom(NamedTuple):
    """The channels' states and work space."""

    x: Float64  # (m, p) range [m], rate [m/s], acceleration [m/s^2]
    P: Float64  # (m, p, p)
    base: Float64  # (m, 2) the filter's predictions from which the next change is counted
    message: Float64  # (m, p, p + 1) of the interval
    all_messages: Float64  # (p, p + 1) their sum
    noise_sums: Float64  # (1 or 2, 2, p, p + 1) the sums G and Y of ``interval_noise``, for clock and motion
    z: Float64  # (p,) what a channel gives to the filter ...
    C: Float64  # (p, p) ... and its covariance
    u: Float64  # (m, 3)
    g: Float64  # (m, 3) derivative of the range rate by the position
    predicted: Float64  # (m, 2)
    v: Float64  # (3, p)
    F_P: Float64  # (p, p)
    h: Float64  # (p,)
    columns: Int64  # (p,)
    offset: Float64  # (3,)
    seen: Float64  # (4,)
    silent: Int64  # (m,) 1: nothing was seen in the last integration
    met: Int64  # (m,) 1: the channel has seen its signal before
    pulling: Int64  # (m,) integrations for which a phase that has returned is still pulled in
    fresh: Int64  # (m,) 1: the filter does not know the phase's cycle yet
    cycles: Float64  # (m,) by which the phase's range counts otherwise than at the beginning, in truth [m]
    innovation: Float64  # (m,) range that the filter took last, less the one that it predicted [m]
    done: Int64  # (1,) integrations so far


class ReceiverHistory(NamedTuple):
    """Recorded history of a run."""

    state: Float64  # (k, 12) r_e, v_e, q_eb, clock, drift at the recorded integrations
    covariance: Float64  # (k, 11, 11) of ``RECORDED``
    offsets: Float64  # (k, m, 2) truth minus the channels' estimates, or minus the filter's prediction
    squares: Float64  # (m, 2) sums over the integrations that count
    led: Float64  # (m, 2) sums of the same integrations: squares of what replicas were off by as they were led on
    counted: Int64  # (m,)
    # (m, 3) sums over the records that count: variances of range and rate that the receiver predicts, and their number
    predicted: Float64
    lost_at: Int64  # (m,) first integration of a loss, ``HELD``: none
    losing: Int64  # (m,) integrations in a row beyond the limits
    power: Float64  # (block, m) of the prompt replicas
    innovation: Float64  # (k, m) of the newest update; NaN of channels without a signal
    apart: Float64  # (k, m, 2) the filter's own ranges by phase less those by code, and their variance
