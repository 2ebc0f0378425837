"""One stage whose discriminators are white noise is the filter ``tight`` over a log of ranges and range rates."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insgnss.config.library import filter_config
from insgnss.constants import C_MPS
from insgnss.filter.parameters import resolve_parameters
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.state import DR, DV, Bank, copy_bank, new_bank
from insgnss.gnss.line_of_sight import line_of_sight
from insgnss.status import USED
from insgnss.studies.receiver import loop
from insgnss.studies.receiver.runs import channel_room, new_found
from insgnss.studies.receiver.settling import NoErrors
from insgnss.studies.receiver.variants import (
    STARTS,
    VARIANTS,
    TrueStart,
    filter_room,
    oscillator_of,
    receiver_of,
)
from insgnss.studies.receiver.workspace import AidingInputs, FilterRoom, SignalArrivals
from insgnss.tables import Float64
from insgnss.tracking.vector_loop import (
    RANGE_VARIANCE,
    RATE_VARIANCE,
    SEEN_RANGE,
    SEEN_RATE,
    ChannelConstants,
    channels_of,
    levels_of,
    noise_count,
)
from tests.filter.scene import START_NS, attitude, place, rows_of, run, sky, steady_force
from tests.studies.test_receiver_study import LOW

T_NS: Final = 10_000_000
T_S: Final = 1e-9 * T_NS
COUNT: Final = 100
CARRIER_HZ: Final = 1.6e9
OSCILLATOR: Final = oscillator_of(100.0, CARRIER_HZ)
# a clock that is known to a millimetre
START: Final = replace(STARTS["noncoherent"], clock_m=1e-3, drift_mps=1e-3)
CHANNELS: Final = channels_of("noncoherent", T_S, CARRIER_HZ, 0.511e6)
LEVEL: Final = levels_of(40.0)
VARIANCES: Final = CHANNELS.table[LEVEL, [RANGE_VARIANCE, RATE_VARIANCE]]
# in body axes both are constant: the log's samples are then free of coning and sculling, which the filter takes out
# and the laboratory does not
C_EB: Final = attitude(place(), 10.0, -5.0, 40.0)
RATE_B: Final = 0.6 * C_EB.T @ place().C_ne[2]  # about the vertical: at rest no force turns
PULL_B: Final = np.array([10.0, 20.0, -30.0])


class Flown(NamedTuple):
    """What arrives at the antenna, and what the inertial system says."""

    satellites: Float64  # (n, m, 8)
    ranges: Float64  # (n, m)
    rates: Float64  # (n, m)
    force_b: Float64  # (3,)


def filter_of(begin: TrueStart, rng: np.random.Generator) -> FilterRoom:
    """Return the filter of the one-stage receiver."""
    return filter_room(LOW, OSCILLATOR, START, begin, rng, True)


def bank_of(f: FilterRoom) -> Bank:
    """Return a copy of a filter as a bank of one, at the time of the log's first epoch."""
    empty = new_bank(1, 0)
    bank = copy_bank(empty._replace(state=f.state, P=f.P[None]))
    bank.head["now_ns"], bank.head["next"] = START_NS, 1
    return bank


def flown(begin: TrueStart, pull_b: Float64) -> Flown:
    """Return the way of a vehicle that turns and pulls, along the filter's own mechanization without errors."""
    truth = filter_of(begin, NoErrors())
    m, states = truth.state[0], sky(place())
    states[:, 6:] = 0.0
    force_b = steady_force(m) + pull_b
    satellites = np.repeat(states[None], COUNT, axis=0)
    satellites[:, :, :3] += T_S * np.arange(COUNT)[:, None, None] * states[:, 3:6]
    ranges, rates = np.zeros((2, COUNT, len(states)))
    for k in range(COUNT):
        if k:
            loop.lead_filter(truth, RATE_B, force_b, T_S, np.zeros(2))
        for c in range(len(states)):
            distance, rate = line_of_sight(satellites[k], c, m.r_e, m.v_e, np.zeros(3), np.zeros(3))
            ranges[k, c], rates[k, c] = distance + m.clock[0], rate + m.clock[1]
    return Flown(satellites, ranges, rates, force_b)


def white(
    channels: ChannelConstants, arriving: int, told: int, offset: Float64, noise: Float64, seen: Float64
) -> None:
    """Stand in for ``observe_channel``: discriminators that are linear for any offset, in white noise."""
    seen[:] = 0.0
    seen[SEEN_RANGE] = offset[0] + math.sqrt(channels.table[told, RANGE_VARIANCE]) * noise[0]
    seen[SEEN_RATE] = offset[1] + math.sqrt(channels.table[told, RATE_VARIANCE]) * noise[1]


