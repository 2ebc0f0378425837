"""Broadcast messages as rows of one matrix, the form in which the compiled orbit and clock read them.

The columns are the message's own elements and what follows from them alone, computed once per message.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.constants import (
    BEIDOU_MU_M3PS2,
    BEIDOU_OMEGA_RADPS,
    C_MPS,
    GALILEO_MU_M3PS2,
    GALILEO_OMEGA_RADPS,
    GPS_MU_M3PS2,
    GPS_OMEGA_RADPS,
    NS_PER_S,
)
from insgnss.tables import EphemerisTable, Float64

# Columns of a row
A: Final = 0  # semi-major axis [m]
E: Final = 1  # eccentricity
ROOT_1_E2: Final = 2  # sqrt(1 - e^2)
N: Final = 3  # mean motion with its correction [rad/s]
M0: Final = 4  # mean anomaly at toe [rad]
SIN_OMEGA: Final = 5  # sine and cosine of the argument of perigee
COS_OMEGA: Final = 6
I0: Final = 7  # inclination at toe [rad] and its rate [rad/s]
IDOT: Final = 8
NODE: Final = 9  # longitude of the node at toe in the Earth-fixed frame [rad]
NODE_RATE: Final = 10  # its rate in the frame of the elements [rad/s]
CUS: Final = 11  # second harmonics: argument of latitude [rad], radius [m], inclination [rad]
CUC: Final = 12
CRS: Final = 13
CRC: Final = 14
CIS: Final = 15
CIC: Final = 16
EARTH_RATE: Final = 17  # rotation of the Earth [rad/s] if the elements are of a BeiDou GEO satellite, else 0
TOC_MINUS_TOE: Final = 18  # [s]
AF0: Final = 19  # [s], [s/s], [s/s^2]
AF1: Final = 20
AF2: Final = 21
RELATIVITY: Final = 22  # -2 sqrt(mu) / c^2 e sqrt(a) [s]
DELAY_1: Final = 23  # the message's two group delays [s]
DELAY_2: Final = 24
N_COLUMNS: Final = 25

_BEIDOU_GEO = frozenset([f"C{prn:02d}" for prn in (1, 2, 3, 4, 5, 59, 60, 61, 62, 63)])


def constants_of(system: str) -> tuple[float, float]:
    """Return the system's mu [m^3/s^2] and rotation rate of the Earth [rad/s]; GPS's for QZSS and NavIC."""
    if system == "E":
        return GALILEO_MU_M3PS2, GALILEO_OMEGA_RADPS
    if system == "C":
        return BEIDOU_MU_M3PS2, BEIDOU_OMEGA_RADPS
    return GPS_MU_M3PS2, GPS_OMEGA_RADPS


def is_beidou_geo(sv: str, message: str) -> bool:
    """Return whether a message's elements are those of a geostationary BeiDou satellite (tilted frame).

    The D2 message is sent by these satellites alone (BDS-SIS-ICD B1I 3.0, 5.1.3); a log that does not separate D1
    from D2 is read by the satellite numbers in use for them.
    """
    return message == "D2" or (message != "D1" and sv in _BEIDOU_GEO)


def ephemeris_rows(table: EphemerisTable) -> Float64:
    """Return the messages as rows, (m, N_COLUMNS); a group delay that is not given counts as zero."""
    system = [constants_of(name[0]) for name in table.sv_names]
    mu, omega_e = np.array(system, dtype=np.float64).reshape(-1, 2).T
    geo = [is_beidou_geo(sv, kind) for sv, kind in zip(table.sv_names, table.message, strict=True)]
    is_geo = np.array(geo, dtype=bool)
    rows = np.zeros((len(table.sv_names), N_COLUMNS))
    rows[:, A] = table.sqrt_a**2
    rows[:, E] = table.e
    rows[:, ROOT_1_E2] = np.sqrt(1.0 - table.e**2)
    # n = sqrt(mu / a^3) + delta n
    rows[:, N] = np.sqrt(mu) / table.sqrt_a**3 + table.delta_n
    rows[:, M0] = table.m0
    rows[:, SIN_OMEGA], rows[:, COS_OMEGA] = np.sin(table.omega), np.cos(table.omega)
    rows[:, I0], rows[:, IDOT] = table.i0, table.idot
    # Omega = Omega0 + (Omega_dot - omega_e) t - omega_e toe; a GEO's elements keep the inertial rate Omega_dot
    rows[:, NODE] = np.remainder(table.omega0 - omega_e * table.toe_sow_s, 2.0 * math.pi)
    rows[:, NODE_RATE] = table.omega_dot - np.where(is_geo, 0.0, omega_e)
    rows[:, EARTH_RATE] = np.where(is_geo, omega_e, 0.0)
    for column, values in (
        (CUS, table.cus),
        (CUC, table.cuc),
        (CRS, table.crs),
        (CRC, table.crc),
        (CIS, table.cis),
        (CIC, table.cic),
        (AF0, table.af0),
        (AF1, table.af1),
        (AF2, table.af2),
    ):
        rows[:, column] = values
    rows[:, TOC_MINUS_TOE] = (table.toc_ns - table.toe_ns) / NS_PER_S
    rows[:, RELATIVITY] = -2.0 * np.sqrt(mu) / C_MPS**2 * table.e * table.sqrt_a
    rows[:, DELAY_1 : DELAY_2 + 1] = np.nan_to_num(table.group_delay_s, nan=0.0)
    return rows
