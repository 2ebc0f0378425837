"""Satellites and signals as SBF numbers them (PolaRx5TR reference guide, firmware 5.5.0, 4.1.9 and 4.1.10)."""

from __future__ import annotations

from typing import Final, NamedTuple

G3_HZ: Final = 1_202.025e6  # GLONASS ICD CDMA L3 1.0, 4.1
CHANNEL_OFFSET: Final = 8


class SbfSignal(NamedTuple):
    """One signal number: system, and RINEX code of the pseudorange."""

    system: str
    code: str


E6_B_USED: Final = 0x40  # bit of MeasEpoch's common flags: signal 19 is E6-B
E6_SIGNAL: Final = 19
_CODES: Final[dict[str, dict[int, str]]] = {
    "G": {0: "C1C", 1: "C1W", 2: "C2W", 3: "C2L", 4: "C5Q", 5: "C1L"},
    "R": {8: "C1C", 9: "C1P", 10: "C2P", 11: "C2C", 12: "C3Q"},
    "S": {24: "C1C", 25: "C5I"},
    "E": {17: "C1C", E6_SIGNAL: "C6C", 20: "C5Q", 21: "C7Q", 22: "C8Q"},
    "C": {13: "C1P", 14: "C5P", 28: "C2I", 29: "C7I", 30: "C6I", 34: "C7D"},
    "J": {6: "C1C", 7: "C2L", 26: "C5Q", 32: "C1L", 33: "C1Z", 38: "C1E", 39: "C5P"},
    "I": {15: "C5A"},
}
SIGNALS: Final = {
    number: SbfSignal(system, code) for system, codes in _CODES.items() for number, code in codes.items()
}
# First and last SVID, system, what is taken from the SVID to get the number of RINEX
_SVID_RANGES: Final = (
    (1, 37, "G", 0),
    (38, 61, "R", 37),
    (63, 68, "R", 38),
    (71, 106, "E", 70),
    (120, 140, "S", 100),
    (141, 180, "C", 140),
    (181, 190, "J", 180),
    (191, 197, "I", 190),
    (198, 215, "S", 157),
    (216, 222, "I", 208),
    (223, 245, "C", 182),
)
SATELLITES: Final = {
    svid: f"{system}{svid - offset:02d}"
    for first, last, system, offset in _SVID_RANGES
    for svid in range(first, last + 1)
}
