"""Everything needed to repeat the run: versions, hashes of the input, resolved settings."""

from __future__ import annotations

import json
from pathlib import PurePath

from insgnss.report.html import Section, folded, table, text
from insgnss.runs.result import Run

_SHOWN_APART = ("versions", "input_sha256", "took", "made")


def section(run: Run) -> Section:
    """Return versions and hashes as tables, the settings folded."""
    settings = dict(run.settings)
    versions = [[name, value] for name, value in settings.get("versions", {}).items()]
    versions.append(["made", settings.get("made", "-")])
    hashes = [[PurePath(name).name, value] for name, value in settings.get("input_sha256", {}).items()]
    took = [[name.removesuffix("_s"), f"{value:.2f} s"] for name, value in settings.get("took", {}).items()]
    before = "<h3>Versions</h3>" + table(("what", "version"), versions)
    before += "<h3>Input</h3>" + table(("file", "SHA-256"), hashes)
    unread = run.events.loc[run.events["kind"] == "columns_not_read", "detail"]
    before += "".join(f"<p>{text(detail)}</p>" for detail in unread)
    before += "<h3>Computing time</h3>" + table(("step", "time"), took) if took else ""
    for name, value in settings.items():
        if name not in _SHOWN_APART and value is not None:
            shown = json.dumps(value, indent=1, default=str)
            before += folded(name.replace("_", " "), f"<pre>{text(shown)}</pre>")
    return Section("settings", "Settings, versions, input", before=before)
