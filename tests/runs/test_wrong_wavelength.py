"""Range rates with the wavelength of another signal: the pseudoranges navigate, whatever the rates say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

import insgnss
from insgnss.log.flight import FlightInMemory
from tests.filter.test_engine import shortened
from tests.runs.scenes import flight, kinds, turns
from tests.sensors.scenes import city_car, flown
from tests.sensors.test_live import bits_of_replay

B1I_AS_B1C = 1561.098 / 1575.42


def scaled(made: FlightInMemory, scale: float) -> FlightInMemory:
    gnss = made.logs.gnss
    return replace(made, logs=replace(made.logs, gnss=replace(gnss, doppler_hz=scale * gnss.doppler_hz)))


def air(seed: int) -> FlightInMemory:
    return flight(turns(), seed=seed)


def car(seed: int) -> FlightInMemory:
    return flown(city_car(), seed)


@pytest.mark.parametrize(
    ("vehicle", "seed", "scale"), [(air, 82, B1I_AS_B1C), (car, 81, B1I_AS_B1C), (car, 82, 1.005)]
)
def test_pseudoranges_navigate_where_the_range_rates_agree_on_no_velocity(
    vehicle: Callable[[int], FlightInMemory], seed: int, scale: float
) -> None:
    """The rates were followed and the pseudoranges refused: 323 to 867 m, up to 384 sigma."""
    run = insgnss.replay(scaled(vehicle(seed), scale), output=1.0)
    told = run.events[run.events["kind"] == "reset"]["detail"]
    assert any(each.startswith("the range rates agree on no velocity") for each in told)
    assert run.errors is not None
    late = run.errors[run.errors["time_s"] > run.errors["time_s"].iloc[0] + 35.0]
    for name in ("n_m", "e_m", "d_m", "vn_mps", "ve_mps", "vd_mps", "yaw_deg"):
        assert (late[f"d_{name}"].abs() < 5.0 * late[f"sd_{name}"]).all(), name
    rows = run.measurements[run.measurements["time_s"] > run.errors["time_s"].iloc[0] + 35.0]
    used = rows[rows["status"] == "used"]["kind"].value_counts()
    assert used["pseudorange"] > 0.9 * (rows["kind"] == "pseudorange").sum()
    assert used.get("range_rate", 0) == 0
    assert not {"imu_distrusted", "sensor_suspect"} & set(kinds(run))


def test_engine_gives_the_bits_of_replay_when_the_rates_are_left_out() -> None:
    """Headings are open at first, where the look for satellites that run away has its own ticks."""
    made = scaled(car(82), B1I_AS_B1C)
    assert bits_of_replay(replace(made, logs=shortened(made.logs, 50.0)), "reset") > 25
