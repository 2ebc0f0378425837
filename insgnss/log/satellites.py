"""Names of satellites as logs write them, in the one form of the tables: "G05"."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from insgnss.constants import SYSTEMS

MAX_NUMBER: Final = {"G": 63, "R": 32, "E": 50, "C": 63, "J": 10, "I": 14, "S": 58}
# A GLONASS satellite that a log knows by its frequency channel alone is R50 + channel, R43 to R56
CHANNEL_NAME_ZERO: Final = 50
CHANNELS_IN_USE: Final = range(-7, 7)  # since 2005; GLONASS ICD 5.1, table 3.1
# PRNs and NMEA's numbers of constellations that RINEX counts from 1: where they begin, and what is taken off
OTHER_NUMBERS: Final = {"S": (100, 100), "J": (193, 192), "R": (65, 64)}
SBAS_OFFSET: Final = 100  # S20 is PRN 120
SYSTEM_NAMES: Final = {
    **{letter: letter for letter in SYSTEMS},
    **dict.fromkeys(("GPS", "NAVSTAR"), "G"),
    **dict.fromkeys(("GLONASS", "GLO"), "R"),
    **dict.fromkeys(("GALILEO", "GAL"), "E"),
    **dict.fromkeys(("BEIDOU", "BDS", "COMPASS"), "C"),
    **dict.fromkeys(("QZSS", "QZS"), "J"),
    **dict.fromkeys(("NAVIC", "IRNSS"), "I"),
    **dict.fromkeys(("SBAS", "WAAS", "EGNOS"), "S"),
}
_NAME: Final = re.compile(r"([A-Za-z]+)[ _-]?0*(\d{1,3})")
# every constellation has PRNs: the word says nothing of which it is
_NUMBER: Final = re.compile(r"(?:PRN[ _-]?)?0*(\d{1,3})(?:\.0*)?", re.IGNORECASE)


def rinex_name(system: str, number: int) -> str:
    """Return the name of a constellation's satellite ("G05"), "" where the constellation has no such number."""
    return f"{system}{number:02d}" if 1 <= number <= MAX_NUMBER.get(system, 0) else ""


def normalised_name(text: str) -> str | None:
    """Return the satellite's name as RINEX 3 writes it ("g5", "G 5", "GPS-05" -> "G05"), None when it cannot be one."""
    match = _NAME.fullmatch(text.strip().strip("\"'").strip())
    return None if match is None else numbered_name(SYSTEM_NAMES.get(match[1].upper(), ""), int(match[2]))


def channel_of_name(name: str) -> int | None:
    """Return the channel of a GLONASS satellite known only by its channel ("R46" -> -4), None for all others."""
    channel = int(name[1:]) - CHANNEL_NAME_ZERO
    return channel if name[0] == "R" and channel in CHANNELS_IN_USE else None


def numbered_name(system: str, number: int) -> str | None:
    """Return the name of a constellation's satellite by its number, None if there is none."""
    first, taken_off = OTHER_NUMBERS.get(system, (0, 0))
    if taken_off and number >= first:
        number -= taken_off  # S120 -> S20
    name = f"{system}{number:02d}"
    is_known = rinex_name(system, number) or (system == "R" and channel_of_name(name) is not None)
    return name if is_known else None


def bare_number(text: str) -> int | None:
    """Return the number of a satellite that is written without its constellation, "5", "5.0" or "PRN05"."""
    match = _NUMBER.fullmatch(text.strip())
    return int(match[1]) if match else None


def system_letter(text: str, codes: Mapping[str, str]) -> str | None:
    """Return a constellation's RINEX letter from its letter, name or code, None if unknown."""
    word = text.strip()
    number = bare_number(word)
    code = codes.get(word) or (None if number is None else codes.get(str(number)))
    return code or SYSTEM_NAMES.get(word.upper())
