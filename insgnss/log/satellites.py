"""Names of satellites as logs write them, in the one form of the tables: "G05"."""

from __future__ import annotations

import re
from typing import Final

SYSTEMS: Final = "GRECJIS"  # GPS, GLONASS, Galileo, BeiDou, QZSS, NavIC, SBAS: letters of RINEX 3
MAX_NUMBER: Final = {"G": 63, "R": 32, "E": 50, "C": 63, "J": 10, "I": 14, "S": 58}
# A GLONASS satellite that a log knows by its frequency channel alone is R50 + channel, R43 to R56
CHANNEL_NAME_ZERO: Final = 50
CHANNELS_IN_USE: Final = range(-7, 7)  # since 2005; GLONASS ICD 5.1, table 3.1
_NAME: Final = re.compile(r"([A-Za-z])[ _-]?0*(\d{1,3})")


def normalised_name(text: str) -> str | None:
    """Return the satellite's name as RINEX 3 writes it ("g5", "G 5", "G05" -> "G05"), None when it cannot be one."""
    match = _NAME.fullmatch(text.strip().strip("\"'").strip())
    if match is None:
        return None
    system, number = match[1].upper(), int(match[2])
    if system == "S" and number >= 100:
        number -= 100  # SBAS by its PRN: S120 -> S20
    if system not in SYSTEMS:
        return None
    name = f"{system}{number:02d}"
    return name if 1 <= number <= MAX_NUMBER[system] or channel_of_name(name) is not None else None


def channel_of_name(name: str) -> int | None:
    """Return the channel of a GLONASS satellite that is known by nothing else ("R46" -> -4), None for all others."""
    channel = int(name[1:]) - CHANNEL_NAME_ZERO
    return channel if name[0] == "R" and channel in CHANNELS_IN_USE else None
