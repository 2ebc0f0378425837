"""The trade-off lines of figures 5 and 6 and the diagram of figure 4."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.interference.discriminators import discriminator
from insgnss.interference.drift import ins_density, oscillator_density
from insgnss.interference.margin import (
    PER_OSCILLATOR,
    PhaseLoop,
    density,
    diagram,
    margin_db,
    per_ins,
    trade_off,
)

F0 = 1600e6
TYPE_1 = PhaseLoop(discriminator("Q", 0.076), 1.022e6, 0.01)
TYPE_2 = PhaseLoop(discriminator("IQ", 0.076), 1.022e6, 0.01)


def test_weights_of_equation_28_are_those_of_the_reference() -> None:
    assert pytest.approx(8.77298, abs=5e-6) == PER_OSCILLATOR
    assert per_ins(F0) == pytest.approx(249.888, abs=5e-4)
    # one unit of c_INS weighs (f0 / c)^2 units of c_osc
    assert per_ins(F0) / PER_OSCILLATOR == pytest.approx(28.48, abs=5e-3)


def test_characteristics_weigh_as_equations_21_and_22_do() -> None:
    expected = oscillator_density(19.0, 1.0) + ins_density(0.5, 30.0, F0)
    assert float(density(19.0**2, 0.5**2 / 30.0, F0)) == pytest.approx(float(expected), rel=1e-12)


@pytest.mark.parametrize("margin", [35.0, 42.0, 45.0])
def test_every_pair_on_a_line_has_its_margin(margin: float) -> None:
    line = trade_off(margin, TYPE_2, F0)
    c_ins = line.c_ins * np.array([0.0, 0.3, 0.9])
    S = density(line.osc_left(c_ins), c_ins, F0)

    assert margin_db(S, TYPE_2) == pytest.approx(margin, abs=1e-9)
    assert float(line.osc_left(2.0 * line.c_ins)) == 0.0


def test_intercepts_are_the_greatest_drift_over_the_weights() -> None:
    line = trade_off(40.0, TYPE_1, F0)
    assert line.c_ins == pytest.approx(1.1544e4 / 249.888, rel=6e-5)
    assert line.c_osc == pytest.approx(1.1544e4 / 8.77298, rel=6e-5)


def test_each_axis_of_the_diagram_stands_alone() -> None:
    # the printed text swaps the axes: on that of the INS the oscillator's characteristic is zero
    lines = diagram([35.0, 45.0], TYPE_1, F0)
    assert margin_db(density(0.0, lines.c_ins, F0), TYPE_1) == pytest.approx([35.0, 45.0], abs=1e-9)
    assert margin_db(density(lines.c_osc, 0.0, F0), TYPE_1) == pytest.approx([35.0, 45.0], abs=1e-9)


def test_thermal_noise_lowers_the_line() -> None:
    assert trade_off(35.0, TYPE_2, F0, 35.0).greatest_density < trade_off(35.0, TYPE_2, F0).greatest_density
