"""A filter of one hypothesis that only predicts: its numbers, its state, and a log to carry it over."""

from __future__ import annotations

from typing import Any

import numpy as np

from insgnss.config.filter import FilterConfig
from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.filter.parameters import resolve_parameters
from insgnss.filter.state import Bank, new_bank
from insgnss.geodesy.rotations import matrix_to_quaternion, quaternion_to_matrix

NOTHING_UNKNOWN = np.zeros((0, 2))  # of the motion that samples show
NO_CLOCK_NOISE = Oscillator(h0_s=0.0, h_minus2_per_s=0.0)


def parameters(grade: ImuGrade, oscillator: Oscillator = NO_CLOCK_NOISE, **changes: float) -> Any:
    """Return the filter's numbers for a sensor and a clock; ``changes`` replaces single ones by name."""
    config = FilterConfig.model_validate(
        {
            "pseudorange_noise_m": {"floor": 1.0, "elevation": 0.0, "cn0_at_45_dbhz": 0.0},
            "range_rate_noise_mps": {"floor": 0.1, "elevation": 0.0, "cn0_at_45_dbhz": 0.0},
        }
    )
    par = resolve_parameters(config, grade, oscillator, (0.0, 0.0, 0.0), False)
    for name, value in changes.items():
        par[name] = value
    return par[0]


def bank_at(C_eb: np.ndarray, r_e: np.ndarray, v_e: np.ndarray, sigma: np.ndarray) -> Bank:
    """Return a filter in a state with independent errors of ``sigma`` (n,)."""
    bank = new_bank(1, len(sigma) - 17)
    m = bank.state[0]
    matrix_to_quaternion(C_eb, m.q_eb)
    quaternion_to_matrix(m.q_eb, m.C_eb)
    m.r_e[:], m.v_e[:] = r_e, v_e
    bank.P[0] = np.diag(sigma**2)
    return bank
