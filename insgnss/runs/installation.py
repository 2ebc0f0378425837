"""Numbers of the installation that a run estimates: the lever arm, the IMU's time, a lag of range rates, the mounting.

Each is a state of the filter if the settings or the flight file declare it uncertain; time and lag are unless these
declare them exact. It counts as determined when its
sigma has fallen to a fifth of the declared one; ``insgnss check FLIGHT --run DIR`` then proposes the corrected keys.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd

from insgnss.config.changes import entry
from insgnss.config.flight import FlightConfig
from insgnss.config.process import Process
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import ConfigError, ResultError
from insgnss.filter.layout import Layout
from insgnss.filter.states.imu_time import ARRIVAL_SIGMA_S
from insgnss.filter.states.rate_lag import LOOP_SIGMA_S
from insgnss.gpstime import week_seconds_to_ns
from insgnss.log.checks.report import Finding, Proposal
from insgnss.log.files import sha256
from insgnss.runs.result import Run
from insgnss.tables import Event

DETERMINED: Final = 0.2  # of the declared sigma
SIGNIFICANT: Final = 3.0  # sigmas
PLAUSIBLE: Final = 4.0  # declared sigmas: a larger error is rarer than a wrong declaration
_LEVER: Final = "gnss.lever_arm_m"
_TIME: Final = "imu.time.offset_s"
_LAG: Final = "gnss.range_rate_lag_s"
_TIME_SIGMA: Final = ("filter", "process", "imu_time_sigma_s")
_LEVER_SIGMA: Final = ("filter", "process", "lever_arm_sigma_m")
_LAG_SIGMA: Final = ("filter", "process", "range_rate_lag_sigma_s")
_ASSUMED: Final = {_TIME: ARRIVAL_SIGMA_S, _LAG: LOOP_SIGMA_S}  # where the settings leave it out
# An error of one looks like one of the other where only one is a state: with tags 20 ms late a jet's lever arm was 154
# sigmas off, with a lever arm 0.5 m too short its tags were 11 sigmas off
_MISTAKEN: Final = {
    _LEVER: "an error of the IMU's time tags looks like a lever arm; replay with process.imu_time_sigma_s as well",
    _TIME: "an error of the lever arm looks like late time tags; replay with process.lever_arm_sigma_m as well",
    _LAG: "in turns an error of the lever arm looks like a lag; replay with process.lever_arm_sigma_m as well",
}
_SLIP: Final = "vehicle.non_holonomic"


class _InstallationNumber(NamedTuple):
    """A number of the flight file and where a run has its error."""

    column: str  # of ``nav``: what has to be added to the number
    key: str
    place: int | None  # in a key that holds several numbers
    declared: tuple[str, ...]  # where its sigma stands in the run's settings


PARTS: Final = (
    *(_InstallationNumber(f"lever_arm_{axis}_m", _LEVER, i, _LEVER_SIGMA) for i, axis in enumerate("xyz")),
    _InstallationNumber("imu_time_offset_s", _TIME, None, _TIME_SIGMA),
    _InstallationNumber("range_rate_lag_s", _LAG, None, _LAG_SIGMA),
    *(
        _InstallationNumber(
            column, f"{_SLIP}.{column}", None, ("flight", *_SLIP.split("."), "mounting_sd_deg")
        )
        for column in ("mounting_pitch_deg", "mounting_yaw_deg")
    ),
)


class InstallationEstimate(NamedTuple):
    """The error of a number of the flight file as a run determined it."""

    part: _InstallationNumber
    time_s: float  # since when it is determined, seconds of the week
    value: float  # to be added to the number
    sigma: float
    declared_sigma: float
    assumed: bool  # the sigma is the filter's own, no setting

    @property
    def is_significant(self) -> bool:
        """Whether the number of the flight file is contradicted."""
        return abs(self.value) >= SIGNIFICANT * self.sigma

    @property
    def is_news(self) -> bool:
        """Whether it was asked for, or differs from the flight file."""
        return self.is_significant or not self.assumed

    @property
    def is_plausible(self) -> bool:
        """Whether the declared sigma allows for an error of this size."""
        return abs(self.value) <= PLAUSIBLE * self.declared_sigma

    def words(self) -> str:
        """Return the error with its sigma."""
        digits = max(0, 1 - int(np.floor(np.log10(self.sigma))))
        return f"{self.part.column} is {self.value:+.{digits}f}, sigma {self.sigma:.{digits}f}"


def installation_estimates(nav: pd.DataFrame, settings: Mapping[str, Any]) -> list[InstallationEstimate]:
    """Return the errors of the installation that a run has determined at its end; ``settings`` are the run's."""
    estimates = []
    for part in PARTS:
        declared = entry(settings, part.declared)
        assumed = declared is None and part.key in _ASSUMED
        if assumed:
            declared = _ASSUMED[part.key]
        if part.column not in nav or not len(nav) or not isinstance(declared, int | float) or declared <= 0.0:
            continue
        sigma = nav[f"sd_{part.column}"].to_numpy()
        determined = sigma <= DETERMINED * declared
        if determined[-1]:
            since = len(sigma) - int(np.argmin(determined[::-1])) if not determined.all() else 0
            time_s, value = float(nav["time_s"].iloc[since]), float(nav[part.column].iloc[-1])
            estimates.append(
                InstallationEstimate(part, time_s, value, float(sigma[-1]), float(declared), assumed)
            )
    return estimates


