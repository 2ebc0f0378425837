"""The schema of a list of manoeuvres: a vehicle's manoeuvres in sequence, in a scenario file.

Each entry ``[[manoeuvre]]`` has a ``kind`` and the keys of that kind. Angles to the right are positive.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from insgnss.config.quantities import NotNegative, Positive
from insgnss.config.strict import StrictModel

Bank = Annotated[float, Field(gt=0.0, lt=85.0)]
Period = Annotated[float, Field(ge=0.5)]


class Straight(StrictModel):
    """Constant velocity, or rest."""

    kind: Literal["straight"]
    duration_s: Positive


class Accelerate(StrictModel):
    """Change the horizontal speed."""

    kind: Literal["accelerate"]
    to_mps: NotNegative
    duration_s: Positive
    meanwhile: bool = Field(False, description="the next manoeuvre begins together with this one")


class Climb(StrictModel):
    """Climb, or descend where ``by_m`` is negative."""

    kind: Literal["climb"]
    by_m: float
    rate_mps: Positive
    ramp_s: Positive = 6.0
    meanwhile: bool = Field(False, description="the next manoeuvre begins together with this one")


class Turn(StrictModel):
    """A coordinated turn at constant bank, with limits for the roll rates into and out of it."""

    kind: Literal["turn"]
    by_deg: float = Field(description="change of heading, right positive")
    bank_deg: Bank
    roll_in_deg_per_s: Positive = 15.0
    roll_out_deg_per_s: Positive = 15.0


class STurn(StrictModel):
    """A turn, a turn back by twice the angle, and the first turn again: same course, displaced path."""

    kind: Literal["s_turn"]
    by_deg: float
    bank_deg: Bank
    roll_in_deg_per_s: Positive = 15.0
    roll_out_deg_per_s: Positive = 15.0


class Steer(StrictModel):
    """A flat turn without bank: a car's corner, a ship's change of course."""

    kind: Literal["steer"]
    by_deg: float
    duration_s: Positive


class Loop(StrictModel):
    """A full circle upwards, wings level, from level flight."""

    kind: Literal["loop"]
    radius_m: Positive = Field(
        description="radius at the bottom; smaller at the top if the speed is lower there"
    )
    top_speed_mps: Positive | None = Field(None, description="left out: as at the bottom")
    ramp_s: Positive = Field(2.0, description="time over which the pull-up begins and ends")


class BarrelRoll(StrictModel):
    """A full roll while the path goes up and sideways, then down again; radius 0 is a roll about the path."""

    kind: Literal["barrel_roll"]
    duration_s: Positive
    radius_m: NotNegative = 0.0
    direction: Literal["right", "left"] = "right"


class TakeOff(StrictModel):
    """The run along the runway, lift-off, and the first climb."""

    kind: Literal["take_off"]
    speed_mps: Positive
    run_s: Positive
    climb_m: Positive
    rate_mps: Positive
    ramp_s: Positive = 6.0


class Landing(StrictModel):
    """The descent to the ground, the flare, and the roll-out until the vehicle stops."""

    kind: Literal["landing"]
    descend_m: Positive
    rate_mps: Positive
    run_s: Positive
    approach_mps: Positive | None = Field(None, description="speed reached during the descent")
    ramp_s: Positive = Field(8.0, description="duration of the flare")


class Sea(StrictModel):
    """A ship in waves at constant course and speed: amplitudes and periods of its motions."""

    kind: Literal["sea"]
    duration_s: Positive
    roll_deg: NotNegative = 0.0
    roll_period_s: Period = 9.0
    pitch_deg: NotNegative = 0.0
    pitch_period_s: Period = 6.5
    yaw_deg: NotNegative = 0.0
    yaw_period_s: Period = 14.0
    heave_m: NotNegative = 0.0
    heave_period_s: Period = 7.5
    ramp_s: Positive = 10.0
    meanwhile: bool = Field(False, description="the next manoeuvre begins together with this one")

    @model_validator(mode="after")
    def _lasts_longer_than_its_ramps(self) -> Sea:
        if self.duration_s < 2.0 * self.ramp_s:
            raise ValueError(
                f"duration_s = {self.duration_s:g} is shorter than the two ramps of {self.ramp_s:g} s"
            )
        return self


class Ascent(StrictModel):
    """A sounding rocket: it waits on its rail, burns, spins and coasts along its axis. Must be the only manoeuvre."""

    kind: Literal["ascent"]
    duration_s: Positive = Field(description="whole duration, wait on the rail included")
    wait_s: NotNegative = Field(60.0, description="wait on the rail before ignition")
    elevation_deg: Annotated[float, Field(gt=30.0, lt=90.0)] = Field(
        85.0, description="elevation of the rail"
    )
    thrust_g: Annotated[float, Field(gt=1.0, le=200.0)] = Field(description="thrust over weight")
    burn_s: Positive
    ramp_s: Positive = Field(0.4, description="time over which the thrust rises and falls")
    rail_m: Positive = 6.0
    drag_m2_per_kg: NotNegative = Field(0.0, description="drag coefficient times area over mass")
    spin_deg_per_s: float = Field(0.0, description="spin at the end of the burn")

    @model_validator(mode="after")
    def _burns_longer_than_it_ramps(self) -> Ascent:
        if self.duration_s <= self.wait_s:
            raise ValueError(
                f"duration_s = {self.duration_s:g} ends before the ignition at {self.wait_s:g} s"
            )
        if self.burn_s <= self.ramp_s:
            raise ValueError(
                f"burn_s = {self.burn_s:g} is not longer than the thrust's ramp of {self.ramp_s:g} s"
            )
        return self


class RandomMotion(StrictModel):
    """Acceleration and angular rate as Gauss-Markov processes, added to a steady motion. Must be the last manoeuvre."""

    kind: Literal["gauss_markov"]
    duration_s: Annotated[float, Field(gt=0.0, le=3600.0)]
    acceleration_g: Annotated[float, Field(ge=0.0, le=50.0)] = Field(
        description="rms of each axis, before the pull to the course removes its slow part"
    )
    acceleration_time_s: Annotated[float, Field(ge=0.1)] = Field(10.0 / 3.0, description="correlation time")
    turn_rate_deg_per_s: Annotated[float, Field(ge=0.0, le=1000.0)] = Field(
        0.0, description="rms of the angular rate about each axis of the body"
    )
    turn_time_s: Annotated[float, Field(ge=0.1)] = Field(1.0, description="correlation time of the rate")
    return_s: Positive | None = Field(
        None, description="period of a weak pull back to the course, longer than the correlation time"
    )
    seed: Annotated[int, Field(ge=0)] = Field(1, description="seed of the motion; the noise has its own")

    @model_validator(mode="after")
    def _pulls_back_slowly(self) -> RandomMotion:
        if self.return_s is not None and self.return_s <= self.acceleration_time_s:
            raise ValueError("return_s has to be longer than acceleration_time_s")
        return self


Manoeuvre = Annotated[
    Straight
    | Accelerate
    | Climb
    | Turn
    | STurn
    | Steer
    | Loop
    | BarrelRoll
    | TakeOff
    | Landing
    | Sea
    | Ascent
    | RandomMotion,
    Field(discriminator="kind"),
]
