"""The optional states of a pseudorange: clock offset, GLONASS channel bias, zenith delay; their columns and values."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.filter.state import OFFSETS, Bank
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.prior_rows import predict_measurements
from insgnss.gnss.observation_rows import PSEUDORANGE, GnssRows
from insgnss.tables import Float64
from tests.filter.scene import START_NS, new_filter, parameters, perfect_rows, place, sky, steady_force
from tests.jacobian import finite_difference_jacobian

GROUP = (0, 1) * 6
CHANNELS = np.array([0, -7, 0, 6, 0, 1, 0, -1, 0, 3, 0, 0])
CHANNEL, ZENITH = OFFSETS + 1, OFFSETS + 2
N = OFFSETS + 3


def numbers(**changes: float) -> np.ndarray:
    return parameters(
        (0.5, 0.2, -1.0),
        **({"at_channel_bias": CHANNEL, "at_zenith_delay": ZENITH, "use_troposphere": 1.0} | changes),
    )


def scene() -> tuple[Bank, GnssRows]:
    """Return a filter with all three states and rows of two constellations, some of them on GLONASS channels."""
    bank = new_filter(place(), offsets=(25.0, 0.4, 0.1))
    log = perfect_rows(bank, parameters(), [START_NS], sky(place()), group=GROUP)
    log.observation["channel"] = CHANNELS
    return bank, log


def lines_of(bank: Bank, log: GnssRows, par: np.ndarray) -> np.ndarray:
    work = new_epoch(12, N)
    predict_measurements(
        bank.state[0], bank.P[0], par[0], log, 0, np.zeros(3), steady_force(bank.state[0]), work
    )
    return work.lines


def columns(lines: np.ndarray) -> Float64:
    """Return the rows of H over the optional states, (12, 3)."""
    H = np.zeros((len(lines), N))
    for j, line in enumerate(lines):
        count = line["count"][PSEUDORANGE]
        H[j, line["columns"][PSEUDORANGE, :count]] = line["h"][PSEUDORANGE, :count]
    return H[:, OFFSETS:]


def test_columns_equal_finite_differences() -> None:
    bank, log = scene()
    par = numbers()
    first = bank.state["optional"][0, :3].copy()

    def predicted(d: Float64) -> Float64:
        bank.state["optional"][0, :3] = first + d
        return -lines_of(bank, log, par)["innovation"][:, PSEUDORANGE]

    expected = finite_difference_jacobian(predicted, np.zeros(3), np.ones(3))
    bank.state["optional"][0, :3] = first
    # the states enter linearly: what is left is the rounding of a range of 2.2e7 m
    assert np.max(np.abs(columns(lines_of(bank, log, par)) - expected)) < 1e-7
    assert np.count_nonzero(expected[:, 0]) == 6 and np.count_nonzero(expected[:, 1]) == 5


def test_zenith_delay_is_mapped_by_elevation() -> None:
    """The wet mapping is 1 / sin(elevation) to 1 % above 20 deg and less below."""
    bank, log = scene()
    lines = lines_of(bank, log, numbers())
    sine = -lines["u_n"][:, 2]
    high = sine > np.sin(np.radians(20.0))
    mapped = columns(lines)[:, 2]
    assert np.allclose(mapped[high], 1.0 / sine[high], rtol=0.01)
    assert np.all(mapped[~high] < 1.0 / sine[~high])


@pytest.mark.parametrize(("at", "name"), [(CHANNEL, "at_channel_bias"), (ZENITH, "at_zenith_delay")])
def test_state_that_the_settings_leave_out_enters_no_row(at: int, name: str) -> None:
    bank, log = scene()
    left_out = columns(lines_of(bank, log, numbers(**{name: -1})))
    assert not left_out[:, at - OFFSETS].any()


def test_channel_zero_has_no_channel_bias_and_the_reference_no_offset() -> None:
    bank, log = scene()
    H = columns(lines_of(bank, log, numbers()))
    assert H[:, 0].tolist() == list(GROUP)
    assert H[:, 1].tolist() == CHANNELS.tolist()


def test_air_left_out_leaves_no_zenith_delay() -> None:
    bank, log = scene()
    assert not columns(lines_of(bank, log, numbers(use_troposphere=0.0)))[:, 2].any()
