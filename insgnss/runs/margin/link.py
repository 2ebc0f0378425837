"""The link from emitters on the ground to the antennas of the vehicle: distance, direction, gain, received power."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import pymap3d

from insgnss.antenna.installation import Installation
from insgnss.antenna.visibility import VisibilityLimits, look_at_all, new_looks
from insgnss.config.interference import Emitter, LoopReceiver
from insgnss.constants import C_MPS, WGS84_A_M
from insgnss.runs.margin.path import FlownPath
from insgnss.status import MASKED_OBSTRUCTION
from insgnss.tables import Float64

# Air bends microwaves: the horizon is that of an Earth a third larger      [ITU-R P.834, standard atmosphere]
_EFFECTIVE_RADIUS_M: Final = 4.0 / 3.0 * WGS84_A_M
_NEAREST_M: Final = 1.0  # the far field's law is not asked below


class Link(NamedTuple):
    """m emitters at n times; powers as received at the antenna's output, whatever the front end passes."""

    distance_m: Float64  # (n, m)
    u_n: Float64  # (n, m, 3) unit directions to the emitters, north-east-down
    u_b: Float64  # (n, m, 3) the same in body axes
    gain_dbic: Float64  # (n, m) of the antenna that receives it best; 0 where none is described
    received_dbw: Float64  # (n, m) -inf while switched off or beyond the horizon
    in_sight: Float64  # (n, m) 1.0 or 0.0


def link(
    path: FlownPath, emitters: tuple[Emitter, ...], receiver: LoopReceiver, antennas: Installation
) -> Link:
    """Return each emitter's power at the antennas, in free space.

    Equation: P = EIRP + 20 log10(c / (4 pi f d)) + G - loss        [Friis 1946]; in sight where
              d < sqrt(2 R h_e) + sqrt(2 R h), R = 4/3 of the Earth's radius
    Neglects: terrain, buildings, reflections, diffraction beyond the horizon; heights below the ellipsoid count as 2 m.
    """
    at = [np.array([getattr(e, name) for e in emitters]) for name in ("lat_deg", "lon_deg", "h_m")]
    lat, lon, h = path.position.T[:, :, None]
    azimuth, elevation, distance = pymap3d.geodetic2aer(
        *(value[None, :] for value in at), np.degrees(lat), np.degrees(lon), h
    )
    azimuth, elevation = np.radians(azimuth), np.radians(elevation)
    level = np.cos(elevation)
    u_n = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), -np.sin(elevation)], axis=-1)
    horizon = np.sqrt(2.0 * _EFFECTIVE_RADIUS_M * np.maximum(at[2], 2.0)) + np.sqrt(
        2.0 * _EFFECTIVE_RADIUS_M * np.maximum(h, 2.0)
    )
    in_sight = distance < horizon
    gain = emitter_gain(path.C_nb, u_n, antennas, receiver.airframe_loss_db)
    frequency = np.array([e.frequency_hz for e in emitters])
    eirp = np.array([e.eirp_dbw - e.loss_db for e in emitters])
    spread = 20.0 * np.log10(C_MPS / (4.0 * math.pi * frequency * np.maximum(distance, _NEAREST_M)))
    on = in_sight & _switched_on(path.time_s, emitters)
    u_b = np.einsum("nji,nmj->nmi", path.C_nb, u_n)
    received = np.where(on, eirp + spread + gain, -np.inf)
    return Link(np.asarray(distance), u_n, u_b, gain, received, in_sight.astype(np.float64))


def emitter_gain(C_nb: Float64, u_n: Float64, antennas: Installation, airframe_loss_db: float) -> Float64:
    """Return the gain towards directions u_n (n, m, 3), of the antenna that the airframe leaves free and hears best.

    Of an emitter hidden from all of them it is the best gain less ``airframe_loss_db``. Without antennas it is 0 dBic.
    """
    if not len(antennas.lever_b):
        return np.zeros(u_n.shape[:2])
    looks = new_looks(*u_n.shape[:2])
    every_gain = VisibilityLimits(-1e9, 0.0, 0.0, math.inf)
    C = np.ascontiguousarray(C_nb)
    look_at_all(C, np.zeros_like(C), np.ascontiguousarray(u_n), antennas, every_gain, looks)
    gain_dbic = np.nan_to_num(looks.gain[..., 0], nan=0.0)
    return np.asarray(np.where(looks.reason == MASKED_OBSTRUCTION, gain_dbic - airframe_loss_db, gain_dbic))


def _switched_on(
    time_s: Float64, emitters: tuple[Emitter, ...]
) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    on = np.ones((len(time_s), len(emitters)), np.bool_)
    for k, emitter in enumerate(emitters):
        if emitter.from_s is not None:
            on[:, k] &= time_s >= emitter.from_s
        if emitter.until_s is not None:
            on[:, k] &= time_s < emitter.until_s
    return on
