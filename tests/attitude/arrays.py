"""Skies and antenna arrays that the tests of this folder share."""

from __future__ import annotations

import numpy as np

from insgnss.attitude.baselines import AntennaArray, Sky, sky_of_angles, wavelength
from insgnss.gnss.signals import G1_HZ, G1_STEP_HZ, L1_HZ

AZ_DEG = (30, 75, 120, 165, 200, 250, 290, 335)
EL_DEG = (15, 55, 25, 70, 35, 15, 50, 30)


def eight(wavelength_m: float = 0.19) -> Sky:
    """Return the eight satellites of the reference numbers, on one wavelength."""
    return sky_of_angles(AZ_DEG, EL_DEG, wavelength_m)


def mixed() -> Sky:
    """Return four GPS satellites and four of GLONASS on channels of their own."""
    channels = np.array([-7, 1, 4, 6])
    return sky_of_angles(
        AZ_DEG, EL_DEG, np.r_[[wavelength(L1_HZ)] * 4, wavelength(G1_HZ + channels * G1_STEP_HZ)]
    )


def four_antennas() -> AntennaArray:
    """Return four antennas on a roof, none of two like another."""
    return AntennaArray(np.array([[0.0, 0.0, 0.0], [1.2, 0.1, 0.0], [0.3, 0.9, -0.1], [1.0, 1.1, 0.2]]))
