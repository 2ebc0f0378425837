"""The oscillator's h-parameters as two driving densities, against the textbook's numbers and a measure of its own."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from insgnss.config.flight import Oscillator
from insgnss.constants import C_MPS
from insgnss.inertial.clock_model import clock_model


def test_densities_of_the_textbooks_crystal() -> None:
    # Brown & Hwang 2012, 9.3, compensated crystal: h0 = 2e-19, h_-2 = 2e-20 give S_f = 1e-19 s, S_g = 3.95e-19 /s
    model = clock_model(Oscillator(h0_s=2e-19, h_minus2_per_s=2e-20))

    assert model.bias_density == pytest.approx(C_MPS**2 * 1e-19, rel=1e-9)  # 0.009 m^2/s
    assert model.drift_density == pytest.approx(C_MPS**2 * 3.948e-19, rel=1e-3)  # 0.035 m^2/s^3


@pytest.mark.parametrize("tau_s", [0.1, 1.0, 30.0])
def test_allan_variance_of_the_model_is_that_of_the_spectrum(tau_s: float) -> None:
    h0, h_minus2 = 3e-21, 5e-23
    model = clock_model(Oscillator(h0_s=h0, h_minus2_per_s=h_minus2))

    # of a random walk of the bias and of the drift: S1 / tau + S2 tau / 3   [Zucca & Tavella 2005]
    of_model = (model.bias_density / tau_s + model.drift_density * tau_s / 3.0) / C_MPS**2

    # of a one-sided spectrum S_y(f): 2 int S_y sin^4(pi tau f) / (pi tau f)^2 df, x = pi tau f
    def transfer(x: float, power: float) -> float:
        return math.sin(x) ** 4 / x**2 * x**power

    white = quad(transfer, 0.0, 400.0, args=(0.0,), limit=2000)[0] + 0.375 / 400.0  # mean of sin^4 beyond
    walk = quad(transfer, 0.0, 100.0, args=(-2.0,), limit=2000)[0]
    of_spectrum = 2.0 * (h0 * white / (np.pi * tau_s) + h_minus2 * walk * np.pi * tau_s)
    assert of_model == pytest.approx(of_spectrum, rel=1e-4, abs=0.0)
