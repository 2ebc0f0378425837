"""Satellites by a table of azimuth and elevation: they stand there, move as they should, and fit the engine's range."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest

from insgnss.constants import WGS84_A_M
from insgnss.gnss.line_of_sight import line_of_sight
from insgnss.simulation.constellation import satellite_states
from insgnss.simulation.faults import false_lock
from insgnss.simulation.flight_text import mirrored_s
from insgnss.simulation.observations import SimulatedReceiver, antenna_motion, observe_paths, paths_to
from insgnss.simulation.oscillator import ClockTruth
from insgnss.simulation.sample_trajectories import airborne_turns
from insgnss.simulation.sky import PAPER_SKY, nominal_constellation
from insgnss.simulation.sky_law import GPS_HEIGHT_M, SkyLaw, table_with_states

PLACE = (59.97, 30.32, 1000.0)
LAW = SkyLaw.of_tracks(PLACE, PAPER_SKY, 1200.0)
NAMES = tuple(f"G{track.number:02d}" for track in PAPER_SKY)
START_NS = 2385 * 604_800 * 10**9
STILL = ClockTruth(np.arange(1.0, 20.0), np.zeros(19), np.zeros(19))


def at(*t_s: float) -> np.ndarray:
    """Return the same times for every satellite."""
    return np.repeat(np.array(t_s)[:, None], len(NAMES), axis=1)


def test_satellites_stand_where_the_table_says_at_start_middle_and_end() -> None:
    r_e = LAW.states(at(0.0, 600.0, 1200.0)).r_e
    azimuth, elevation, _ = pymap3d.ecef2aer(*np.moveaxis(r_e, -1, 0), *PLACE)

    table = np.array([[t.azimuth_deg, t.elevation_deg] for t in PAPER_SKY])  # (11, 2, 2)
    for row, share in enumerate((0.0, 0.5, 1.0)):
        wanted = table[:, :, 0] + share * (table[:, :, 1] - table[:, :, 0])
        # rounding of 2e7 m is 4e-9 m: 1e-14 deg; the conversion's own is 1e-9 deg
        np.testing.assert_allclose(azimuth[row], wanted[:, 0], atol=1e-8)
        np.testing.assert_allclose(elevation[row], wanted[:, 1], atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(r_e, axis=-1), WGS84_A_M + GPS_HEIGHT_M, rtol=1e-14)


def test_velocity_is_the_derivative_of_the_position() -> None:
    h = 0.5
    ahead, behind = (LAW.states(at(400.0 + side * h)).r_e for side in (1.0, -1.0))

    # the third derivative leaves 2e-4 m/s for the satellite near the zenith, rounding 1e-8 m/s
    np.testing.assert_allclose(LAW.states(at(400.0)).v_e, (ahead - behind) / (2.0 * h), atol=5e-4)


def test_rows_with_states_fit_the_engines_range_and_rate() -> None:
    trajectory = airborne_turns(30.0, PLACE)
    antenna = antenna_motion(trajectory, STILL.true_s, (0.0, 0.0, 0.0))
    paths = paths_to(antenna, LAW.states, len(NAMES), STILL.true_s)
    perfect = SimulatedReceiver(horizon_mask_deg=-90.0)
    table = table_with_states(
        observe_paths(paths, NAMES, np.zeros(len(NAMES)), START_NS, STILL, perfect, None), paths, START_NS
    )

    assert table.sat is not None
    assert len(table.t_ns) == len(STILL.tag_s) * len(NAMES)
    u, g = np.empty(3), np.empty(3)
    for row in range(len(table.t_ns)):
        epoch = row // len(NAMES)
        distance, rate = line_of_sight(table.sat, row, antenna.r_e[epoch], antenna.v_e[epoch], u, g)
        # two computations of the same light time: rounding of 2e7 m, and of a Doppler in cycles
        assert abs(table.pseudorange_m[row] - distance) < 1e-6
        assert abs(-table.doppler_hz[row] * 299_792_458.0 / 1_575.42e6 - rate) < 1e-6


def test_false_lock_stands_in_the_log_though_the_satellite_is_hidden() -> None:
    antenna = antenna_motion(airborne_turns(30.0, PLACE), STILL.true_s, (0.0, 0.0, 0.0))
    paths = paths_to(antenna, LAW.states, len(NAMES), STILL.true_s)
    clean = observe_paths(
        paths, NAMES, np.zeros(len(NAMES)), START_NS, STILL, SimulatedReceiver(horizon_mask_deg=45.0), None
    )
    # 13 deg high
    lock = false_lock("G16", 5.0, 9.0, offset_m=20.0, growth_mps=3.0, rate_error_mps=2.0, cn0_dbhz=33.0)

    off = lock(clean)

    own = NAMES.index("G16")
    assert STILL.tag_s[off.tracked[:, own]].tolist() == [5.0, 6.0, 7.0, 8.0]
    np.testing.assert_allclose(
        (off.pseudorange_m - clean.pseudorange_m)[4:8, own], [20.0, 23.0, 26.0, 29.0], atol=1e-6
    )
    np.testing.assert_allclose((off.range_rate_mps - clean.range_rate_mps)[4:8, own], 2.0, atol=1e-9)
    assert (off.cn0_dbhz[4:8, own] == 33.0).all()
    others = np.arange(len(NAMES)) != own
    np.testing.assert_array_equal(off.pseudorange_m[:, others], clean.pseudorange_m[:, others])


def test_a_mirrors_error_lasts_as_long_as_its_phase_takes_for_a_radian() -> None:
    """Of the nominal satellites above 5 deg, over a day, at 50 deg of latitude; an antenna 18 m above the sea."""
    satellites = nominal_constellation(START_NS).ephemerides
    times_s = np.arange(0.0, 86_400.0, 300.0)[:, None] + np.zeros(len(satellites.sv_names))
    sines = []
    for later_s in (0.0, 1.0):
        r_e = satellite_states(satellites, START_NS, times_s + later_s).r_e
        _, elevation, _ = pymap3d.ecef2aer(*np.moveaxis(r_e, -1, 0), 50.0, 11.0, 0.0)
        sines.append(np.sin(np.radians(elevation)))
    rising = (sines[1] - sines[0])[sines[0] > np.sin(np.radians(5.0))]

    radians_per_s = 4.0 * np.pi * 18.0 / 0.190294 * np.sqrt(np.mean(rising**2))
    # the rate of the sine depends on the latitude: 6 to 8.5e-5 /s from the equator to the pole
    np.testing.assert_allclose(mirrored_s(18.0), 1.0 / radians_per_s, rtol=0.05)
    assert mirrored_s(2.0) == pytest.approx(9.0 * mirrored_s(18.0))
