"""Where a term is zero, the filter is the simpler filter that has no such term, bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from insgnss.constants import NS_PER_S
from insgnss.filter.loop import carry_bank
from insgnss.filter.output.writing import NO_MEASUREMENTS
from insgnss.filter.prediction import new_scratch
from insgnss.filter.state import CLOCK, DR, DRIFT, DV, OFFSETS, Bank, copy_bank
from insgnss.filter.update.predictions import RANGE_COLUMNS, RATE_COLUMNS
from insgnss.filter.update.scalar_update import scalar_update
from insgnss.gnss.observation_rows import ABSENT, PSEUDORANGE, RANGE_RATE, GnssRows, prepare_rows
from insgnss.inertial.increments import effective_rates
from insgnss.inertial.mechanization import mechanize
from insgnss.status import SWITCHED_OFF
from insgnss.tables import Float64, GnssTable
from tests.filter.scene import (
    RANGE_SIGMA_M,
    RATE_SIGMA_MPS,
    START_NS,
    at_rest,
    attitude,
    new_filter,
    observed,
    parameters,
    perfect_rows,
    place,
    rows_of,
    run,
    sky,
    update,
)

LEVER_B = (0.8, -0.3, -1.4)
STATES = ("q_eb", "C_eb", "r_e", "v_e", "b_a", "b_g", "clock")
W_IB_B = np.array([0.3, -0.2, 0.5])


def noisy_rows(
    bank: Bank, par: npt.NDArray[Any], epochs: int, rng: np.random.Generator, n_satellites: int = 12
) -> GnssRows:
    """Return rows at 1 Hz about the filter's own start, at rest."""
    epoch_ns = START_NS + np.arange(1, epochs + 1) * NS_PER_S
    log = perfect_rows(bank, par, epoch_ns, sky(place())[:n_satellites])
    log.observation["value"] += rng.normal(size=(len(log.sat), 2)) * [RANGE_SIGMA_M, RATE_SIGMA_MPS]
    return log


def same_bits(one: Bank, two: Bank) -> bool:
    """Return whether two filters have the same state and, for the states both have, the same covariance."""
    n = min(one.P.shape[1], two.P.shape[1])
    states = all(np.array_equal(one.state[name], two.state[name]) for name in STATES)
    return states and np.array_equal(one.P[:, :n, :n], two.P[:, :n, :n])


def test_zero_lever_arm_equals_rows_without_lever_arm_terms(rng: np.random.Generator) -> None:
    """Columns: position and clock for a range; position, velocity and drift for a range rate."""
    at, par = place(), parameters()
    bank = new_filter(at, v_n=(60.0, 10.0, 0.0), C_eb=attitude(at, 20.0, 5.0, 80.0))
    log = perfect_rows(bank, par, [START_NS], sky(at), w_ib_b=W_IB_B)
    log.observation["value"] += rng.normal(size=(12, 2)) * [RANGE_SIGMA_M, RATE_SIGMA_MPS]
    lines = observed(bank, par, log, w_ib_b=W_IB_B).lines
    P, v = bank.P[0].copy(), np.zeros((3, OFFSETS))
    for kind, wanted in ((PSEUDORANGE, {DR, CLOCK}), (RANGE_RATE, {DR, DV, DRIFT})):
        columns = (RANGE_COLUMNS, RATE_COLUMNS)[kind]
        blocks = np.where(columns < CLOCK, columns - columns % 3, columns)
        kept = np.flatnonzero(np.isin(blocks, list(wanted)))
        for line in lines:
            h = line.h[kind, : len(columns)]
            assert np.all(np.delete(h, kept) == 0.0)
            scalar_update(P, h[kept].copy(), columns[kept], line.innovation[kind], line.variance[kind], v)

    result = update(bank, log, par, W_IB_B)

    assert np.array_equal(bank.P[0], P)
    assert np.array_equal(result.work.epoch.vectors[0][:OFFSETS], v[0])


def test_zero_lever_arm_does_not_see_how_the_body_turns() -> None:
    at, par = place(), parameters()
    bank = new_filter(at)
    log = rows_of([START_NS], sky(at))
    still, turning = (
        observed(bank, par, log, w_ib_b=w).lines["innovation"][:, :2] for w in (np.zeros(3), 50.0 * W_IB_B)
    )

    assert np.array_equal(still, turning)


