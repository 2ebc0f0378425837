"""Each term of the prediction moves the innovation by the amount that physics says: it is there, with its sign."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from insgnss.constants import C_MPS, GPS_MU_M3PS2, WGS84_OMEGA_RADPS
from insgnss.filter.loop import ImuSamples, carry_bank
from insgnss.filter.prediction import new_scratch
from insgnss.filter.state import OFFSETS, Bank, copy_bank
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE, GnssRows, prepare_rows
from insgnss.inertial.mechanization import mechanize
from insgnss.tables import EphemerisTable, Float64
from tests.filter.scene import (
    START_NS,
    W_IE_E,
    Place,
    at_rest,
    attitude,
    new_filter,
    observed,
    parameters,
    perfect_rows,
    place,
    rows_of,
    sky,
    steady_force,
)
from tests.gnss.broadcast_sample import TOE_NS, copies, navigation_table, observations


def innovations(
    bank: Bank, log: GnssRows, par: npt.NDArray[Any] | None = None, w_ib_b: Float64 | None = None
) -> Float64:
    """Return (k, 2) innovations of the first epoch."""
    numbers = parameters() if par is None else par
    return np.array(observed(bank, numbers, log, w_ib_b=w_ib_b).lines["innovation"][:, :2])


def directions(at: Place) -> Float64:
    """Return (k, 3) unit vectors to the sky's satellites, the Earth's turn of 5e-6 rad left out."""
    d = sky(at)[:, 0:3] - at.r_e
    return np.asarray(d / np.linalg.norm(d, axis=1)[:, None])


def test_sagnac_moves_the_range_by_tens_of_metres() -> None:
    at = place(5.0, 20.0, 0.0)
    bank, sat = new_filter(at), sky(at, [(90, 15), (270, 15), (0, 15)])
    straight = np.linalg.norm(sat[:, 0:3] - at.r_e, axis=1) + bank.state["clock"][0, 0] - sat[:, 6]
    values = np.stack([straight, np.zeros(3)], axis=1)[None]

    moved = innovations(bank, rows_of([START_NS], sat, values))[:, PSEUDORANGE]

    # rho = straight + omega / c (x_s y_r - y_s x_r): shorter in the east, longer in the west
    x_s, y_s = sat[:, 0], sat[:, 1]
    expected = -WGS84_OMEGA_RADPS / C_MPS * (x_s * at.r_e[1] - y_s * at.r_e[0])
    np.testing.assert_allclose(moved, expected, atol=1e-3)
    assert moved[0] > 30.0 > -30.0 > moved[1]


class Broadcast(NamedTuple):
    """A receiver under a satellite with a broadcast message."""

    bank: Bank
    table: EphemerisTable
    pseudorange_m: float


@pytest.fixture
def broadcast(tmp_path: Path) -> Broadcast:
    """A GPS satellite of eccentricity 0.024 half an hour after its reference time."""
    table = navigation_table(tmp_path, ["G04"])
    first = rows_with(table, 2.2e7)
    # the receiver stands where this satellite is at 40 deg of elevation or so: 30 deg beside the point below it
    lon, lat = np.degrees([np.arctan2(first.sat[0, 1], first.sat[0, 0]), np.arcsin(first.sat[0, 2] / 2.66e7)])
    at = place(float(lat) * 0.5, float(lon) - 30.0, 100.0)
    return Broadcast(
        new_filter(at, clock=(0.0, 0.0)), table, float(np.linalg.norm(first.sat[0, :3] - at.r_e))
    )


def rows_with(table: EphemerisTable, pseudorange_m: float) -> GnssRows:
    """Return one row of G04 with its state by the message, at the time of transmission."""
    tag = TOE_NS + 1_800_000_000_000
    log = replace(observations(("G04",), [tag], [pseudorange_m]), range_rate_mps=np.zeros(1))
    return prepare_rows(log, table, None, clock_groups=("G",), signals={"G": ("C1C",)})


def test_light_time_moves_the_range_by_the_satellites_way_meanwhile(broadcast: Broadcast) -> None:
    """A pseudorange 70 ms too short puts the transmission, and the satellite, 70 ms further on."""
    bank, table, pseudorange_m = broadcast
    later_s = 0.07
    right, wrong = rows_with(table, pseudorange_m), rows_with(table, pseudorange_m - C_MPS * later_s)
    u = right.sat[0, :3] - bank.state["r_e"][0]
    along = u @ right.sat[0, 3:6] / np.linalg.norm(u)

    moved = innovations(bank, wrong)[0, PSEUDORANGE] - innovations(bank, right)[0, PSEUDORANGE]

    # the satellite's acceleration over 70 ms adds 2 mm, its clock drift 0.1 mm
    assert moved + C_MPS * later_s == pytest.approx(-along * later_s, abs=5e-3)
    assert abs(along * later_s) > 10.0


def test_relativity_of_an_eccentric_orbit_moves_the_range_by_metres(broadcast: Broadcast) -> None:
    """The message's polynomial alone lacks -2 r.v / c, the same as F e sqrt(a) sin E."""
    bank, table, pseudorange_m = broadcast
    with_it = rows_with(table, pseudorange_m)
    t = 1800.0 - pseudorange_m / C_MPS - (table.toc_ns[0] - table.toe_ns[0]) * 1e-9
    polynomial = table.af0[0] + table.af1[0] * t + table.af2[0] * t**2 - table.group_delay_s[0, 0]
    without = with_it._replace(sat=with_it.sat.copy())
    without.sat[0, 6] = C_MPS * polynomial

    moved = innovations(bank, without)[0, PSEUDORANGE] - innovations(bank, with_it)[0, PSEUDORANGE]

    expected = 2.0 * (with_it.sat[0, :3] @ with_it.sat[0, 3:6]) / C_MPS
    # the polynomial is taken at a time 0.3 ms of satellite clock off, the harmonics of the orbit are not in F e sin E
    assert moved == pytest.approx(expected, abs=0.02)
    largest = 2.0 * np.sqrt(GPS_MU_M3PS2) * table.e[0] * table.sqrt_a[0] / C_MPS
    assert 5.0 < abs(moved) < largest == pytest.approx(16.5, abs=0.2)


