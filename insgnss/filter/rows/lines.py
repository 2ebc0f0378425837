"""The work space of an epoch: one line for each row of the log, with what the filter expects of its measurements."""

from __future__ import annotations

from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from insgnss.gnss.observation_rows import N_KINDS
from insgnss.tables import Float64

WIDTH: Final = 15  # of the longest row, so that one compiled update serves all kinds

LINE_DTYPE: Final = np.dtype(
    (
        np.record,
        [
            ("status", np.int64, (N_KINDS,)),  # per kind: 0 pseudorange, 1 range rate, 2 carrier difference
            ("innovation", np.float64, (N_KINDS,)),  # at the prior
            ("variance", np.float64, (N_KINDS,)),  # r of the measurement
            ("predicted", np.float64, (N_KINDS,)),  # D = h P h^T at the prior
            ("h", np.float64, (N_KINDS, WIDTH)),  # row of H: its entries ...
            ("columns", np.int64, (N_KINDS, WIDTH)),  # ... where they stand ...
            ("count", np.int64, (N_KINDS,)),  # ... and how many they are
            ("group", np.int64),
            ("u_n", np.float64, (3,)),  # line of sight, north-east-down
            ("u_b", np.float64, (3,)),  # line of sight in body axes
            ("gain", np.float64),  # of the best antenna towards it [dBic], NaN where no antenna is described
            ("doubt", np.float64),  # probability that it is hidden, for which its variances were made larger
        ],
    )
)
ANTENNA_DTYPE: Final = np.dtype(
    (
        np.record,
        [
            ("r_a", np.float64, (3,)),  # antenna position, ECEF, at reception
            ("v_a", np.float64, (3,)),  # antenna velocity, ECEF
            ("l_e", np.float64, (3,)),  # lever arm, ECEF
            ("a_e", np.float64, (3,)),  # C_eb (w_ib x l)
            ("turning_e", np.float64, (3,)),  # the same of the rotation that counts as motion
            ("turned_e", np.float64, (3,)),  # lever arm of the epoch before, turned by that rotation [m]
            ("C_ne", np.float64, (3, 3)),
            ("u", np.float64, (3,)),  # line of sight
            ("distance", np.float64),  # of the last row: range [m] ...
            ("range_rate", np.float64),  # ... and how fast it grows [m/s]
            ("dr", np.float64, (3,)),  # derivative of the range rate by position
            ("u_before", np.float64, (3,)),  # line of sight at the epoch before
            # a little earlier, as ``delays`` has it
            ("look_back", np.float64),  # how much earlier [s]
            ("r_earlier", np.float64, (3,)),
            ("C_earlier", np.float64, (3, 3)),  # to its north-east-down
            ("u_earlier", np.float64, (3,)),  # line of sight, north-east-down
            # of the last row
            ("ionosphere", np.float64),  # delay on L1 [m] ...
            ("ionosphere_grown", np.float64),  # ... and by how much it has grown since
            ("troposphere", np.float64),
            ("troposphere_grown", np.float64),
            ("shell", np.float64),  # mapping of the ionosphere's residual [-]
            ("shell_grown", np.float64),
        ],
    )
)
Line: TypeAlias = Any  # one element of LINE_DTYPE: what the filter expects of one row
Lines: TypeAlias = npt.NDArray[Any]  # (k,) of LINE_DTYPE, one for each row of an epoch
Antenna: TypeAlias = Any  # one element of ANTENNA_DTYPE


FIT_ROWS: Final = 15  # of ``integrity``
CLONE_ROWS: Final = 4  # first of the vectors that keep the clone's rows of P until the next epoch


class Epoch(NamedTuple):
    """Work space of one epoch."""

    lines: Lines  # room for the rows of the largest epoch
    antenna: npt.NDArray[Any]  # (1,) of ANTENNA_DTYPE
    air: npt.NDArray[Any]  # (2,) of AIR_DTYPE: now, and a little earlier
    vectors: (
        Float64  # (4 + N_CLONE, n or k): correction, two of scratch, one to sort; the old clone's rows of P
    )
    fit: Float64  # (FIT_ROWS, 4) work space of ``integrity``
