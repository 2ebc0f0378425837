"""What must hold over several rows together: their runs are one sample, so that the bound can be tight."""

from __future__ import annotations

import math
from typing import Final

from tests.benchmarks.trust.rows import Line

LINES: Final = (
    # 144 runs: a consistent filter is beyond these bounds once in 10^8
    Line(
        "yaw NEES at the end of the drive after 600 s straight",
        ("straight_*",),
        ("yaw",),
        "end",
        "nees",
        0.4,
        2.0,
    ),
    Line(
        "yaw NEES before the brake, 600 s straight",
        ("straight_*",),
        ("yaw",),
        "before the brake",
        "nees",
        0.0,
        2.0,
    ),
    Line("yaw NEES at the end of gentle motion", ("gentle_*",), ("yaw",), "end", "nees", 0.4, 2.0),
    *(
        Line(
            f"e/s (rms) of {' and '.join(blocks)} with an IMU of 5, 10, 20 Hz, once the heading is known",
            ("rate_5hz", "rate_10hz", "rate_20hz"),
            blocks,
            "known",
            "rms",
            0.7,
            1.3,
        )
        for blocks in (("velocity",), ("tilt", "yaw"))
    ),
    Line(
        "vertical e/s with carrier over that without, ionosphere of 1.5 m",
        ("air_errors_carrier", "air_errors"),
        ("vertical.square",),
        "",
        "ratio",
        -math.inf,
        1.0,
    ),
)
