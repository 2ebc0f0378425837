"""The page of a run, loaded when one is drawn: its parts take as long to load as the engine."""

from __future__ import annotations

from pathlib import Path

from insgnss.runs.result import Run


def write_report(run: Run, path: str | Path) -> Path:
    """Return where ``report.page.write_report`` wrote a run's page."""
    from insgnss.report.page import write_report as written

    return written(run, path)
