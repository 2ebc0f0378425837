"""Closed loops in error states: the linear theory where it holds, and slips as an independent program counted them."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import pytest

from insgnss.antenna.obstruction import directions
from insgnss.errors import ConfigError
from insgnss.interference import (
    PhaseLoop,
    PhaseModel,
    UnknownAcceleration,
    channel_model,
    discriminator,
    phase_threshold,
    receiver_models,
)
from insgnss.interference.riccati import discretised, predicted_covariance
from insgnss.studies.receiver.slips import error_loop, slip_runs

CARRIER_HZ: Final = 1.6e9
SKY: Final = directions([20, 65, 110, 155, 200, 245, 290, 335], [12, 40, 20, 65, 15, 35, 70, 25])
T: Final = 5e-3
LOOP: Final = PhaseLoop(discriminator("IQ", 0.076), 1.022e6, T)
OFFSETS_DB: Final = (-2.0, -1.0, 0.0, 1.0, 2.0)

# Share of 100 runs of 20 s with a slip, C/N0 against the linear threshold, of a program that was written independently
# of this project. In its two-stage receivers a run is one channel.
COUNTED: Final = {
    "two_stage": (1.00, 1.00, 0.91, 0.58, 0.20),
    "two_stage_ins": (0.86, 0.59, 0.22, 0.09, 0.03),
    "one_stage": (1.00, 0.99, 0.71, 0.15, 0.02),
    "one_stage_ins": (0.80, 0.29, 0.03, 0.00, 0.00),
}


def models() -> dict[str, PhaseModel]:
    vehicle, error = UnknownAcceleration(49.03, 10.0), UnknownAcceleration(0.06, 100.0, 0.1, 1e-3)
    return receiver_models(vehicle, error, 100.0, CARRIER_HZ, SKY)


@pytest.mark.parametrize("name", COUNTED)
def test_slips_about_the_linear_threshold_are_those_of_an_independent_program(name: str) -> None:
    model = models()[name]
    threshold = phase_threshold(model, LOOP).cn0_dbhz
    runs = [slip_runs(model, LOOP, threshold + offset, SKY) for offset in OFFSETS_DB]

    found = [run.lost_channels for run in runs]
    np.testing.assert_allclose(found, COUNTED[name], atol=0.15)
    if name.startswith("one"):
        # a slip of one phase takes all with it
        np.testing.assert_allclose([run.lost_runs for run in runs], found, atol=0.03)


def test_any_of_eight_channels_slips_more_often_than_one() -> None:
    model = models()["two_stage"]
    run = slip_runs(model, LOOP, phase_threshold(model, LOOP).cn0_dbhz + 2.0, SKY)

    # nearly independent: 1 - (1 - p)^8
    assert run.lost_runs == pytest.approx(1.0 - (1.0 - run.lost_channels) ** 8, abs=0.12)
    assert run.lost_runs > 3.0 * run.lost_channels


@pytest.mark.parametrize("name", COUNTED)
def test_phase_error_of_a_strong_signal_is_that_of_the_linear_theory(name: str) -> None:
    model, cn0 = models()[name], 50.0
    variance = 0.5 / (10.0 ** (0.1 * cn0) * T)
    P = predicted_covariance(discretised(model.A, model.Q, T), model.H, variance * (1.0 + variance))
    wanted = math.sqrt(np.mean(np.einsum("ij,jk,ik->i", model.H, P, model.H)))

    found = slip_runs(model, LOOP, cn0, SKY, runs=20)
    assert found.lost_runs == 0.0
    assert found.rms_rad == pytest.approx(wanted, rel=0.03)


@pytest.mark.parametrize("name", ["two_stage_ins", "one_stage"])
def test_small_steps_lead_to_the_continuous_covariance(name: str) -> None:
    model, r, step = models()[name], 1e-4, 1e-4
    from_steps = predicted_covariance(discretised(model.A, model.Q, step), model.H, r / step)
    F, Q = discretised(model.A, model.Q, step)
    S = model.H @ from_steps @ model.H.T + r / step * np.eye(len(model.H))
    again = F @ (from_steps - from_steps @ model.H.T @ np.linalg.solve(S, model.H @ from_steps)) @ F.T + Q

    sigma = np.sqrt(np.diag(from_steps))
    np.testing.assert_allclose(again / np.outer(sigma, sigma), from_steps / np.outer(sigma, sigma), atol=1e-9)
    continuous = np.linalg.norm(
        predicted_covariance(discretised(model.A, model.Q, 1e-5), model.H, r / 1e-5) - from_steps
    )
    assert continuous < 0.02 * np.linalg.norm(from_steps)


def test_result_depends_on_the_seed_alone() -> None:
    model = models()["one_stage"]
    once, threaded, other = (
        slip_runs(model, LOOP, 25.0, SKY, runs=6, seconds=4.0, seed=seed, threads=threads)
        for seed, threads in ((1, 1), (1, 2), (2, 1))
    )

    assert np.array_equal(once.first_slip_s, threaded.first_slip_s)
    assert once.rms_rad == threaded.rms_rad or math.isnan(once.rms_rad)
    assert not np.array_equal(once.first_slip_s, other.first_slip_s)


@pytest.mark.parametrize("kind", ["Q", "atan", "sign(I)Q"])
def test_every_discriminator_holds_a_strong_signal(kind: str) -> None:
    loop = PhaseLoop(discriminator(kind), 1.022e6, T)
    found = slip_runs(models()["two_stage"], loop, 45.0, SKY, runs=4, seconds=5.0)

    assert found.lost_runs == 0.0


@pytest.mark.parametrize(
    ("key", "call"),
    [
        ("cn0_dbhz", lambda: error_loop(models()["one_stage"], LOOP, -11.0, SKY)),
        ("directions", lambda: error_loop(models()["one_stage"], LOOP, 30.0, SKY[:6])),
        ("directions", lambda: error_loop(models()["two_stage"], LOOP, 30.0, SKY[:3])),
        ("runs", lambda: slip_runs(models()["two_stage"], LOOP, 30.0, SKY, runs=0)),
        ("threads", lambda: slip_runs(models()["two_stage"], LOOP, 30.0, SKY, threads=0)),
        ("seconds", lambda: slip_runs(models()["two_stage"], LOOP, 30.0, SKY, seconds=math.nan)),
        ("seed", lambda: slip_runs(models()["two_stage"], LOOP, 30.0, SKY, seed=-1)),
        ("drift", lambda: channel_model(UnknownAcceleration(1.0, 1.0), -1.0, CARRIER_HZ)),
    ],
)
def test_bad_input_is_refused_with_its_key(key: str, call: object) -> None:
    with pytest.raises(ConfigError) as refused:
        call()  # type: ignore[operator]

    assert refused.value.key == key
    assert refused.value.advice
