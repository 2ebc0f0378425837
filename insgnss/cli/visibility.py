"""``insgnss visibility``: which satellites the antennas saw along a run or a reference trajectory."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from insgnss.cli.command import at_least
from insgnss.cli.file_options import (
    Force,
    FormatName,
    Pictures,
    StudyFolder,
    check_files,
    run_files,
    table_form,
    tell_end,
)
from insgnss.cli.filter_options import FilterName, Settings, chosen_filter
from insgnss.cli.printing import AsJson, print_json, records, result_console, text_table
from insgnss.cli.progress import telling
from insgnss.constants import S_PER_WEEK
from insgnss.results.saving import PICTURE_KIND, overwriting

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table

    from insgnss.runs.visibility import VisibilityStudy


def visibility(
    source: Annotated[Path, typer.Argument(help="A saved run (its folder) or a reference trajectory (CSV).")],
    flight: Annotated[
        Path, typer.Option("--flight", help="The flight file: GPS week, navigation messages, antennas.")
    ],
    antenna: Annotated[
        str | None,
        typer.Option("--antenna", "-a", help="Name of a gain pattern in the library, or a file (.csv)."),
    ] = None,
    output: StudyFolder = None,
    filter: FilterName = "tight",
    settings: Settings = None,
    threshold: Annotated[
        float | None,
        typer.Option(
            "--threshold",
            callback=at_least(-200.0, 100.0),
            help="Least gain in dBic at which a satellite is visible, in place of the filter's.",
        ),
    ] = None,
    step: Annotated[
        float,
        typer.Option(
            "--step",
            callback=at_least(0.0, S_PER_WEEK),
            help="Seconds between two evaluated attitudes; 0: all.",
        ),
    ] = 1.0,
    format: FormatName = "parquet",
    pictures: Pictures = True,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Report which satellites the antennas and the airframe hid, when, and how much DOP degraded."""
    began = time.perf_counter()
    with overwriting(force, run_files(source), output):
        form = table_form(format)
        # pandas and the compiled code are loaded only once the options are known to be right
        from insgnss.log.flight import Flight
        from insgnss.runs.visibility.figures import PICTURES, save_figures
        from insgnss.runs.visibility.sources import visibility_of
        from insgnss.runs.visibility.study import FILES, STUDY_NAME

        config = chosen_filter(filter, settings)
        if threshold is not None:
            by_gain = {"threshold": "gain", "threshold_gain_dbic": threshold}
            changed = config.visibility.model_copy(update=by_gain)
            config = config.model_copy(update={"visibility": changed})
        loaded = Flight.load(flight)
        with overwriting(force, loaded.files()), telling("studying") as tell:
            check_files(output, FILES, STUDY_NAME)
            check_files(output if pictures else None, PICTURES, PICTURE_KIND)
            study = visibility_of(source, loaded, config, antenna, step)
            written: list[Path] = []
            if output is not None:
                tell("saving")
                written.append(study.save(output, form))
                written += save_figures(study, output) if pictures else []
    if as_json:
        median = study.dop.drop(columns="time_s").median().to_dict()
        dop = {"median": median, "largest_pdop_seen": study.dop["pdop_seen"].max()}
        results = {"satellites": records(_shares(study).reset_index()), "dop": dop}
        print_json({**results, "events": records(study.events), "wrote": output if written else None})
        return
    console = result_console()
    console.print(_satellite_table(study))
    console.print(_dop_line(study), highlight=False)
    for _, event in study.events.iterrows():
        console.print(f"{event['time_s']:.1f} s: {event['kind']}: {event['detail']}", highlight=False)
    tell_end(began, output if written else None)


def _satellite_table(study: VisibilityStudy) -> Table:
    """Return, per satellite, the share of its time above the horizon's mask in each state."""
    heads = ("satellite", "seen", "uncertain", "gain too low", "behind the airframe", "lowest gain, dBic")
    rows = (
        (str(sv), *(f"{100.0 * share:.1f} %" for share in row.iloc[:-1]), f"{row['lowest_gain_dbic']:.1f}")
        for sv, row in _shares(study).iterrows()
    )
    return text_table("share of the time above the elevation mask", heads, rows, left=("satellite",))


def _shares(study: VisibilityStudy) -> pd.DataFrame:
    """Return, per satellite, the shares of its time above the mask in each state, and its lowest gain."""
    import pandas as pd

    above = study.satellites[study.satellites["reason"] != "masked_elevation"]
    decision, reason = above["decision"].astype("str"), above["reason"].astype("str")
    states = {
        "seen": decision.isin(["visible", "uncertain_visible"]),
        "uncertain": decision.str.startswith("uncertain"),
        "masked_gain": reason == "masked_gain",
        "masked_obstruction": reason == "masked_obstruction",
    }
    groups = pd.DataFrame(states).groupby(above["sv"], observed=True)
    return groups.mean().assign(lowest_gain_dbic=above["gain_dbic"].groupby(above["sv"], observed=True).min())


def _dop_line(study: VisibilityStudy) -> str:
    """Return the medians of satellites and dilution, without and with the stage."""
    middle = study.dop.drop(columns="time_s").median()
    worst = study.dop["pdop_seen"].max()
    return (
        f"median satellites {middle['n_all']:.0f} -> {middle['n_seen']:.0f}, "
        f"PDOP {middle['pdop_all']:.2f} -> {middle['pdop_seen']:.2f} (largest {worst:.2f})"
    )
