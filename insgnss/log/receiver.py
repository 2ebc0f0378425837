"""What a receiver's own file holds: observations, broadcast messages, inertial samples, the receiver's own solution."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from insgnss.tables import Event, GnssTable, ImuTable, NavigationData, ReferenceTable


@dataclass(frozen=True)
class ReceiverLog:
    """One receiver's files as tables; times are GPS time."""

    gnss: GnssTable
    navigation: NavigationData | None = None
    imu: ImuTable | None = None  # in the sensor's own axes, as logged
    events: list[Event] = field(default_factory=list)
    solution: ReferenceTable | None = None  # the receiver's own, with its sigmas
    imu_axes: tuple[str, str, str] = (
        "+x",
        "+y",
        "+z",
    )  # the sensor's, as far as its format says where they point
    imu_is_mean: bool = False  # samples are means over their intervals, as integrating sensors give
    solution_point: Literal["imu", "antenna"] = (
        "antenna"  # whose place the solution is, unless the user told otherwise
    )

    def span_ns(self) -> tuple[int, int]:
        """Return the first and last GPS time of the measurements, without any of the samples, else of the solution."""
        parts = (self.gnss, self.imu, self.solution)
        t_ns = next(part.t_ns for part in parts if part is not None and len(part.t_ns))
        return int(t_ns[0]), int(t_ns[-1])


def no_measurements() -> GnssTable:
    """Return a table of measurements without a row, for logs that hold other things alone."""
    none, index = np.zeros(0), np.zeros(0, np.int16)
    return GnssTable(np.zeros(0, np.int64), index, index, none, none, none, none, (), ())
