"""The antennas of a vehicle file, or of a flight, as an array of phase centres."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from insgnss.attitude.baselines import AntennaArray
from insgnss.config.flight import AttitudeConfig, Gnss, MountedAntenna, Vector3
from insgnss.config.library import vehicle as vehicle_of
from insgnss.config.vehicle import Vehicle, VehicleAntenna
from insgnss.errors import ConfigError

_MOUNTING = {"pattern", "mounting_rpy_deg", "mounting_matrix", "obstruction"}
MAIN = "main"  # name of the antenna of [gnss] if the flight file does not name it


def array_of_vehicle(vehicle: str | Path | Vehicle, first: str | None = None) -> AntennaArray:
    """Return the antennas of a vehicle: its settings, a file (a path ending in .toml), or a name in the library.

    Parameters
    ----------
    first : name of the antenna that all baselines begin at; the file's first when None

    Raises
    ------
    ModelError, ConfigError : there is no such vehicle, its file is wrong, or it has no antenna named ``first``
    GeometryError : two antennas are at one place
    """
    model = vehicle_of(vehicle)
    positions = {antenna.name: antenna.lever_arm_m for antenna in model.antenna}
    begin = model.antenna[0].name if first is None else first
    position_of(positions, begin, "first")
    names = (begin, *(name for name in positions if name != begin))
    return AntennaArray(np.array([positions[name] for name in names]), names)


def array_of_flight(attitude: AttitudeConfig, gnss: Gnss, folder: Path) -> AntennaArray:
    """Return the antennas of a flight, that of [gnss] first; positions by the vehicle where the block names one.

    Raises
    ------
    ConfigError : an antenna's place is not given, or the vehicle has no antenna of that name
    ModelError : there is no such vehicle
    GeometryError : two antennas are at one place
    """
    known: dict[str, Vector3] = {}
    if attitude.vehicle is not None:
        model = vehicle_of(attitude.vehicle, (folder,))
        known = {antenna.name: antenna.lever_arm_m for antenna in model.antenna}
    main = attitude.main_antenna or MAIN
    if not known and gnss.lever_b is None:
        raise ConfigError(
            "the place of the main antenna is not given, and baselines begin there",
            key="gnss.lever_arm_m",
            advice="give gnss.lever_arm_m, or attitude.vehicle and attitude.main_antenna",
        )
    places = [gnss.lever_b if not known else position_of(known, main, "attitude.main_antenna")]
    for antenna in attitude.antenna:
        if antenna.lever_arm_m is not None and not known:
            places.append(antenna.lever_arm_m)
        elif known:
            places.append(position_of(known, antenna.name, "attitude.antenna.name"))
        else:
            raise ConfigError(
                f"the place of antenna '{antenna.name}' is not given",
                key="attitude.antenna.lever_arm_m",
                advice="give lever_arm_m in body axes, or attitude.vehicle",
            )
    return AntennaArray(np.array(places), (main, *(antenna.name for antenna in attitude.antenna)))


def mounted_antennas(attitude: AttitudeConfig, gnss: Gnss, folder: Path) -> tuple[MountedAntenna, ...]:
    """Return the mounting and field of view of each antenna of a flight, that of [gnss] first.

    The flight file's entry on an antenna takes precedence over the vehicle's file; an antenna without an entry is
    level and sees everything.

    Raises
    ------
    ConfigError, ModelError : the vehicle cannot be found, or lacks an antenna
    """
    own: dict[str, VehicleAntenna] = {}
    if attitude.vehicle is not None:
        own = {antenna.name: antenna for antenna in vehicle_of(attitude.vehicle, (folder,)).antenna}
    main = own.get(attitude.main_antenna or MAIN, MountedAntenna(pattern="isotropic"))
    antennas: list[MountedAntenna] = [gnss.antenna[0] if gnss.antenna else main]
    for antenna in attitude.antenna:
        is_told = bool(antenna.model_fields_set & _MOUNTING)
        antennas.append(antenna if is_told else own.get(antenna.name, antenna))
    return tuple(antennas)


def position_of(positions: dict[str, Vector3], name: str, key: str) -> Vector3:
    """Return the place of an antenna of a vehicle.

    Raises
    ------
    ConfigError : there is no antenna of that name
    """
    if name not in positions:
        raise ConfigError(
            f"the vehicle has no antenna '{name}'", key=key, advice=f"it has: {', '.join(positions)}"
        )
    return positions[name]
