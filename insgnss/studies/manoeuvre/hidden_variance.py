"""Variance of the filter's predicted pseudoranges of hidden satellites over time: D = h P^- h^T.

The scenario of A. I. Sokolov and Yu. S. Yurchenko (2015): a user at rest, eleven satellites, five of them off for 20 s.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import pandas as pd

from insgnss.config.library import scenario_config
from insgnss.config.scenario import ScenarioConfig
from insgnss.errors import ConfigError
from insgnss.studies import figures
from insgnss.studies.manoeuvre.covariance_run import CovarianceRun, OutageCause, Sensors, Update
from insgnss.studies.saved_study import SavedStudy

if TYPE_CHECKING:
    from insgnss.studies.figures import Figure


@dataclass(frozen=True, repr=False)
class HiddenVariance(SavedStudy):
    """The result of ``hidden_satellite_variance``.

    ``table`` has one row for each satellite and update: time_s sv az_deg el_deg body_el_deg hidden waits
    d_range_m2 d_rate_m2ps2. ``hidden`` says that the update goes without it, ``waits`` that the heading is too
    uncertain for the stage to hide anything; D is that just before the update.
    """

    PREFIX: ClassVar = "hidden_variance"
    TABLES: ClassVar = ("", "_summary")
    SETTINGS: ClassVar = "_settings"
    PICTURES: ClassVar = {"hidden_variance": "figure"}

    table: pd.DataFrame
    scenario: ScenarioConfig
    imu: str
    oscillator: str
    outage: OutageCause
    sensors: Sensors

    def at(self, time_s: Sequence[float]) -> pd.DataFrame:
        """Return D of the pseudoranges of the scenario's hidden satellites [m^2]: row: time, column: satellite.

        Raises
        ------
        ConfigError : there was no update at one of the times
        """
        d: pd.DataFrame = self.table.pivot(index="time_s", columns="sv", values="d_range_m2")
        missing = sorted(set(time_s) - set(d.index))
        if missing:
            raise ConfigError(
                f"there is no update at {missing[0]:g} s",
                advice=f"updates are from {d.index[0]:g} to {d.index[-1]:g} s; ask for a longer study",
            )
        return d[list(self.scenario.outage.sv)].loc[list(time_s)]

    def summary(self) -> pd.DataFrame:
        """Return D of each hidden satellite before the outage, at its end and after, and by what factor it grows."""
        outage, period = self.scenario.outage, 1.0 / self.scenario.measurements.rate_hz
        before, peak, after = outage.from_s - period, outage.until_s, outage.until_s + period
        d = self.at([before, peak, after]).T
        d.columns = pd.Index(["before_m2", "peak_m2", "after_m2"])
        d["peak_over_before"] = d["peak_m2"] / d["before_m2"]
        d["sd_peak_m"] = np.sqrt(d["peak_m2"])
        return d.reset_index()

    def figure(self) -> Figure:
        """Return the picture: D of the hidden satellites over time, the outage shaded."""
        outage = self.scenario.outage
        of_sensors = f", {self.sensors} sensors" if self.outage == "bank" else ""
        title = f"{self.imu} IMU, {self.oscillator} clock, outage by {self.outage}{of_sensors}"
        return figures.variance_figure(self.table, outage.sv, (outage.from_s, outage.until_s), title)

    def _table(self, name: str) -> pd.DataFrame:
        return self.summary() if name else self.table

    def _settings(self) -> Mapping[str, Any]:
        asked = {name: getattr(self, name) for name in ("imu", "oscillator", "outage", "sensors")}
        return {**asked, "scenario": self.scenario.model_dump(mode="json")}


def hidden_satellite_variance(
    scenario: str | Path | ScenarioConfig = "sokolov_2015",
    *,
    imu: str | None = None,
    oscillator: str | None = None,
    outage: OutageCause = "switch",
    sensors: Sensors = "strapdown",
    until_s: float | None = None,
) -> HiddenVariance:
    """Return D = h P^- h^T of every satellite over time, the filter's own, for a user at rest.

    Equation: P^- = Phi P Phi^T + Q between updates; then for each satellite that is not hidden, pseudoranges first,
    P <- (I - K h) P; D is taken between the two                 [Sokolov & Yurchenko 2015, (2), (9), (10), corrected]
    Neglects: the user's motion. It stays in its place, whatever its attitude; specific force is standard gravity.

    Parameters
    ----------
    scenario : name in ``models/scenarios``, a file, or the scenario itself
    imu, oscillator : names in the model library; those of the scenario when None. Their biases are taken as
        Gauss-Markov processes with the grade's bias for sigma and its correlation time: instability and scale factor
        do not count
    outage : "switch": the scenario's satellites are off from ``from_s`` to ``until_s``, the user level and heading
        north. "bank": the user keeps the scenario's heading and banks for that time, and the visibility stage
        decides by antenna, attitude and the attitude's covariance what it hides
    sensors : "strapdown": they bank with the user, and tilts that were known as sums with biases come apart: D of the
        tactical grade grows by a quarter more. "levelled": they stay level as on a stabilised platform, only the
        antenna banks: the covariance is that of the switch, as far as the stage hides the same satellites
    until_s : end of the study; the scenario's when None

    Raises
    ------
    ModelError, ConfigError : an unknown name or a scenario that does not fit the schema
    """
    config = scenario_config(scenario)
    names = imu or config.equipment.imu, oscillator or config.equipment.oscillator
    run = CovarianceRun.of(config, *names, outage, sensors)
    end_s = config.duration_s if until_s is None else until_s
    count = int(end_s * config.measurements.rate_hz + 1e-9)
    rows = [run.update((k + 1) / config.measurements.rate_hz) for k in range(count)]
    return HiddenVariance(_table(config, rows), config, *names, outage, sensors)


def _table(scenario: ScenarioConfig, rows: list[Update]) -> pd.DataFrame:
    """Return one row for each satellite and update."""
    n = len(scenario.satellites)
    angles = np.degrees(np.concatenate([row.angles for row in rows]) if rows else np.zeros((0, 2)))
    D = np.concatenate([row.D for row in rows]) if rows else np.zeros((0, 2))
    return pd.DataFrame(
        {
            "time_s": np.repeat([row.time_s for row in rows], n),
            "sv": list(scenario.sv_names) * len(rows),
            "az_deg": angles[:, 0] % 360.0,
            "el_deg": angles[:, 1],
            "body_el_deg": np.degrees([e for row in rows for e in row.body_elevation]),
            "hidden": np.array([h for row in rows for h in row.is_hidden], np.bool_),
            "waits": np.repeat(np.array([row.waits for row in rows], np.bool_), n),
            "d_range_m2": D[:, 0],
            "d_rate_m2ps2": D[:, 1],
        }
    )
