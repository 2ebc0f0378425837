"""A receiver's own file: the user's declarations about it, and its content as tables."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from insgnss.errors import InputError
from insgnss.log.events import in_file
from insgnss.log.further_samples import FurtherSamples, most_samples
from insgnss.tables import Event, GnssTable, ImuTable, NavigationData, ReferenceTable

RtcmOrigin = Literal["own", "base"]


@dataclass(frozen=True)
class LogDeclarations:
    """The declarations for a conversion; values that are not declared come from the files if they state them."""

    date: dt.date | None = None  # of the log's first epoch, for streams that do not say it
    imu_scales: tuple[float, float] | None = None  # [rad, m/s] of one count of a NovAtel sensor
    # part ("imu", "gnss", "reference") -> topic of a bag
    topics: Mapping[str, str] = field(default_factory=dict)
    # whose the RTCM measurements in another log are: this receiver's, or a base station's that corrects it
    rtcm: RtcmOrigin | None = None


SolutionFrom = Literal["satellites", "filter", "truth"]


@dataclass(frozen=True)
class ReceiverLog:
    """One receiver's files as tables; times are GPS time."""

    gnss: GnssTable
    navigation: NavigationData | None = None
    imu: ImuTable | None = None  # in the sensor's own axes, as logged
    events: list[Event] = field(default_factory=list)
    solution: ReferenceTable | None = None  # the receiver's own, with its sigmas
    # the sensor's, as far as its format says where they point
    imu_axes: tuple[str, str, str] = ("+x", "+y", "+z")
    imu_is_mean: bool = False  # samples are means over their intervals, as integrating sensors give
    # whose place the solution is, unless configured otherwise
    solution_point: Literal["imu", "antenna"] = "antenna"
    # satellites: fixes alone; filter: with inertial data; truth: a simulator's
    solution_from: SolutionFrom = "satellites"
    fixes: ReferenceTable | None = None  # of satellites alone, beside a solution that is another's
    further: tuple[FurtherSamples, ...] = ()  # one of a kind at most
    # ECEF, where an RTCM stream states the place of its antenna
    station_m: tuple[float, float, float] | None = None

    def satellite_fixes(self) -> ReferenceTable | None:
        """Return the receiver's fixes from satellites alone, which may take the place of measurements."""
        if self.fixes is None and self.solution_from == "satellites":
            return self.solution
        return self.fixes

    def span_ns(self) -> tuple[int, int]:
        """Return the first and last GPS time of the measurements, without any of the samples, else of the solution."""
        parts = (self.gnss, self.imu, self.solution)
        t_ns = next(part.t_ns for part in parts if part is not None and len(part.t_ns))
        return int(t_ns[0]), int(t_ns[-1])


def no_measurements() -> GnssTable:
    """Return a table of measurements without a row, for logs that hold other things alone."""
    none, index = np.zeros(0), np.zeros(0, np.int16)
    return GnssTable(np.zeros(0, np.int64), index, index, none, none, none, none, (), ())


def assembled(
    path: Path,
    raw: ReceiverLog | None,
    imu: ImuTable | None,
    solution: ReferenceTable | None,
    events: list[Event],
    *,
    further: Sequence[FurtherSamples] = (),
    holder: str,
    advice: str,
) -> ReceiverLog:
    """Return the log of a container (a bag, a flight recorder's file) from its content.

    Parameters
    ----------
    raw : a receiver's own bytes or messages, read
    events : of the container; they get its name
    further : samples of further sensors; of each kind the table with most of them is kept
    holder : what the container is called, as ``advice`` what to record in it, for the error

    Raises
    ------
    InputError : there is neither a measurement nor a sample nor a solution
    """
    if raw is None and imu is None and solution is None:
        why = "; ".join(event.detail for event in events[:4])
        raise InputError(
            f"the {holder} holds nothing that can be used{': ' + why if why else ''}",
            file=path,
            advice=advice,
        )
    samples, more_events = most_samples(further)
    named = in_file(path, [*events, *more_events])
    if raw is None:
        return ReceiverLog(no_measurements(), None, imu, named, solution, further=samples)
    return ReceiverLog(raw.gnss, raw.navigation, imu, named + raw.events, solution, further=samples)
