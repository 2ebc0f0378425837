"""Numbers and vectors as settings have them: within what any vehicle, sensor or clock has."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

Vector3 = tuple[float, float, float]
# Upper limits are the field's own, or those of all settings (``strict``): one given here would override the field's
Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
# Bounds that no vehicle passes: what lies beyond is a slip of unit or keyboard, and its square leaves the numbers
Arm = Annotated[float, Field(ge=-1e3, le=1e3)]
Speed = Annotated[float, Field(ge=-2e4, le=2e4)]
Angle = Annotated[float, Field(ge=-360.0, le=360.0)]
LeverArm = tuple[Arm, Arm, Arm]  # [m]
Velocity = tuple[Speed, Speed, Speed]  # [m/s]
Angles = tuple[Angle, Angle, Angle]  # [deg]
Elevation = Annotated[float, Field(ge=-90.0, le=90.0)]  # [deg]
Height = Annotated[float, Field(ge=-1e4, le=1e7)]  # [m]
AngleSigma = Annotated[float, Field(gt=0.0, le=180.0)]  # [deg]
Probability = Annotated[float, Field(gt=0.0, lt=1.0)]
Constellation = Literal["G", "E", "J", "C", "R", "I", "S"]  # a constellation's letter in RINEX
GpsSatellite = Annotated[str, Field(pattern=r"^G\d\d$")]

AXES = ("+x", "-x", "+y", "-y", "+z", "-z")
