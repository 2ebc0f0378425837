"""A hand-made run for the supervisor: 11 satellites over an airfield, an aircraft that stands in the air and banks."""

from __future__ import annotations

from functools import cache

import numpy as np

from insgnss.aiding.satellite_arcs import SatelliteArcs, broadcast_arcs
from insgnss.aiding.table import AidingSetup
from insgnss.aiding.trace import Covariances, FilterTrace, Trace, TraceSamples
from insgnss.config.aiding import AidingConfig
from insgnss.config.filter import Visibility
from insgnss.config.search import Search
from insgnss.constants import NS_PER_S
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.geodesy.rotations import euler_to_matrix
from insgnss.gnss.orbits.ephemeris_choice import broadcast_messages
from insgnss.inertial.clock_model import clock_model
from insgnss.inertial.sensor_model import sensor_model
from insgnss.receiver import Sightings, SupervisionSetup
from insgnss.simulation.sample_trajectories import AIRFIELD
from insgnss.simulation.trajectory import EARTH_RATE_E
from insgnss.tables import Float64, Int64
from tests.antenna.vehicle import vehicle
from tests.runs.scenes import START_NS, TACTICAL, TCXO, paper_sky

SIGNALS = {"G": "C1C"}
RATE_HZ = 10
DURATION_S = 120.0
BANK_S = (80.0, 100.0)
# A left bank of 43.5 deg on heading 355.5 deg: with a mask of 5 deg in the body it hides exactly five of the eleven
BANK_DEG, HEADING_DEG = -43.5, 355.5
MASK = Visibility(threshold_gain_dbic=-5.3, hysteresis_db=0.0)  # the cardioid's gain at 5 deg
LEVEL_SIGMA = {DR: 1.0, DV: 0.03, PSI: 1e-6, BA: 5e-3, BG: 1e-5}


@cache
def sky() -> SatelliteArcs:
    """Return the pieces of the 11 satellites."""
    messages = broadcast_messages(paper_sky())
    return broadcast_arcs(messages, SIGNALS, START_NS, START_NS + round(DURATION_S * NS_PER_S))


def times_ns(duration_s: float = DURATION_S) -> Int64:
    """Return the times of the run, ten a second, the end left out."""
    steps = np.arange(round(duration_s * RATE_HZ), dtype=np.int64)
    return START_NS + steps * (NS_PER_S // RATE_HZ)


def is_banked(t_ns: Int64) -> np.ndarray:
    """Return whether the aircraft is banked."""
    t_s = (t_ns - START_NS) / NS_PER_S
    return (t_s >= BANK_S[0]) & (t_s < BANK_S[1])


def banking_run(P: Float64 | None = None) -> FilterTrace:
    """Return the run; ``P`` (n, 17, 17) are the covariances at its times, constant ones when None."""
    t_ns = times_ns()
    n = len(t_ns)
    r_e, C_ne, C_nb = np.zeros(3), np.zeros((3, 3)), np.zeros((2, 3, 3))
    lat, lon = np.radians(AIRFIELD[:2])
    geodetic_to_ecef(lat, lon, AIRFIELD[2], r_e)
    ecef_to_ned_matrix(lat, lon, C_ne)
    euler_to_matrix(0.0, 0.0, np.radians(HEADING_DEG), C_nb[0])
    euler_to_matrix(np.radians(BANK_DEG), 0.0, np.radians(HEADING_DEG), C_nb[1])
    zero, gravity = np.zeros((n, 3)), np.zeros(3)
    normal_gravity_ecef(r_e, gravity)
    C_eb = np.ascontiguousarray((C_ne.T @ C_nb)[is_banked(t_ns).astype(int)])
    clock = np.column_stack([30.0 + 5.0 * (t_ns - START_NS) / NS_PER_S, np.full(n, 5.0)])
    trace = Trace(t_ns, np.arange(n), np.tile(r_e, (n, 1)), zero, C_eb, zero, zero, clock, np.zeros((n, 0)))
    samples = TraceSamples(t_ns, EARTH_RATE_E @ C_eb, -gravity @ C_eb)
    given = np.tile(usual_covariance(), (n, 1, 1)) if P is None else P
    return FilterTrace(trace, Covariances(t_ns, given), samples)


def usual_covariance() -> Float64:
    """Return a covariance of the usual size, uncorrelated; the attitude is known."""
    sigma = np.zeros(OFFSETS)
    for first, size in LEVEL_SIGMA.items():
        sigma[first : first + 3] = size
    sigma[CLOCK], sigma[DRIFT] = 1.0, 0.03
    return np.diag(sigma**2)


def supervision_setup(pattern: str | None = "cardioid", search: Search | None = None) -> SupervisionSetup:
    """Return a setup with an antenna of this pattern; none at all without."""
    aiding = AidingSetup(
        AidingConfig(signals=SIGNALS), sensor_model(TACTICAL), clock_model(TCXO), troposphere=False
    )
    antennas = None if pattern is None else vehicle(pattern)
    return SupervisionSetup(aiding, antennas, MASK, Search() if search is None else search)


def sightings_without(hidden: set[str], back_s: float = BANK_S[1]) -> Sightings:
    """Return a receiver that sees all but ``hidden`` from the bank's beginning to ``back_s``."""
    t_ns = times_ns()
    names = sky().sv_names
    t_s = (t_ns - START_NS) / NS_PER_S
    away = (t_s >= BANK_S[0]) & (t_s < back_s)
    seen = ~(away[:, None] & np.array([name in hidden for name in names]))
    return Sightings(t_ns, seen, names)
