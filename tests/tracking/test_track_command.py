"""``insgnss track``: numbers of a trial, the same for any threads, and typed errors with their exit codes."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from insgnss.cli.main import app
from insgnss.gnss.signals import L1_HZ
from insgnss.tracking.codes import gps_ca
from insgnss.tracking.loop_filters import digital_filter
from insgnss.tracking.trial import Assessment, CarrierDynamics, assess, design_channels, simulation_of

T = 1e-3
QUICK = ["track", "--time", "4"]


def trial(cn0: float, motion: CarrierDynamics, aided: bool = False, seconds: float = 6.0) -> Assessment:
    code = gps_ca(1)
    design = design_channels(code, L1_HZ, cn0, digital_filter(2, 12.0, T), digital_filter(1, 1.0, T))
    simulation = simulation_of(design, code, L1_HZ, motion, seconds, 12, 5, aided)
    return assess(simulation, simulation.run(5))


def test_trial_at_rest_has_the_noise_of_the_linear_loop_and_reports_its_cn0() -> None:
    found = trial(43.0, CarrierDynamics())
    assert found.slipped == 0
    # 12 channels of 4.8 s at 12 Hz: 1400 values: 4 sigma of an rms
    assert found.phase_rms_rad == pytest.approx(found.phase_noise_rad, rel=4.0 / math.sqrt(2.0 * 1400) + 0.01)
    assert (found.moment_dbhz, found.narrow_wide_dbhz) == (
        pytest.approx(43.0, abs=0.4),
        pytest.approx(43.0, abs=0.6),
    )
    assert found.phase_lock > 0.98


def test_motion_breaks_the_loop_that_aiding_holds() -> None:
    lost, held = trial(43.0, CarrierDynamics(200.0)), trial(43.0, CarrierDynamics(200.0), aided=True)
    assert lost.slipped == 12 and math.isnan(lost.phase_rms_rad)
    assert held.slipped == 0 and held.phase_rms_rad < 0.1


def test_phase_lock_of_lost_signals_is_nan_and_not_a_ratio_of_noises() -> None:
    """At 400 m/s^2 from the first integration on the frequency leaves the integrations' band: no signal is seen."""
    assert np.isnan(
        [trial(cn0, CarrierDynamics(400.0), seconds=10.0).phase_lock for cn0 in (40.0, 70.0)]
    ).all()
    assert trial(30.0, CarrierDynamics(), seconds=10.0).phase_lock > 0.8


def test_short_trials_say_nan_instead_of_failing() -> None:
    found = trial(43.0, CarrierDynamics(), seconds=0.001)  # one integration
    assert np.isnan([found.phase_lock, found.moment_dbhz, found.narrow_wide_dbhz]).all()
    assert trial(43.0, CarrierDynamics(), seconds=0.005).slipped == 0


def test_command_prints_errors_lock_and_cn0() -> None:
    result = CliRunner().invoke(app, [*QUICK, "--cn0", "42", "--bandwidth", "10", "--wander", "5"])
    assert result.exit_code == 0, result.output
    for word in ("carrier phase", "code delay", "slipped 0 of 12", "moments 4", "narrow-wide 4", " s in all"):
        assert word in result.stdout
    assert "true noise bandwidth 10.000 Hz" in result.stdout


def test_command_prints_the_same_numbers_for_any_number_of_threads() -> None:
    runs = [CliRunner().invoke(app, [*QUICK, "--threads", str(n)]).stdout for n in (1, 3)]
    assert len({re.sub(r"[\d.]+ s in all", "", text) for text in runs}) == 1


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--signal", "gps-ca-0"], "nearest: 'gps-ca-"),
        (["--bandwidth", "12000"], "the limit for order 3 is 9.5"),
        (["--discriminator", "atan3"], "nearest: 'atan"),
        (["--cn0", "10000"], "dBHz"),
        (["--integration", "3"], "do not fill"),
        (["--integration", "-1"], "'--integration': -1 is not at least"),
        (["--time", "nan"], "'--time': nan is not at least"),
        (["--channels", "0"], "'--channels'"),
        (["--time", "1e6"], "need too much memory"),
        (["--seed", "-3"], "'--seed'"),
        (["--order", "5"], "take 1, 2 or 3"),
        (["--spacing", "3"], "see the peak"),
        (["--threads", "0"], "'--threads'"),
        (["--wander", "-2"], "'--wander': -2 is not at least"),
    ],
)
def test_command_refuses_what_makes_no_sense(arguments: list[str], word: str) -> None:
    result = CliRunner().invoke(app, [*QUICK, *arguments])
    assert result.exit_code == 2
    begins = result.stderr.startswith("error: ") or "Invalid value for" in result.stderr
    assert begins and word in result.stderr and "->" in result.stderr
