"""The scenarios of the trust campaign, as TOML: what the vehicle does and what it carries."""

from __future__ import annotations

from typing import Final

LEVER_M: Final = (0.5, 0.1, -0.8)


def straight(duration_s: float) -> str:
    """Return the manoeuvre that goes on as before."""
    return f'{{ kind = "straight", duration_s = {duration_s} }}'


def accelerate(to_mps: float, duration_s: float) -> str:
    """Return a change of speed."""
    return f'{{ kind = "accelerate", to_mps = {to_mps}, duration_s = {duration_s} }}'


def steer(by_deg: float, duration_s: float) -> str:
    """Return a flat turn."""
    return f'{{ kind = "steer", by_deg = {by_deg}, duration_s = {duration_s} }}'


def turn(by_deg: float, bank_deg: float) -> str:
    """Return a coordinated turn."""
    return f'{{ kind = "turn", by_deg = {by_deg}, bank_deg = {bank_deg} }}'


def scenario(
    name: str,
    *manoeuvres: str,
    grade: str = "industrial",
    rate_hz: float = 50.0,
    imu: str = "",
    speed_mps: float = 0.0,
    carrier: bool = False,
    gnss: str = "",
    place: str = "lat_deg = 47.0, lon_deg = 8.0, h_m = 300.0, heading_deg = 35.0",
    faults: str = "",
) -> str:
    """Return a scenario file; ``imu`` and ``gnss`` are further lines of their tables."""
    lever = ", ".join(str(metres) for metres in LEVER_M)
    phase = "carrier_noise_m = { floor = 0.002 }" if carrier else ""
    moves = ",\n  ".join(manoeuvres)
    return f"""
name = "{name}"
source = "trust campaign"
gps_week = 2385
start_s = 300000.0
place = {{ {place} }}
speed_mps = {speed_mps}
manoeuvre = [
  {moves},
]
[imu]
grade = "{grade}"
rate_hz = {rate_hz}
{imu}
[gnss]
lever_arm_m = [{lever}]
{phase}
{gnss}
{faults}
"""


def outage(from_s: float, to_s: float) -> str:
    """Return the fault of all satellites lost for a while."""
    return f'[[fault]]\nkind = "outage"\nfrom_s = {from_s}\nto_s = {to_s}\n'


# 60 s at rest, then away and round two corners: the heading is known from about 70 s on. Lasts 142 s.
TO_KNOWN: Final = (
    straight(60.0),
    accelerate(12.0, 10.0),
    straight(20.0),
    steer(90.0, 6.0),
    straight(20.0),
    steer(-90.0, 6.0),
    straight(20.0),
)
TO_KNOWN_S: Final = 142.0
# 60 s of corners, as between traffic lights
CORNERS: Final = (
    accelerate(6.0, 5.0),
    steer(90.0, 5.0),
    accelerate(14.0, 7.0),
    straight(13.0),
    accelerate(6.0, 5.0),
    steer(-90.0, 5.0),
    accelerate(12.0, 7.0),
    straight(13.0),
)
CORNERS_S: Final = 60.0
# a drive with stops, 6.5 minutes: standing, away, two corners, standing ...
CITY: Final = (
    straight(20.0),
    *(
        move
        for side in (1.0, -1.0, 1.0, 1.0, -1.0)
        for move in (
            accelerate(13.0, 8.0),
            straight(12.0),
            accelerate(6.0, 4.0),
            steer(90.0 * side, 5.0),
            accelerate(11.0, 5.0),
            straight(9.0),
            accelerate(6.0, 4.0),
            steer(60.0 * side, 4.0),
            accelerate(0.0, 5.0),
            straight(15.0),
        )
    ),
)
CITY_S: Final = 20.0 + 5 * 71.0
