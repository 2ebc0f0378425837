"""What the visibility stage decides in attitudes that it does not know for certain, setting by setting.

The scenario's sky and antenna, in all headings and banks of a grid: the filter's heading is off by an error of its own
sigma, level is known. Which satellites the airframe hides follows from the true attitude.

| column | |
|--------|-|
| uncertain | the setting ``visibility.uncertain`` |
| decisions | satellites over attitudes and heading errors |
| undecided | of them within the margin |
| kept_although_hidden | in use though the antenna does not see them: reflections and false locks |
| hidden_although_visible | not in use though the antenna sees them |
| attitudes_with_hidden | attitudes and errors with at least one hidden satellite in use |
| deepest_db | the lowest gain of a satellite in use, below the threshold |
| kept_hidden_sigma_m, kept_visible_sigma_m | what noise, beside a range's own, those within the margin have on average (rms) |
| error_rms_m, error_max_m | what a position from the ranges in use alone is off by, one sigma, over the attitudes with something undecided |
| error_kept_m, error_lost_m | rms of it where hidden satellites are in use, and where only visible ones are lost |

A hidden satellite's range is off by the scenario's reflections. There the cost of either mistake can be read off.
"""  # noqa: E501 - the table is the documentation

from __future__ import annotations

from typing import Any, Final, get_args

import numpy as np
import pandas as pd
from scipy import stats

from insgnss.antenna.equipment import limits_of
from insgnss.antenna.installation import Installation
from insgnss.antenna.visibility import (
    DEWEIGHT,
    IS_UNCERTAIN,
    IS_VISIBLE,
    Looks,
    VisibilityLimits,
    look_at_all,
    new_looks,
)
from insgnss.config.filter import Visibility
from insgnss.config.scenario import ScenarioConfig
from insgnss.geodesy.directions import directions
from insgnss.geodesy.rotations import euler_to_matrix
from insgnss.studies.scenario_equipment import installation_of, visibility_of
from insgnss.tables import Bool, Float64, Int8

HEADINGS_DEG: Final = np.arange(0.0, 360.0, 15.0)
BANKS_DEG: Final = np.arange(-75.0, 76.0, 15.0)
_STEADY_BELOW_M: Final = 100.0
_ERRORS: Final = 9  # equally likely ones of the heading, each in the middle of its share


def decision_table(scenario: ScenarioConfig, heading_sigma_deg: float | None = None) -> pd.DataFrame:
    """Return the table; the heading's sigma is that of the scenario's start when None.

    Each satellite is evaluated for the first time, as after a turn without decisions.
    """
    sigma = np.radians(scenario.start.sd_heading_deg if heading_sigma_deg is None else heading_sigma_deg)
    antennas, settings = installation_of(scenario), visibility_of(scenario)
    quantiles = stats.norm.ppf((np.arange(_ERRORS) + 0.5) / _ERRORS) * sigma
    rpy = [(np.radians(b), np.radians(h), e) for h in HEADINGS_DEG for b in BANKS_DEG for e in quantiles]
    C_nb = np.array([_attitude(bank, heading) for bank, heading, _ in rpy])
    C_true = np.array([_attitude(bank, heading + error) for bank, heading, error in rpy])
    # level is known, the rotation about the vertical is not
    P_b = sigma**2 * C_nb[:, 2, :, None] * C_nb[:, 2, None, :]
    limits = limits_of(settings)
    true_gain = _look(antennas, limits, scenario, C_true, np.zeros_like(P_b))[1][..., 0]
    rows = [
        _row(antennas, settings.model_copy(update={"uncertain": name}), scenario, C_nb, P_b, true_gain)
        for name in get_args(Visibility.model_fields["uncertain"].annotation)
    ]
    return pd.DataFrame(rows)


