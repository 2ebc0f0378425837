"""NeQuick-G against the verification tables of its description."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.gnss.nequick import nequick_delay
from insgnss.gnss.signals import L1_HZ

M_PER_TECU = 40.3e16 / L1_HZ**2  # 0.162 m

# Ionospheric correction algorithm for Galileo single frequency users 1.2, annex A: high, medium, low solar activity.
# UT [h], station longitude, latitude [deg], height [m], satellite longitude, latitude [deg], height [m], TECU; April
TABLES = (
    (
        (236.831641, -0.39362878, 0.00402826613),
        (
            (0, 297.66, 82.49, 78.11, 8.23, 54.29, 20281546.18, 20.40),
            (4, 297.66, 82.49, 78.11, 140.68, 35.85, 19953735.00, 37.81),
            (12, 297.66, 82.49, 78.11, 81.09, 35.20, 20278071.03, 49.30),
            (20, 297.66, 82.49, 78.11, -52.46, 24.28, 19831557.96, 48.45),
            (0, 307.19, 5.25, -25.76, -89.48, -29.05, 20081457.33, 240.59),
            (8, 307.19, 5.25, -25.76, 7.14, -19.55, 20226657.45, 26.47),
            (16, 307.19, 5.25, -25.76, -66.77, 2.37, 19986966.89, 133.16),
            (20, 307.19, 5.25, -25.76, 10.94, 44.72, 20450566.19, 336.74),
        ),
    ),
    (
        (121.129893, 0.351254133, 0.0134635348),
        (
            (0, 40.19, -3.00, -23.32, 76.65, -41.43, 20157673.93, 18.26),
            (4, 40.19, -3.00, -23.32, 107.19, -10.65, 19943686.06, 76.77),
            (12, 40.19, -3.00, -23.32, 90.78, -28.26, 20081398.25, 127.83),
            (20, 40.19, -3.00, -23.32, 54.11, 3.15, 20251696.28, 48.06),
            (0, 115.89, -31.80, 12.78, 119.90, -8.76, 19941513.27, 24.84),
            (8, 115.89, -31.80, 12.78, 127.35, 23.46, 19837695.71, 88.58),
            (16, 115.89, -31.80, 12.78, 124.09, -14.31, 20100697.90, 6.96),
            (20, 115.89, -31.80, 12.78, 131.65, -31.56, 20066111.12, 4.36),
        ),
    ),
    (
        (2.580271, 0.127628236, 0.0252748384),
        (
            (0, 141.13, 39.14, 117.00, 165.14, -13.93, 20181976.50, 36.44),
            (4, 141.13, 39.14, 117.00, 107.19, -10.65, 19943685.88, 77.49),
            (12, 141.13, 39.14, 117.00, 62.65, 54.77, 20370905.24, 16.33),
            (20, 141.13, 39.14, 117.00, 84.18, 36.59, 19953853.27, 6.06),
            (0, 204.54, 19.80, 3754.69, 165.14, -13.93, 20181976.58, 94.98),
            (8, 204.54, 19.80, 3754.69, -125.97, 2.30, 20251559.90, 0.12),
            (16, 204.54, 19.80, 3754.69, -140.58, 51.70, 20455387.61, 2.16),
            (20, 204.54, 19.80, 3754.69, -82.52, 20.64, 19937791.48, 38.20),
        ),
    ),
)
CASES = [(coefficients, row) for coefficients, rows in TABLES for row in rows]


def place(lon_deg: float, lat_deg: float, h: float) -> np.ndarray:
    return np.array([math.radians(lat_deg), math.radians((lon_deg + 180.0) % 360.0 - 180.0), h])


@pytest.mark.parametrize(("coefficients", "row"), CASES)
def test_delay_equals_the_published_electron_content(
    coefficients: tuple[float, float, float], row: tuple[float, ...]
) -> None:
    hour, *station = row[:4]
    delay = nequick_delay(np.array(coefficients), 4, hour, place(*station), place(*row[4:7]))
    # the table is rounded to 0.01 TECU; the model's own integration tolerance is 0.01 of the content at most
    assert delay == pytest.approx(row[7] * M_PER_TECU, abs=0.03 * M_PER_TECU)


def test_coefficients_that_are_not_told_are_the_models_default() -> None:
    station, satellite = place(9.0, 48.0, 300.0), place(20.0, 40.0, 2.02e7)
    of_zero = nequick_delay(np.zeros(3), 6, 12.0, station, satellite)
    assert of_zero == nequick_delay(np.array([63.7, 0.0, 0.0]), 6, 12.0, station, satellite)
    assert of_zero < nequick_delay(np.array([200.0, 0.0, 0.0]), 6, 12.0, station, satellite)


def test_ray_through_the_earth_has_no_delay() -> None:
    assert math.isnan(
        nequick_delay(np.array([63.7, 0.0, 0.0]), 6, 12.0, place(9.0, 48.0, 300.0), place(-171.0, -48.0, 2e7))
    )
