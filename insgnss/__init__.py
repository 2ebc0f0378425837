"""insgnss: a tightly coupled INS/GNSS navigation engine and the laboratory around it.

Conventions, assumed by every file:

- Frames: i inertial, e ECEF (WGS-84), n local level north-east-down, b body forward-right-down, a antenna.
- Target first: ``C_nb @ f_b = f_n`` (the literature's C_b^n). Vectors carry their frame: ``r_e``, ``v_e``, ``f_b``,
  ``w_ib_b``.
- Mechanization and error state live in ECEF (no singular latitude); users read latitude, longitude, height, NED
  velocity, roll, pitch, yaw.
- Error = estimate minus truth, everywhere: ``r_e_hat = r_e + dr``, ``C_eb_hat = (I + [psi x]) C_eb``, estimated bias
  minus true bias. Innovation = measured minus predicted.
- Error state, in this order: dr_e(3) dv_e(3) psi_e(3) b_a(3) b_g(3) clock bias [m] clock drift [m/s], then the
  further states in the order of ``filter.layout``. Indices exist only in ``inertial/error_state.py``, as names.
- Clock in metres and m/s. Range rate is positive when the distance grows; Doppler has the RINEX sign (positive when the
  distance shrinks): range_rate = -wavelength * doppler.
- Quaternions scalar first (Hamilton).
- Inside: SI and radians. At the edges (columns, keys, options) every name ends in its unit: ``lat_deg``, ``sd_n_m``.
- Time: integer nanoseconds of GPS time inside tables; differences as float seconds in kernels. Users see ``time_s``,
  seconds of the GPS week stated in the flight file.
- Arrays: time first, component last, (n, 3), (n, 3, 3).
- Random numbers come from a ``numpy.random.Generator`` argument; there is no global seed.

The main job is two calls::

    flight = insgnss.Flight.load("flight.toml")
    run = insgnss.replay(flight, filter="tight")
"""

from __future__ import annotations

from insgnss.cli import interrupt  # noqa: F401 - first: it answers Ctrl-C while the rest is loaded
from insgnss.errors import InsGnssError
from insgnss.filter.engine_results import NavState
from insgnss.filter.layout import Coupling, GaussMarkov, RandomWalk, StateBlock
from insgnss.filter.layout_names import StateLayout
from insgnss.filter.own_rows.rows import Measurement, Row
from insgnss.filter.own_rows.state_estimate import StateEstimate
from insgnss.former_names import register
from insgnss.log.flight import Flight
from insgnss.report.compare import Comparison, compare
from insgnss.report.page_on_demand import write_report
from insgnss.runs.check import examine as check_flight
from insgnss.runs.engine import Engine
from insgnss.runs.point import PointRun, point
from insgnss.runs.replay import replay
from insgnss.runs.result import Run
from insgnss.runs.setup import engine_settings
from insgnss.version import __version__

register()
Run.page_writer = staticmethod(write_report)

__all__ = [
    "Comparison",
    "Coupling",
    "Engine",
    "Flight",
    "GaussMarkov",
    "InsGnssError",
    "Measurement",
    "NavState",
    "PointRun",
    "RandomWalk",
    "Row",
    "Run",
    "StateBlock",
    "StateEstimate",
    "StateLayout",
    "__version__",
    "check_flight",
    "compare",
    "engine_settings",
    "point",
    "replay",
]
