"""The declared oscillator against the wander of the receiver's clock."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.config.flight import Oscillator
from insgnss.config.library import find
from insgnss.config.strict import load_toml
from insgnss.log.checks.clock import oscillator_findings
from insgnss.log.checks.report import Finding
from insgnss.log.checks.track import GnssTrack
from insgnss.simulation.oscillator import simulate_clock
from insgnss.tables import Float64


def oscillator(name: str) -> Oscillator:
    return load_toml(find("oscillators", name), Oscillator)


def track_of_drift(t_s: Float64, drift_mps: Float64) -> GnssTrack:
    n, zeros = len(t_s), np.zeros((len(t_s), 3))
    return GnssTrack(t_s, zeros, zeros, zeros[:, 0], zeros[:, 0], drift_mps, 0, n, n, n)


def findings(
    true: str, declared: str, rng: np.random.Generator, noise_mps: float = 0.05, rate_hz: float = 1.0
) -> list[Finding]:
    """Return what is found in ten minutes of a clock whose drift is measured with white noise."""
    t_s = np.arange(600.0 * rate_hz) / rate_hz
    clock = simulate_clock(oscillator(true), t_s, rng, drift_mps=80.0)
    drift = clock.drift_mps + noise_mps * rng.standard_normal(len(t_s))
    return oscillator_findings(track_of_drift(t_s, drift), oscillator(declared))


@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
@pytest.mark.parametrize(("true", "declared"), [("tcxo", "ocxo"), ("tcxo", "csac"), ("quartz", "ocxo")])
def test_clock_noisier_than_declared_is_an_error_that_names_the_right_oscillator(
    true: str, declared: str, rate_hz: float, rng: np.random.Generator
) -> None:
    (finding,) = findings(true, declared, rng, rate_hz=rate_hz)
    assert finding.severity == "error"
    assert [(p.key, p.value) for p in finding.proposals] == [("gnss.oscillator", true)]


@pytest.mark.parametrize("noise_mps", [0.02, 0.5])
@pytest.mark.parametrize(
    ("true", "declared"),
    [
        ("tcxo", "tcxo"),
        ("ocxo", "ocxo"),
        ("csac", "csac"),
        ("ocxo", "tcxo"),
        ("quartz", "quartz"),
        ("ocxo", "csac"),
    ],
)
def test_clock_as_declared_or_quieter_is_no_finding(
    true: str, declared: str, noise_mps: float, rng: np.random.Generator
) -> None:
    """Nor is one so little noisier that reflections could explain it."""
    assert findings(true, declared, rng, noise_mps) == []


def test_errors_of_reflections_are_not_taken_for_the_clock(rng: np.random.Generator) -> None:
    """1 m/s that all range rates share for three seconds."""
    steps = rng.standard_normal(600)
    error = np.zeros(600)
    for k in range(1, 600):
        error[k] = math.exp(-1.0 / 3.0) * error[k - 1] + math.sqrt(1.0 - math.exp(-2.0 / 3.0)) * steps[k]
    assert oscillator_findings(track_of_drift(np.arange(600.0), 80.0 + error), oscillator("ocxo")) == []


@pytest.mark.parametrize("step_s", [0.5, 50.0])
def test_short_log_and_slow_log_say_nothing(step_s: float, rng: np.random.Generator) -> None:
    drift = 10.0 * rng.standard_normal(100).cumsum()
    assert oscillator_findings(track_of_drift(step_s * np.arange(100.0), drift), oscillator("csac")) == []
