"""Hours of a cheap motion: an IMU on a table that turns once a minute, under a sky that stands still."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.filter.loop import ImuSamples
from insgnss.filter.state import Bank, copy_bank
from insgnss.geodesy.rotations import matrix_to_quaternion
from insgnss.gnss.observation_rows import GnssRows
from tests.filter.scene import (
    RANGE_SIGMA_M,
    RATE_SIGMA_MPS,
    START_NS,
    W_IE_E,
    attitude,
    new_filter,
    observed,
    place,
    rows_of,
    sky,
)

TURN_S = 60
RATE_RADPS = 2.0 * np.pi / TURN_S


class Turning(NamedTuple):
    """A filter on the truth at the start, the samples and one epoch a second."""

    bank: Bank
    imu: ImuSamples
    rows: GnssRows


def turning(par: npt.NDArray[Any], seconds: int, imu_hz: int, rng: np.random.Generator) -> Turning:
    """Return so many seconds of turning; the sensors have the white noise of ``par``, the rows that of the scene."""
    at = place()
    bank = new_filter(at, clock=(0.0, 0.0))
    w_b, f_b = one_turn(imu_hz)
    turns = seconds // TURN_S + 1
    n = turns * TURN_S * imu_hz
    # the sample that ends at the start comes first; only its time counts
    w = np.concatenate([w_b[-1:], np.tile(w_b, (turns, 1))])
    f = np.concatenate([f_b[-1:], np.tile(f_b, (turns, 1))])
    w += np.sqrt(par[0].gyro_density * imu_hz) * rng.normal(size=w.shape)
    f += np.sqrt(par[0].accel_density * imu_hz) * rng.normal(size=f.shape)
    t_ns = START_NS + np.arange(n + 1) * (NS_PER_S // imu_hz)
    epoch_ns = START_NS + np.arange(1, seconds + 1) * NS_PER_S
    values = np.tile(values_of_one_turn(bank, par), (turns, 1, 1))[1 : seconds + 1]
    values += rng.normal(size=values.shape) * [RANGE_SIGMA_M, RATE_SIGMA_MPS]
    return Turning(bank, ImuSamples(t_ns, w, f), rows_of(epoch_ns, sky(at), values))


def one_turn(imu_hz: int) -> tuple[np.ndarray, np.ndarray]:
    """Return mean rates and specific forces of one turn, each taken at the middle of its interval."""
    at, n = place(), TURN_S * imu_hz
    yaw = 2.0 * np.pi * (np.arange(n) + 0.5) / n
    c, s, o, i = np.cos(yaw), np.sin(yaw), np.zeros(n), np.ones(n)
    C_bn = np.moveaxis(np.array([[c, s, o], [-s, c, o], [o, o, i]]), 2, 0)
    return C_bn @ (at.C_ne @ W_IE_E) + [0.0, 0.0, RATE_RADPS], C_bn @ (at.C_ne @ at.f_e)


def values_of_one_turn(bank: Bank, par: npt.NDArray[Any]) -> np.ndarray:
    """Return (60, k, 2) pseudoranges and range rates at each second of a turn."""
    at, truth = place(), copy_bank(bank)
    values = []
    for second in range(TURN_S):
        m = truth.state[0]
        m.C_eb[:] = attitude(at, 0.0, 0.0, 360.0 * second / TURN_S)
        matrix_to_quaternion(m.C_eb, m.q_eb)
        w_ib_b = m.C_eb.T @ W_IE_E + [0.0, 0.0, RATE_RADPS]
        values.append(
            -observed(truth, par, rows_of([START_NS], sky(at)), 0, w_ib_b).lines["innovation"][:, :2]
        )
    return np.array(values)
