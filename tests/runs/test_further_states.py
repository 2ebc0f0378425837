"""State blocks and measurements of a user's own that a filter refuses: wrong types, columns of the table ``nav``."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import insgnss
from insgnss.errors import ConfigError, MeasurementError
from insgnss.filter.layout import Layout
from insgnss.filter.own_rows.declared import own_measurements

FLIGHT = Path("data/sample_flight/flight.toml")
NAN, INF = math.nan, math.inf


def block(**changes: Any) -> insgnss.StateBlock:
    return insgnss.StateBlock(
        **{"name": "mine", "columns": ("mine_m",), "unit": "m", "sigma": 1.0, **changes}
    )


@pytest.mark.parametrize(
    "wrong",
    [
        {"columns": "mine_m"},
        {"columns": ("mine_m", 3)},
        {"name": 3},
        {"sigma": (1.0,)},
        {"sigma": True},
        {"process": 3.0},
        {"couples": ("gyro",)},
        {"couples": 3},
    ],
)
def test_a_value_of_the_wrong_type_is_refused_with_advice(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="state block") as raised:
        block(**wrong)
    assert raised.value.advice


@pytest.mark.parametrize(
    ("sigma", "time_s"), [(1.0, 0.0), (-1.0, 50.0), ("1", 50.0), (NAN, 50.0), (1.0, INF)]
)
def test_a_process_without_finite_numbers_is_refused(sigma: Any, time_s: float) -> None:
    with pytest.raises(ConfigError, match="state block"):
        block(process=insgnss.GaussMarkov(sigma, time_s))


@pytest.mark.parametrize("column", ["lat_deg", "time_s", "n_m", "vpl_m", "point_h_m", "clock_bias_m"])
def test_a_column_of_the_table_nav_is_refused(column: str) -> None:
    """The block's values would replace latitude or a sigma of the position in the table."""
    for apply in (insgnss.engine_settings, insgnss.replay):
        with pytest.raises(ConfigError, match=f"'{column}'") as raised:
            apply(insgnss.Flight.load(FLIGHT), states=[block(columns=(column,))])
        assert "mine" in str(raised.value.advice)


def test_a_column_that_is_the_sigma_of_another_is_refused() -> None:
    with pytest.raises(ConfigError, match="'sd_mine_m'"):
        Layout((block(columns=("mine_m", "sd_mine_m")),))


@pytest.mark.parametrize("states", [block(), [3], 3, [insgnss.StateBlock]])
def test_states_that_are_no_list_of_blocks_are_refused(states: Any) -> None:
    with pytest.raises(ConfigError, match="not a list of state blocks"):
        insgnss.engine_settings(FLIGHT, states=states)


def mine(**changes: Any) -> Any:
    return SimpleNamespace(**{"name": "mine", "rows": lambda state, layout: (), **changes})


def test_a_measurement_with_a_period_and_times_is_refused() -> None:
    """Its times would never be used."""
    with pytest.raises(MeasurementError, match="'mine' has both period_ns and times_ns") as raised:
        own_measurements([mine(period_ns=10**9, times_ns=np.array([5]))])
    assert raised.value.advice
    assert own_measurements([mine(period_ns=10**9, times_ns=np.zeros(0, np.int64))]) is not None


def test_measurements_that_are_no_list_are_refused() -> None:
    setup = insgnss.engine_settings(FLIGHT)
    with pytest.raises(MeasurementError, match="not a list"):
        insgnss.Engine(setup, measurements=mine(period_ns=10**9))


def test_a_message_counts_the_users_own_measurements() -> None:
    with pytest.raises(MeasurementError, match="measurement 1 of the list"):
        own_measurements([mine()], [mine(name="other", period_ns=10**9)])
