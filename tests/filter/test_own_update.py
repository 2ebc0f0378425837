"""A user's own rows by themselves: their partials, their update against a dense one, and what is refused."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from insgnss.config.process import Process
from insgnss.constants import NS_PER_S
from insgnss.errors import MeasurementError
from insgnss.filter.headings.heading_bank import add_to_state, difference
from insgnss.filter.layout import Layout
from insgnss.filter.layout_names import StateLayout, state_layout
from insgnss.filter.own_rows.checked_rows import checked_rows
from insgnss.filter.own_rows.declared import BUILT_IN, own_measurements
from insgnss.filter.own_rows.rows import Measurement
from insgnss.filter.own_rows.state_estimate import StateEstimate, state_estimate
from insgnss.filter.own_update import OwnUpdate, use_own_rows
from insgnss.filter.prediction import ImuSamples, new_scratch
from insgnss.filter.setup import FilterSetup
from insgnss.filter.state import OFFSETS, Bank, copy_bank, joined_banks
from insgnss.runs.multi_antenna import KIND
from insgnss.runs.result_tables import KINDS
from insgnss.status import BAD_VALUE, GATED, NAMES, USED
from tests.filter.scene import START_NS, attitude, new_filter, place
from tests.layouts import layout_with
from tests.runs.matched_runs import matched_setup
from tests.runs.own_kinds import Beacon, Compass, MapHeight, ZeroVelocity

AT = place()
ONE = np.array([START_NS], np.int64)
IMU = ImuSamples(
    START_NS + np.arange(3) * 10_000_000, np.full((3, 3), 0.02), np.tile([0.1, 0.2, -9.8], (3, 1))
)
BEACON = Beacon(ONE, np.array([5000.0]), 0.5, AT.r_e + AT.C_ne.T @ [3000.0, 4000.0, 50.0], (1.5, -0.5, 0.3))


def filter_at(rng: np.random.Generator | None = None) -> Bank:
    """Return a filter of one heading, 5 deg of bank and 10 deg of pitch; its covariance is full where ``rng`` is."""
    bank = new_filter(AT, v_n=(12.0, -7.0, 1.0), C_eb=attitude(AT, 5.0, 10.0, 60.0))
    if rng is not None:
        sd = np.sqrt(np.diag(bank.P[0]))
        A = rng.normal(size=(OFFSETS, OFFSETS))
        correlation = A @ A.T + OFFSETS * np.eye(OFFSETS)
        scale = sd / np.sqrt(np.diag(correlation))
        bank.P[0] = correlation * np.outer(scale, scale)
    return bank


def setup_with(*measurements: Measurement, motion_sigma: float = 0.0) -> FilterSetup:
    setup = matched_setup()
    process = Process(motion_sigma=motion_sigma, imu_time_sigma_s=0.0)  # the bank has no further states
    config = setup.config.model_copy(update={"process": process})
    return dataclasses.replace(setup, config=config, own=own_measurements(measurements))


class Probe:
    """Keeps the state that it is asked for, and has measured nothing."""

    name = "probe"
    times_ns = np.array([START_NS])
    state: StateEstimate

    def rows(self, state: StateEstimate, _: object) -> tuple[()]:
        self.state = state
        return ()


def estimate_of(bank: Bank) -> StateEstimate:
    return state_estimate(bank.state[0], START_NS, IMU.w_ib_b[0], IMU.f_b[0], StateLayout({}))


def used(bank: Bank, setup: FilterSetup) -> OwnUpdate:
    return use_own_rows(bank, START_NS, setup, IMU, setup.parameters(), new_scratch(OFFSETS))


def one_row(measurement: Measurement, bank: Bank, row: int = 0) -> tuple[float, np.ndarray]:
    """Return the value of a row, and its partials by all states."""
    own = own_measurements([measurement])
    assert own is not None
    found = checked_rows(own.kinds[0], estimate_of(bank), state_layout(Layout()))[row]
    h = np.zeros(OFFSETS)
    h[found.columns] = found.h
    return found.innovation, h


@pytest.mark.parametrize(
    ("measurement", "row"),
    [
        (MapHeight(ONE, np.array([150.0]), 1.0), 0),
        (Compass(ONE, np.array([1.0]), 0.1), 0),
        (BEACON, 0),
        *((ZeroVelocity(ONE, np.zeros((1, 3))), row) for row in range(3)),
    ],
)
def test_partials_of_the_documented_rows_are_those_of_the_prediction(measurement: Any, row: int) -> None:
    """The innovation falls by what the prediction grows; steps of 1 m, 1 m/s, 1 mrad."""
    value, h = one_row(measurement, filter_at(), row)
    for state in range(9):
        step = 1e-3 if state >= 6 else 1.0
        moved = []
        for sign in (-1.0, 1.0):
            bank, d = filter_at(), np.zeros(OFFSETS)
            d[state] = sign * step
            add_to_state(bank.state[0], d, Layout())
            moved.append(one_row(measurement, bank, row)[0])
        assert -(moved[1] - moved[0]) / (2.0 * step) == pytest.approx(h[state], abs=2e-6), state
    assert math.isfinite(value)


def test_roll_and_pitch_grow_with_the_attitude_as_told() -> None:
    by_attitude = estimate_of(filter_at()).rpy_by_attitude
    for axis in range(3):
        angles = []
        for sign in (-1e-4, 1e-4):
            bank, d = filter_at(), np.zeros(OFFSETS)
            d[6 + axis] = sign
            add_to_state(bank.state[0], d, Layout())
            angles.append(np.array(estimate_of(bank).rpy_rad))
        np.testing.assert_allclose((angles[1] - angles[0]) / 2e-4, by_attitude[:, axis], atol=1e-6)


def test_rows_of_one_time_are_the_dense_update(rng: np.random.Generator) -> None:
    """Range to a beacon, height and yaw at once against K = P H^T (H P H^T + R)^-1 on matrices.

    1e-9 of each state's sigma, and of the attitude 1e-9 rad: its reset is of second order in corrections of 1e-5 rad.
    """
    bank = filter_at(rng)
    estimate = estimate_of(bank)
    predicted = float(np.linalg.norm(estimate.r_e + estimate.C_eb @ BEACON.lever_b - BEACON.beacon_e))
    kinds = (
        dataclasses.replace(BEACON, range_m=np.array([predicted + 0.02])),
        MapHeight(ONE, np.array([estimate.h_m - 0.01]), 2.0),
        Compass(ONE, np.array([estimate.yaw_rad + 1e-5]), 0.05),
    )
    y, H = (np.array(part) for part in zip(*(one_row(kind, bank) for kind in kinds), strict=True))
    P, setup = bank.P[0].copy(), setup_with(*kinds)
    S = H @ P @ H.T + np.diag([kind.sigma_m**2 for kind in kinds[:2]] + [0.05**2])
    K = np.linalg.solve(S, H @ P).T
    wanted = copy_bank(bank)
    add_to_state(wanted.state[0], K @ y, Layout())

    found = used(bank, setup)

    sd = np.sqrt(np.diag(P))
    assert np.abs(K @ y)[6:9].max() < 3e-5
    apart = difference(bank.state[0], wanted.state[0], OFFSETS, Layout())
    assert np.abs(apart / sd).max() < 1e-9 or np.abs(apart[6:9]).max() < 1e-9
    np.testing.assert_allclose(found.correction / sd, K @ y / sd, rtol=0.0, atol=1e-9)
    scale = np.outer(sd, sd)
    np.testing.assert_allclose(bank.P[0] / scale, (P - K @ S @ K.T) / scale, rtol=0.0, atol=1e-9)
    assert [NAMES[entry.status] for entry in found.entries] == ["used"] * 3
    np.testing.assert_allclose([entry.variance for entry in found.entries], np.diag(S), rtol=1e-12)


def test_correction_of_the_heading_turns_the_axes_of_the_tilt_as_at_an_epoch(
    rng: np.random.Generator,
) -> None:
    """Trace and determinant stay under a rotation; without it the covariance would be that of other axes."""
    measured = Compass(ONE, np.array([estimate_of(filter_at()).yaw_rad + 0.02]), 0.02)
    plain = filter_at(rng)
    turned = copy_bank(plain)
    used(plain, setup_with(measured))
    setup = setup_with(measured, motion_sigma=3.0)
    used(turned, setup)
    block = slice(6, 9)
    assert np.abs(turned.P[0, block, block] - plain.P[0, block, block]).max() > 1e-8
    np.testing.assert_allclose(
        np.linalg.eigvalsh(turned.P[0, block, block]), np.linalg.eigvalsh(plain.P[0, block, block]), rtol=1e-9
    )


def test_row_beyond_its_gate_is_refused_and_one_without_a_gate_is_used() -> None:
    far = dataclasses.replace(BEACON, range_m=np.array([9000.0]))
    for gate, status in ((3.0, GATED), (None, USED)):
        bank = filter_at()
        setup = setup_with(dataclasses.replace(far, gate_sigma=gate))
        found = used(bank, setup)
        assert [entry.status for entry in found.entries] == [status]
        assert found.correction.any() == (status == USED)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
def test_value_that_is_no_number_or_endless_is_a_refused_row(value: float) -> None:
    bank = filter_at()
    before = copy_bank(bank)
    setup = setup_with(MapHeight(ONE, np.array([value]), 1.0))
    found = used(bank, setup)
    assert [entry.status for entry in found.entries] == [BAD_VALUE]
    assert not difference(bank.state[0], before.state[0], OFFSETS, Layout()).any()
    np.testing.assert_array_equal(bank.P, before.P)


def test_state_is_read_only_and_without_the_biases() -> None:
    bank = filter_at()
    bank.state[0].b_g[:], bank.state[0].b_a[:] = 0.001, 0.01
    probe = Probe()
    used(bank, setup_with(probe))
    estimate = probe.state
    np.testing.assert_allclose(estimate.w_ib_b, IMU.w_ib_b[0] - 0.001)
    np.testing.assert_allclose(estimate.f_b, IMU.f_b[0] - 0.01)
    for array in (estimate.r_e, estimate.C_eb, estimate.C_ne, estimate.rpy_rad, estimate.w_ib_b):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_layout_names_every_state_of_the_filter_once() -> None:
    layout = layout_with(n_offsets=2, channel_bias=True, zenith_delay=True, ionosphere=True, clone=True)
    blocks = state_layout(layout)
    columns = [i for block in blocks.values() for i in range(block.columns.start, block.columns.stop)]
    assert columns == list(range(OFFSETS + layout.n_values))
    assert list(blocks)[7:] == ["offset_0", "offset_1", "glonass_channel_bias", "zenith_delay", "ionosphere"]
    assert blocks["attitude"].unit == "rad" and blocks["clock_drift"].unit == "m/s"


# ------------------------------------------------------------------------------------------------ what is wrong


def giving(rows: Any, **more: Any) -> Any:
    """Return a measurement whose method gives ``rows``, an exception where that is one."""

    def asked(state: StateEstimate, layout: Any) -> Any:
        if isinstance(rows, Exception):
            raise rows
        return rows

    return SimpleNamespace(**({"name": "mine", "times_ns": ONE, "rows": asked} | more))


UP = {"position": np.ones(3)}
BAD_ROWS = {
    "unknown state": ((1.0, {"postion": np.ones(3)}, 1.0), "no state 'postion'.*\n.*nearest: position"),
    "wrong length": ((1.0, {"position": np.ones(2)}, 1.0), r"shape \(2,\).*\n.*3 \[m\]"),
    "partials not finite": ((1.0, {"position": [0.0, np.inf, 0.0]}, 1.0), "partials of 'position' are.*inf"),
    "partials no numbers": ((1.0, {"position": "up"}, 1.0), "partials of 'position' are up"),
    "no partials": ((1.0, {}, 1.0), "no partials.*\n.*position 3"),
    "variance zero": ((1.0, UP, 0.0), "variance is 0"),
    "variance not finite": ((1.0, UP, np.inf), "variance is inf"),
    "value no number": ((None, UP, 1.0), "innovation is None"),
    "two values": (([1.0, 2.0], UP, 1.0), "innovation is"),
    "no row": ([(1.0, 2.0)], "a row is"),
    "nothing returned": (None, "rows.. failed with TypeError"),
    "its own error": (ZeroDivisionError("in my code"), "ZeroDivisionError: in my code"),
}


@pytest.mark.parametrize("case", BAD_ROWS)
def test_defect_in_a_users_code_names_measurement_and_time_and_what_is_expected(case: str) -> None:
    rows, told = BAD_ROWS[case]
    setup = setup_with(giving(rows))
    with pytest.raises(MeasurementError, match=told) as raised:
        used(filter_at(), setup)
    assert "'mine' at 200000.000 s of the week" in str(raised.value)
    assert raised.value.advice
    if isinstance(rows, Exception):
        assert raised.value.__cause__ is rows


BAD_KINDS = {
    "no method": (SimpleNamespace(name="mine", times_ns=ONE), "lacks rows"),
    "name with a space": (giving((), name="my height"), "not a name"),
    "built-in name": (giving((), name="range_rate"), "built-in"),
    "seconds": (giving((), times_ns=np.array([1.5, 2.5])), "type float64"),
    "not increasing": (giving((), times_ns=np.array([3, 5, 5])), "entry 2 is 5 after 5"),
    "a matrix": (giving((), times_ns=np.zeros((2, 2), np.int64)), r"shape \(2, 2\)"),
    "a gate of zero": (giving((), gate_sigma=0.0), "gate_sigma"),
}

WRONG_TYPES = {
    "watched": "yes",
    "carrying": 1,
    "together": "no",
    "unit": 3,
    "hint": None,
    "steps": True,
    "unlikely": 0.5,
}


@pytest.mark.parametrize("key", WRONG_TYPES)
def test_setting_of_a_measurement_of_another_type_is_refused_by_its_name(key: str) -> None:
    with pytest.raises(
        MeasurementError, match=f"^{key} of measurement 'mine' is {WRONG_TYPES[key]!r}"
    ) as raised:
        own_measurements([giving((), **{key: WRONG_TYPES[key]})])
    assert raised.value.advice.startswith("give ")


def test_measurement_may_say_that_it_has_no_likelihood_of_its_own() -> None:
    own = own_measurements([giving((), unlikely=None)])
    assert own is not None and own.kinds[0].unlikely is None


@pytest.mark.parametrize("case", BAD_KINDS)
def test_impossible_name_times_or_gate_is_refused_with_advice(case: str) -> None:
    measurement, told = BAD_KINDS[case]
    with pytest.raises(MeasurementError, match=told) as raised:
        own_measurements([measurement])
    assert raised.value.advice


def test_two_measurements_of_one_name_are_refused_and_none_is_no_measurement() -> None:
    with pytest.raises(MeasurementError, match="two measurements are called 'mine'"):
        own_measurements([giving(()), giving(())])
    assert own_measurements([]) is None


def test_names_of_the_built_in_kinds_are_those_of_the_ledger() -> None:
    assert BUILT_IN == (*KINDS, KIND)


def test_rows_that_differ_in_number_between_the_headings_are_refused() -> None:
    north, east = filter_at(), new_filter(AT, C_eb=attitude(AT, 0.0, 0.0, 150.0))
    bank = joined_banks(north, east)
    bank.state["log_weight"] = -math.log(2.0)
    measurement = giving(())
    measurement.rows = lambda state, layout: [(0.0, UP, 1.0)] * (1 if state.yaw_rad < 1.5 else 2)
    setup = setup_with(measurement)
    with pytest.raises(
        MeasurementError, match=r"\['mine'\] for one heading hypothesis and \['mine', 'mine'\] for"
    ):
        used(bank, setup)


def test_no_row_at_a_time_changes_nothing() -> None:
    bank = filter_at()
    before = copy_bank(bank)
    setup = setup_with(giving(()))
    assert used(bank, setup).entries == []
    assert bank.P.tobytes() == before.P.tobytes()


def test_times_of_several_kinds_make_one_line() -> None:
    own = own_measurements(
        [giving((), times_ns=ONE + 5), giving((), name="other", times_ns=[*ONE, *(ONE + 5), *(ONE + 9)])]
    )
    assert own is not None
    assert own.due(START_NS, START_NS + 9) == [START_NS + 5, START_NS + 9]
    assert [kind.name for kind in own.at(START_NS + 5)] == ["mine", "other"]
    epochs = START_NS + np.array([1, 5, 6, NS_PER_S])
    assert [own.epochs_before_next(epochs, epoch, 4) for epoch in range(4)] == [1, 3, 3, 4]
