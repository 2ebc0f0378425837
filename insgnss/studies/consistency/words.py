"""The verdict of a consistency study in plain words: what a user should change, and what can be trusted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import pandas as pd

from insgnss.runs.agreement import AGREES_WITHIN, HeadingAgreement, times_their_sigma

NOISE_WORDS: Final = {
    "pseudorange": "range noise",
    "range_rate": "range rate noise",
    "carrier_difference": "carrier noise",
    "attitude_difference": "noise of the phase between antennas",
}
_OUTLYING: Final = 1.3  # of one satellite's factor over its kind's
_CORRELATED: Final = 0.1  # at lag one; less costs under a tenth of the information
_LEAST_CHANCE: Final = 1e-12  # a smaller one is as good as none
_SATELLITES_TOLD: Final = 4
_HARDLY: Final = 1.5  # a sigma that came down by less was hardly observed
_CHANCE_Z: Final = 2.58  # a factor is beyond chance with 99 %
_SHORT_OF_NONE: Final = 0.05
_STATES: Final = {"accel_bias": "accelerometer bias", "gyro_bias": "gyro bias"}


def verdict(
    kinds: pd.DataFrame,
    satellites: pd.DataFrame,
    whiteness: pd.DataFrame,
    states: pd.DataFrame,
    observability: pd.DataFrame,
    alarm: float,
    heading: HeadingAgreement,
    *,
    adapts: bool,
) -> tuple[str, ...]:
    """Return the sentences; tables are those of ``Consistency``, ``alarm`` the chance of a false one."""
    sentences = [_of_noise(row) for row in kinds.to_dict("records")]
    if adapts:
        sentences.append(
            "the filter adapts its noise levels (adaptation.on): factors are relative to the levels that it found, not"
            " to the settings; replay with it off to judge those"
        )
    sentences += _of_satellites(kinds, satellites)
    sentences += _of_whiteness(whiteness, alarm)
    sentences += [text for text in map(_of_error, states.to_dict("records")) if text]
    sentences.append(_of_heading(heading))
    sentences += _of_biases(observability)
    return tuple(sentences)


def _of_noise(row: Mapping[Any, Any]) -> str:
    """Return what a kind's NIS says of its innovations and its noise."""
    nis = _number(row, "mean_nis")
    ratio, factor = float(np.sqrt(nis)), _number(row, "factor")
    low, high = _number(row, "low"), _number(row, "high")
    bounds = f"mean NIS {nis:.3f}, bounds {low:.3f} to {high:.3f}"
    refused = _number(row, "refused") / (_number(row, "refused") + _number(row, "used"))
    also = f"; {100.0 * refused:.1f} % were refused for their innovation" if refused > _SHORT_OF_NONE else ""
    innovations, agree = times_their_sigma(ratio), abs(ratio - 1.0) < AGREES_WITHIN
    if low <= nis <= high:
        innovations += "" if agree else ", within chance"
        noise = "as assumed"
        if abs(factor - 1.0) > max(AGREES_WITHIN, _CHANCE_Z / np.sqrt(2.0 * max(_number(row, "dof"), 1.0))):
            # residuals know the noise better than innovations, which hold the state's uncertainty too
            noise = f"{factor:.2g} times the assumed, judged by the residuals"
    else:
        innovations += f" within {100.0 * abs(ratio - 1.0):.1g} %, not by chance" if agree else ""
        noise = f"{factor:.2g} times the assumed"
        if not np.isfinite(factor):
            noise = f"{'below' if nis < 1.0 else 'above'} the assumed"
        elif abs(factor - 1.0) < AGREES_WITHIN:
            noise = f"as assumed within {100.0 * abs(factor - 1.0):.0f} %"
    kind = str(row["kind"])
    words = f"{kind.replace('_', ' ')} innovations {innovations}: {NOISE_WORDS[kind]} is {noise}"
    return f"{words} ({bounds}){also}"


def _number(row: Mapping[Any, Any], name: str) -> float:
    return float(row[name])


