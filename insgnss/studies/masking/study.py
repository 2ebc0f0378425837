"""Four ways to treat satellites that a manoeuvre hides, over the same flights: what each costs and what it lets through.

What A. I. Sokolov and Yu. S. Yurchenko (2015) only announce: (a) no masking while the channels report false
measurements, (b) an elevation mask, (c) attitude-aware masking in the filter, (d) masking and search supervision.

| table         | one row for each | columns |
|---------------|------------------|---------|
| cases         | case             | case words rms_before_m rms_during_m max_during_m rms_after_m max_after_m false_rows believed refused true_refused kept_hidden hidden_visible delay_mean_s delay_max_s search_s in_vain_s false_lock_s |
| false_locks   | case, false lock, kind | case lock kind rows believed refused statuses |
| reacquisition | hidden satellite, case and flight | run case sv lock how lost_s returned_s tracked_s delay_s search_s in_vain_s false_lock_s |
| errors        | epoch, case and flight | run case time_s error_m sd_m d_n_m d_e_m d_d_m |
| rows          | row of a hidden satellite in the first flight, and case | case time_s sv kind innovation status lock believed |
| sweeps        | sensitivity of the unsupervised search | cn0_dbhz sweep_s mean_delay_s |
| decisions     | setting of ``visibility.uncertain`` | as in ``masking_decisions``: what the stage decides in attitudes that are not certain |

``before`` is the half minute up to the first satellite's loss, ``during`` from there to the last one's return,
``after`` the half minute that follows.
``believed`` counts rows behind a false lock that corrected the state, ``true_refused`` rows without one that did not.
``kept_hidden`` are pseudoranges of hidden satellites that the stage let pass, ``hidden_visible`` those of visible ones
that it did not.
Seconds of search are those of a hidden satellite in one flight, on average; ``in_vain_s`` of it before it was back.
"""  # noqa: E501 - the table is the documentation

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
import pandas as pd

from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config, scenario_config
from insgnss.config.scenario import ScenarioConfig
from insgnss.errors import ConfigError
from insgnss.receiver.detection import detector
from insgnss.receiver.search_window import unsupervised_sweep_s
from insgnss.studies.masking import pictures
from insgnss.studies.masking.banked_flight import BankedFlight, Spell
from insgnss.studies.masking.cases import CASES, CaseResult, fly
from insgnss.studies.masking.decisions import decision_table
from insgnss.studies.masking.receiver_channels import ChannelSpell
from insgnss.studies.saved_study import SavedStudy
from insgnss.studies.scenario_equipment import filter_of, without_fault_tests

if TYPE_CHECKING:
    from insgnss.studies.figures import Figure

STUDY_SEED: Final = 2015
_COMPARED_S: Final = 30.0
_SENSITIVITIES_DBHZ: Final = (35.0, 30.0, 25.0, 20.0)  # the paper's table 1


@dataclass(frozen=True, repr=False)
class MaskingStudy(SavedStudy):
    """The result of ``masking_study``. Tables are DataFrames, the module's text has their columns."""

    PREFIX: ClassVar = "masking_"
    TABLES: ClassVar = ("cases", "false_locks", "reacquisition", "errors", "rows", "sweeps", "decisions")
    PICTURES: ClassVar = {
        "masking_errors": "error_figure",
        "masking_rows": "rows_figure",
        "masking_reacquisition": "reacquisition_figure",
    }

    cases: pd.DataFrame
    false_locks: pd.DataFrame
    reacquisition: pd.DataFrame
    errors: pd.DataFrame
    rows: pd.DataFrame
    sweeps: pd.DataFrame
    decisions: pd.DataFrame
    scenario: ScenarioConfig
    asked: dict[str, Any]  # imu, oscillator, runs, seed, fault_tests

    def error_figure(self) -> Figure:
        """Return the picture of the position error over time, one line per case."""
        return pictures.error_figure(self.errors, self._outage_s(), self._words(), self._title())

    def rows_figure(self) -> Figure:
        """Return the picture of the status of hidden satellites' rows in the first flight, one panel per case."""
        spells = self.reacquisition[self.reacquisition["run"] == 0]
        return pictures.rows_figure(self.rows, spells, self._words(), self._title())

    def reacquisition_figure(self) -> Figure:
        """Return the picture of delay and search of each hidden satellite, without and with supervision."""
        return pictures.reacquisition_figure(self.reacquisition, self._title())

    def _settings(self) -> Mapping[str, Any]:
        return {**self.asked, "scenario": self.scenario.model_dump(mode="json")}

    def _outage_s(self) -> tuple[float, float]:
        return float(self.reacquisition["lost_s"].min()), float(self.reacquisition["returned_s"].max())

    def _words(self) -> dict[str, str]:
        return dict(zip(self.cases["case"], self.cases["words"], strict=True))

    def _title(self) -> str:
        tests = "with its fault tests" if self.asked["fault_tests"] else "without gates and fault tests"
        return f"{self.asked['imu']} IMU, {self.asked['oscillator']} clock, filter {tests}"


