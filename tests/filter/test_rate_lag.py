"""The lag of the range rates as a state: its column, and which velocity a row then is about."""

from __future__ import annotations

import numpy as np

from insgnss.filter.diagnosis.offset_state import with_further_states
from insgnss.filter.layout import Layout
from insgnss.filter.state import OFFSETS, Bank
from insgnss.filter.states.imu_time import UNKNOWN_IMU_TIME
from insgnss.filter.states.rate_lag import UNKNOWN_RATE_LAG
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.prior_rows import predict_measurements
from insgnss.gnss.observation_rows import RANGE_RATE
from insgnss.tables import Float64
from tests.filter.scene import parameters
from tests.filter.test_carrier import carrier_log
from tests.filter.test_imu_time import LEVER_B, PULL, RATE, manoeuvring_filter
from tests.jacobian import finite_difference_jacobian

LAG = OFFSETS + 1


def lagging_filter(late_s: float) -> Bank:
    bank = with_further_states(
        manoeuvring_filter(),
        Layout((UNKNOWN_IMU_TIME,), clone=True),
        Layout((UNKNOWN_IMU_TIME, UNKNOWN_RATE_LAG), clone=True),
    )
    bank.state[0].optional[LAG - OFFSETS] = late_s
    return bank


def rates_of(late_s: float) -> tuple[Float64, Float64]:
    """Return the predicted range rates, less the measured ones, and their derivatives by the lag."""
    bank = lagging_filter(late_s)
    n = bank.P.shape[1]
    par = parameters(LEVER_B, at_imu_time=OFFSETS, at_rate_lag=LAG, at_clone=LAG + 1, motion_gate2=0.0)[0]
    work = new_epoch(12, n, LAG)
    predict_measurements(bank.state[0], bank.P[0], par, carrier_log(), 0, RATE, PULL, work)
    H = [
        line["h"][RANGE_RATE][list(line["columns"][RANGE_RATE][: line["count"][RANGE_RATE]]).index(LAG)]
        for line in work.lines
    ]
    return -np.asarray(work.lines["innovation"][:, RANGE_RATE]), np.array(H)


def test_column_equals_finite_differences() -> None:
    _, H = rates_of(0.05)
    found = finite_difference_jacobian(
        lambda d: rates_of(float(d[0]))[0], np.full(1, 0.05), np.full(1, 1e-4)
    )[:, 0]
    np.testing.assert_allclose(H, found, rtol=1e-6, atol=1e-6)
    assert np.abs(found).max() > 3.0


def test_further_states_begin_at_zero_with_their_sigma_and_leave_the_others_alone() -> None:
    before, after = manoeuvring_filter(), lagging_filter(0.0)
    np.testing.assert_array_equal(after.P[0, :LAG, :LAG], before.P[0, :LAG, :LAG])
    assert after.P[0, LAG, LAG] == UNKNOWN_RATE_LAG.variance
    assert not after.P[0, LAG, :LAG].any() and not after.P[0, LAG + 1 :].any()
    assert after.state[0].clone_ns == 0
