"""Tests whether a run's errors agree with its sigmas: innovations, whiteness, errors, and the verdict in words.

| table         | one row for each | columns |
|---------------|------------------|---------|
| kinds         | kind of measurement | kind used refused dof mean_nis expected low high share_95 mean_z mean_z_bound robust_scale factor |
| satellites    | kind and satellite | kind sv, then as kinds; bounds for all satellites at once (Bonferroni) |
| whiteness     | kind and lag     | kind lag_s correlation bound pairs q p_value correlation_time_s |
| states        | component with a reference, block of them | component axes rows dof mean rms mean_sigma nees low high share_1_sigma share_3_sigma |
| observability | state            | state first last smallest reduction limit known_s |
| sigmas        | navigation row   | time_s and the sigmas of heading, roll, pitch and biases |

``factor`` is what the assumed sigma of the noise should be multiplied by, from residuals in which the state's error has
no part (``innovation_statistics.fitted``). A filter that widens its sigma for errors that last (correlation_time_s) does so in its
weights alone: the ledger, and the factor, refer to the plain sigma. Rows that a mask kept out were not judged by their
innovation and do not count; ``innovation_statistics`` says how those behind a gate are treated.
"""  # noqa: E501 - the table is the documentation

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
import pandas as pd

from insgnss.errors import ConfigError, ResultError
from insgnss.runs.agreement import heading_of
from insgnss.runs.datum import label_as
from insgnss.runs.result import Run
from insgnss.studies.consistency import pictures
from insgnss.studies.consistency.error_statistics import (
    SIGMAS,
    ErrorComponent,
    error_rows,
    observability_table,
)
from insgnss.studies.consistency.innovation_statistics import (
    GATE_KEYS,
    InnovationRows,
    Nis,
    judged_rows,
    nis_of,
    period_of,
    whiteness_of,
)
from insgnss.studies.consistency.words import verdict
from insgnss.studies.saved_study import SavedStudy

if TYPE_CHECKING:
    from insgnss.studies.figures import Figure

_WHITENESS: Final = ("correlation", "bound", "pairs")


@dataclass(frozen=True, repr=False)
class Consistency(SavedStudy):
    """The result of ``consistency_study``. Tables are DataFrames, the module's text has their columns."""

    PREFIX: ClassVar = "consistency_"
    TABLES: ClassVar = ("kinds", "satellites", "whiteness", "states", "observability", "sigmas")
    SETTINGS: ClassVar = "verdict"
    PICTURES: ClassVar = {"consistency": "figure"}

    kinds: pd.DataFrame
    satellites: pd.DataFrame
    whiteness: pd.DataFrame
    states: pd.DataFrame  # empty without a reference
    observability: pd.DataFrame
    sigmas: pd.DataFrame
    innovations: pd.DataFrame  # time_s sv signal kind z used share residual leverage: what they are made of
    verdict: tuple[str, ...]  # sentences, what matters most first
    asked: Mapping[str, Any]  # confidence lags from_s

    @property
    def noise_factors(self) -> dict[str, float]:
        """The factor on the assumed sigma of each kind; kinds without a result are left out."""
        factors = self.kinds.set_index("kind")["factor"]
        return {str(kind): float(f) for kind, f in factors.items() if np.isfinite(f)}

    def __str__(self) -> str:
        return "\n".join(self.verdict)

    def _sentences(self) -> Iterator[str]:
        yield from self.verdict

    def figure(self) -> Figure:
        """Return the picture: NIS over time, by satellite, autocorrelation, sigmas."""
        return pictures.consistency_figure(
            self.innovations, self.kinds, self.satellites, self.whiteness, self.sigmas
        )

    def _settings(self) -> Mapping[str, Any]:
        return {"asked": dict(self.asked), "verdict": self.verdict, "noise_factors": self.noise_factors}


