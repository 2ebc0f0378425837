"""Numbers and vectors as settings have them: within what any vehicle, sensor or clock has."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

Vector3 = tuple[float, float, float]
# No sensor, clock or time is larger in the units used here; squares of these are numbers still
PositiveFloat = Annotated[float, Field(gt=0.0, le=1e9)]
NonNegativeFloat = Annotated[float, Field(ge=0.0, le=1e9)]
# Bounds that no vehicle passes: a value beyond is a wrong unit or a typing error, and its square leaves the range
Arm = Annotated[float, Field(ge=-1e3, le=1e3)]
Speed = Annotated[float, Field(ge=-2e4, le=2e4)]
Angle = Annotated[float, Field(ge=-360.0, le=360.0)]
LeverArm = tuple[Arm, Arm, Arm]  # [m]
Velocity = tuple[Speed, Speed, Speed]  # [m/s]
Angles = tuple[Angle, Angle, Angle]  # [deg]
Height = Annotated[float, Field(ge=-1e4, le=1e7)]  # [m]
AngleSigma = Annotated[float, Field(gt=0.0, le=180.0)]  # [deg]

AXES = ("+x", "-x", "+y", "-y", "+z", "-z")
