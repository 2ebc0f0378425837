"""The meaning of ``[vehicle]`` of a flight file for the filter, in words."""

from __future__ import annotations

from insgnss.config.vehicle_kind import ROWS, VehicleRows
from insgnss.log.checks.report import Finding


def vehicle_findings(vehicle: VehicleRows) -> list[Finding]:
    """Return which rows a vehicle's kind allows and which of them are used, and their weaknesses."""
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