def test_group_delay_moves_the_range_by_its_length(broadcast: Broadcast) -> None:
    bank, table, pseudorange_m = broadcast
    dropped = copies(table, 0, group_delay_s=[[0.0, 0.0]])

    moved = innovations(bank, rows_with(dropped, pseudorange_m)) - innovations(
        bank, rows_with(table, pseudorange_m)
    )

    # pseudorange = rho - c (clock - TGD): a delay that is not modelled leaves the measurement too long
    assert moved[0, PSEUDORANGE] == pytest.approx(C_MPS * table.group_delay_s[0, 0], abs=1e-6)
    assert moved[0, PSEUDORANGE] > 1.0
    assert moved[0, RANGE_RATE] == 0.0


def test_troposphere_moves_the_range_by_metres_and_more_near_the_horizon() -> None:
    at = place(45.0, 10.0, 0.0)
    angles = [(0, 80), (0, 30), (0, 10)]
    bank, log = new_filter(at), rows_of([START_NS], sky(at, angles))

    moved = innovations(bank, log) - innovations(bank, log, parameters(use_troposphere=1.0))

    # dry zenith delay 2.307 m at 1013 hPa [Saastamoinen 1972], wet 0.05 to 0.25 m; at 10 deg 1 / sin is 3 % too much
    by_zenith = moved[:, PSEUDORANGE] * np.sin(np.radians([el for _, el in angles]))
    assert np.all((by_zenith > 2.2) & (by_zenith < 2.6))
    # it grows as the satellite sinks, by 1 / sin: 24 m / tan(el) rad of elevation at most 1.4e-4 rad/s
    slant_m = moved[:, PSEUDORANGE] / np.tan(np.radians([el for _, el in angles]))
    assert np.all(np.abs(moved[:, RANGE_RATE]) < 1.5e-4 * slant_m) and np.abs(moved[2, RANGE_RATE]) > 1e-3


