"""Satellites and signals as NovAtel numbers them (OEM7 commands and logs reference manual, RANGE, RANGECMP2)."""

from __future__ import annotations

from typing import Final

from insgnss.log.satellites import rinex_name

SYSTEMS: Final = "GRSECJI"  # bits 16 to 18 of the channel tracking status
# First number of a constellation's satellites, what is taken from it to get the number of RINEX
_NUMBERS: Final = {"R": (38, 37), "S": (120, 100), "J": (193, 192)}
# Bits 21 to 25 of the channel tracking status, as codes of RINEX
SIGNALS: Final[dict[str, dict[int, str]]] = {
    "G": {0: "C1C", 5: "C2P", 9: "C2W", 14: "C5Q", 16: "C1L", 17: "C2S"},
    "R": {0: "C1C", 1: "C2C", 5: "C2P", 6: "C3Q"},
    "S": {0: "C1C", 6: "C5I"},
    "E": {2: "C1C", 6: "C6B", 7: "C6C", 12: "C5Q", 17: "C7Q", 20: "C8Q"},
    "C": {
        **{0: "C2I", 1: "C7I", 2: "C6I", 4: "C2I", 5: "C7I", 6: "C6I"},  # D1, then D2
        **{7: "C1P", 9: "C5P", 11: "C7D"},
    },
    "J": {0: "C1C", 14: "C5Q", 16: "C1L", 17: "C2S"},
    "I": {0: "C5A"},
}
# Signal types of RANGECMP2's signal blocks
SIGNALS_2: Final[dict[str, dict[int, str]]] = {
    "G": {1: "C1C", 4: "C2W", 5: "C2S", 6: "C2P", 7: "C5Q", 15: "C1L"},
    "R": {1: "C1C", 3: "C2C", 4: "C2P", 6: "C3Q"},
    "S": {1: "C1C", 2: "C5I"},
    "E": {1: "C1C", 2: "C5Q", 3: "C7Q", 4: "C8Q", 5: "C6C", 12: "C6B"},
    "C": {
        **{1: "C2I", 2: "C2I", 3: "C7I", 4: "C7I", 13: "C6I", 16: "C6I"},
        **{19: "C1P", 20: "C5P", 21: "C7D"},
    },
    "J": {1: "C1C", 3: "C2S", 4: "C5Q", 8: "C1L"},
    "I": {1: "C5A"},
}


def satellite_name(system: str, number: int) -> str:
    """Return the satellite's name ("R05"), "" if the constellation has no such number."""
    first, taken_off = _NUMBERS.get(system, (0, 0))
    return rinex_name(system, number - taken_off) if number >= first else ""
