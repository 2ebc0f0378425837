"""The page of a run: one HTML file that opens anywhere, without a network."""

from __future__ import annotations

from pathlib import Path

from insgnss.errors import ResultError
from insgnss.report.event_marks import marked_events, with_events
from insgnss.report.html import Section, key_figures, page, paragraphs, write
from insgnss.report.run_time import utc_origin_ms
from insgnss.report.sections import (
    aiding,
    biases,
    errors,
    events,
    inertial,
    innovations,
    integrity,
    ledger,
    motion,
    reception,
    satellites,
    settings,
    sky,
    smoothing,
    supervision,
    track,
)
from insgnss.report.sentences import figures, name_and_utc, name_of, sentences
from insgnss.runs.result import Run
from insgnss.version import __version__

_SECTIONS = (
    track,
    errors,
    integrity,
    motion,
    smoothing,
    satellites,
    reception,
    sky,
    innovations,
    biases,
    inertial,
    aiding,
    supervision,
    events,
    ledger,
    settings,
)


def write_report(run: Run, path: str | Path) -> Path:
    """Write the run's page; return its path.

    Parameters
    ----------
    run : as a replay gives it, or loaded from its folder
    path : of the HTML file; its folder is made if needed

    Raises
    ------
    ResultError : the run has no navigation row, or the file cannot be written
    """
    return write(path, report_html(run))


def report_html(run: Run) -> str:
    """Return the run's page: a summary, then every section that the run has something for.

    Raises
    ------
    ResultError : the run has no navigation row
    """
    if run.nav.empty:
        raise ResultError("the run has no navigation row to show", advice="replay the flight again")
    summary = Section("summary", "Summary", before=key_figures(figures(run)) + paragraphs(sentences(run)))
    own_sections = [part.section(run) for part in _SECTIONS]
    date = run.settings.get("made", "")
    events = marked_events(run)
    sections = with_events([summary, *(section for section in own_sections if section is not None)], events)
    marked = f" {len(events)} of {len(run.events)} events are marked on them." if len(events) else ""
    foot = f"insgnss {__version__}; the run was made {date}. Time axes move together; a double click shows all.{marked}"
    return page(name_of(run), sections, foot, utc_origin_ms(run), about=name_and_utc(run))
