"""``insgnss margin RUN``: the margin along the path of a saved run, printed and written."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from insgnss.cli.file_options import check_files
from insgnss.cli.printing import records, text_table
from insgnss.cli.progress import telling
from insgnss.results.saving import PICTURE_KIND

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from insgnss.results.table_files import TableFormat
    from insgnss.runs.margin import FlownMargin


def flown_study(
    console: Console,
    source: Path,
    emitters: str,
    output: Path | None,
    form: TableFormat,
    step: float,
    pictures: bool,
) -> tuple[dict[str, Any], list[Path]]:
    """Study a saved run; print the summary, write tables and picture; return data and written files."""
    from insgnss.config.interference import InterferenceConfig
    from insgnss.config.library import file_of
    from insgnss.config.strict import load_toml
    from insgnss.runs.margin import flown_margin, picture
    from insgnss.runs.margin.figures import PICTURE_FILE
    from insgnss.runs.margin.study import FILES, STUDY_NAME
    from insgnss.runs.result import Run

    check_files(output, FILES, STUDY_NAME)
    check_files(output if pictures else None, (PICTURE_FILE,), PICTURE_KIND)
    config = load_toml(file_of("emitters", emitters), InterferenceConfig)
    with telling("flying the run past the emitters"):
        study = flown_margin(Run.load(source), config, step_s=step)
    console.print(_flown_table(study))
    events = study.events[~study.events["kind"].str.startswith("lock_lost")]
    for _, event in events.iterrows():
        console.print(f"{event['time_s']:.1f} s: {event['kind']}: {event['detail']}", highlight=False)
    counts = study.in_lock()
    results: dict[str, Any] = {
        "satellites": records(study.summary().reset_index()),
        "events": records(events),
    }
    least_in_lock = {}
    for loop, words in (("unaided", "without"), ("aided", "with")):
        least = counts.iloc[int(counts[f"lock_{loop}"].to_numpy().argmin())]
        least_in_lock[loop] = {
            name: float(least[name]) for name in (f"lock_{loop}", "n_satellites", "time_s")
        }
        console.print(
            f"{words} aiding: at least {least[f'lock_{loop}']:.0f} of {least['n_satellites']:.0f} satellites "
            f"in lock, at {least['time_s']:.1f} s",
            highlight=False,
        )
    results["least_in_lock"] = least_in_lock
    if output is None:
        return results, []
    written = [study.save(output, form)]
    return results, written + ([picture(study, output / PICTURE_FILE)] if pictures else [])


def _flown_table(study: FlownMargin) -> Table:
    names = {
        "js_max_db": "largest J/S, dB",
        "reserve_unaided_min_db": "least reserve without aiding, dB",
        "lock_unaided_share": "in lock",
        "reserve_aided_min_db": "least reserve with aiding, dB",
        "lock_aided_share": "in lock",
    }
    rows = (
        (str(sv), *(f"{row[n]:.1%}" if n.endswith("share") else f"{row[n]:.1f}" for n in names))
        for sv, row in study.summary().iterrows()
    )
    title = "phase loops along the path, each the better of second and third order"
    return text_table(title, ("satellite", *names.values()), rows, left=("satellite",))