def _of_satellites(kinds: pd.DataFrame, satellites: pd.DataFrame) -> list[str]:
    """Return the satellites that are noisier than their kind, or biased, the worst first."""
    whole = kinds.set_index("kind")["factor"]
    sentences = []
    for kind, rows in satellites.groupby("kind", sort=False):
        over = rows["factor"] / whole[kind]
        noisy = rows[(over > _OUTLYING) & (rows["mean_nis"] > rows["high"])]
        for row in noisy.sort_values("factor", ascending=False).head(_SATELLITES_TOLD).itertuples():
            sentences.append(f"{row.sv}: {NOISE_WORDS[str(kind)]} is {row.factor:.2g} times the assumed")
        beyond = (rows["mean_z"].abs() / rows["mean_z_bound"]).rename("beyond")
        biased = rows.assign(beyond=beyond)[beyond > 1.0].sort_values("beyond", ascending=False)
        if len(biased):
            names = ", ".join(f"{r.sv} {r.mean_z:+.2f}" for r in biased.head(_SATELLITES_TOLD).itertuples())
            sentences.append(f"mean {kind} innovation is not zero (in sigmas): {names}")
    return sentences


def _of_whiteness(whiteness: pd.DataFrame, alarm: float) -> list[str]:
    sentences = []
    for kind, rows in whiteness.groupby("kind", sort=False):
        first = rows.iloc[0]
        if first["p_value"] >= alarm:
            sentences.append(f"{kind} innovations are white (Ljung-Box {_chance(first['p_value'])})")
            continue
        weak = "" if abs(first["correlation"]) > _CORRELATED else "barely "
        lasts = first["correlation_time_s"]
        time = f", as errors that last {lasts:.2g} s would be" if lasts > 0.0 and not weak else ""
        sentences.append(
            f"{kind} innovations are {weak}correlated in time: {first['correlation']:+.2f} after"
            f" {first['lag_s']:.2g} s{time} (Ljung-Box {_chance(first['p_value'])})"
        )
    return sentences


def _chance(p_value: float) -> str:
    return f"p = {p_value:.2g}" if p_value >= _LEAST_CHANCE else f"p < {_LEAST_CHANCE:g}"


def _of_error(row: Mapping[Any, Any]) -> str:
    """Return what a block's errors say of its sigma; single components are in the table."""
    if _number(row, "axes") == 1:
        return ""
    nees, low, high = (_number(row, name) for name in ("nees", "low", "high"))
    ratio = np.sqrt(nees)
    bounds = f"NEES per axis {nees:.2f}, bounds {low:.2f} to {high:.2f}"
    errors = f"{row['component']}: errors {times_their_sigma(float(ratio))} ({bounds})"
    if low <= nees <= high:
        return f"{errors}: within the chance bounds"
    return f"{errors}: the filter is {'overconfident' if nees > high else 'conservative'}"


def _of_heading(heading: HeadingAgreement) -> str:
    sigma = f"sigma {heading.first_deg:.3g} to {heading.last_deg:.3g} deg"
    if heading.known_s is None:
        return f"heading never known ({sigma})"
    lost = ", lost again by the end" if heading.is_lost else ""
    return f"heading known from t = {heading.known_s:g} s{lost} ({sigma})"


def _of_biases(table: pd.DataFrame) -> list[str]:
    sentences = []
    hardly = table[table["state"].str.contains("bias") & (table["reduction"] < _HARDLY)]
    known = table[table["state"].str.contains("bias") & np.isfinite(table["known_s"])]
    if len(known):
        sentences.append(
            "biases known from: " + ", ".join(f"{_in_words(r)} {r.known_s:g} s" for r in known.itertuples())
        )
    if len(hardly):
        names = ", ".join(f"{_in_words(r)} ({r.reduction:.2g} times)" for r in hardly.itertuples())
        sentences.append(f"hardly observed, the sigma fell little: {names}")
    return sentences


def _in_words(row: object) -> str:
    sensor, bias, axis, _ = str(getattr(row, "state", "")).split("_")
    return f"{_STATES[f'{sensor}_{bias}']} {axis}"
