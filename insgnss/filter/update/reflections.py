"""By how much a satellite's pseudoranges have been off for seconds: a reflection that stays, compiled.

The filter takes the errors of a row for noise of the variance r, which averages out. A reflection in a street does not:
a car that waits at a light sees the same one for a minute, and the position stays as far off as it was. What shows it
is the satellite's own residual e against the others (``integrity``),

    m = mean of e / sqrt(1 - g D g^T / r) over five seconds,   b^2 = max(m^2 - 4 v r, 0)

with v r the variance that noise gives the mean: means below two of its sigmas are ignored. b, with the sign of m, is
the size of a slow error of the satellite (``slow_errors``), forgotten within ``adaptation.reflection_time_s``. So the
gains stay as they are, and sd_* and, with one heading, the gates include the position error that reflections cause. The
time matters little: 30 and 300 s give the same errors over sigma in a city within 5 %. Where the ranges of four in ten
satellites are off by 10 m rms for a minute, the position's error over sigma is 2.2 (rms); without it 6 to 10.

Needs five pseudoranges that agree, and slow errors that are followed. Neglects: of one satellite that is off among few,
the residuals show a part only.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import Lines
from insgnss.filter.update.satellite_memory import FORGOTTEN_S, RANGE_S, REFLECTION, REFLECTION_VARIANCE
from insgnss.gnss.observation_rows import PSEUDORANGE, GnssRows
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

_BY_CHANCE: Final = 4.0  # variances of the mean


@kernel(inline=True)
def write_reflections(memory: Float64, par: Parameters, rows: GnssRows, epoch: int, lines: Lines) -> None:
    """Write b into the lines of an epoch; zero of satellites that are not followed.

    ``memory`` is (slots, N_MEMORY), see ``satellite_memory``.
    """
    first, now = rows.first[epoch], rows.epoch_ns[epoch] * 1e-9
    for j in range(rows.first[epoch + 1] - first):
        own = memory[rows.observation[first + j].slot]
        lines[j].reflection = 0.0
        if lines[j].bias > 0 and par.reflection_rate > 0.0 and now - own[RANGE_S] <= FORGOTTEN_S:
            noise = own[REFLECTION_VARIANCE] * lines[j].variance[PSEUDORANGE]
            beyond = max(own[REFLECTION] * own[REFLECTION] - _BY_CHANCE * noise, 0.0)
            lines[j].reflection = math.copysign(math.sqrt(beyond), own[REFLECTION])
