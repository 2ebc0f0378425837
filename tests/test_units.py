"""Conversions at the edges: each against a number that stands in a book or on a data sheet."""

from __future__ import annotations

import math
from typing import get_args

import numpy as np
import pytest

from insgnss import units
from insgnss.config.flight import ImuConfig
from insgnss.config.log_table import TimeScale


@pytest.mark.parametrize(
    ("function", "value", "expected"),
    [
        (units.deg_to_rad, 180.0, math.pi),
        (units.rad_to_deg, math.pi / 6.0, 30.0),
        # Earth rate, 15.041067 deg/h, is 7.292115e-5 rad/s
        (units.deg_per_h_to_radps, 15.041067, 7.292115e-5),
        (units.radps_to_deg_per_h, 7.292115e-5, 15.041067),
        # 1 deg/sqrt(h) is 2.908882e-4 rad/sqrt(s): pi / 180 / 60
        (units.deg_per_sqrt_h_to_rad_per_sqrt_s, 1.0, 2.908882e-4),
        (units.mps_per_sqrt_h_to_mps_per_sqrt_s, 0.06, 0.001),
        (units.mg_to_mps2, 1000.0, 9.80665),
        (units.mps2_to_mg, 9.80665e-3, 1.0),
        (units.ppm_to_ratio, 300.0, 3e-4),
    ],
)
def test_conversion_gives_the_known_number(function, value: float, expected: float) -> None:
    assert function(value) == pytest.approx(expected, rel=1e-6)


def test_random_walk_density_accumulates_to_the_data_sheet_after_one_hour() -> None:
    density = units.deg_per_sqrt_h_to_rad_per_sqrt_s(0.1)

    assert units.rad_to_deg(density * math.sqrt(3600.0)) == pytest.approx(0.1, rel=1e-15)


def test_arrays_convert_like_floats_and_keep_their_shape() -> None:
    rates = np.array([[1.0, -2.0, 0.0], [3.0, 4.0, 5.0]])

    converted = units.deg_per_h_to_radps(rates)

    assert converted.shape == (2, 3)
    assert converted[1, 2] == units.deg_per_h_to_radps(5.0)


@pytest.mark.parametrize(
    ("there", "back"),
    [
        (units.deg_to_rad, units.rad_to_deg),
        (units.deg_per_h_to_radps, units.radps_to_deg_per_h),
        (units.mg_to_mps2, units.mps2_to_mg),
    ],
)
def test_conversion_and_its_inverse_return_the_value(there, back) -> None:
    values = np.array([-360.0, 1e-9, 0.0, 123.456])

    np.testing.assert_allclose(back(there(values)), values, rtol=4e-16)


@pytest.mark.parametrize(
    ("model", "field"), [(ImuConfig, "gyro_unit"), (ImuConfig, "accel_unit"), (TimeScale, "unit")]
)
def test_every_unit_that_a_flight_file_may_declare_has_its_factor(model, field: str) -> None:
    for unit in get_args(model.model_fields[field].annotation):
        assert units.SI_PER_UNIT[unit] > 0.0
