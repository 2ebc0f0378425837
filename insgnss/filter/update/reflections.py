"""By how much a satellite's pseudoranges have been off for seconds: a reflection that stays, compiled.

The filter takes the errors of a row for noise of the variance r, which averages out. A reflection in a street does not:
a car that waits at a light sees the same one for a minute, and the position stays as far off as it was. What shows it
is the satellite's own residual e against the others (``integrity``),

    m = mean of e / sqrt(1 - g D g^T / r) over five seconds,   b^2 = max(m^2 - r, 0)

where noise alone has m^2 = r / 10, and b is the size of the reflection beyond what r allows for. It is a slow error of
the size b (``slow_errors``), forgotten within ``adaptation.reflection_time_s``. So gains and position are those of the
filter without it, and sd_* and the gates have what reflections have done to the position. The time matters little:
30 and 300 s give the same errors over sigma in a city within 5 %.
"""

from __future__ import annotations

import math

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import Lines
from insgnss.filter.update.satellite_memory import FORGOTTEN_S, RANGE_S, REFLECTION
from insgnss.gnss.observation_rows import PSEUDORANGE, GnssRows
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64


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
            beyond = own[REFLECTION] * own[REFLECTION] - lines[j].variance[PSEUDORANGE]
            lines[j].reflected = math.sqrt(max(beyond, 0.0))