@pytest.mark.parametrize("factor", [1.0, (1575.42 / 1176.45) ** 2], ids=["L1", "L5"])
def test_ionosphere_moves_the_range_by_klobuchars_night_and_the_square_of_the_frequency(
    factor: float,
) -> None:
    at = place(45.0, 10.0, 0.0)
    bank, log = new_filter(at), rows_of([START_NS], sky(at, [(0, 90), (0, 20)]))
    log.observation["ionosphere_factor"] = log.observation["phase_factor"] = factor

    moved = innovations(bank, log) - innovations(bank, log, parameters(use_ionosphere=1.0))

    # without amplitudes: 5 ns times 1 + 16 (0.53 - el)^3, el in semicircles             [IS-GPS-200N, 20.3.3.5.2.5]
    slant = 1.0 + 16.0 * (0.53 - np.array([90.0, 20.0]) / 180.0) ** 3
    np.testing.assert_allclose(moved[:, PSEUDORANGE], factor * 5e-9 * C_MPS * slant, atol=1e-3)
    # of the carrier, against the sign of the code: the satellite at 20 deg rises or sinks by 1.4e-4 rad/s at most
    assert 1e-5 < np.abs(moved[1, RANGE_RATE]) < factor * 5e-9 * C_MPS * 48.0 * 0.42**2 / np.pi * 1.4e-4


def test_lever_arm_moves_range_and_range_rate_by_its_shadow_on_the_line_of_sight() -> None:
    at, lever_b, w_ib_b = place(), np.array([2.0, -1.0, -3.0]), np.array([0.8, -0.5, 1.5])
    C_eb = attitude(at, 25.0, -10.0, 130.0)
    bank, log = new_filter(at, C_eb=C_eb), rows_of([START_NS], sky(at))

    moved = innovations(bank, log, parameters(lever_b), w_ib_b) - innovations(bank, log, None, w_ib_b)

    u, l_e = directions(at), C_eb @ lever_b
    v_e = C_eb @ np.cross(w_ib_b, lever_b) - np.cross(W_IE_E, l_e)
    # the antenna's way over the clock of 4 us and the Earth's turn: 5e-6 of 5 m/s and of 4 m
    np.testing.assert_allclose(moved[:, PSEUDORANGE], u @ l_e, atol=1e-4)
    # the other line of sight from 4 m beside: 1.4e-4 rad/s of it
    np.testing.assert_allclose(moved[:, RANGE_RATE], u @ v_e, atol=6e-4)
    assert np.max(np.abs(moved[:, PSEUDORANGE])) > 3.0
    assert np.max(np.abs(moved[:, RANGE_RATE])) > 3.0


def test_clock_of_a_millisecond_moves_a_fast_antenna_back_along_its_way() -> None:
    """Reception was clock / c before the time tag: at 250 m/s a quarter of a metre earlier on the way."""
    at, v_n = place(), np.array([150.0, 200.0, 0.0])
    bank, late = new_filter(at, v_n=v_n, clock=(0.0, 0.0)), new_filter(at, v_n=v_n, clock=(1e-3 * C_MPS, 0.0))
    log = rows_of([START_NS], sky(at))
    shifted = log._replace(observation=log.observation.copy())
    shifted.observation["value"][:, PSEUDORANGE] += 1e-3 * C_MPS

    moved = innovations(late, shifted) - innovations(bank, log)

    np.testing.assert_allclose(moved[:, PSEUDORANGE], -directions(at) @ (at.C_ne.T @ v_n) * 1e-3, atol=1e-5)
    assert np.max(np.abs(moved[:, PSEUDORANGE])) > 0.15


def test_clock_of_a_millisecond_takes_the_velocity_of_an_accelerating_antenna_back() -> None:
    """At 30 m/s^2 the velocity was 3 cm/s less when the signal arrived than at the time tag."""
    at, par = place(), parameters()
    bank, log = new_filter(at, clock=(1e-3 * C_MPS, 0.0)), rows_of([START_NS], sky(at))
    f_b = steady_force(bank.state[0])
    pushed = f_b + np.array([30.0, 0.0, 0.0])

    steady, moved = (
        observed(bank, par, log, f_b=f).lines["innovation"][:, RANGE_RATE] for f in (f_b, pushed)
    )

    # predicted rate -u.v, v smaller by a late; the direction turns by 1e-12 rad meanwhile
    forward = bank.state[0].C_eb[:, 0]
    np.testing.assert_allclose(moved - steady, -30.0 * 1e-3 * directions(at) @ forward, atol=1e-6)
    assert np.max(np.abs(moved - steady)) > 0.025


