"""Sample calls of the kernels in ``insgnss.gnss``."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.gnss.range_model import AirModel
from insgnss.gnss.troposphere import Weather
from insgnss.tables import EphemerisTable, GnssTable, NavigationData, StateVectorTable
from tests.kernels import KernelCase

_SIGHT = "insgnss.gnss.line_of_sight"
_SAT = np.array(
    [
        [15_600e3, 7_540e3, 20_140e3, 1_200.0, -2_900.0, 150.0, 1.2e4, -3e-3],
        [-2_300e3, 21_800e3, 14_900e3, -1_900.0, -1_100.0, 1_400.0, -8.1e4, 2e-3],
    ]
)
_R_E = np.array([1_744_000.0, 1_116_000.0, 6_008_000.0])
_V_E = np.array([30.0, -110.0, 12.0])
_U = np.array([0.6, 0.0, 0.8])
_C_EN = np.array([[-0.48, -0.64, -0.6], [0.36, 0.48, -0.8], [0.8, -0.6, 0.0]])
_KLOBUCHAR = np.array([1.2e-8, 7.5e-9, -6e-8, -6e-8, 9e4, 3.3e4, -2e5, -6.5e4])
_TOE_NS = 2268 * NS_PER_WEEK + 201_600 * NS_PER_S


def ephemerides() -> EphemerisTable:
    """Return four messages: two of a GPS satellite, one of Galileo, one marked unhealthy."""
    n = 4
    same: dict[str, Any] = {field.name: np.zeros(n) for field in fields(EphemerisTable)}
    orbit = {
        "sqrt_a": 5153.7,
        "e": 0.012,
        "i0": 0.96,
        "omega0": 1.1,
        "omega": -0.7,
        "m0": 0.4,
        "delta_n": 4.5e-9,
    }
    rates = {"omega_dot": -8e-9, "idot": 2e-10, "cuc": 1e-6, "cus": 8e-6, "crc": 220.0, "crs": -30.0}
    clock = {"cic": 1e-7, "cis": -5e-8, "af0": -2e-4, "af1": 3e-12, "af2": 1e-18, "toe_sow_s": 201_600.0}
    for name, value in (orbit | rates | clock).items():
        same[name] = np.full(n, value)
    same |= {
        "sv_names": ("G07", "G07", "E05", "G09"),
        "message": ("LNAV", "LNAV", "FNAV", "LNAV"),
        "toe_ns": _TOE_NS + np.array([0, 7200, 0, 0]) * NS_PER_S,
        "toc_ns": np.full(n, _TOE_NS),
        "group_delay_s": np.full((n, 2), 5e-9),
        "health": np.array([0.0, 0.0, 0.0, 1.0]),
        "accuracy_m": np.full(n, 2.0),
        "fit_interval_s": np.full(n, np.nan),
    }
    return EphemerisTable(**same)


def state_vectors() -> StateVectorTable:
    """Return the message of one GLONASS satellite."""
    return StateVectorTable(
        sv_names=("R03",),
        t_ns=np.array([_TOE_NS]),
        r_e=np.array([[-23_809.82128906e3, -8_908.935546875e3, 2_209.434082031e3]]),
        v_e=np.array([[228.9457321167, 253.6134719849, 3_556.049346924]]),
        a_e=np.array([[-3.725290298462e-6, 9.313225746155e-7, -1.862645149231e-6]]),
        clock_s=np.array([-1.236097887158e-4]),
        clock_rate=np.array([9.1e-13]),
        group_delay_s=np.array([4e-9]),
        health=np.zeros(1),
        channel=np.array([5], np.int16),
    )


def integrated_states() -> list[np.ndarray]:
    """Return the satellite states of five rows of a GLONASS satellite: within its message's time and outside."""
    n = 5
    none = np.full(n, np.nan)
    log = GnssTable(
        t_ns=_TOE_NS + np.array([-929, -30, 0, 459, 960]) * NS_PER_S,
        sv=np.zeros(n, np.int16),
        signal=np.array([0, 1, 0, 1, 0], np.int16),
        pseudorange_m=np.linspace(2.0e7, 2.3e7, n),
        doppler_hz=none,
        range_rate_mps=none,
        cn0_dbhz=none,
        sv_names=("R03",),
        signal_names=("C1C", "C2C"),
    )
    navigation = NavigationData(ephemerides(), None, None, state_vectors())
    return list(satellite_states(log, navigation))


def broadcast_states() -> list[np.ndarray]:
    """Return the satellite states of nine rows: in use, unhealthy, unknown, without a pseudorange, out of bounds."""
    n = 9
    none = np.full(n, np.nan)
    log = GnssTable(
        t_ns=_TOE_NS + np.repeat([-1800, 5400, 90_000], 3) * NS_PER_S,
        sv=np.tile([0, 1, 2], 3).astype(np.int16),
        signal=np.array([0, 0, 0, 0, 0, 1, 0, 0, 0], np.int16),
        pseudorange_m=np.array([2.1e7, 2.4e7, 2.2e7, np.nan, 2.4e7, 2.3e7, 2.1e7, 9e9, 2.2e7]),
        doppler_hz=none,
        range_rate_mps=none,
        cn0_dbhz=none,
        sv_names=("G07", "E05", "G09"),
        signal_names=("C1C", "C9Z"),
    )
    return list(satellite_states(log, ephemerides()))


CASES = [
    KernelCase(f"{_SIGHT}:line_of_sight_range", (_SAT, 1, _R_E, np.zeros(3))),
    KernelCase(f"{_SIGHT}:line_of_sight", (_SAT, 0, _R_E, _V_E, np.zeros(3), np.zeros(3))),
    KernelCase("insgnss.gnss.ionosphere:ionosphere_above", (350_000.0,)),
    KernelCase("insgnss.gnss.ionosphere:klobuchar_delay", (_KLOBUCHAR, 1.0, 0.5, 2.0, 0.6, 2e5)),
    KernelCase(
        "insgnss.gnss.range_model:path_delay", (_KLOBUCHAR, (1.0, 0.5, 300.0), 2.0, 0.6, 2e5, 1.6, 1.0)
    ),
    KernelCase(
        "insgnss.gnss.differential:base_ranges",
        (
            np.full(2, _TOE_NS),
            _SAT,
            np.zeros(2),
            _R_E,
            AirModel(_KLOBUCHAR, np.array([1.0, 1.8]), 1.0, Weather(1013.25, 288.15, 0.7)),
            np.array([np.nan, 4.0]),
            np.zeros(2),
            np.zeros(2),
        ),
    ),
    KernelCase("tests.kernels.gnss:broadcast_states"),
    KernelCase("tests.kernels.gnss:integrated_states"),
]
