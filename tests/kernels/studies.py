"""Sample calls of the kernels in ``insgnss.studies``."""

from __future__ import annotations

import numpy as np

from insgnss.antenna.obstruction import directions
from insgnss.inertial.error_dynamics import COUPLING_DTYPE
from insgnss.interference import PhaseLoop, UnknownAcceleration, discriminator, receiver_models
from insgnss.studies.manoeuvring_covariance import Drive, carry_along
from insgnss.studies.receiver_slips import NEVER, error_loop, run_errors
from tests.kernels import KernelCase


def error_states() -> list[np.ndarray]:
    """Return errors, slips and squares of a two-stage and a one-stage receiver near their thresholds."""
    sky = directions([20.0, 110.0, 200.0, 290.0, 10.0], [12.0, 20.0, 15.0, 70.0, 60.0])
    motion, error = UnknownAcceleration(49.0, 3.3), UnknownAcceleration(0.06, 100.0, 0.1)
    loop = PhaseLoop(discriminator("IQ", 0.076), 1.022e6, 5e-3)
    found: list[np.ndarray] = []
    for name, model in receiver_models(motion, error, 100.0, 1.6e9, sky).items():
        receiver = error_loop(model, loop, 26.0 if "ins" not in name else 20.0, sky)
        x, slips, squares = np.zeros((2, len(receiver.F))), np.full(5, NEVER), np.zeros(5)
        draws = np.random.default_rng(9).standard_normal((100, 10 + receiver.L.shape[1]))
        run_errors(receiver, draws, 0, x, np.zeros(5), slips, squares)
        found += [x, slips, squares]
    return found


def covariance_along() -> list[np.ndarray]:
    """Return a covariance of 17 states after a short motion, and the variances on its way."""
    rng = np.random.default_rng(10)
    sky = directions([20.0, 110.0, 200.0, 290.0], [12.0, 20.0, 15.0, 70.0])
    rows = np.column_stack([-33.0 * sky, np.full(4, 33.0)])
    drive = Drive(5e-3, np.full(17, 1e-9), np.full(17, 0.99), np.array([3e6, 2e6, 5e6]), rows)
    force, C_eb = 30.0 * rng.standard_normal((20, 3)), np.linalg.qr(rng.standard_normal((20, 3, 3)))[0]
    P, scratch, found = 1e-2 * np.eye(17), (np.empty((17, 17)), np.zeros((3, 17))), np.empty((20, 6))
    couplings = np.zeros(0, COUPLING_DTYPE)
    columns = np.array([0, 1, 2, 15])
    carry_along(drive, force, np.ascontiguousarray(C_eb), 1e-2, columns, couplings, P, scratch, found)
    return [P, found]


CASES = [
    # an error is a sum over all integrations, so rounding of sin and cos adds up
    KernelCase("tests.kernels.studies:error_states", rtol=1e-9),
    KernelCase("tests.kernels.studies:covariance_along", rtol=1e-12),
]