def _row(
    antennas: Installation,
    settings: Visibility,
    scenario: ScenarioConfig,
    C_nb: Float64,
    P_b: Float64,
    true_gain: Float64,
) -> dict[str, Any]:
    limits = limits_of(settings)
    decision, gain = _look(antennas, limits, scenario, C_nb, P_b)
    used, hidden = (decision & IS_VISIBLE) != 0, true_gain < limits.threshold_dbic
    undecided = (decision & IS_UNCERTAIN) != 0
    added_m2 = np.where(limits.uncertain == DEWEIGHT, gain[..., 2] * limits.false_range2, 0.0)

    wrong, lost = used & hidden, ~used & ~hidden
    variance, false_m2 = scenario.measurements.range_variance_m2, _reflection_m2(scenario)
    error = position_sigma(
        _directions(scenario), used, variance + added_m2, variance + np.where(hidden, false_m2, 0.0)
    )
    doubtful = undecided.any(axis=1) & np.isfinite(error)
    kept, short = doubtful & wrong.any(axis=1), doubtful & lost.any(axis=1) & ~wrong.any(axis=1)
    return {
        "uncertain": settings.uncertain,
        "decisions": decision.size,
        "undecided": int(undecided.sum()),
        "kept_although_hidden": int(wrong.sum()),
        "hidden_although_visible": int(lost.sum()),
        "attitudes_with_hidden": int(wrong.any(axis=1).sum()),
        "deepest_db": float((limits.threshold_dbic - true_gain[wrong]).max(initial=0.0)),
        "kept_hidden_sigma_m": _rms(np.sqrt(added_m2[wrong & undecided])),
        "kept_visible_sigma_m": _rms(np.sqrt(added_m2[used & ~hidden & undecided])),
        "error_rms_m": _rms(error[doubtful]),
        "error_max_m": float(error[doubtful].max(initial=0.0)),
        "error_kept_m": _rms(error[kept]),
        "error_lost_m": _rms(error[short]),
    }


def _rms(values: Float64) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _reflection_m2(scenario: ScenarioConfig) -> float:
    """Return the mean square of the offsets of the scenario's steady false locks of less than 100 m [m^2]."""
    steady = [lock.offset_m for lock in scenario.false_locks if 0.0 < max(lock.offset_m) < _STEADY_BELOW_M]
    return float(np.mean([(a * a + a * b + b * b) / 3.0 for a, b in steady]))


def position_sigma(u_n: Float64, used: Bool, assumed_m2: Float64, true_m2: Float64) -> Float64:
    """Return one sigma of the position from ranges of one epoch alone, (n,) [m]; NaN where they fix none.

    Equation: G = (H^T W H)^-1 H^T W with the assumed variances, G R G^T with the true mean squares, R diagonal

    Parameters
    ----------
    u_n : (s, 3) unit lines of sight
    used : (n, s)
    assumed_m2, true_m2 : (n, s)
    """
    H = np.column_stack([-u_n, np.ones(len(u_n))])
    sigma = np.full(len(used), np.nan)
    for k in np.flatnonzero(used.sum(axis=1) >= H.shape[1]):
        rows, weight = H[used[k]], 1.0 / assumed_m2[k, used[k]]
        G = np.linalg.solve(rows.T @ (weight[:, None] * rows), rows.T * weight)
        sigma[k] = np.sqrt(np.trace(((G * true_m2[k, used[k]]) @ G.T)[:3, :3]))
    return sigma


def _look(
    antennas: Installation, limits: VisibilityLimits, scenario: ScenarioConfig, C_nb: Float64, P_b: Float64
) -> tuple[Int8, Float64]:
    """Return decisions (n, s) and gains (n, s, 3), every attitude on its own."""
    u_n = _directions(scenario)
    looks = new_looks(len(C_nb), len(u_n), with_doubt=True)
    for k in range(len(C_nb)):
        one = slice(k, k + 1)
        of_one = Looks(looks.decision[one], looks.reason[one], looks.antenna[one], looks.gain[one])
        look_at_all(C_nb[one], P_b[one], u_n[None], antennas, limits, of_one)
    return looks.decision, looks.gain


def _attitude(bank: float, heading: float) -> Float64:
    C_nb = np.empty((3, 3))
    euler_to_matrix(bank, 0.0, heading, C_nb)
    return C_nb


def _directions(scenario: ScenarioConfig) -> Float64:
    """Return the unit lines of sight (s, 3), north-east-down, half-way through the outage."""
    share = 0.5 * (scenario.outage.from_s + scenario.outage.until_s) / scenario.duration_s
    begin, end = np.moveaxis(np.array([(s.azimuth_deg, s.elevation_deg) for s in scenario.satellites]), -1, 0)
    return directions(*(begin + share * (end - begin)).T)