def masking_study(
    scenario: str | Path | ScenarioConfig = "sokolov_2015",
    *,
    imu: str | None = None,
    oscillator: str | None = None,
    runs: int = 20,
    seed: int = STUDY_SEED,
    filter: str | Path | FilterConfig | None = None,
    settings: Mapping[str, Any] | None = None,
    fault_tests: bool = True,
) -> MaskingStudy:
    """Compare no masking, an elevation mask, attitude-aware masking and supervision on the same flights.

    Within a flight all cases have the same sensor errors, clock, noise and start; (a) to (c) have the same log of an
    unsupervised receiver with the same false locks, (d) that of a supervised one, which has none.

    Parameters
    ----------
    scenario : name in ``models/scenarios``, a file, or the scenario itself
    imu, oscillator : names in the model library; those of the scenario when None
    runs : flights, each with errors and false locks of its own
    seed : of all random numbers; the same seed gives the same tables
    filter : name, file or settings; the library's ``tight`` with the scenario's noise when None. Its elevation mask
        and its visibility stage are what the cases change
    settings : of the filter, to be otherwise, as in ``insgnss.replay``
    fault_tests : False: no gate and no test for faults, as in the paper's filter; only a mask refuses a false row

    Raises
    ------
    ModelError, ConfigError : an unknown name, a scenario that does not fit the schema or hides nothing, no run
    """
    config = scenario_config(scenario)
    if runs < 1:
        raise ConfigError(f"invalid number of runs {runs}", key="runs", advice="give at least one")
    chosen = filter_config(filter_of(config) if filter is None else filter, settings)
    chosen = chosen if fault_tests else without_fault_tests(chosen)
    names = imu or config.equipment.imu, oscillator or config.equipment.oscillator
    flight = BankedFlight.of(config, *names)
    if not flight.spells:
        advice = "bank more, choose another heading, or raise antenna.body_mask_deg"
        raise ConfigError("the flight's bank hides no satellite", key="bank.roll_deg", advice=advice)
    flown = [fly(flight, chosen, np.random.default_rng([seed, run])) for run in range(runs)]
    asked = {"imu": names[0], "oscillator": names[1], "runs": runs, "seed": seed, "fault_tests": fault_tests}
    return _study(config, flight.spells, flown, asked)


def _study(
    scenario: ScenarioConfig,
    spells: tuple[Spell, ...],
    flown: list[list[CaseResult]],
    asked: dict[str, Any],
) -> MaskingStudy:
    """Return the tables of all flights."""
    reacquisition = pd.DataFrame(
        [
            {"run": run, "case": result.case.name, **_of_channel(channel)}
            for run, results in enumerate(flown)
            for result in results
            for channel in result.channels
        ]
    )
    errors = _stacked([(run, r.case.name, r.errors) for run, results in enumerate(flown) for r in results])
    ledger = _stacked(
        [(run, r.case.name, r.measurements) for run, results in enumerate(flown) for r in results]
    )
    ledger["hidden"] = _is_hidden(ledger, spells)
    window = min(s.from_s for s in spells), max(s.until_s for s in spells)
    hidden = ledger[(ledger["run"] == 0) & ledger["sv"].isin({s.sv for s in spells})]
    shown = ["case", "time_s", "sv", "kind", "innovation", "status", "lock", "believed"]
    return MaskingStudy(
        _case_table(errors, ledger, reacquisition, window),
        _lock_table(ledger),
        reacquisition,
        errors,
        hidden[shown].reset_index(drop=True),
        sweep_table(scenario),
        decision_table(scenario),
        scenario,
        asked,
    )


def _of_channel(channel: ChannelSpell) -> dict[str, Any]:
    """Return a channel's row of the table."""
    wanted = ("sv", "lock", "how", "lost_s", "returned_s", "tracked_s", "delay_s", "search_s", "in_vain_s")
    values = {**asdict(channel), "delay_s": channel.delay_s}
    false_s = channel.false_until_s - channel.false_from_s if np.isfinite(channel.false_from_s) else 0.0
    return {**{name: values[name] for name in wanted}, "false_lock_s": false_s}