def one_stage(f: FilterRoom, of: Flown, noise: Float64) -> None:
    """Run the one-stage receiver, interpreted: its compiled loop would call the true discriminators."""
    m = of.ranges.shape[1]
    receiver = receiver_of(VARIANTS["one_stage"], T_S, 10, 1.0, None, (1e9, 1e9, 0), 1, 0)
    level = np.full((COUNT, m), LEVEL)
    told = AidingInputs(
        of.satellites, np.tile(RATE_B, (COUNT, 1)), np.tile(of.force_b, (COUNT, 1)), np.zeros((COUNT, 6)), level,
        np.zeros((COUNT, 2)),
    )  # fmt: skip
    room = channel_room(receiver, of.ranges[0], of.rates[:2], START, np.random.default_rng(1), T_S)
    arriving = SignalArrivals(of.ranges, of.rates, level, np.zeros((COUNT, m)))
    interpreted = getattr(loop.run_receiver, "py_func", loop.run_receiver)
    interpreted(receiver, CHANNELS, arriving, told, f, room, noise, new_found(receiver, COUNT, m, COUNT))


def tight(bank: Bank, of: Flown, noise: Float64) -> None:
    """Run the loop over a log with the filter ``tight``: no air, sound rows, the same white noise for all."""
    alone = {"elevation": 0.0, "cn0_at_45_dbhz": 0.0, "correlation_time_s": 0.0}
    config = filter_config(
        "tight",
        {
            "pseudorange_noise_m": {"floor": math.sqrt(VARIANCES[0]), **alone},
            "range_rate_noise_mps": {"floor": math.sqrt(VARIANCES[1]), **alone},
            "measurements": {"elevation_mask_deg": -90.0, "ionosphere": "none", "troposphere": "none"},
            "process": {"motion_sigma": 0.0, "covariance_step_s": T_S},
            "adaptation": {"on": False},
            "faults": {"residual_sigma": 0.0, "drift_sigma": 0.0, "reflected_below_db": 0.0},
            "health": {"recovery": False},
        },
    )
    par = resolve_parameters(config, LOW, OSCILLATOR, (0.0, 0.0, 0.0), False)
    epochs_ns = START_NS + T_NS * np.arange(COUNT)
    value = np.stack([of.ranges, of.rates], axis=2) + np.sqrt(VARIANCES) * noise[:, :, :2]
    samples = np.ones((COUNT + 1, 1))
    imu = ImuSamples(
        np.concatenate([epochs_ns[:1] - T_NS, epochs_ns]), samples * RATE_B, samples * of.force_b
    )
    bank.head["next"] = 2
    result = run(bank, rows_of(epochs_ns, of.satellites, value), imu, par)
    assert result.code == 0
    assert (result.out.ledger["status"][:, :2] == USED).all()


def both(v_n: tuple[float, float, float], pull_b: Float64, clock_m: float) -> tuple[FilterRoom, Bank]:
    """Return the one-stage receiver's filter and that of the log after one second."""
    rng, at = np.random.default_rng(41), place()
    begin = TrueStart(at.r_e, at.C_ne.T @ np.array(v_n), C_EB, clock_m, 0.0, np.zeros(3))
    of, f = flown(begin, pull_b), filter_of(begin, rng)
    bank, before = bank_of(f), f.P.copy()
    noise = rng.standard_normal((COUNT, of.ranges.shape[1], noise_count(CHANNELS)))
    one_stage(f, of, noise)
    tight(bank, of, noise)
    assert (np.diag(f.P)[DR : DR + 3] < 0.1 * np.diag(before)[DR : DR + 3]).all()
    assert (np.diag(f.P)[DV : DV + 3] < 0.1 * np.diag(before)[DV : DV + 3]).all()
    return f, bank


def test_one_stage_in_white_noise_is_the_filter_of_a_log_of_ranges_and_rates(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(loop, "observe_channel", white)
    f, bank = both((0.0, 0.0, 0.0), np.zeros(3), 0.0)
    one, log, sd = f.state[0], bank.state[0], np.sqrt(np.diag(f.P))

    apart = np.concatenate(
        [
            one.r_e - log.r_e,
            one.v_e - log.v_e,
            Rotation.from_matrix(one.C_eb @ log.C_eb.T).as_rotvec(),
            one.b_a - log.b_a,
            one.b_g - log.b_g,
            one.clock - log.clock,
        ]
    )
    assert np.abs(apart / sd).max() < 1e-9  # 6e6 m are rounded to 9e-10 m, a sigma is 1.4 m
    assert np.abs((f.P - bank.P[0]) / np.outer(sd, sd)).max() < 1e-9


def test_filter_of_a_log_knows_that_a_late_clock_dates_its_ranges_late_and_one_stage_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(loop, "observe_channel", white)
    f, bank = both((120.0, 160.0, 5.0), PULL_B, 3.0)
    one, log = f.state[0], bank.state[0]

    # 3 m of clock are 1e-8 s, 213 m/s make 2 um of them; the filter's mean over a second lags by 15 m/s of 213 m/s
    late_m = 3.0 / C_MPS * log.v_e
    assert log.r_e - one.r_e == pytest.approx(late_m, abs=0.1 * float(np.linalg.norm(late_m)))
    sd = np.sqrt(np.diag(f.P))
    # what is left is second order: 5e-6 sigmas of velocity turn the rows of H
    assert np.abs((f.P - bank.P[0]) / np.outer(sd, sd)).max() < 1e-8
