"""Satellites hidden by a bank, and the cost: bank x heading x antenna x IMU grade, without noise.

| table      | one row for each | columns |
|------------|------------------|---------|
| cases      | manoeuvre        | imu antenna bank_deg heading_deg n_hidden hidden n_seen pdop gdop d_worst_m2 d_mean_m2 sd_worst_m sd_position_m sd_before_m |
| satellites | satellite and manoeuvre | imu antenna bank_deg heading_deg sv az_deg el_deg body_el_deg hidden d_range_m2 d_before_m2 |

The user stands level on the heading until the scenario's outage begins and banks through it. What is hidden, the
dilutions of the satellites left and ``sd_position_m``, three axes together, are those of the outage's last update.
D = h P^- h^T of a satellite's range is that just before the first update after it, where it is largest: how well the
filter still predicts what it has not seen. ``d_worst_m2`` is the largest among the hidden, NaN where nothing is.
"""  # noqa: E501 - the table is the documentation

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
import pandas as pd

from insgnss.config.library import scenario_config
from insgnss.config.scenario import ScenarioConfig
from insgnss.errors import ConfigError
from insgnss.filter.state import DR, copy_bank
from insgnss.gnss.dilution import dilution
from insgnss.gnss.least_squares import RANGE, FitRows, FitWorkspace, free_clocks
from insgnss.studies.figures import heat_map
from insgnss.studies.manoeuvre.covariance_run import CovarianceRun, Update
from insgnss.studies.saved_study import SavedStudy
from insgnss.tables import Bool

if TYPE_CHECKING:
    from insgnss.studies.figures import Figure

BANKS_DEG: Final = (0.0, 15.0, 30.0, 45.0, 60.0)  # right wing down
HEADINGS_DEG: Final = tuple(30.0 * k for k in range(12))
_STEEPEST_DEG: Final = 90.0


@dataclass(frozen=True, repr=False)
class ManoeuvreStudy(SavedStudy):
    """The result of ``manoeuvre_study``. Tables are DataFrames, the module's text has their columns."""

    PREFIX: ClassVar = "manoeuvre_"
    TABLES: ClassVar = ("cases", "satellites")
    SETTINGS: ClassVar = "scenario"
    PICTURES: ClassVar = {f"manoeuvre_{column}": column for column in ("d_worst_m2", "n_hidden", "pdop")}

    cases: pd.DataFrame
    satellites: pd.DataFrame
    scenario: ScenarioConfig

    def heat_map(self, column: str = "d_worst_m2") -> Figure:
        """Return the picture: bank over heading, a panel an antenna and IMU, coloured by a column of ``cases``.

        Raises
        ------
        ConfigError : ``cases`` has no such column of numbers
        """
        numbers = self.cases.select_dtypes("number").columns
        if column not in numbers:
            raise ConfigError(f"no column '{column}'", key=column, advice=f"give one of {', '.join(numbers)}")
        return heat_map(self.cases, column)

    def figures(self) -> Mapping[str, Callable[[], Figure]]:
        """Return the drawing function of each picture, by file name."""
        return {name: partial(self.heat_map, column) for name, column in self.PICTURES.items()}

    def _settings(self) -> Mapping[str, Any]:
        return self.scenario.model_dump(mode="json")


def manoeuvre_study(
    scenario: str | Path | ScenarioConfig = "sokolov_2015",
    *,
    banks_deg: Sequence[float] = BANKS_DEG,
    headings_deg: Sequence[float] = HEADINGS_DEG,
    antennas: Sequence[str] | None = None,
    imus: Sequence[str] | None = None,
    oscillator: str | None = None,
) -> ManoeuvreStudy:
    """Return the satellites that each manoeuvre of a grid hides, and the cost in accuracy.

    Parameters
    ----------
    scenario : name in ``models/scenarios``, a file, or the scenario itself: sky, outage, measurements
    banks_deg : right wing down is positive
    headings_deg : headings of the user
    antennas : patterns in the library or files; that of the scenario when None. The threshold is the scenario's
    imus, oscillator : names in the library; those of the scenario when None

    Raises
    ------
    ModelError, ConfigError : an unknown name, a bank of 90 deg or more, an empty axis of the grid
    """
    config = scenario_config(scenario)
    patterns = (config.antenna.pattern,) if antennas is None else tuple(antennas)
    grades = (config.equipment.imu,) if imus is None else tuple(imus)
    axes = {"banks_deg": banks_deg, "headings_deg": headings_deg, "antennas": patterns, "imus": grades}
    for key, values in axes.items():
        if not len(values):
            raise ConfigError("an axis of the grid is empty", key=key, advice="give at least one value")
    if not max(abs(bank) for bank in banks_deg) < _STEEPEST_DEG:
        raise ConfigError("a bank of 90 deg or more", key="banks_deg", advice="give less, to either side")
    cases: list[dict[str, Any]] = []
    satellites: list[pd.DataFrame] = []
    for imu in grades:
        for pattern in patterns:
            for heading in headings_deg:
                level = _levelled(config, imu, oscillator, pattern, heading)
                for bank in banks_deg:
                    names: dict[str, Any] = {
                        "imu": imu,
                        "antenna": pattern,
                        "bank_deg": bank,
                        "heading_deg": heading,
                    }
                    case, rows = _banked(level, bank)
                    cases.append({**names, **case})
                    for place, (name, value) in enumerate(names.items()):
                        rows.insert(place, name, value)
                    satellites.append(rows)
    return ManoeuvreStudy(pd.DataFrame(cases), pd.concat(satellites, ignore_index=True), config)


