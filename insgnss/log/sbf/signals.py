"""Satellites and signals as SBF numbers them (PolaRx5TR reference guide, firmware 5.5.0, 4.1.9 and 4.1.10)."""

from __future__ import annotations

from typing import Final, NamedTuple

from insgnss.gnss.signals import (
    B1I_HZ,
    B3I_HZ,
    E5_HZ,
    E5B_HZ,
    E6_HZ,
    G1_HZ,
    G1_STEP_HZ,
    G2_HZ,
    G2_STEP_HZ,
    L1_HZ,
    L2_HZ,
    L5_HZ,
)

G3_HZ: Final = 1_202.025e6  # GLONASS ICD CDMA L3 1.0, 4.1
CHANNEL_OFFSET: Final = 8


class SbfSignal(NamedTuple):
    """One signal number: system, RINEX code of the pseudorange, carrier, and its step from channel to channel."""

    system: str
    code: str
    carrier_hz: float
    step_hz: float = 0.0


E6_B_USED: Final = 0x40  # bit of MeasEpoch's common flags: signal 19 is E6-B
E6_SIGNAL: Final = 19
SIGNALS: Final = {
    0: SbfSignal("G", "C1C", L1_HZ),
    1: SbfSignal("G", "C1W", L1_HZ),
    2: SbfSignal("G", "C2W", L2_HZ),
    3: SbfSignal("G", "C2L", L2_HZ),
    4: SbfSignal("G", "C5Q", L5_HZ),
    5: SbfSignal("G", "C1L", L1_HZ),
    6: SbfSignal("J", "C1C", L1_HZ),
    7: SbfSignal("J", "C2L", L2_HZ),
    8: SbfSignal("R", "C1C", G1_HZ, G1_STEP_HZ),
    9: SbfSignal("R", "C1P", G1_HZ, G1_STEP_HZ),
    10: SbfSignal("R", "C2P", G2_HZ, G2_STEP_HZ),
    11: SbfSignal("R", "C2C", G2_HZ, G2_STEP_HZ),
    12: SbfSignal("R", "C3Q", G3_HZ),
    13: SbfSignal("C", "C1P", L1_HZ),
    14: SbfSignal("C", "C5P", L5_HZ),
    15: SbfSignal("I", "C5A", L5_HZ),
    17: SbfSignal("E", "C1C", L1_HZ),
    19: SbfSignal("E", "C6C", E6_HZ),
    20: SbfSignal("E", "C5Q", L5_HZ),
    21: SbfSignal("E", "C7Q", E5B_HZ),
    22: SbfSignal("E", "C8Q", E5_HZ),
    24: SbfSignal("S", "C1C", L1_HZ),
    25: SbfSignal("S", "C5I", L5_HZ),
    26: SbfSignal("J", "C5Q", L5_HZ),
    28: SbfSignal("C", "C2I", B1I_HZ),
    29: SbfSignal("C", "C7I", E5B_HZ),
    30: SbfSignal("C", "C6I", B3I_HZ),
    32: SbfSignal("J", "C1L", L1_HZ),
    33: SbfSignal("J", "C1Z", L1_HZ),
    34: SbfSignal("C", "C7D", E5B_HZ),
    38: SbfSignal("J", "C1E", L1_HZ),
    39: SbfSignal("J", "C5P", L5_HZ),
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
