"""By how much a satellite's pseudoranges have been off for seconds: a reflection that stays, compiled.

The filter takes the errors of a row for noise of the variance r, which averages out. A reflection in a street does not:
a car that waits at a light sees the same one for a minute, and the position stays as far off as it was. What shows it
is the satellite's own residual e against the others (``integrity``),

    m = mean of e / sqrt(1 - g D g^T / r) over five seconds,   b^2 = max(m^2 - s^2 - 4 v r, B^2, 0)

with v r the variance that noise gives the mean (means below two of its sigmas are ignored), and s the sigma of the
satellite's slow error that the settings state: what that explains is not counted again. b, with the sign of m, is
the size of a slow error of the satellite (``slow_errors``), forgotten within ``adaptation.reflection_time_s``. So the
gains stay as they are, and sd_* and, with one heading, the gates include the position error that reflections cause. The
time matters little: 30 and 300 s give the same errors over sigma in a city within 5 %.

Among few satellites the residual of one that is off shows a part of its error, and those of the others the rest. So
none is taken for better than all together are on average, two sigmas of that mean of n squares taken off:

    B^2 = mean of (m^2 - s^2 - v r (1 + 2 sqrt(2 / (n - 4))))

In the centre of Hong Kong the position's error over sigma is 1.0 to 1.2 in the median and 2.8 to 3.9 at 95 % (0.8 and
1.7 would be right); without B 1.4 to 1.6 and 3.2 to 5.3, without b 2.0 and 10 to 13. Where the ranges of four in ten
satellites are off by 10 m rms for a minute, it is 1.9 (rms); without B 2.2, without b 6. White noise widens the sigma
by up to 1 %.

Needs five pseudoranges that agree, and slow errors that are followed. Neglects: of an error that moves position and
clock alone, no residual shows anything.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import Line, Lines
from insgnss.filter.update.integrity import UNKNOWNS
from insgnss.filter.update.satellite_memory import FORGOTTEN_S, RANGE_S, REFLECTION, REFLECTION_VARIANCE
from insgnss.gnss.observation_rows import PSEUDORANGE, GnssRows, Observation
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

_BY_CHANCE: Final = 4.0  # variances of the mean
_SIGMAS: Final = 2.0  # of the mean of all squares


@kernel(inline=True)
def write_reflections(memory: Float64, par: Parameters, rows: GnssRows, epoch: int, lines: Lines) -> None:
    """Write b into the lines of an epoch; zero of satellites that are not followed.

    ``memory`` is (slots, N_MEMORY), see ``satellite_memory``.
    """
    first, now = rows.first[epoch], rows.epoch_ns[epoch] * 1e-9
    count = rows.first[epoch + 1] - first if par.reflection_rate > 0.0 else 0
    n, squares, noise = 0, 0.0, 0.0
    for j in range(rows.first[epoch + 1] - first):
        lines[j].reflection = 0.0
    for j in range(count):
        row = rows.observation[first + j]
        own = memory[row.slot]
        if is_followed(lines[j], own, now):
            n += 1
            squares += beyond_slow_error(own, row)
            noise += own[REFLECTION_VARIANCE] * lines[j].variance[PSEUDORANGE]
    if n == 0:
        return
    of_all = (squares - noise * (1.0 + _SIGMAS * math.sqrt(2.0 / max(n - UNKNOWNS, 1)))) / n
    for j in range(count):
        row = rows.observation[first + j]
        own = memory[row.slot]
        if is_followed(lines[j], own, now):
            by_chance = _BY_CHANCE * own[REFLECTION_VARIANCE] * lines[j].variance[PSEUDORANGE]
            square = max(beyond_slow_error(own, row) - by_chance, of_all, 0.0)
            lines[j].reflection = math.copysign(math.sqrt(square), own[REFLECTION])


@kernel(inline=True)
def beyond_slow_error(own: Float64, row: Observation) -> float:
    """Return m^2 - s^2 [m^2]: how far a satellite's mean residual exceeds its stated slow error."""
    stated = np.float64(row.bias_sigma)
    return float(own[REFLECTION] * own[REFLECTION] - stated * stated)


@kernel(inline=True)
def is_followed(line: Line, own: Float64, now: float) -> bool:
    """Return whether a band's reflections are followed: its satellite has a place, and it was seen of late."""
    return bool(line.bias > 0 and now - own[RANGE_S] <= FORGOTTEN_S)
