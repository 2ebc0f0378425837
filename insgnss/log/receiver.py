"""What a receiver's own file holds: observations, broadcast messages, inertial samples, the receiver's own solution."""

from __future__ import annotations

from dataclasses import dataclass, field

from insgnss.tables import Event, GnssTable, ImuTable, NavigationData, ReferenceTable


@dataclass(frozen=True)
class ReceiverLog:
    """One receiver file (u-blox UBX, Septentrio SBF, Android GnssLogger) as tables; times are GPS time."""

    gnss: GnssTable
    navigation: NavigationData | None = None
    imu: ImuTable | None = None  # in the sensor's own axes, as logged
    events: list[Event] = field(default_factory=list)
    solution: ReferenceTable | None = None  # the receiver's own, with its sigmas
