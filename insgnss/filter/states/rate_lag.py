"""The time by which range rates lag behind the motion: T seconds, a constant of the receiver.

A range rate is that of the antenna's velocity T earlier, so it grows with T by u . a less the satellite's part of the
range's acceleration (``rows.late_rates``). Early inertial tags do the same to it, but in motion they change the
pseudoranges, too: where both are states, pseudoranges and carriers say which it is. It needs the state of the tags'
offset. No setting asks for it: a filter that has found such tags goes on with both.
"""

from __future__ import annotations

from typing import Final

from insgnss.filter.layout import StateBlock

RATE_LAG: Final = "range_rate_lag"
UNKNOWN_RATE_LAG: Final = StateBlock(RATE_LAG, ("range_rate_lag_s",), "s", 0.1, shown=False)