def _stacked(tables: list[tuple[int, str, pd.DataFrame]]) -> pd.DataFrame:
    """Return the tables of runs and cases as one, with both as columns."""
    parts = [table.assign(run=run, case=case) for run, case, table in tables]
    whole = pd.concat(parts, ignore_index=True)
    return whole[["run", "case", *tables[0][2].columns]]


def _case_table(
    errors: pd.DataFrame, ledger: pd.DataFrame, reacquisition: pd.DataFrame, window: tuple[float, float]
) -> pd.DataFrame:
    """Return one row for each case: errors over all flights, rows in all of them, seconds of a satellite."""
    rows = []
    for case in CASES:
        e, m, r = (table[table["case"] == case.name] for table in (errors, ledger, reacquisition))
        before = e.loc[e["time_s"].between(window[0] - _COMPARED_S, window[0], inclusive="left"), "error_m"]
        during = e.loc[e["time_s"].between(*window), "error_m"]
        after = e.loc[e["time_s"].between(window[1], window[1] + _COMPARED_S, inclusive="right"), "error_m"]
        false = m["lock"] != ""
        rows.append(
            {
                "case": case.name,
                "words": case.words,
                "rms_before_m": _rms(before),
                "rms_during_m": _rms(during),
                "max_during_m": during.max(),
                "rms_after_m": _rms(after),
                "max_after_m": after.max(),
                "false_rows": int(false.sum()),
                "believed": int((false & m["believed"]).sum()),
                "refused": int((false & ~m["believed"]).sum()),
                "true_refused": int((~false & ~m["believed"]).sum()),
                "kept_hidden": int((m["hidden"] & ~_is_masked(m)).sum()),
                "hidden_visible": int((~m["hidden"] & _is_masked(m)).sum()),
                "delay_mean_s": r["delay_s"].mean(),
                "delay_max_s": r["delay_s"].max(),
                **{name: r[name].mean() for name in ("search_s", "in_vain_s", "false_lock_s")},
            }
        )
    return pd.DataFrame(rows)


def _is_hidden(ledger: pd.DataFrame, spells: tuple[Spell, ...]) -> pd.Series[bool]:
    """Return which pseudoranges are of satellites that the airframe truly hides."""
    hidden = pd.Series(False, index=ledger.index)
    for spell in spells:
        within = (ledger["time_s"] >= spell.from_s) & (ledger["time_s"] < spell.until_s)
        hidden |= within & (ledger["sv"] == spell.sv) & (ledger["kind"] == "pseudorange")
    return hidden


def _is_masked(ledger: pd.DataFrame) -> pd.Series[bool]:
    """Return which pseudoranges the visibility stage refused."""
    return (ledger["kind"] == "pseudorange") & ledger["status"].isin(["masked_gain", "masked_obstruction"])


def _rms(values: pd.Series[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _lock_table(ledger: pd.DataFrame) -> pd.DataFrame:
    """Return the status of the rows behind each kind of false lock, in each case; all cases where there were none."""
    false = ledger[ledger["lock"] != ""]
    rows = []
    for (case, lock, kind), m in false.groupby(["case", "lock", "kind"]):
        counts = m["status"].value_counts()
        believed = int(m["believed"].sum())
        rows.append(
            {
                "case": case,
                "lock": lock,
                "kind": kind,
                "rows": len(m),
                "believed": believed,
                "refused": len(m) - believed,
                "statuses": ", ".join(f"{status} {count}" for status, count in counts.items()),
            }
        )
    columns = ["case", "lock", "kind", "rows", "believed", "refused", "statuses"]
    return pd.DataFrame(rows, columns=columns)


def sweep_table(scenario: ScenarioConfig) -> pd.DataFrame:
    """Return how the unsupervised search depends on the weakest signal it is made for.

    ``mean_delay_s`` is half a sweep and the loops' pull-in: what a channel that goes on searching needs on average.
    """
    search = scenario.search
    need = detector(search.detection)
    rows = []
    for cn0 in _SENSITIVITIES_DBHZ:
        receiver = search.unsupervised.model_copy(update={"cn0_dbhz": cn0})
        sweep_s = unsupervised_sweep_s(search.model_copy(update={"unsupervised": receiver}), need)
        mean_s = 0.5 * sweep_s + search.guards.pull_in_s
        rows.append({"cn0_dbhz": cn0, "sweep_s": sweep_s, "mean_delay_s": mean_s})
    return pd.DataFrame(rows)
