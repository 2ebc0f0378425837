"""The settings of measurements and faults: defaults that fit together, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.lib.recfunctions import structured_to_unstructured
from pydantic import ValidationError

from insgnss.config.filter import DEFAULT_SIGNALS, Faults, FilterConfig, Measurements
from insgnss.config.library import filter_config
from insgnss.filter.parameters import resolve_parameters, weather_of
from insgnss.gnss.observation_rows import CARRIER
from insgnss.gnss.signals import reason_unsupported, signal_of
from insgnss.gnss.troposphere import STANDARD_WEATHER
from tests.filter.scene import TACTICAL, TCXO
from tests.layouts import layout_with


def resolved(**tables: Any) -> Any:
    """Return the filter's numbers with some tables of the settings replaced."""
    config = FilterConfig.model_validate(filter_config("tight17").model_dump() | tables)
    return resolve_parameters(
        config, TACTICAL, TCXO, (0.0, 0.0, 0.0), klobuchar_known=True, layout=layout_with()
    )[0]


@pytest.mark.parametrize(("letter", "code"), [(s, c) for s, codes in DEFAULT_SIGNALS.items() for c in codes])
def test_every_signal_of_the_defaults_is_one_the_package_knows(letter: str, code: str) -> None:
    assert signal_of(letter, code) is not None, reason_unsupported(letter, code)


def test_constellations_of_the_defaults_have_signals_and_sbas_is_left_out() -> None:
    use = Measurements()
    assert all(use.signals_of()[letter] for letter in use.constellations)
    assert "S" not in use.constellations and set(use.signals_of()) == set(use.constellations)


def test_signals_of_a_constellation_left_out_are_not_offered() -> None:
    assert set(Measurements(constellations=("E", "G")).signals_of()) == {"E", "G"}
    assert Measurements(signals={"G": ("C5Q",)}).signals_of() == {"G": ("C5Q",), **dict.fromkeys("EJCRI", ())}


def test_default_signals_are_nobodys_to_change() -> None:
    Measurements().signals.clear()
    assert Measurements().signals == DEFAULT_SIGNALS


@pytest.mark.parametrize(
    "wrong",
    [
        {"constellations": ()},
        {"constellations": ("X",)},
        {"ionosphere": "nequik"},
        {"variance_scale": {"R": 0.0}},
        {"weather": {"humidity_percent": 101.0}},
        {"weather": {"pressure_hpa": 101_325.0}},
        {"weather": {"temperature_c": 288.15}},
    ],
)
def test_measurements_that_cannot_be_meant_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Measurements.model_validate(wrong)


@pytest.mark.parametrize(
    "wrong", [{"weights": "tukey"}, {"huber_k": 0.0}, {"drift_sigma": -1.0}, {"residual_sigma": -5.0}]
)
def test_faults_that_cannot_be_meant_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Faults.model_validate(wrong)


def test_zero_switches_each_fault_test_off() -> None:
    off = resolved(faults={"residual_sigma": 0.0, "drift_sigma": 0.0, "reflected_below_db": 0.0})
    assert (off.residual_gate2, off.drift_gate, off.reflected_below_db, off.robust) == (0.0, 0.0, 0.0, 0)
    on = resolved()
    assert (on.residual_gate2, on.drift_gate, on.reflected_below_db) == (25.0, 4.0, 8.0)


@pytest.mark.parametrize(("weights", "number"), [("gate", 0), ("huber", 1), ("student", 2)])
def test_weights_reach_the_compiled_filter(weights: str, number: int) -> None:
    assert resolved(faults={"weights": weights}).robust == number


def test_weather_left_out_is_the_standard_atmosphere() -> None:
    assert weather_of(Measurements()) == pytest.approx(STANDARD_WEATHER)


def test_weather_measured_on_a_hill_is_brought_to_sea_level() -> None:
    """8.3 m a hectopascal: 1000 m up the pressure is 114 hPa lower in the standard atmosphere."""
    air = weather_of(Measurements.model_validate({"weather": {"pressure_hpa": 898.8, "h_m": 1000.0}}))
    assert air.pressure_hpa == pytest.approx(1013.25, abs=1.0)


def leaves(table: dict[str, Any], path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Return the paths of all numbers of the settings."""
    found = []
    for key, value in table.items():
        if isinstance(value, dict):
            found += leaves(value, (*path, key))
        elif isinstance(value, int | float) and not isinstance(value, bool):
            found.append((*path, key))
    return found


@pytest.mark.parametrize("value", [1e300, -1e300, 1e16, 1e-300, 5e-324])
def test_no_number_of_the_settings_may_be_wild(value: float) -> None:
    """The square of each, times a few others, has to be a number."""
    for path in leaves(filter_config("tight17").model_dump()):
        settings = filter_config("tight17").model_dump()
        table = settings
        for key in path[:-1]:
            table = table[key]
        table[path[-1]] = round(value) if isinstance(table[path[-1]], int) else value
        if table[path[-1]] == 0:
            continue  # of a whole number nothing is left
        with pytest.raises(ValidationError):
            FilterConfig.model_validate(settings)


def test_largest_settings_resolve_to_finite_numbers() -> None:
    huge = {"floor": 1e6, "elevation": 1e6, "cn0_at_45_dbhz": 1e6}
    par = resolved(pseudorange_noise_m=huge, range_rate_noise_mps=huge, process={"covariance_step_s": 10.0})

    assert np.isfinite(structured_to_unstructured(par)).sum() == structured_to_unstructured(par).size - 1
    assert par.kind[CARRIER].least_step == np.inf  # no common step of the carriers is the clock's
