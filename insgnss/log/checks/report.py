"""The result of a flight's check: facts and findings, each with its severity, printed line by line."""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

from insgnss.errors import InsGnssError, UnitsError
from insgnss.tables import Event

Severity = Literal["ok", "warning", "error"]
MARKS: Final[dict[Severity, str]] = {"ok": "ok     ", "warning": "WARNING", "error": "ERROR  "}


# kinds of findings that no event tells
AXES_FIT: Final = "axes_fit"  # the declared axes, as far as the motion shows them
CLOCK_LEAPS: Final = "clock_leaps"  # bad epochs, not jumps of the receiver's clock
RATES_CONTRADICT: Final = (
    "rates_contradict"  # the pseudoranges, and no key mends it: no velocity comes from them
)
VERTICAL_AXIS: Final = "vertical_axis"  # which one gravity shows, by itself

_SURE_OF_UNITS: Final = "sure: no other unit explains gravity at rest"
Value = str | float | int | tuple[str, ...] | tuple[float, ...]


@dataclass(frozen=True)
class Proposal:
    """One key of the flight file and the value that the logs themselves ask for."""

    key: str  # dotted, "imu.time.offset_s"
    value: Value
    why: str  # one line, written next to the key in a corrected file

    def text(self) -> str:
        """Return the entry as written in a flight file."""
        return f"{self.key} = {_toml(self.value)}"


def _toml(value: Value) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml(part) for part in value) + "]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


@dataclass(frozen=True)
class Finding:
    """One result of a check.

    ``proposals`` are made only where the logs leave one explanation; ``sure`` says in words how far they bear it out.
    """

    severity: Severity
    topic: str  # "imu", "gnss", "navigation", "reference", "flight"
    text: str
    advice: str = ""
    sure: str = ""
    proposals: tuple[Proposal, ...] = ()
    kind: str = ""  # by which a program knows it: the kind of the event that it tells, or one of those above

    def line(self) -> str:
        """Return the finding on one line, the advice and the proposed keys after an arrow."""
        sure = f" ({self.sure})" if self.sure else ""
        proposed = "proposed: " + ", ".join(p.text() for p in self.proposals) if self.proposals else ""
        advice = "; ".join(part for part in (self.advice, proposed) if part)
        return f"{MARKS[self.severity]} {self.topic:<10} {self.text}{sure}" + (
            f" -> {advice}" if advice else ""
        )


@dataclass(frozen=True, repr=False)
class CheckReport:
    """All findings of a flight, in the order of its logs."""

    name: str
    findings: tuple[Finding, ...] = field(default=())
    compile_s: float = 0.0  # that the first command of an installation waited for the compiler

    @property
    def severity(self) -> Severity:
        """The worst severity among the findings."""
        severities = {finding.severity for finding in self.findings}
        return "error" if "error" in severities else "warning" if "warning" in severities else "ok"

    def of(self, severity: Severity) -> tuple[Finding, ...]:
        """Return the findings of one severity."""
        return tuple(finding for finding in self.findings if finding.severity == severity)

    @property
    def proposals(self) -> tuple[Proposal, ...]:
        """All proposals, each key once: the first stands."""
        by_key = {p.key: p for finding in reversed(self.findings) for p in finding.proposals}
        order = dict.fromkeys(p.key for finding in self.findings for p in finding.proposals)
        return tuple(by_key[key] for key in order)

    @property
    def sure_proposals(self) -> tuple[Proposal, ...]:
        """The sure proposals; a likely one is left to the reader."""
        sure = {
            p.key for finding in self.findings if finding.sure.startswith("sure") for p in finding.proposals
        }
        return tuple(p for p in self.proposals if p.key in sure)

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def __repr__(self) -> str:
        return f"CheckReport({self.lines()[-1]})"

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"

    def lines(self) -> list[str]:
        """Return the report as lines of text, the last one a summary."""
        count = Counter(finding.severity for finding in self.findings)
        summary = f"{self.name}: {count['error']} error(s), {count['warning']} warning(s), {count['ok']} ok"
        return [*(finding.line() for finding in self.findings), summary]


def from_error(topic: str, error: InsGnssError) -> Finding:
    """Return the finding of a log or a table that cannot be read; units that fit are proposed."""
    fits = error.fits if isinstance(error, UnitsError) else ()
    proposals = tuple(Proposal(key, value, error.message) for key, value in fits)
    text = f"{error.place()}: {error.message}" if error.place() else error.message
    return Finding("error", topic, text, error.advice, _SURE_OF_UNITS if fits else "", proposals)


def from_events(
    topic: str, events: Sequence[Event], notices: frozenset[str], errors: frozenset[str] = frozenset()
) -> list[Finding]:
    """Return one finding for each kind of event, the first event's detail and the number of such.

    Parameters
    ----------
    topic : of the findings
    events : what the readers noticed
    notices : kinds that are reported but not a defect
    errors : kinds with which the log is of no use
    """
    kinds: dict[str, list[Event]] = {}
    for event in events:
        kinds.setdefault(event.kind, []).append(event)
    findings = []
    for kind, same in kinds.items():
        more = f" (and {len(same) - 1} more)" if len(same) > 1 else ""
        severity: Severity = "ok" if kind in notices else "error" if kind in errors else "warning"
        findings.append(Finding(severity, topic, f"{kind}: {same[0].detail}{more}", kind=kind))
    return findings
