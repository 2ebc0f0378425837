"""Sample calls of the kernels in ``insgnss.inertial``."""

from __future__ import annotations

import numpy as np

from insgnss.inertial.alignment import inertial_window
from insgnss.inertial.error_dynamics import COUPLING_DTYPE, apply_transition, transition_step
from insgnss.inertial.error_state import BG, FURTHER
from tests.kernels import KernelCase

_MECHANIZATION = "insgnss.inertial.mechanization"
_W = np.array([0.3, -0.2, 0.5])
_F = np.array([1.0, -2.0, -9.5])
_Q_EB = np.array([0.5, -0.1, 0.7, 0.5])  # of length one
_C_EB = np.array([[-0.48, -0.64, 0.6], [0.36, 0.48, 0.8], [-0.8, 0.6, 0.0]])
_R_E = np.array([-1_826_000.0, -3_121_000.0, 5_238_000.0])
_V_E = np.array([10.0, -20.0, 5.0])

_SAMPLES = np.outer(np.sin(np.arange(30.0)), [1.0, 2.0, -1.0])


def window() -> tuple[float, np.ndarray, np.ndarray, float, float]:
    """Return the means of a turning sensor over 0.2 s."""
    t_ns = np.arange(30) * 10_000_000
    found = inertial_window(t_ns, 0.1 * _SAMPLES + _W, _SAMPLES + _F, 50_000_000, 250_000_000)
    assert found is not None
    return found.length_s, found.f_b, found.w_ib_b, found.spread_f, found.spread_w


def transition() -> np.ndarray:
    """Return Phi of a step with one further state, an error of gyro y."""
    couplings, Phi, keep = np.zeros(1, COUPLING_DTYPE), np.zeros((18, 18)), np.full(18, 0.9)
    couplings["at"], couplings["bias"], couplings["factor"] = FURTHER, BG + 1, 0.5
    step = transition_step(0.02, 0.1, -0.2, 0.15, _R_E)
    apply_transition(step, _C_EB * 0.02, couplings, keep, np.eye(18), Phi)
    return Phi


CASES = [
    KernelCase("tests.kernels.inertial:window"),
    KernelCase(
        "insgnss.inertial.increments:effective_rates",
        (_W, _F, 0.9 * _W, 1.1 * _F, 0.005, 0.006, np.zeros(3), np.zeros(3)),
    ),
    KernelCase(f"{_MECHANIZATION}:rotation_integral", (0.01, -0.02, 0.03), label="series"),
    KernelCase(f"{_MECHANIZATION}:rotation_integral", (1.0, -0.2, 0.3), label="trigonometry"),
    KernelCase(f"{_MECHANIZATION}:turn_attitude", (_Q_EB, _C_EB, _W, 0.005)),
    KernelCase(
        f"{_MECHANIZATION}:mechanize",
        (_Q_EB, _C_EB, _R_E, _V_E, _W, _F, 0.005, np.zeros(3)),
    ),
    KernelCase("tests.kernels.inertial:transition"),
]