def installation_events(nav: pd.DataFrame, settings: Mapping[str, Any], week: int) -> list[Event]:
    """Return an event for each number of the installation whose error a run has determined and that is news."""
    return [
        Event(int(week_seconds_to_ns(week, estimate.time_s)), "installation_known", estimate.words())
        for estimate in installation_estimates(nav, settings)
        if estimate.is_news
    ]


class LiveInstallation:
    """The same events of a streaming engine: each number of the installation once, when it is determined first."""

    def __init__(self, layout: Layout, process: Process) -> None:
        """Take the sigmas from the states of the filter; ``process`` says which of them were declared."""
        declared = {_TIME: process.imu_time_sigma_s, _LAG: process.range_rate_lag_sigma_s}
        self._assumed = [key for key, sigma in declared.items() if sigma is None]
        parts = {part.column: part for part in PARTS}
        self._open = {
            column: (parts[column], block.sigma)
            for block in layout.blocks
            for column in block.columns
            if column in parts
        }

    def events(self, t_ns: int, values: Mapping[str, Any]) -> list[Event]:
        """Return the events of an epoch; ``values`` has estimates and sigmas by their columns in ``nav``."""
        new_events = []
        for column, (part, declared) in list(self._open.items()):
            sigma = float(values[f"sd_{column}"])
            time_s, value = t_ns % NS_PER_WEEK / NS_PER_S, float(values[column])
            assumed = part.key in self._assumed
            estimate = InstallationEstimate(part, time_s, value, sigma, declared, assumed)
            if sigma <= DETERMINED * declared and estimate.is_news:
                del self._open[column]
                new_events.append(Event(t_ns, "installation_known", estimate.words()))
        return new_events


def installation_findings(run: Run, config: FlightConfig) -> list[Finding]:
    """Return a run's proposals for its flight file.

    A key that was changed since the run is left as it is: the run determined the error of its former value.

    Raises
    ------
    ConfigError : the run was made from other logs
    ResultError : the run does not say from which flight it was made
    """
    before = run.settings.get("flight")
    if not isinstance(before, Mapping):
        advice = "replay the flight and give the folder of that run"
        raise ResultError("the run's settings do not hold its flight", key="run", advice=advice)
    refuse_other_flight(run.settings, config)
    estimates = installation_estimates(run.nav, run.settings)
    findings = []
    of_events = run.events[run.events["kind"] == "rates_late"]["detail"]
    if len(of_events):  # the state is what the rates lag beyond the event's number
        estimates = [estimate for estimate in estimates if estimate.part.key != _LAG]
        findings.append(Finding("warning", "run", f"event rates_late: {of_events.iloc[-1]}"))
    if not estimates and not findings:
        text = "the run determined neither lever arm nor IMU time nor a lag of range rates nor mounting"
        advice = "process.lever_arm_sigma_m and process.imu_time_sigma_s make them states; they need turns and stops"
        return [Finding("ok", "run", text, advice)]
    for key in dict.fromkeys(estimate.part.key for estimate in estimates):
        same = [estimate for estimate in estimates if estimate.part.key == key]
        now, then = _declared(config.model_dump(mode="json"), key), _declared(before, key)
        if now is None or now != then:
            advice = f"{key} has changed since the run: replay the flight again"
            findings += [Finding("warning", "run", estimate.words(), advice) for estimate in same]
        else:
            findings += _findings_of_key(same, now, _are_both_states(estimates, run.nav))
    return findings


