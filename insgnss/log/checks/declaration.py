"""The flight file's declarations: of the inertial log, as matrices, with the log in its own axes; of the vehicle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from insgnss.config.vehicle_kind import ROWS, VehicleRows
from insgnss.log.checks.report import Finding
from insgnss.log.flight import Flight
from insgnss.log.imu.axes import mounting_matrix, signed_permutation
from insgnss.log.imu.csv_log import inertial, read_imu_as_logged
from insgnss.tables import Float64, ImuTable
from insgnss.units import SI_PER_UNIT


class AxesDeclaration(NamedTuple):
    """An inertial log in the axes that ``imu.axes`` picks from, and how the flight file declares them."""

    imu: ImuTable  # as logged; turned by the mounting matrix where there is one
    accel: Float64  # (3, 3) to body axes
    gyro: Float64  # (3, 3)
    turned: bool  # by a mounting matrix: the flight file has no imu.axes
    factors: tuple[float, ...]  # on the gyros' unit: 1, and the factor of the other unit
    units: tuple[str, ...]  # of the gyros, as ``factors``


def declared_log(flight: Flight, imu: ImuTable | None = None) -> AxesDeclaration:
    """Return the inertial log of a flight in its own axes.

    Parameters
    ----------
    imu : the log as read by ``read_imu``, where it could be; else it is read again without checks

    Raises
    ------
    InsGnssError : the log cannot be read, or its mounting matrix is not a rotation
    """
    config = inertial(flight.config)
    turned = config.mounting_matrix is not None
    accel = np.eye(3) if turned else signed_permutation(config.axes)
    gyro = accel if config.gyro_axes is None else signed_permutation(config.gyro_axes)
    if imu is None:
        logged = read_imu_as_logged(config, flight.config.gps_week)
        C_bs = mounting_matrix(config) if turned else np.eye(3)
        own = ImuTable(logged.t_ns, logged.w_ib_b @ C_bs.T, logged.f_b @ C_bs.T)
    else:
        own = ImuTable(imu.t_ns, imu.w_ib_b @ gyro, imu.f_b @ accel)
    # the declared unit and the other one of its kind
    now, other = ("rad", "deg") if config.gyro_unit.startswith("rad") else ("deg", "rad")
    units = config.gyro_unit, config.gyro_unit.replace(now, other)
    factors = tuple(SI_PER_UNIT[unit] / SI_PER_UNIT[config.gyro_unit] for unit in units)
    return AxesDeclaration(own, accel, gyro, turned, factors, units)


def vehicle_findings(vehicle: VehicleRows) -> list[Finding]:
    """Return the motion constraints that a vehicle's kind allows, those in use, and their weaknesses."""
    allowed = [name for name in ROWS if getattr(vehicle, name) is not None]
    off = [name for name in allowed if name not in vehicle.rows]
    text = f"{vehicle.kind}: its motion makes no rows"
    if allowed:
        text = f"{vehicle.kind}: rows {', '.join(vehicle.rows) or 'none'} every {vehicle.period_s:g} s"
        text += f"; switched off: {', '.join(off)}" if off else ""
    findings = [Finding("ok", "vehicle", text)]
    along = vehicle.non_holonomic
    if along is not None and along.on and along.axle_m is None:
        findings.append(
            Finding(
                "warning",
                "vehicle",
                f"the axle is not given: it is taken to be at the IMU, within {along.axle_sd_m:g} m (1 sigma)",
                "measure it: vehicle.non_holonomic.axle_m, IMU to the middle of the axle that does not steer",
            )
        )
    return findings
