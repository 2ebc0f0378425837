"""By how much a satellite's pseudoranges have been off for seconds: a reflection that stays, compiled.

The filter takes the errors of a row for noise of the variance r, which averages out. A reflection in a street does not:
a car that waits at a light sees the same one for a minute, and the position stays as far off as it was. What shows it
is the satellite's own residual e against the others (``integrity``),

    m = mean of e / sqrt(1 - g D g^T / r) over five seconds,   b^2 = max(m^2 - 0.4 r, 0)

where noise alone has m^2 = r / 10, and twice its sigma are left alone. It is a slow error of the size b
(``slow_errors``), forgotten within ``adaptation.reflection_time_s``. So the gains stay as they are, and sd_* and the
gates have what reflections have done to the position. The time matters little: 30 and 300 s give the same errors over
sigma in a city within 5 %. Where the ranges of four in ten satellites are off by 10 m rms for a minute, the position's
error over sigma is 2.1 (rms); without it 10.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import Lines
from insgnss.filter.update.satellite_memory import FORGOTTEN_S, RANGE_S, REFLECTION
from insgnss.gnss.observation_rows import PSEUDORANGE, GnssRows
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

_BY_CHANCE: Final = 0.4  # of r: the square of a mean of noise, in 19 of 20


@kernel(inline=True)
def place_reflections(memory: Float64, par: Parameters, rows: GnssRows, epoch: int, lines: Lines) -> None:
    """Write b into the lines of an epoch; zero of satellites that are not followed yet.

    ``memory`` is (slots, N_MEMORY), see ``satellite_memory``.
    """
    first, now = rows.first[epoch], rows.epoch_ns[epoch] * 1e-9
    for j in range(rows.first[epoch + 1] - first):
        own = memory[rows.observation[first + j].slot]
        lines[j].reflected = 0.0
        if par.reflection_rate > 0.0 and now - own[RANGE_S] <= FORGOTTEN_S:
            beyond = own[REFLECTION] * own[REFLECTION] - _BY_CHANCE * lines[j].variance[PSEUDORANGE]
            lines[j].reflected = math.sqrt(max(beyond, 0.0))
