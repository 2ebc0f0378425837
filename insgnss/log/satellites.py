"""Names of satellites as logs write them, in the one form of the tables: "G05"."""

from __future__ import annotations

import re
from typing import Final

SYSTEMS: Final = "GRECJIS"  # GPS, GLONASS, Galileo, BeiDou, QZSS, NavIC, SBAS: letters of RINEX 3
MAX_NUMBER: Final = {"G": 63, "R": 32, "E": 50, "C": 63, "J": 10, "I": 14, "S": 58}
_NAME: Final = re.compile(r"([A-Za-z])[ _-]?0*(\d{1,3})")


def normalised_name(text: str) -> str | None:
    """Return the satellite's name as RINEX 3 writes it ("g5", "G 5", "G05" -> "G05"), None when it cannot be one."""
    match = _NAME.fullmatch(text.strip().strip("\"'").strip())
    if match is None:
        return None
    system, number = match[1].upper(), int(match[2])
    if system == "S" and number >= 100:
        number -= 100  # SBAS by its PRN: S120 -> S20
    if system not in SYSTEMS or not 1 <= number <= MAX_NUMBER[system]:
        return None
    return f"{system}{number:02d}"