def consistency_study(
    run: Run | str | Path, *, confidence: float = 0.99, lags: int = 20, from_s: float | None = None
) -> Consistency:
    """Return how a run's innovations, errors and sigmas agree with what the filter assumed.

    Parameters
    ----------
    run : the run or its folder
    confidence : probability that a consistent filter lies within each bound
    lags : of the autocorrelation, in epochs
    from_s : where the statistics begin; when None, at the heading known, or at the first row where it never is

    Raises
    ------
    ConfigError : an impossible confidence or number of lags
    ResultError : the folder holds no run, or the run used no measurement
    """
    if not 0.0 < confidence < 1.0:
        raise ConfigError(f"invalid confidence {confidence}", key="confidence", advice="0.99 is usual")
    if lags < 1:
        raise ConfigError(f"invalid number of lags {lags}", key="lags", advice="give at least one")
    run = run if isinstance(run, Run) else Run.load(run)
    start_s = _start(run) if from_s is None else from_s
    judged = judged_rows(run, start_s)
    kinds = _kind_table(judged, confidence)
    if kinds.empty:
        raise ResultError(
            f"the run used too few measurements from {start_s:g} s on to say anything",
            advice="give an earlier --from, or look at the run's table of statuses",
        )
    satellites = _satellite_table(judged, kinds, confidence)
    white = _whiteness_table(judged, lags, confidence)
    errors = [] if run.errors is None else error_rows(run.errors, start_s, confidence)
    states = pd.DataFrame(errors, columns=list(ErrorComponent._fields))
    filter_settings = run.settings.get("filter", {})
    heading = heading_of(run)
    seen = observability_table(run.nav, heading)
    adapts = bool(filter_settings.get("adaptation", {}).get("on", False))
    sentences = verdict(kinds, satellites, white, states, seen, 1.0 - confidence, heading, adapts=adapts)
    sigmas = run.nav[["time_s", *(c for c in SIGMAS if c in run.nav)]]
    label_as(judged.table, run.nav)
    asked = {"confidence": confidence, "lags": lags, "from_s": start_s}
    return Consistency(kinds, satellites, white, states, seen, sigmas, judged.table, sentences, asked)


def _start(run: Run) -> float:
    known_s = run.heading_known_s()
    return float(run.nav["time_s"].iloc[0]) if known_s is None else known_s


def _kind_table(judged: InnovationRows, confidence: float) -> pd.DataFrame:
    rows = []
    for kind in GATE_KEYS:
        nis = nis_of(judged.table[judged.table["kind"] == kind], judged.gates[kind], confidence)
        if nis is not None:
            rows.append({"kind": kind, **nis._asdict()})
    return pd.DataFrame(rows, columns=["kind", *Nis._fields])


def _satellite_table(judged: InnovationRows, kinds: pd.DataFrame, confidence: float) -> pd.DataFrame:
    """Return the same for each satellite, the chance of a false alarm shared out among them."""
    factor = kinds.set_index("kind")["factor"]
    rows = []
    for kind in GATE_KEYS:
        groups = judged.table[judged.table["kind"] == kind].groupby("sv")
        alone = 1.0 - (1.0 - confidence) / max(groups.ngroups, 1)
        for sv, group in groups:
            nis = nis_of(group, judged.gates[kind], alone, float(factor.get(kind, np.nan)))
            if nis is not None:
                rows.append({"kind": kind, "sv": str(sv), **nis._asdict()})
    return pd.DataFrame(rows, columns=["kind", "sv", *Nis._fields])


def _whiteness_table(judged: InnovationRows, lags: int, confidence: float) -> pd.DataFrame:
    tables = []
    for kind in GATE_KEYS:
        rows = judged.table[(judged.table["kind"] == kind) & judged.table["used"]]
        period_s = period_of(rows["time_s"].to_numpy())
        whiteness = whiteness_of(rows, period_s, lags, confidence)
        if whiteness is None:
            continue
        values = whiteness._asdict()
        columns = {name: values[name] for name in _WHITENESS}
        single = {name: value for name, value in values.items() if name not in _WHITENESS}
        lag_s = period_s * np.arange(1, lags + 1)
        tables.append(pd.DataFrame({"kind": kind, "lag_s": lag_s, **columns, **single}))
    names = ["kind", "lag_s", *_WHITENESS, "q", "p_value", "correlation_time_s"]
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=names)
