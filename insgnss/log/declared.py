"""The user's declarations for a receiver's file, which the file itself does not state."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

RtcmOrigin = Literal["own", "base"]


@dataclass(frozen=True)
class LogDeclarations:
    """The declarations for a conversion; values that are not declared come from the files if they state them."""

    date: dt.date | None = None  # of the log's first epoch, for streams that do not say it
    imu_scales: tuple[float, float] | None = None  # [rad, m/s] of one count of a NovAtel sensor
    # part ("imu", "gnss", "reference") -> topic of a bag
    topics: Mapping[str, str] = field(default_factory=dict)
    # whose the RTCM measurements in another log are: this receiver's, or a base station's that corrects it
    rtcm: RtcmOrigin | None = None
