"""The visibility stage without a filter: which satellites a vehicle's antennas saw along its attitude history.

::

    from insgnss.runs.visibility import AttitudeHistory, sky_of_navigation, visibility

    attitude = AttitudeHistory.from_rpy(t_ns, rpy, position)      # or from_quaternion, of_reference, of_nav
    sky = sky_of_navigation(attitude, navigation)                 # or sky_of_table
    study = visibility(attitude, sky, antennas)
    study.satellites, study.dop, study.events
"""

from __future__ import annotations

from insgnss.runs.visibility.attitude_history import AttitudeHistory
from insgnss.runs.visibility.sky import SatelliteDirections, sky_of_navigation, sky_of_table
from insgnss.runs.visibility.study import VisibilityStudy, visibility

__all__ = [
    "AttitudeHistory",
    "SatelliteDirections",
    "VisibilityStudy",
    "sky_of_navigation",
    "sky_of_table",
    "visibility",
]
