"""The kind of vehicle, and the measurements that its motion makes without any sensor.

`VEHICLE_KINDS` is the one table of defaults; every number can be given in the flight file instead. Sigmas are of the
vehicle's real motion, before its correlation in time is counted (``insgnss.sensors.vehicle_motion``).

| kind | rows that it allows |
|---|---|
| car | non-holonomic, zero velocity, zero rate |
| train | non-holonomic, zero velocity, zero rate |
| ship | course |
| aircraft (with wings) | course, zero velocity, zero rate |
| drone | zero velocity, zero rate |
| pedestrian | zero velocity, zero rate |
| none | none |
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal

from pydantic import Field, model_validator

from insgnss.config.changes import merged
from insgnss.config.quantities import Arm
from insgnss.config.strict import StrictModel

KindOfVehicle = Literal["car", "train", "ship", "aircraft", "drone", "pedestrian", "none"]
_Speed = Annotated[float, Field(gt=0.0, le=1e3)]  # [m/s]
_Angle = Annotated[float, Field(ge=0.0, le=180.0)]  # [deg]
_SmallAngle = Annotated[float, Field(ge=-45.0, le=45.0)]  # [deg]
_Time = Annotated[float, Field(gt=0.0, le=1e5)]  # [s]
_Gate = Annotated[float, Field(gt=0.0, le=1e3)]


ROWS: Final = ("non_holonomic", "course", "zero_velocity", "zero_rate")
_TABLES: Final = (*ROWS, "standstill", "nose_first")
_GIVEN_AXLE_SD_M: Final = 0.1  # of an axle that the flight file gives: measured with a tape
# A tyre slips by some 0.35 deg for each m/s^2 (a rear axle of 750 kg on 2 x 60 kN/rad); a body pitches on its springs
# by half a degree when it brakes; crosswind and camber of the road make 0.3 deg of slip. Rails allow no slip.
# The axle is somewhere in the vehicle. At rest engine, wind and passengers rock it by millimetres. Currents and leeway
# of some 0.35 m/s turn a ship of 5 m/s by 4 deg; a wind of 10 m/s across an aircraft of 60 m/s by 10.
_ROCKING: Final = {"sigma_mps": 0.02, "correlation_s": 3.0}
_HELD: Final = {"zero_rate": {"sigma_deg_per_s": 0.02}, "standstill": {}}
VEHICLE_KINDS: Final[Mapping[str, Mapping[str, Mapping[str, float]]]] = {
    "car": {
        "non_holonomic": {
            "lateral_mps": 0.05,
            "lateral_deg": 0.3,
            "cornering_deg_per_mps2": 0.35,
            "vertical_mps": 0.1,
            "vertical_deg": 0.5,
            "correlation_s": 1.0,
            "axle_sd_m": 1.5,
            "mounting_sd_deg": 2.0,
        },
        "zero_velocity": {**_ROCKING, "below_mps": 1.0},
        **_HELD,
        "nose_first": {"above_mps": 8.0},
    },
    "train": {
        "non_holonomic": {
            "lateral_mps": 0.05,
            "lateral_deg": 0.1,
            "cornering_deg_per_mps2": 0.0,
            "vertical_mps": 0.05,
            "vertical_deg": 0.1,
            "correlation_s": 2.0,
            "axle_sd_m": 8.0,
            "mounting_sd_deg": 2.0,
        },
        "zero_velocity": {**_ROCKING, "below_mps": 0.5},
        **_HELD,
        "nose_first": {"above_mps": 2.0},
    },
    "ship": {
        "course": {
            "leeway_deg": 4.0,
            "leeway_time_s": 300.0,
            "yawing_deg": 2.0,
            "correlation_s": 3.0,
            "above_mps": 2.0,
        },
        "nose_first": {"above_mps": 2.0},
    },
    "aircraft": {
        "course": {
            "leeway_deg": 10.0,
            "leeway_time_s": 200.0,
            "yawing_deg": 2.0,
            "correlation_s": 3.0,
            "above_mps": 20.0,
        },
        "zero_velocity": {**_ROCKING, "below_mps": 0.5},
        **_HELD,
        "nose_first": {"above_mps": 20.0},
    },
    "drone": {"zero_velocity": {**_ROCKING, "below_mps": 0.3}, **_HELD},
    "pedestrian": {
        "zero_velocity": {"sigma_mps": 0.05, "correlation_s": 3.0, "below_mps": 0.5},
        "zero_rate": {"sigma_deg_per_s": 0.3},
        "standstill": {},
    },
    "none": {},
}


class NonHolonomicRows(StrictModel):
    """The vehicle's axle moves along the vehicle's own forward axis alone: lateral and vertical velocity are zero."""

    on: bool = True
    lateral_mps: _Speed = Field(description="sideways velocity of the axle, one sigma")
    lateral_deg: _Angle = Field(description="angle of the sideways slip, one sigma: it grows with the speed")
    cornering_deg_per_mps2: _Angle = Field(description="slip angle of the tyres by the lateral acceleration")
    vertical_mps: _Speed = Field(description="vertical velocity of the axle in vehicle axes, one sigma")
    vertical_deg: _Angle = Field(description="pitch of the body on its springs, one sigma")
    correlation_s: _Time = Field(description="correlation time of slip and pitch")
    gate_sigma: _Gate = 3.0
    axle_m: tuple[Arm, Arm, Arm] | None = Field(
        None, description="IMU to the point that does not slip, as the middle of the rear axle; body axes"
    )
    axle_sd_m: _Speed = Field(description="of that point, one sigma; the kind's own where axle_m is left out")
    mounting_pitch_deg: _SmallAngle = Field(0.0, description="pitch of the IMU against the vehicle")
    mounting_yaw_deg: _SmallAngle = Field(0.0, description="yaw of the IMU against the vehicle")
    mounting_sd_deg: _Angle = Field(
        description="one sigma of both angles; zero: known exactly, not estimated"
    )


class CourseRows(StrictModel):
    """The nose points along the horizontal velocity, but for an angle of leeway, current or wind that lasts."""

    on: bool = True
    leeway_deg: Annotated[float, Field(gt=0.0, le=60.0)] = Field(description="angle that lasts, one sigma")
    leeway_time_s: _Time = Field(description="correlation time of that angle")
    yawing_deg: _Angle = Field(description="angle that changes from row to row, one sigma")
    correlation_s: _Time = Field(description="correlation time of the yawing")
    above_mps: _Speed = Field(description="slower vehicles have no rows")
    gate_sigma: _Gate = 3.0


class ZeroVelocityRows(StrictModel):
    """At standstill the velocity is zero."""

    on: bool = True
    sigma_mps: _Speed = Field(description="rocking of the vehicle at rest, one sigma")
    correlation_s: _Time
    below_mps: _Speed = Field(
        description="no row above this estimated speed: the samples of a smooth drive look like standstill"
    )
    gate_sigma: _Gate = 3.0


class ZeroRateRows(StrictModel):
    """At standstill the vehicle turns with the Earth alone."""

    on: bool = True
    sigma_deg_per_s: Annotated[float, Field(gt=0.0, le=10.0)] = Field(
        description="mean rate of the rocking over a window, one sigma"
    )
    gate_sigma: _Gate = 4.0


class Standstill(StrictModel):
    """When the inertial samples are those of a vehicle at rest (``insgnss.sensors.standstill``)."""

    window_s: Annotated[float, Field(ge=0.5, le=5.0)] = 1.0
    missed_share: Annotated[float, Field(gt=0.0, lt=0.5)] = Field(
        0.01, description="of the windows at rest that the test takes for motion"
    )
    rocking_deg_per_s: Annotated[float, Field(ge=0.0, le=10.0)] = Field(
        0.05, description="turning of a vehicle at rest, mean over an eighth of the window, one sigma"
    )
    rocking_mps2: Annotated[float, Field(ge=0.0, le=10.0)] = Field(
        0.02, description="its acceleration, mean over an eighth of the window, one sigma"
    )
    most_rate_deg_per_s: Annotated[float, Field(gt=0.0, le=10.0)] = Field(
        0.5, description="a mean rate above it is a turn, whatever the noise"
    )
    most_vibration_mps2: Annotated[float, Field(gt=0.0, le=10.0)] = Field(
        0.15, description="sigma of an eighth of the window: stronger vibration would hide motion"
    )


class NoseFirst(StrictModel):
    """The vehicle seldom moves backward: evidence of limited weight, counted once, while several headings are open."""

    on: bool = True
    above_mps: _Speed = Field(description="backward motion below it says nothing")
    odds: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        1e-4, description="share of first motions faster than that that are backward"
    )


class VehicleRows(StrictModel):
    """``[vehicle]`` of a flight file; what is left out is the kind's own (``VEHICLE_KINDS``)."""

    kind: KindOfVehicle
    period_s: Annotated[float, Field(ge=0.1, le=60.0)] = Field(
        1.0, description="of the rows: at whole multiples of it in GPS time"
    )
    non_holonomic: NonHolonomicRows | None = None
    course: CourseRows | None = None
    zero_velocity: ZeroVelocityRows | None = None
    zero_rate: ZeroRateRows | None = None
    standstill: Standstill | None = None
    nose_first: NoseFirst | None = None

    @model_validator(mode="before")
    @classmethod
    def _has_the_numbers_of_its_kind(cls, given: Any) -> Any:
        if not isinstance(given, Mapping):
            return given
        own = VEHICLE_KINDS.get(str(given.get("kind")), {})
        for table in _TABLES:
            if given.get(table) is not None and table not in own and str(given.get("kind")) in VEHICLE_KINDS:
                allowed = ", ".join(own) or "none"
                raise ValueError(f"a vehicle of kind '{given['kind']}' has no {table}; it has: {allowed}")
        mended = merged(own, {key: value for key, value in given.items() if value is not None})
        holonomic = given.get("non_holonomic")
        if isinstance(holonomic, Mapping) and holonomic.get("axle_m") is not None:
            mended["non_holonomic"] = {
                **mended["non_holonomic"],
                "axle_m": _as_tuple(holonomic["axle_m"]),
                "axle_sd_m": holonomic.get("axle_sd_m", _GIVEN_AXLE_SD_M),
            }
        return mended

    @property
    def rows(self) -> tuple[str, ...]:
        """Names of the rows that are used."""
        tables = {name: getattr(self, name) for name in ROWS}
        return tuple(name for name, table in tables.items() if table is not None and table.on)


def _as_tuple(given: Any) -> Any:
    """Return an array of a file as the tuple that a strict schema wants."""
    return tuple(given) if isinstance(given, list) else given
