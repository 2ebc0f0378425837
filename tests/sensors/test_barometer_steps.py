"""A window that opens beside the barometer while GNSS is gone: the height keeps what the inertial sensors say."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import insgnss
from insgnss.runs.result import Run
from insgnss.simulation.faults import outage
from tests.runs.scenes import START_S, kinds, true_start, with_faults
from tests.sensors.scenes import city_car, fault, flown, simulated, with_sensors

GONE_S = (70.0, 130.0)
OPEN_S = {"in the outage": (75.0, 95.0), "to the end": (80.0, 131.0), "from before it": (60.0, 100.0)}
SEEDS = range(2)


@cache
def tunnel(
    open_s: tuple[float, float] | None, seed: int, *, smooth: bool = False, size_hpa: float = 1.0
) -> Run:
    base = with_faults(city_car(), [outage(None, *GONE_S)])
    draught = [] if open_s is None else [fault("draught", *open_s, size_hpa=size_hpa)]
    base = with_sensors(base, [simulated("barometer", rate_hz=2.0)], draught)
    return insgnss.replay(flown(base, 100 + seed, true_start(base, 2.0)), output=1.0, smooth=smooth)


def heights(run: Run) -> Any:
    assert run.errors is not None
    return run.errors[run.errors["time_s"].between(START_S + 40.0, START_S + GONE_S[1])]


@pytest.mark.parametrize("size_hpa", [1.0, -4.0])
@pytest.mark.parametrize("when", OPEN_S)
def test_height_hardly_moves_whenever_the_window_opens(when: str, size_hpa: float) -> None:
    """1 hPa is 8.5 m. The gate took it once the prediction was vague: 45 m and 12 sigma."""
    for seed in SEEDS:
        run = tunnel(OPEN_S[when], seed, size_hpa=size_hpa)
        late, sound = heights(run), heights(tunnel(None, seed))  # of the same draw
        moved, sigma, sound_sigma = (
            late["d_d_m"].to_numpy() - sound["d_d_m"].to_numpy(),
            late["sd_d_m"].to_numpy(),
            sound["sd_d_m"].to_numpy(),
        )
        lost2 = np.maximum(sigma**2 - sound_sigma**2, 0.0)  # what less information adds to the variance
        assert (moved**2 < 4.0**2 * (lost2 + 0.2**2)).all()
        assert sigma.max() < 1.2 * sound_sigma.max()
        assert "sensor_stepped" in kinds(run)


def test_smoothed_height_does_not_carry_the_step_back() -> None:
    for seed in SEEDS:
        stepped, sound = (
            heights(tunnel(open_s, seed, smooth=True))["d_d_m"].to_numpy()
            for open_s in (OPEN_S["in the outage"], None)
        )
        assert abs(stepped - sound).max() < 1.0


def test_single_wrong_reading_leaves_the_offset_as_it_was() -> None:
    run, sound = tunnel((80.0, 80.6), 0), tunnel(None, 0)
    assert "sensor_stepped" not in kinds(run)
    assert (run.measurements["status"] == "gated").sum() == (
        sound.measurements["status"] == "gated"
    ).sum() + 2
    assert run.nav["sd_barometer_offset_m"].iloc[-1] < 1.02 * sound.nav["sd_barometer_offset_m"].iloc[-1]
