"""Sample calls of the kernels in ``insgnss.studies``."""

from __future__ import annotations

import numpy as np

from insgnss.antenna.obstruction import directions
from insgnss.interference import PhaseLoop, UnknownAcceleration, discriminator, receiver_models
from insgnss.studies.receiver_loop import NEVER, error_loop, run_errors
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


# An error is a sum over all integrations, so rounding of sin and cos adds up
CASES = [KernelCase("tests.kernels.studies:error_states", rtol=1e-9)]
