"""The faults that protection levels are to bound, and a log's rows without the satellites of one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.config.integrity import Integrity
from insgnss.errors import ConfigError
from insgnss.gnss.observation_rows import N_BANDS, GnssRows, satellite_name
from insgnss.status import SWITCHED_OFF, USED
from insgnss.tables import Int64


class Fault(NamedTuple):
    """Satellites that may be wrong together."""

    name: str  # a satellite's, or a constellation's letter
    satellites: Int64  # their numbers in any log
    probability: float


def faults_of(blocks: Sequence[GnssRows], config: Integrity) -> list[Fault]:
    """Return a fault for each satellite that a filter may use, and one for each of two constellations or more."""
    numbers = np.unique(np.concatenate([_numbers(rows)[_tried(rows)] for rows in blocks]))
    names = [satellite_name(int(number)) for number in numbers]
    letters = sorted({name[0] for name in names})
    faults = [
        Fault(name, np.array([number]), config.satellite_fault)
        for name, number in zip(names, numbers, strict=True)
    ]
    if len(letters) > 1:
        of = np.array([name[0] for name in names])
        faults += [Fault(letter, numbers[of == letter], config.constellation_fault) for letter in letters]
    return faults


def risk_left(blocks: Sequence[GnssRows], config: Integrity) -> float:
    """Return the risk that two faults at once leave, which no sub-filter is without.

    Equation: risk - (n p_satellite + m p_constellation)^2 / 2, n and m the most satellites and constellations at once

    Raises
    ------
    ConfigError : nothing is left
    """
    satellites = constellations = 0
    for rows in blocks:
        numbers, tried = _numbers(rows), _tried(rows)
        for first, last in zip(rows.first[:-1], rows.first[1:], strict=True):
            here = np.unique(numbers[first:last][tried[first:last]])
            satellites = max(satellites, len(here))
            constellations = max(constellations, len({satellite_name(int(number))[0] for number in here}))
    constellations = constellations if constellations > 1 else 0
    two = 0.5 * (satellites * config.satellite_fault + constellations * config.constellation_fault) ** 2
    if not two < config.risk:
        raise ConfigError(
            f"two of {satellites} satellites are wrong at once with a probability of {two:.1e}, more than the risk of"
            f" {config.risk:.1e}",
            key="integrity.risk",
            advice="raise the risk, or lower satellite_fault and constellation_fault",
        )
    return config.risk - two


def without(rows: GnssRows, satellites: Int64) -> GnssRows:
    """Return a copy of rows of which none of some satellites is used."""
    off = np.isin(_numbers(rows), satellites)
    observation, carrier = rows.observation.copy(), rows.carrier.copy()
    observation["status"][off[:, None] & (observation["status"] == USED)] = SWITCHED_OFF
    if len(carrier):
        carrier["status"][off & (carrier["status"] == USED)] = SWITCHED_OFF
    return rows._replace(observation=observation, carrier=carrier)


def _numbers(rows: GnssRows) -> Int64:
    return np.asarray(rows.observation["slot"], np.int64) // N_BANDS


def _tried(rows: GnssRows) -> npt.NDArray[np.bool_]:
    return np.asarray((rows.observation["status"] == USED).any(axis=1))
