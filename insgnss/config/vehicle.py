"""The schema of a vehicle file: its antennas, where they sit, how they are turned and what they see."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from insgnss.config.flight import LeverArm, MountedAntenna
from insgnss.config.key_errors import require_own_names
from insgnss.config.strict import StrictModel


class VehicleAntenna(MountedAntenna):
    """An antenna of a vehicle; its lever arm counts from the IMU, or from any one point of the body."""

    name: Annotated[str, Field(min_length=1)]
    pattern: str = "isotropic"
    lever_arm_m: LeverArm = Field(description="body axes forward, right, down")


class Vehicle(StrictModel):
    """A whole vehicle file."""

    name: str = ""
    source: str = Field("", description="where the numbers come from")
    antenna: tuple[VehicleAntenna, ...] = Field(min_length=2)

    @model_validator(mode="after")
    def _names_are_different(self) -> Vehicle:
        require_own_names([antenna.name for antenna in self.antenna], "antennas", "antenna")
        return self