def carried(bank: Bank, imu: ImuSamples) -> Bank:
    """Return the filter after all samples, without GNSS."""
    moving = copy_bank(bank)
    carry_bank(moving, int(imu.t_ns[-1]), imu, parameters()[0], new_scratch(OFFSETS))
    return moving


def test_earth_rotation_missing_in_the_gyros_tips_the_platform_and_moves_every_range() -> None:
    """C_eb' = -[w_ie x] C_eb then turns gravity: r = (f x w_ie) t^3 / 6, 13 m to the west in a minute at 60 deg."""
    at, seconds = place(), 60.0
    C_eb = attitude(at, 0.0, 0.0, 30.0)
    bank, imu = new_filter(at, C_eb=C_eb), at_rest(at, C_eb, seconds, 50.0)
    right, wrong = carried(bank, imu), carried(bank, imu._replace(w_ib_b=np.zeros_like(imu.w_ib_b)))
    log = perfect_rows(right, parameters(), [int(imu.t_ns[-1])], sky(at))

    moved = wrong.state["r_e"][0] - right.state["r_e"][0]

    expected = np.cross(at.f_e, W_IE_E) * seconds**3 / 6.0
    # gravity's own pull back, (t / 800 s)^2 / 20, and the fourth order in t: 0.3 % together
    np.testing.assert_allclose(moved, expected, atol=0.005 * np.linalg.norm(expected))
    assert (at.C_ne @ moved)[1] < -12.0
    assert np.linalg.norm(right.state["r_e"][0] - at.r_e) < 1e-4
    np.testing.assert_allclose(innovations(wrong, log)[:, PSEUDORANGE], directions(at) @ moved, atol=0.01)


def cone(theta: float, omega: float, t: Float64) -> Float64:
    """Return the rate vectors that turn around in the body's xy plane, (n, 3)."""
    return theta * omega * np.stack([np.cos(omega * t), np.sin(omega * t), np.zeros(len(t))], axis=1)


def test_coning_terms_keep_an_attitude_that_increments_alone_lose() -> None:
    """A cone of 1 deg at 5 Hz in samples of 10 ms: half theta^2 Omega (1 - sin x / x), x = Omega dt, is 16 deg/h."""
    theta, omega, dt, seconds, fine = np.radians(1.0), 2.0 * np.pi * 5.0, 0.01, 20.0, 200
    n, period = round(seconds / dt), 0.2
    at = place(0.0, 0.0, 0.0)
    bank = new_filter(at)
    # the truth in steps of 50 us, one period of the cone after the other; a sample is the mean of its 200 steps
    rates = cone(theta, omega, (np.arange(round(period / dt * fine)) + 0.5) * dt / fine)
    w = np.tile(rates.reshape(-1, fine, 3).mean(axis=1), (round(seconds / period), 1))
    one_period = Rotation.identity()
    for rate in rates:
        one_period = one_period * Rotation.from_rotvec(rate * dt / fine)
    earth, start = Rotation.from_rotvec(-W_IE_E * seconds), Rotation.from_matrix(bank.state[0].C_eb)
    truth = earth * start * one_period ** round(seconds / period)
    imu = ImuSamples(
        START_NS + np.arange(n + 1) * 10_000_000, np.concatenate([w[-1:], w]), np.zeros((n + 1, 3))
    )
    plain = [bank.state[name][0].copy() for name in ("q_eb", "C_eb", "r_e", "v_e")]
    for k in range(1, n + 1):
        mechanize(*plain, imu.w_ib_b[k], imu.f_b[k], dt, np.zeros(3))

    lost = (Rotation.from_matrix(plain[1]) * truth.inv()).as_rotvec()
    kept = (Rotation.from_matrix(carried(bank, imu).state["C_eb"][0]) * truth.inv()).as_rotvec()

    x = omega * dt
    expected = 0.5 * theta**2 * omega * (1.0 - np.sin(x) / x) * seconds
    assert expected == pytest.approx(np.radians(16.2) / 3600.0 * seconds, rel=0.01)
    assert np.linalg.norm(lost) == pytest.approx(expected, rel=0.02)
    assert np.linalg.norm(kept) < 0.05 * expected
