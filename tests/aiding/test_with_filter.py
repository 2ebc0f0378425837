"""The aiding of a real filter against the truth of the simulation it ran on: does the sigma cover the error."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.aiding.table import AidingSetup, AidingTable, compute_aiding
from insgnss.aiding.trace import Covariances, Trace, TraceSamples
from insgnss.config.aiding import AidingConfig
from insgnss.filter.loop import ImuSamples
from insgnss.filter.navigator import Navigator
from insgnss.filter.output.writing import new_output
from insgnss.gnss.observation_rows import prepare_rows
from insgnss.inertial.clock_model import clock_model
from insgnss.inertial.sensor_model import sensor_model
from insgnss.simulation.simulated_log import SimulatedLog
from insgnss.tables import Float64
from tests.aiding.exact import SIGNALS, sky_arcs, true_derivatives
from tests.runs.matched_runs import (
    CLOCK_TYPE,
    GRADE,
    LEVER_ARM_B,
    matched_setup,
    matched_simulator,
    opened_bank,
)
from tests.runs.scenes import START_NS
from tests.statistics_bounds import mean_chi_square_bounds

EPOCHS = tuple(range(30, 115, 3))
N_RUNS = 6


def traced_run(log: SimulatedLog, rng: np.random.Generator) -> AidingTable:
    """Return the aiding at some epochs of a filter's run, with its own state and covariance there."""
    setup = matched_setup()
    use = setup.config.measurements
    rows = prepare_rows(
        log.gnss, setup.navigation, None, clock_groups=setup.clock_groups, signals=dict(use.signals)
    )
    out = new_output(rows, len(rows.epoch_ns), 64, np.zeros(0, np.int64))
    imu = ImuSamples(log.imu.t_ns, log.imu.w_ib_b, log.imu.f_b)
    navigator = Navigator(setup)
    navigator.bank = opened_bank(log, rng)
    navigator.started_ns = int(log.at_gnss.t_ns[0])
    states, covariances, times = [], [], []
    done = 1
    for epoch in EPOCHS:
        navigator.run(imu, rows, done, epoch + 1, out)
        done = epoch + 1
        assert navigator.bank is not None
        states.append(navigator.bank.state[0].copy())
        covariances.append(navigator.bank.P[0, :17, :17].copy())
        times.append(int(navigator.bank.head["now_ns"][0]))
    t_ns = np.array(times, np.int64)
    column = {
        name: np.array([s[name] for s in states]) for name in ("r_e", "v_e", "C_eb", "b_a", "b_g", "clock")
    }
    sample = np.searchsorted(log.imu.t_ns, t_ns)
    np.testing.assert_array_equal(log.imu.t_ns[sample], t_ns)
    trace = Trace(t_ns, sample, offset=np.zeros((len(t_ns), 0)), **column)
    return compute_aiding(
        aiding_setup(), sky_arcs(), trace, TraceSamples(*imu[:3]), Covariances(t_ns, np.array(covariances))
    )


def aiding_setup() -> AidingSetup:
    """Return a setup whose satellites are exact, as the simulation's are; one sample's slope."""
    config = AidingConfig(
        signals=SIGNALS,
        horizon_deg=-90.0,
        slope_samples=1,
        satellite_range_sigma_m=0.0,
        satellite_rate_sigma_mps=0.0,
        satellite_acceleration_sigma_mps2=0.0,
    )
    return AidingSetup(config, sensor_model(GRADE), clock_model(CLOCK_TYPE), LEVER_ARM_B, troposphere=False)


@pytest.fixture(scope="module")
def scaled_errors() -> dict[str, Float64]:
    """Return errors over their sigma, (runs, epochs, satellites), of range rate and acceleration."""
    simulator = matched_simulator()
    found: dict[str, list[Float64]] = {"rate": [], "acceleration": []}
    for run in range(N_RUNS):
        rng = np.random.default_rng(100 + run)
        table = traced_run(simulator.draw(rng), rng)
        t_s = (table.t_ns - START_NS) / 1e9
        rate, acceleration, _ = true_derivatives(simulator.scenario.trajectory, t_s, LEVER_ARM_B)
        shape = rate.shape
        sigma = table.sigma.reshape(*shape, -1)
        found["rate"].append((table.values.range_rate.reshape(shape) - rate) / sigma[..., 1])
        found["acceleration"].append(
            (table.values.acceleration.reshape(shape) - acceleration) / sigma[..., 2]
        )
    return {name: np.array(values) for name, values in found.items()}


@pytest.mark.parametrize("kind", ["rate", "acceleration"])
def test_sigma_covers_the_error_of_a_filter_within_computed_bounds(
    scaled_errors: dict[str, Float64], kind: str
) -> None:
    square = scaled_errors[kind] ** 2
    # eleven directions of a vector of three: three independent ones an epoch; the velocity error is that of a second
    # ago for a good part, of the acceleration the samples' white noise is most: a third of the epochs count
    low, high = mean_chi_square_bounds(1, N_RUNS * len(EPOCHS), effective_share=3.0 / 3.0)
    assert low <= square.mean() <= high, f"mean of squared errors over variance {square.mean():.3f}"
    assert np.mean(square < 9.0) > 0.98
