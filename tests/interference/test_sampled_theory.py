"""The linear theory of integrations of a length: it tends to the continuous one, and is what a recursion gives."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.antenna.obstruction import directions
from insgnss.interference import (
    PhaseLoop,
    UnknownAcceleration,
    discriminator,
    one_stage_velocity_mps,
    phase_rms_rad,
    receiver_models,
    two_stage_velocity_mps,
)
from insgnss.interference.linear_threshold import (
    sampled_filter,
    sampled_one_stage_velocity_mps,
    sampled_phase_rms_rad,
    sampled_two_stage_velocity_mps,
)
from insgnss.interference.phase_models import FREQUENCY, VELOCITY
from insgnss.interference.riccati import discretised

CARRIER_HZ, CN0_DBHZ = 1.6e9, 40.0
SKY = directions([20, 65, 110, 155, 200, 245, 290, 335], [12, 40, 20, 65, 15, 35, 70, 25])
MODELS = receiver_models(
    UnknownAcceleration(49.03, 1.0 / 0.3), UnknownAcceleration(0.06, 100.0, 0.1, 1e-3), 100.0, CARRIER_HZ, SKY
)


def loop(step_s: float) -> PhaseLoop:
    """Return a loop whose discriminator's noise does not depend on the integration."""
    return PhaseLoop(discriminator("Q", 0.076), 1.022e6, step_s)


@pytest.mark.parametrize("name", MODELS)
def test_short_integrations_lead_to_the_continuous_theory(name: str) -> None:
    model, short = MODELS[name], loop(1e-5)
    found = sampled_filter(model, short, CN0_DBHZ)

    assert sampled_phase_rms_rad(model, found) == pytest.approx(
        phase_rms_rad(model, short, CN0_DBHZ), rel=1e-3
    )
    if name.startswith("one"):
        velocity = sampled_one_stage_velocity_mps(model, found)
        assert velocity == pytest.approx(one_stage_velocity_mps(model, short, CN0_DBHZ), rel=1e-3)
    else:
        velocity = sampled_two_stage_velocity_mps(model, found, 1e-5, SKY, CARRIER_HZ)
        wanted = two_stage_velocity_mps(model, short, CN0_DBHZ, SKY, CARRIER_HZ)
        assert velocity == pytest.approx(wanted, rel=1e-3)


def test_errors_are_those_of_a_recursion_and_differ_before_and_after_an_update() -> None:
    T, r = 5e-3, 0.5 / (10.0 ** (0.1 * CN0_DBHZ) * 5e-3)
    one, alone = MODELS["one_stage"], MODELS["two_stage"]
    F, Q = discretised(one.A, one.Q, T)
    P = np.diag([1.0] * 3 + [1.0] * 3 + [49.03**2] * 3 + [1.0, 1.0])
    for _ in range(4000):
        before = F @ P @ F.T + Q
        K = before @ one.H.T @ np.linalg.inv(one.H @ before @ one.H.T + r * np.eye(8))
        P = before - K @ one.H @ before
        P = 0.5 * (P + P.T)
    found = sampled_filter(one, loop(T), CN0_DBHZ)

    assert sampled_phase_rms_rad(one, found) == pytest.approx(
        np.sqrt(np.diag(one.H @ before @ one.H.T)), rel=1e-6
    )
    velocity = np.sqrt(np.trace(P[VELOCITY, VELOCITY]))
    assert sampled_one_stage_velocity_mps(one, found) == pytest.approx(velocity, rel=1e-6)
    # noise, acceleration and oscillator of a channel add up to its covariance after the update
    found = sampled_filter(alone, loop(T), CN0_DBHZ)
    left = np.eye(3) - found.K @ alone.H
    F, Q = discretised(alone.A, alone.oscillator, T)
    clock = np.zeros((3, 3))
    for _ in range(4000):
        clock = left @ (F @ clock @ F.T + Q) @ left.T
    k = 2.0 * np.pi * CARRIER_HZ / 299_792_458.0
    U = np.column_stack([-SKY, np.ones(8)])
    dilution = np.trace(np.linalg.inv(U.T @ U)[:3, :3])
    F, Q = discretised(alone.A, alone.motion, T)
    motion = np.zeros((3, 3))
    for _ in range(4000):
        motion = left @ (F @ motion @ F.T + Q) @ left.T
    noise = (left @ found.P - clock - motion)[FREQUENCY, FREQUENCY]
    wanted = np.sqrt(noise * dilution + 3.0 * motion[FREQUENCY, FREQUENCY]) / k
    assert sampled_two_stage_velocity_mps(alone, found, T, SKY, CARRIER_HZ) == pytest.approx(wanted, rel=1e-6)