@dataclass(frozen=True)
class _LevelCovariance:
    """A covariance that has come to the beginning of the outage, level on a heading."""

    run: CovarianceRun
    last: Update
    sd_m: float
    next_update: int


def _levelled(
    config: ScenarioConfig, imu: str, clock: str | None, pattern: str, heading_deg: float
) -> _LevelCovariance:
    antenna = config.antenna.model_copy(update={"pattern": pattern})
    turned = config.bank.model_copy(update={"heading_deg": heading_deg})
    scenario = config.model_copy(update={"antenna": antenna, "bank": turned})
    run = CovarianceRun.of(scenario, imu, clock or config.equipment.oscillator, "bank", "strapdown")
    rate_hz, count = config.measurements.rate_hz, 0
    last: Update | None = None
    while (count + 1) / rate_hz < config.outage.from_s:
        count += 1
        last = run.update(count / rate_hz)
    if last is None:
        advice = "let the outage begin after the first update"
        raise ConfigError("there is no update before the outage", key="outage.from_s", advice=advice)
    return _LevelCovariance(run, last, _sd_position(run), count + 1)


def _sd_position(run: CovarianceRun) -> float:
    P = run.bank.P[0]
    return float(np.sqrt(sum(P[i, i] for i in range(DR, DR + 3))))


def _dilutions(run: CovarianceRun, t_s: float, seen: Bool) -> tuple[float, float]:
    """Return GDOP and PDOP of the satellites seen, NaN where they fix no position."""
    n = len(seen)
    states = run.sky.states(np.full((1, n), t_s))
    sat = np.ascontiguousarray(np.concatenate([states.r_e[0], states.v_e[0]], axis=1))
    one_clock = np.zeros(n, np.int64)
    rows = FitRows(RANGE, sat, np.zeros(n), np.ones(n), one_clock, free_clocks(1), run.sky.r_e)
    work = FitWorkspace(np.zeros(3), np.zeros(3), np.zeros((4, 4)), np.zeros(4))
    dop = np.full(5, np.nan)
    x = np.append(run.sky.r_e, 0.0)
    dilution(rows, seen, x, np.ascontiguousarray(run.sky.C_ne), work, np.zeros((4, 4)), dop)
    return float(dop[0]), float(dop[1])


def _banked(level: _LevelCovariance, bank_deg: float) -> tuple[dict[str, Any], pd.DataFrame]:
    """Return a manoeuvre's row and its satellites', from a copy of the covariance."""
    base = level.run.scenario
    scenario = base.model_copy(update={"bank": base.bank.model_copy(update={"roll_deg": bank_deg})})
    run = replace(level.run, scenario=scenario, bank=copy_bank(level.run.bank), seen=level.run.seen.copy())
    rate_hz, number = base.measurements.rate_hz, level.next_update
    last = level.last
    while number / rate_hz < base.outage.until_s:
        last = run.update(number / rate_hz)
        number += 1
    sd_m, hidden = _sd_position(run), last.is_hidden
    d = run.update(number / rate_hz).D[:, 0]
    names = np.array(base.sv_names)
    gdop, pdop = _dilutions(run, last.time_s, ~hidden)
    worst = float(d[hidden].max()) if hidden.any() else np.nan
    case = {
        "n_hidden": int(hidden.sum()),
        "hidden": " ".join(names[hidden]),
        "n_seen": int((~hidden).sum()),
        "pdop": pdop,
        "gdop": gdop,
        "d_worst_m2": worst,
        "d_mean_m2": float(d[hidden].mean()) if hidden.any() else np.nan,
        "sd_worst_m": float(np.sqrt(worst)),
        "sd_position_m": sd_m,
        "sd_before_m": level.sd_m,
    }
    rows = pd.DataFrame(
        {
            "sv": names,
            "az_deg": np.degrees(last.angles[:, 0]) % 360.0,
            "el_deg": np.degrees(last.angles[:, 1]),
            "body_el_deg": np.degrees(last.body_elevation),
            "hidden": hidden,
            "d_range_m2": d,
            "d_before_m2": level.last.D[:, 0],
        }
    )
    return case, rows
