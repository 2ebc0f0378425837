"""Antennas of one vehicle, the satellites they see, and the phase differences between them with their derivatives.

``psi`` is in radians, one row per baseline (from the first antenna to each other one), one column per satellite. It
grows as the second antenna comes nearer to the satellite, as the received carrier phase does; ranges have the other
sign.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS
from insgnss.errors import ConfigError, GeometryError
from insgnss.geodesy.directions import directions
from insgnss.geodesy.rotations import euler_to_matrix
from insgnss.tables import Bool, Float64
from insgnss.tracking.admissible import require_known, require_positive

ANGLES: Final = ("roll", "pitch", "yaw")
_SHORTEST_M: Final = 1e-3  # two phase centres nearer than that are one antenna written twice
_UNIT_TOLERANCE: Final = 1e-6


@dataclass(frozen=True)
class AntennaArray:
    """Phase centres of M antennas that are fixed to one body; the first one is common to all baselines."""

    positions_b: Float64  # (M, 3) in body axes, from any origin [m]
    names: tuple[str, ...] = ()
    baselines_b: Float64 = field(init=False)  # (M - 1, 3) from the first antenna to each other one [m]

    def __post_init__(self) -> None:
        positions = np.asarray(self.positions_b, np.float64)
        if positions.ndim != 2 or positions.shape[1] != 3 or len(positions) < 2:
            raise GeometryError(
                f"{len(positions) if positions.ndim else 0} antenna(s): a baseline needs two",
                key="positions_b",
                advice="give at least two antennas, each with three coordinates in body axes",
            )
        if not np.isfinite(positions).all():
            raise ConfigError(
                "a position is not finite", key="positions_b", advice="give metres in body axes"
            )
        names = self.names or tuple(f"antenna {i + 1}" for i in range(len(positions)))
        if len(names) != len(positions) or len(set(names)) != len(names):
            raise ConfigError(
                "each antenna needs one name of its own", key="names", advice="leave names out, or give M"
            )
        for i, k in zip(*np.triu_indices(len(positions), 1), strict=True):
            if np.linalg.norm(positions[i] - positions[k]) < _SHORTEST_M:
                raise GeometryError(
                    f"{names[i]} and {names[k]} are at the same place",
                    key="positions_b",
                    advice="give each antenna its own phase centre, or leave one of them out",
                )
        object.__setattr__(self, "positions_b", positions)
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "baselines_b", positions[1:] - positions[0])

    @property
    def lengths_m(self) -> Float64:
        """Return the lengths of the baselines, (M - 1,)."""
        return np.asarray(np.linalg.norm(self.baselines_b, axis=1))

    def reordered(self, order: tuple[int, ...]) -> AntennaArray:
        """Return the same antennas in another order."""
        return AntennaArray(self.positions_b[list(order)], tuple(self.names[i] for i in order))


def triangle(edge_m: float) -> AntennaArray:
    """Return three antennas at the corners of an equilateral triangle in the body's x-y plane, the paper's array."""
    require_positive(edge_m=edge_m)
    corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.5 * math.sqrt(3.0), 0.0]]
    return AntennaArray(edge_m * np.array(corners))


@dataclass(frozen=True)
class Sky:
    """The N signals that all antennas receive: direction and wavelength of each; one satellite may have several."""

    los_n: Float64  # (N, 3) unit vectors, receiver to satellite, north-east-down
    wavelength_m: Float64  # (N,) of each signal; one number where all have the same
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        los = np.atleast_2d(np.asarray(self.los_n, np.float64))
        if los.ndim != 2 or los.shape[1] != 3 or not len(los):
            raise ConfigError("directions are three numbers each", key="los_n", advice="give (N, 3)")
        away = np.abs(np.linalg.norm(los, axis=1) - 1.0)
        if not (away < _UNIT_TOLERANCE).all():
            raise ConfigError(
                f"direction {int(np.argmax(~(away < _UNIT_TOLERANCE)))} is not a unit vector",
                key="los_n",
                advice="divide the vectors to the satellites by their lengths",
            )
        wavelength = np.broadcast_to(np.asarray(self.wavelength_m, np.float64), (len(los),))
        for value in wavelength:
            require_positive("carriers of satellites are 0.1 to 0.3 m long", wavelength_m=float(value))
        object.__setattr__(self, "los_n", los)
        object.__setattr__(self, "wavelength_m", wavelength.copy())
        object.__setattr__(self, "names", self.names or tuple(f"signal {i + 1}" for i in range(len(los))))

    @property
    def wave_vectors_n(self) -> Float64:
        """Return 2 pi / lambda times the directions, (N, 3) [rad/m]."""
        return np.asarray(2.0 * math.pi / self.wavelength_m[:, None] * self.los_n)

    def only(self, kept: Bool) -> Sky:
        """Return the signals that are marked, (N,)."""
        names = tuple(n for n, k in zip(self.names, kept, strict=True) if k)
        return Sky(self.los_n[kept], self.wavelength_m[kept], names)


def sky_of_angles(az_deg: npt.ArrayLike, el_deg: npt.ArrayLike, wavelength_m: npt.ArrayLike) -> Sky:
    """Return satellites by azimuth from north to east and elevation."""
    return Sky(directions(az_deg, el_deg), np.asarray(wavelength_m, np.float64))


def wavelength(carrier_hz: npt.ArrayLike) -> Float64:
    """Return the wavelengths of carriers [m]; those of GLONASS differ by satellite."""
    return np.asarray(C_MPS / np.asarray(carrier_hz, np.float64))


def attitude_matrices(rpy: npt.ArrayLike) -> Float64:
    """Return C_nb (..., 3, 3) of roll, pitch, yaw (..., 3) [rad]: (2) of the paper, Rz(y) Ry(p) Rx(r)."""
    angles = np.asarray(rpy, np.float64)
    flat = angles.reshape(-1, 3)
    C = np.empty((len(flat), 3, 3))
    for one, (roll, pitch, yaw) in zip(C, flat, strict=True):
        euler_to_matrix(roll, pitch, yaw, one)
    return C.reshape(*angles.shape[:-1], 3, 3)


def euler_axes(rpy: npt.ArrayLike) -> Float64:
    """Return the axes in n about which roll, pitch and yaw turn the body, (..., 3, 3), one row for each angle.

    Roll turns about the body's own forward axis, pitch about the level axis to the right, yaw about down.
    """
    angles = np.asarray(rpy, np.float64)
    sp, cp = np.sin(angles[..., 1]), np.cos(angles[..., 1])
    sy, cy = np.sin(angles[..., 2]), np.cos(angles[..., 2])
    zero, one = np.zeros_like(sp), np.ones_like(sp)
    rows = [[cp * cy, cp * sy, -sp], [-sy, cy, zero], [zero, zero, one]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def baselines_by_euler(rpy: npt.ArrayLike, baselines_b: npt.ArrayLike) -> Float64:
    """Return the derivatives of baselines in n by roll, pitch, yaw: (..., baselines, angles, 3) [m/rad].

    Equation: L_a = e_a x (C_nb l_b), e_a the angle's axis        [(20), (22) of Dneprov and Korogodin 2015]
    The printed (22) has all signs of L_r reversed, and errors in L_p and L_y; this is the exact derivative.
    """
    turned = _turned(attitude_matrices(rpy), baselines_b)
    return np.asarray(np.cross(euler_axes(rpy)[..., None, :, :], turned[..., :, None, :]))


def phase_differences(C_nb: npt.ArrayLike, array: AntennaArray, sky: Sky) -> Float64:
    """Return the phase differences against the first antenna, (..., M - 1, N) [rad], not wrapped.

    Equation: psi_mn = 2 pi / lambda_n k_n^T C_nb l_m                                            [(3)]
    Neglects: wind-up between antennas that are tilted against each other (``wind_up``), the curvature of the wave
    (l^2 / (2 R), 1e-7 m for 2 m), and delays of cables and receivers.
    """
    return np.asarray(_turned(np.asarray(C_nb, np.float64), array.baselines_b) @ sky.wave_vectors_n.T)


def phases_by_euler(rpy: npt.ArrayLike, array: AntennaArray, sky: Sky) -> Float64:
    """Return the derivatives of the phase differences by roll, pitch, yaw: (..., M - 1, N, 3) [rad/rad].

    Equation: d psi_mn / d a = 2 pi / lambda_n k_n^T L_a,m                                [(14), (16), (21)]
    At a pitch of +-90 deg roll and yaw turn about one axis and their columns coincide: use ``phases_by_rotation``.
    """
    L = baselines_by_euler(rpy, array.baselines_b)
    return np.asarray(np.swapaxes(L @ sky.wave_vectors_n.T, -1, -2))


def phases_by_euler_twice(rpy: npt.ArrayLike, array: AntennaArray, sky: Sky) -> Float64:
    """Return the second derivatives by each angle, d2 psi / d a2, (..., M - 1, N, 3) [rad/rad^2].

    Equation: d2 l / d a2 = e_a x (e_a x l)
    """
    L = baselines_by_euler(rpy, array.baselines_b)
    bend = np.cross(euler_axes(rpy)[..., None, :, :], L)
    return np.asarray(np.swapaxes(bend @ sky.wave_vectors_n.T, -1, -2))


def phases_by_rotation(C_nb: npt.ArrayLike, array: AntennaArray, sky: Sky) -> Float64:
    """Return the derivatives by a small rotation vector in n, (..., M - 1, N, 3) [rad/rad].

    Equation: C_nb -> (I + [phi x]) C_nb, d psi_mn / d phi = 2 pi / lambda_n (C_nb l_m) x k_n
    """
    turned = _turned(np.asarray(C_nb, np.float64), array.baselines_b)
    return np.asarray(np.cross(turned[..., :, None, :], sky.wave_vectors_n))


def difference_covariance(variance_rad2: npt.ArrayLike) -> Float64:
    """Return the covariance of differences that share the first antenna, (N, M - 1, M - 1) [rad^2].

    Equation: cov(psi_m, psi_k) = D_1 + D_m (m = k), D_1 (m != k); satellites are independent
    Half of the variance of a difference between like antennas is common to all of them: the correlation is 1/2.

    Parameters
    ----------
    variance_rad2 : (M, N) variance of the phase at each antenna
    """
    D = np.asarray(variance_rad2, np.float64).T  # (N, M)
    own = D[:, 1:, None] * np.eye(D.shape[1] - 1)
    return np.asarray(own + D[:, :1, None])


def wrapped(phase_rad: npt.ArrayLike) -> Float64:
    """Return phases in (-pi, pi]."""
    phase = np.asarray(phase_rad, np.float64)
    return np.asarray(phase - 2.0 * math.pi * np.ceil(phase / (2.0 * math.pi) - 0.5))


def angle_index(angle: str) -> int:
    """Return the place of "roll", "pitch" or "yaw" among the angles.

    Raises
    ------
    ConfigError : another name; the advice gives the nearest
    """
    return ANGLES.index(require_known(angle, ANGLES, "angle", "angle of an attitude"))


def _turned(C_nb: Float64, baselines_b: npt.ArrayLike) -> Float64:
    """Return baselines in n, (..., baselines, 3)."""
    return np.asarray(np.asarray(baselines_b, np.float64) @ np.swapaxes(C_nb, -1, -2))
