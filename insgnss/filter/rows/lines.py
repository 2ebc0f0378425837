"""The work space of an epoch: one line for each row of the log, with the prediction of its measurements."""

from __future__ import annotations

from typing import Annotated, Any, Final, NamedTuple, TypeAlias

import numpy.typing as npt

from insgnss.filter.state import N_CLONE, N_PATTERNS
from insgnss.gnss.observation_rows import N_KINDS
from insgnss.kernels.records import Record, dtype_of
from insgnss.tables import Float64, Int64

WIDTH: Final = 21  # of the longest row, so that one compiled update serves all kinds


class Line(Record):
    """The filter's prediction of one row."""

    status: Annotated[Int64, N_KINDS]  # per kind: 0 pseudorange, 1 range rate, 2 carrier difference
    innovation: Annotated[Float64, N_KINDS]  # at the prior
    variance: Annotated[Float64, N_KINDS]  # r of the measurement
    predicted: Annotated[Float64, N_KINDS]  # D = h P h^T at the prior
    h: Annotated[Float64, N_KINDS, WIDTH]  # row of H: its entries ...
    columns: Annotated[Int64, N_KINDS, WIDTH]  # ... where they stand ...
    count: Annotated[Int64, N_KINDS]  # ... and how many they are
    group: int
    bias: int  # number of the satellite's slow error, from one (``range_biases``); 0: it has none
    load: Annotated[
        Float64, N_PATTERNS
    ]  # effect of one sigma of the sky's slow errors on the pseudorange [m]
    reflection: float  # by how much its pseudoranges have been off for seconds [m], signed (``reflections``)
    slow: float  # variance that the slow errors of message and air add to its innovation [m^2]
    astray: float  # the same of the state's error by reflections and by earlier slow errors [m^2]
    weakness: float  # of its signal [dB], see ``signal_weakness`` ...
    weak: float  # ... and what that adds to the variance of its pseudorange
    extra: float  # what its satellite's own noise adds to its range rate's variance (``satellite_noise``)
    foreseen: float  # the same, by the epochs before
    square: float  # mean square of its range rate's residual over the variance at the level of all
    u_n: Annotated[Float64, 3]  # line of sight, north-east-down
    u_b: Annotated[Float64, 3]  # line of sight in body axes
    gain: float  # of the best antenna towards it [dBic], NaN where no antenna is described
    doubt: float  # probability that it is hidden, for which its variances were made larger


LINE_DTYPE: Final = dtype_of(Line)


class AntennaState(Record):
    """The antenna at an epoch, and the geometry of its last row."""

    r_a: Annotated[Float64, 3]  # antenna position, ECEF, at reception
    v_a: Annotated[Float64, 3]  # antenna velocity, ECEF
    l_b: Annotated[Float64, 3]  # lever arm, body: that of the flight file, and what was found of its error
    l_e: Annotated[Float64, 3]  # the same, ECEF
    w_b: Annotated[Float64, 3]  # rate w_ib of the body that counts as motion
    a_e: Annotated[Float64, 3]  # C_eb (w_ib x l)
    turning_e: Annotated[Float64, 3]  # the same of the rotation that counts as motion
    shown_v_e: Annotated[
        Float64, 3
    ]  # velocity and acceleration of the antenna that count as motion, where the
    shown_a_e: Annotated[Float64, 3]  # IMU's time is estimated, ECEF
    whole_a_e: Annotated[Float64, 3]  # its acceleration, noise and all
    swing: Annotated[Float64, 3, 3]  # scratch of ``lever_swing``
    C_ne: Annotated[Float64, 3, 3]
    u: Annotated[Float64, 3]  # line of sight
    distance: float  # of the last row: range [m] ...
    range_rate: float  # ... and how fast it grows [m/s]
    dr: Annotated[Float64, 3]  # derivative of the range rate by position
    u_before: Annotated[Float64, 3]  # line of sight at the epoch before
    # a little earlier, as ``delays`` has it
    look_back: float  # how much earlier [s]
    r_earlier: Annotated[Float64, 3]
    C_earlier: Annotated[Float64, 3, 3]  # to its north-east-down
    u_earlier: Annotated[Float64, 3]  # line of sight, north-east-down
    # of the last row
    ionosphere: float  # delay on L1 [m] ...
    ionosphere_grown: float  # ... and by how much it has grown since
    troposphere: float
    troposphere_grown: float
    shell: float  # mapping of the ionosphere's residual [-]
    shell_grown: float


ANTENNA_DTYPE: Final = dtype_of(AntennaState)
Lines: TypeAlias = npt.NDArray[Any]  # (k,) of LINE_DTYPE, one for each row of an epoch


FIT_ROWS: Final = 15  # of ``integrity``
CLONE_ROWS: Final = 4  # first of the vectors that keep the clone's rows of P until the next epoch
# first of those that keep the gains: a range's and a carrier's of each line
GAIN_ROWS: Final = CLONE_ROWS + N_CLONE


class EpochWorkspace(NamedTuple):
    """Work space of one epoch."""

    lines: Lines  # room for the rows of the largest epoch
    antenna: npt.NDArray[Any]  # (1,) of ANTENNA_DTYPE
    air: npt.NDArray[Any]  # (2,) of AIR_DTYPE: now, and a little earlier
    # (4 + N_CLONE + 2 k, n or k): correction, two of scratch, one to sort; the old clone's rows of P; gains
    vectors: Float64
    fit: Float64  # (FIT_ROWS, 4) work space of ``integrity``
