"""The delays of a predicted pseudorange besides distance and clocks: the atmosphere, at the rate of the sigma.

Held over a span: the troposphere of a satellite at 5 deg changes by up to 0.03 m/s, at 30 deg by 1 mm/s.
"""

from __future__ import annotations

import numpy as np

from insgnss.aiding.antenna_motion import turn_about_axis
from insgnss.aiding.observables import LANES, N_LANE_ROWS, Spans, expand_satellite, towards
from insgnss.aiding.satellite_arcs import PIECE_NS, Arcs
from insgnss.aiding.trace import Trace
from insgnss.constants import NS_PER_S, NS_PER_WEEK, WGS84_OMEGA_RADPS
from insgnss.geodesy.ellipsoid import ecef_to_geodetic
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.gnss.range_model import AIR_DTYPE, AirModel, evaluate_atmosphere, slant_delay
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64


@kernel
def fill_delays(trace: Trace, arcs: Arcs, spans: Spans, lever_b: Float64, air_model: AirModel) -> None:
    """Add the air's delay [m] of each satellite to ``spans.delay_m``, at the span's first time."""
    air = np.zeros(1, AIR_DTYPE)
    motion, line, u_n, C_ne = np.zeros((4, 3)), np.zeros((2, 3)), np.zeros(3), np.zeros((3, 3))
    r_a, e = np.zeros(3), np.zeros(N_LANE_ROWS * LANES)
    for span in range(len(spans.first_time) - 1):
        i = spans.first_time[span]
        C = trace.C_eb[i]
        for k in range(3):
            r_a[k] = trace.r_e[i, k] + C[k, 0] * lever_b[0] + C[k, 1] * lever_b[1] + C[k, 2] * lever_b[2]
            motion[0, k] = r_a[k]
        lat, lon, h = ecef_to_geodetic(r_a)
        ecef_to_ned_matrix(lat, lon, C_ne)
        week_s = (trace.t_ns[i] % NS_PER_WEEK) / NS_PER_S
        evaluate_atmosphere(air[0], lat, lon, h, week_s, air_model.troposphere, air_model.weather)
        since_ns = trace.t_ns[i] - arcs.start_ns
        p = since_ns // PIECE_NS
        since_s = (since_ns - p * PIECE_NS) / NS_PER_S
        turn_about_axis(motion, 0, 1, WGS84_OMEGA_RADPS * since_s)
        for j in range(spans.first_satellite[span], spans.first_satellite[span + 1]):
            satellite = spans.satellite[j]
            expand_satellite(arcs.pieces[satellite, p], since_s, motion, e, 0)
            towards(e, 0, motion, line)
            turn_about_axis(line, 0, 1, -WGS84_OMEGA_RADPS * since_s)
            for k in range(3):
                u_n[k] = C_ne[k, 0] * line[0, 0] + C_ne[k, 1] * line[0, 1] + C_ne[k, 2] * line[0, 2]
            spans.delay_m[j] += slant_delay(air[0], air_model.klobuchar, u_n, air_model.ionosphere[satellite])
