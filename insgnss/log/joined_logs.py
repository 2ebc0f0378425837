"""Joins logs of several makers: measurements of one receiver, inertial samples of another device."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from insgnss.errors import InputError, TimeError
from insgnss.gpstime import ns_to_datetime
from insgnss.log.detect import NAMES, Format
from insgnss.log.further_samples import HEADING, FurtherSamples
from insgnss.log.own_solution import has_attitude
from insgnss.log.receiver import ReceiverLog
from insgnss.tables import Event

_APART: Final = "convert each into a folder of its own"


@dataclass(frozen=True)
class FormatLog:
    """The log of the inputs of one format."""

    kind: Format
    paths: tuple[Path, ...]
    log: ReceiverLog

    def __str__(self) -> str:
        log = self.log
        held = [
            f"{count} {what}"
            for count, what in (
                (len(log.gnss.t_ns), "measurements"),
                (0 if log.imu is None else len(log.imu.t_ns), "inertial samples"),
                (0 if log.solution is None else len(log.solution.t_ns), "rows of its own solution"),
            )
            if count
        ]
        return f"{self.names()} ({NAMES[self.kind]}: {', '.join(held)})"

    def names(self) -> str:
        """Return the names of the files."""
        return ", ".join(path.name for path in self.paths)


def join_logs(logs: Sequence[FormatLog]) -> ReceiverLog:
    """Return one log with the measurements of the one format that has them and the inertial samples of another.

    Without measurements the fixes of the one format that has them take their place. Broadcast messages come from the
    log of the measurements, else from another. Further samples are in the axes of the inertial ones and come from the
    same log; a heading, which has no axes, may come from another. The solution is one with attitude if there is one; an
    event names others.

    Raises
    ------
    InputError : not exactly one format holds measurements, or without any fixes; several hold inertial samples
    TimeError : the time spans do not overlap
    """
    if len(logs) == 1:
        return logs[0].log
    first = _only(logs, "measurements", lambda log: len(log.gnss.t_ns) > 0)
    if first is None:
        first = _only(logs, "fixes", lambda log: log.satellite_fixes() is not None)
    if first is None:
        raise InputError(
            f"none of the files holds raw measurements or fixes: {' and '.join(map(str, logs))}",
            file=_files(logs),
            advice=f"give the file that holds them in one call with these, or {_APART}",
        )
    inertial = _only(logs, "inertial samples", lambda log: log.imu is not None)
    if inertial is None:
        inertial = next((one for one in logs if one.log.further), first)
    _check_overlap(first, [one for one in logs if one is not first])
    solved = [one for one in (first, *logs) if one.log.solution is not None]
    solution = next((one for one in solved if has_attitude(one.log.solution)), next(iter(solved), first))
    navigation = first.log.navigation
    for one in logs:
        if navigation is None or not navigation.has_messages:
            navigation = one.log.navigation or navigation
    headings = [s for one in (inertial, first, *logs) for s in one.log.further if s.kind == HEADING][:1]
    further = (*(s for s in inertial.log.further if s.kind != HEADING), *headings)
    return replace(
        first.log,
        navigation=navigation,
        imu=inertial.log.imu,
        imu_axes=inertial.log.imu_axes,
        imu_is_mean=inertial.log.imu_is_mean,
        further=further,
        solution=solution.log.solution,
        solution_point=solution.log.solution_point,
        solution_from=solution.log.solution_from,
        fixes=first.log.fixes if solution is first else first.log.satellite_fixes(),
        events=[event for one in logs for event in one.log.events]
        + _not_used(logs, inertial, solution, further),
    )


def _only(logs: Sequence[FormatLog], what: str, holds: Callable[[ReceiverLog], bool]) -> FormatLog | None:
    """Return the one log that holds something, None without one."""
    holders = [one for one in logs if holds(one.log)]
    if len(holders) > 1:
        raise InputError(
            f"{what} are in files of {len(holders)} formats: {' and '.join(map(str, holders))}",
            file=_files(holders),
            advice=f"leave one of them out, or {_APART} and name in one flight file the tables that you want",
        )
    return next(iter(holders), None)


def _check_overlap(first: FormatLog, others: Sequence[FormatLog]) -> None:
    """Hold the span of the measurements against those of the other logs."""
    begin, end = first.log.span_ns()
    for other in others:
        other_begin, other_end = other.log.span_ns()
        if other_begin > end or other_end < begin:
            raise TimeError(
                f"the files do not overlap in time: {_span(first)}, {_span(other)}",
                file=_files((first, other)),
                advice="check that both are of one flight. If one clock was wrong, "
                f"{_APART}, name both tables in one flight file and give imu.time.offset_s",
            )


def _span(one: FormatLog) -> str:
    first, last = (f"{ns_to_datetime(t_ns):%Y-%m-%d %H:%M:%S}" for t_ns in one.log.span_ns())
    return f"{one.names()} from {first} to {last} GPS time"


def _not_used(
    logs: Sequence[FormatLog], inertial: FormatLog, solution: FormatLog, further: Sequence[FurtherSamples]
) -> list[Event]:
    """Return the events of solutions and further samples that are in the logs but not in the joined one."""
    events = []
    for one in logs:
        if one.log.solution is not None and one is not solution:
            detail = f"{one.names()}: its own solution is not used, that of {solution.names()} is"
            events.append(Event(None, "reference_not_used", detail))
        lost = [samples.kind for samples in one.log.further if all(samples is not used for used in further)]
        if lost:
            kinds = " and ".join(lost)
            detail = f"{one.names()}: {kinds} not used: {inertial.names()} is read for inertial and further samples"
            events.append(Event(None, "sensor_samples_not_used", detail))
    return events


def _files(logs: Sequence[FormatLog]) -> str:
    return ", ".join(str(path) for one in logs for path in one.paths)