def test_one_constellation_equals_the_filter_of_17_states(rng: np.random.Generator) -> None:
    """The offset of a constellation that is never seen is carried along and changes no bit of the others."""
    at, par = place(), parameters(LEVER_B)
    C_eb = attitude(at, 1.0, 2.0, 30.0)
    imu = at_rest(at, C_eb, 31.0, 100.0)
    plain, wider = new_filter(at, C_eb=C_eb), new_filter(at, C_eb=C_eb, offsets=(40.0, -7.0))
    log = noisy_rows(plain, par, 30, rng)

    run(plain, log, imu, par)
    run(wider, log, imu, par)

    assert plain.P.shape[1] == 17
    assert same_bits(plain, wider)
    assert wider.state["optional"][0, :2].tolist() == [40.0, -7.0]
    assert not wider.P[0, OFFSETS:, :OFFSETS].any()


def test_second_constellation_with_a_known_offset_equals_one_constellation(rng: np.random.Generator) -> None:
    at, par = place(), parameters(LEVER_B, optional_density=0.0)
    C_eb = attitude(at, 1.0, 2.0, 30.0)
    imu = at_rest(at, C_eb, 11.0, 100.0)
    one = new_filter(at, C_eb=C_eb)
    two = new_filter(at, C_eb=C_eb, offsets=(0.0,), sigmas={OFFSETS: 1e-9})
    log = noisy_rows(one, par, 10, rng)
    mixed = log._replace(observation=log.observation.copy())
    mixed.observation["group"] = np.tile([0, 1], len(log.sat) // 2)

    run(one, log, imu, par)
    run(two, mixed, imu, par)

    # an offset known to 1 nm moves the position by less than that
    np.testing.assert_allclose(two.state["r_e"], one.state["r_e"], rtol=0, atol=1e-8)
    np.testing.assert_allclose(two.P[0, :17, :17], one.P[0], rtol=1e-9, atol=1e-15)


def test_filter_without_gnss_is_the_mechanization_alone(rng: np.random.Generator) -> None:
    """Biases held still: coning terms and mechanization called one by one give the same bits.

    The closed loop of an epoch without rows renormalises the quaternion: a last digit, nothing else.
    """
    at = place(70.0, -40.0, 3000.0)
    C_eb = attitude(at, 10.0, 20.0, 200.0)
    par = parameters(LEVER_B, gyro_bias_time=np.inf, accel_bias_time=np.inf, covariance_step=0.02)
    bank = new_filter(at, v_n=(100.0, 50.0, -3.0), C_eb=C_eb)
    imu = at_rest(at, C_eb, 21.0, 100.0)
    imu.w_ib_b[:] += 0.3 * rng.normal(size=imu.w_ib_b.shape)
    imu.f_b[:] += 3.0 * rng.normal(size=imu.f_b.shape)
    log = rows_of(START_NS + np.arange(1, 21) * NS_PER_S, sky(at), np.full((20, 12, 2), np.nan))
    q, C, r, v = (bank.state[name][0].copy() for name in ("q_eb", "C_eb", "r_e", "v_e"))
    w, f, g = np.zeros((3, 3))
    for k in range(1, 2001):
        b = max(k - 1, 1)
        dt, dt_before = (imu.t_ns[k] - imu.t_ns[k - 1]) * 1e-9, (imu.t_ns[b] - imu.t_ns[b - 1]) * 1e-9
        effective_rates(imu.w_ib_b[k], imu.f_b[k], imu.w_ib_b[b], imu.f_b[b], dt, dt_before, w, f)
        mechanize(q, C, r, v, w, f, dt, g)

    inertial = copy_bank(bank)
    carry_bank(inertial, int(imu.t_ns[2000]), imu, par[0], new_scratch(OFFSETS))
    result = run(bank, log, imu, par)

    for name, expected in (("q_eb", q), ("C_eb", C), ("r_e", r), ("v_e", v)):
        assert np.array_equal(inertial.state[name][0], expected), name
        # rounding of a position, 1e-9 m, and of a velocity and an attitude over 2000 steps
        np.testing.assert_allclose(
            bank.state[name][0], expected, rtol=0, atol=4e-9 if name == "r_e" else 1e-11
        )
    np.testing.assert_allclose(bank.P, inertial.P, rtol=1e-9, atol=1e-18)
    assert bank.state["clock"][0] == pytest.approx([1200.0 + 3.0 * 20.0, 3.0], rel=1e-12)
    assert np.all(result.out.ledger["status"] == ABSENT)
    assert [int(e["kind"]) for e in result.out.events[: result.out.counts[0].events]] == [NO_MEASUREMENTS]


def gnss_table(log: GnssRows, values: Float64) -> GnssTable:
    """Return a log of GPS satellites with these values (n, 2)."""
    n, k = len(log.sat), int(log.first[1])
    return GnssTable(
        t_ns=np.repeat(log.epoch_ns, np.diff(log.first)),
        sv=np.tile(np.arange(k), n // k).astype(np.int16),
        signal=np.zeros(n, np.int16),
        pseudorange_m=values[:, PSEUDORANGE].copy(),
        doppler_hz=np.full(n, np.nan),
        range_rate_mps=values[:, RANGE_RATE].copy(),
        cn0_dbhz=np.full(n, 45.0),
        sv_names=tuple(f"G{i + 1:02d}" for i in range(k)),
        signal_names=("C1C",),
        sat=log.sat,
    )


@pytest.mark.parametrize("kind", [PSEUDORANGE, RANGE_RATE], ids=["pseudorange", "range rate"])
def test_kind_switched_off_equals_a_log_without_it(rng: np.random.Generator, kind: int) -> None:
    at, par = place(), parameters(LEVER_B)
    C_eb = attitude(at, 1.0, 2.0, 30.0)
    imu = at_rest(at, C_eb, 11.0, 100.0)
    first = new_filter(at, C_eb=C_eb)
    second = copy_bank(first)
    log = noisy_rows(first, par, 10, rng)
    values = log.observation["value"].copy()
    options: dict[str, Any] = {"clock_groups": ("G",), "signals": {"G": ("C1C",)}}
    off = ("pseudorange", "range_rate")[kind]
    switched = prepare_rows(gnss_table(log, values), None, None, **options, **{off: False})
    values[:, kind] = np.nan
    without = prepare_rows(gnss_table(log, values), None, None, **options)

    one, two = run(first, switched, imu, par), run(second, without, imu, par)

    assert np.all(one.out.ledger["status"][:, kind] == SWITCHED_OFF)
    assert np.all(two.out.ledger["status"][:, kind] == ABSENT)
    assert same_bits(first, second)
    # and the kind that is left does its work: the position from ranges, the velocity from rates
    of = (slice(DV, DV + 3), slice(DR, DR + 3))[kind]
    sigma = np.sqrt(np.diag(first.P[0]))
    start = np.sqrt(np.diag(new_filter(at).P[0]))
    assert np.all(sigma[of] < 0.5 * start[of])
    assert np.all(np.abs(first.state["r_e"][0] - at.r_e) < 4.0 * sigma[DR : DR + 3])
    assert np.all(np.abs(first.state["v_e"][0]) < 4.0 * sigma[DV : DV + 3])


def test_one_satellite_corrects_along_its_line_of_sight_only() -> None:
    """From a round prior and a perfect clock and attitude one range moves the position along u."""
    at, par = place(), parameters()
    bank = new_filter(at, sigmas={CLOCK: 1e-6})
    log = perfect_rows(bank, par, [START_NS], sky(at)[:1])
    log.observation["status"][:, RANGE_RATE] = ABSENT
    log.observation["value"][0, PSEUDORANGE] -= 4.0
    u = (sky(at)[0, :3] - at.r_e) / np.linalg.norm(sky(at)[0, :3] - at.r_e)

    update(bank, log, par)
    moved = bank.state["r_e"][0] - at.r_e

    # 4 m nearer, weighed 9 : 1 against the measurement; the Earth's turn during the flight tilts u by 5e-6 rad
    assert moved @ u == pytest.approx(4.0 * 9.0 / 10.0, abs=1e-4)
    assert np.linalg.norm(moved - (moved @ u) * u) < 1e-4
