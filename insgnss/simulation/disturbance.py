"""The forms of observation errors: white noise, and errors that belong to the sky and its geometry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from insgnss.tables import Float64


class ObservationNoise(Protocol):
    """White noise of one kind of observation."""

    def sigma(self, elevation: Float64, cn0_dbhz: Float64) -> Float64:
        """Return sigma for elevations [rad] and C/N0 [dBHz]."""


class PathErrors(NamedTuple):
    """A disturbance of code and carrier of all columns, (m, n) each [m]."""

    code_m: Float64
    carrier_m: Float64


@dataclass(frozen=True)
class SkyGeometry:
    """The sky as disturbances see it: n satellites for each of ``codes`` signals."""

    t_s: Float64  # (m,) true time
    elevation: Float64  # (m, n) [rad]
    direction_e: Float64  # (m, n, 3) unit, towards the satellites
    satellite_r_e: Float64  # (m, n, 3) [m]
    satellite_inertial_v_e: Float64  # (m, n, 3) [m/s]
    codes: int
    wavelength_m: Float64  # (codes n,) of each column
    ionosphere_factor: Float64  # (codes n,) delay of the code over that on L1


class Disturbance(Protocol):
    """A source of errors that is not white noise."""

    def __call__(self, sky: SkyGeometry, rng: np.random.Generator) -> PathErrors:
        """Return one realisation along the whole scenario."""