def refuse_other_flight(settings: Mapping[str, Any], config: FlightConfig) -> None:
    """Refuse the settings of a run that was made from other inertial or GNSS logs than those of a flight.

    Files are compared by their content, or by their names if the run was made from logs in memory.

    Raises
    ------
    ConfigError : they differ
    """
    hashes = settings.get("input_sha256") or {}
    now = config.model_dump(mode="json")
    for table in ("imu", "gnss"):
        before, given = (entry(each, (table, "files")) or () for each in (settings["flight"], now))
        by_content = all(path in hashes for path in before) and all(Path(path).is_file() for path in given)
        if by_content:
            same = [hashes[path] for path in before] == [sha256(Path(path)) for path in given]
        else:
            same = [Path(path).name for path in before] == [Path(path).name for path in given]
        if not same:
            names = [", ".join(Path(path).name for path in paths) or "none" for paths in (before, given)]
            differ = (
                "its content has changed since"
                if names[0] == names[1]
                else f"that of the flight is {names[1]}"
            )
            raise ConfigError(
                f"the run is of another flight: it was made from the {table} log {names[0]}, {differ}",
                key="run",
                advice="replay this flight and give the folder of that run",
            )


def _are_both_states(estimates: list[InstallationEstimate], nav: pd.DataFrame) -> bool:
    """Return whether a run had lever arm and IMU time as states, and determined no implausible error of either."""
    plausible = all(one.is_plausible for one in estimates if one.part.key in (_LEVER, _TIME))
    return plausible and all(part.column in nav for part in PARTS if part.key in (_LEVER, _TIME))


def _findings_of_key(estimates: list[InstallationEstimate], now: Any, both: bool) -> list[Finding]:
    """Return the findings of one key of the flight file, whose value is ``now``, as it was in the run."""
    key = estimates[0].part.key
    if not all(estimate.is_plausible for estimate in estimates):
        name = ".".join(estimates[0].part.declared[1:])
        advice = (
            f"larger than {PLAUSIBLE:g} sigmas of {name} = {estimates[0].declared_sigma:g}: nothing is proposed. Check"
            f" {key}, the time tags and the axes, or declare a larger sigma and replay"
        )
        return [Finding("warning", "run", estimate.words(), advice) for estimate in estimates]
    sure = "sure: determined by a run" if both or key not in _MISTAKEN else f"likely: {_MISTAKEN[key]}"
    significant = [estimate for estimate in estimates if estimate.is_significant]
    findings = []
    for estimate in estimates:
        if estimate.is_significant:
            why = f"determined by a run, sigma {estimate.sigma:.2g}"
            proposed = _corrected(significant, now)
            if key == _LAG and proposed < 0.0:
                advice = (
                    "range rates do not lead the motion: check the time tags of both logs and the lever arm"
                )
                findings.append(Finding("warning", "run", estimate.words(), advice))
                continue
            proposal = Proposal(key, proposed, why)
            findings.append(Finding("warning", "run", estimate.words(), "", sure, (proposal,)))
        else:
            findings.append(Finding("ok", "run", f"{estimate.words()}: {key} is not contradicted"))
    return findings


def _corrected(estimates: list[InstallationEstimate], now: Any) -> Any:
    """Return the number of a key, or all of its numbers, with estimates added, each sum rounded to its sigma."""
    if estimates[0].part.place is None:
        return _rounded(float(now) + estimates[0].value, estimates[0].sigma)
    values = [float(each) for each in now]
    for estimate in estimates:
        assert estimate.part.place is not None
        values[estimate.part.place] = _rounded(values[estimate.part.place] + estimate.value, estimate.sigma)
    return tuple(values)


def _rounded(value: float, sigma: float) -> float:
    return round(value, 1 - int(np.floor(np.log10(sigma))))


def _declared(flight: Mapping[str, Any], key: str) -> Any:
    """Return the value of a key of a flight's settings, None where its table is missing.

    A lever arm that is left out is that of the first antenna, or zero, as in a replay.
    """
    value = entry(flight, tuple(key.split(".")))
    if value is None and key == _LEVER:
        antennas: Any = entry(flight, ("gnss", "antenna")) or ({},)
        value = antennas[0].get("lever_arm_m") or (0.0, 0.0, 0.0)
    return list(value) if isinstance(value, tuple) else value
