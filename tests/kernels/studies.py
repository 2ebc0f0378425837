"""Sample calls of the kernels in ``insgnss.studies``."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from insgnss.antenna.obstruction import directions
from insgnss.config.library import imu_grade
from insgnss.inertial.error_dynamics import COUPLING_DTYPE, step_space
from insgnss.interference import PhaseLoop, UnknownAcceleration, discriminator, receiver_models
from insgnss.simulation.closed_loop_sky import closed_loop_truth, inertial_truth, orbits_towards
from insgnss.simulation.trajectory import Trajectory
from insgnss.studies.receiver.estimated_cn0 import newest_moments
from insgnss.studies.receiver.manoeuvring_covariance import Drive, carry_along
from insgnss.studies.receiver.options import ReceiverOptions
from insgnss.studies.receiver.runs import Setting, run_once
from insgnss.studies.receiver.slips import NEVER, error_loop, run_errors
from insgnss.studies.receiver.variants import STARTS, VARIANTS
from insgnss.tracking.vector_loop import N_SEEN, channels_of, observe_channels
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
    drive = Drive(
        5e-3, np.full(17, 1e-9), np.full(17, 0.99), np.array([3e6, 2e6, 5e6]), rows, np.array([0, 1, 2, 15])
    )
    force, C_eb = 30.0 * rng.standard_normal((20, 3)), np.linalg.qr(rng.standard_normal((20, 3, 3)))[0]
    P, found = 1e-2 * np.eye(17), np.empty((20, 6))
    couplings = np.zeros(0, COUPLING_DTYPE)
    carry_along(
        drive,
        force,
        np.ascontiguousarray(5e-3 * C_eb),
        1e-2,
        couplings,
        P,
        (step_space(17), np.zeros((3, 17))),
        found,
    )
    return [P, found]


def closed_loops() -> list[np.ndarray]:
    """Return what runs of every receiver leave, with and without phase tracking and INS, and signals that go."""
    hour = np.arange(0.0, 4.05, 0.05)
    r_e = np.array([2.85e6, 2.2e6, 5.27e6]) + np.column_stack([hour, 30.0 * np.sin(hour), hour**2])
    turns = Rotation.from_rotvec(np.outer(hour, [0.1, 0.2, -0.1]))
    trajectory = Trajectory.from_knots(hour, r_e, turns)
    sky = orbits_towards(r_e[0], [20.0, 110.0, 200.0, 290.0, 10.0], [22.0, 20.0, 35.0, 70.0, 50.0])
    truth = closed_loop_truth(trajectory, sky, 0.01, 1.0, 60)
    cn0 = np.full((60, 5), 42.0)
    cn0[52:, 1] = np.nan
    cn0[20:32] = np.nan  # without INS the cycle of the phases is open then
    found: list[np.ndarray] = []
    for tracking in ("coherent", "noncoherent"):
        for with_ins in (True, False):
            setting = Setting(
                truth=truth,
                inertial=inertial_truth(trajectory, truth, 0.01) if with_ins else None,
                grade=imu_grade("tactical") if with_ins else None,
                channels=channels_of(tracking, 0.01, 1.6e9, 1e6),
                drift_density=1.0,
                interval=5,
                record_every=10,
                settle=5,
                start=STARTS[tracking],
                options=ReceiverOptions(
                    carrier_hz=1.6e9, unknown_mps2=5.0, unknown_s=3.0, imu_gaps_s=((0.42, 0.46),)
                ),
            )
            for name in (
                ("scalar", "two_stage", "optimal", "one_stage")
                if with_ins
                else ("scalar", "optimal", "one_stage")
            ) + (("one_stage_code",) if tracking == "coherent" else ()):
                run = run_once(setting, VARIANTS[name], cn0, np.random.default_rng(4))
                found += [run.error, run.rms]
    seen, offsets = np.zeros((2, N_SEEN)), np.array([[0.01, 0.1, 3.0], [-0.01, 0.2, -4.0]])
    levels = np.array([2000, 2500])
    channels = channels_of("coherent", 0.01, 1.6e9, 1e6)
    observe_channels(channels, levels, levels, offsets, 0.1 * np.ones((2, 2)), seen)
    both = np.zeros((2, N_SEEN))
    observe_channels(channels._replace(with_code=True), levels, levels, offsets, 0.1 * np.ones((2, 6)), both)
    return [*found, seen, both]


def windows_of_power() -> list[np.ndarray]:
    """Return the windows of four channels' powers, three of which change, and their moments."""
    power = np.random.default_rng(6).exponential(2.0, (200, 4))
    power[180:, 1] *= 5.0
    power[40:, 2] *= 0.2
    power[196:, 3] *= 8.0
    count, moments = np.array([200, 200, 200, 60]), np.empty((2, 4))
    newest_moments(power, 4, count, moments)
    return [count, moments]


CASES = [
    # an error is a sum over all integrations, so rounding of sin and cos adds up
    KernelCase("tests.kernels.studies:error_states", rtol=1e-9),
    KernelCase("tests.kernels.studies:covariance_along", rtol=1e-12),
    # positions of 6e6 m, whose rounding is 1e-9 of the errors
    KernelCase("tests.kernels.studies:closed_loops", rtol=1e-4),
    KernelCase("tests.kernels.studies:windows_of_power", rtol=1e-12),
]
