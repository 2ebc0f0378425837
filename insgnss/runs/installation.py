"""A run's estimates of the installation: the antenna's lever arm, the IMU's time, the IMU's mounting in the vehicle.

Each is a state where the settings or the flight file doubt it. It is reported when its sigma has fallen to a fifth of
that doubt, and ``insgnss check FLIGHT --run DIR`` proposes the corrected keys.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd

from insgnss.config.flight import FlightConfig
from insgnss.gpstime import week_seconds_to_ns
from insgnss.log.checks.report import Finding, Proposal
from insgnss.runs.result import Run
from insgnss.tables import Event

KNOWN: Final = 0.2  # of the sigma at the start
SIGNIFICANT: Final = 3.0  # sigmas
_SLIP: Final = "vehicle.non_holonomic"


class _InstallationNumber(NamedTuple):
    """A number of the flight file and the place of its error in a run."""

    column: str  # of ``nav``: what has to be added to the number
    key: str
    place: int | None  # in a key that holds several numbers
    doubt: tuple[str, ...]  # path of its initial sigma in the run's settings


PARTS: Final = (
    *(
        _InstallationNumber(
            f"lever_arm_{axis}_m", "gnss.lever_arm_m", i, ("filter", "process", "lever_arm_sigma_m")
        )
        for i, axis in enumerate("xyz")
    ),
    _InstallationNumber(
        "imu_time_offset_s", "imu.time.offset_s", None, ("filter", "process", "imu_time_sigma_s")
    ),
    *(
        _InstallationNumber(
            column, f"{_SLIP}.{column}", None, ("flight", *_SLIP.split("."), "mounting_sd_deg")
        )
        for column in ("mounting_pitch_deg", "mounting_yaw_deg")
    ),
)


class InstallationEstimate(NamedTuple):
    """A number that a run has found."""

    part: _InstallationNumber
    time_s: float  # since when, seconds of the week
    value: float
    sigma: float

    def words(self) -> str:
        """Return the number with its sigma."""
        digits = max(0, 1 - int(np.floor(np.log10(self.sigma))))
        return f"{self.part.column} is {self.value:+.{digits}f}, sigma {self.sigma:.{digits}f}"


def known_parts(nav: pd.DataFrame, settings: Mapping[str, Any]) -> list[InstallationEstimate]:
    """Return a run's estimates at its end, with the time of convergence; ``settings`` are the run's."""
    found = []
    for part in PARTS:
        if part.column not in nav or not len(nav):
            continue
        sigma = nav[f"sd_{part.column}"].to_numpy()
        known = sigma <= KNOWN * float(_value(settings, part.doubt))
        if known[-1]:
            since = len(known) - int(np.argmin(known[::-1])) if not known.all() else 0
            time_s, value = nav["time_s"].iloc[since], nav[part.column].iloc[-1]
            found.append(InstallationEstimate(part, float(time_s), float(value), float(sigma[-1])))
    return found


def installation_events(nav: pd.DataFrame, settings: Mapping[str, Any], week: int) -> list[Event]:
    """Return an event for each number of the installation that a run has come to know."""
    return [
        Event(int(week_seconds_to_ns(week, one.time_s)), "installation_known", one.words())
        for one in known_parts(nav, settings)
    ]


def installation_findings(run: Run, config: FlightConfig) -> list[Finding]:
    """Return a run's proposals for its flight file.

    A number that was changed since the run is left as it stands: the run has found the error of the former one.
    """
    known, now, then = (
        known_parts(run.nav, run.settings),
        config.model_dump(mode="json"),
        run.settings["flight"],
    )
    if not known:
        told = "the run has no estimate of lever arm, IMU time or mounting"
        advice = "process.lever_arm_sigma_m and process.imu_time_sigma_s make them states; they need turns and stops"
        return [Finding("ok", "run", told, advice)]
    findings = []
    for one in known:
        keys = tuple(one.part.key.split("."))
        given, before = _value(now, keys), _value(then, keys)
        if given is None or given != before:
            advice = f"{one.part.key} is not what the run was made with: replay the flight again"
            findings.append(Finding("warning", "run", one.words(), advice))
        elif abs(one.value) < SIGNIFICANT * one.sigma:
            findings.append(Finding("ok", "run", f"{one.words()}: consistent with {one.part.key}"))
        else:
            value = _corrected([k for k in known if k.part.key == one.part.key], given)
            proposal = Proposal(one.part.key, value, f"found in a run, sigma {one.sigma:.2g}")
            findings.append(Finding("warning", "run", one.words(), "", "sure: found in a run", (proposal,)))
    return findings


def _corrected(known: list[InstallationEstimate], given: Any) -> float | tuple[float, ...]:
    """Return the number of a key, or all of its numbers, with the estimate added and rounded to its sigma."""
    if known[0].part.place is None:
        return _rounded(float(given) + known[0].value, known[0].sigma)
    values = [float(each) for each in given]
    for one in known:
        assert one.part.place is not None
        values[one.part.place] = _rounded(values[one.part.place] + one.value, one.sigma)
    return tuple(values)


def _rounded(value: float, sigma: float) -> float:
    return round(value, 1 - int(np.floor(np.log10(sigma))))


def _value(settings: Mapping[str, Any], keys: tuple[str, ...]) -> Any:
    """Return an entry of nested tables, None where a table or the entry is missing."""
    value: Any = settings
    for key in keys:
        value = None if value is None else value.get(key)
    return value
