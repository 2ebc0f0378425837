"""``insgnss smooth``: a flight's logs in, a solution from the whole log out."""

from __future__ import annotations

import time

from insgnss.cli.command_errors import own_errors_told
from insgnss.cli.file_options import FlightFile, Force, FormatName, RunFolder, RunPage, table_form
from insgnss.cli.filter_options import FilterName, Integrity, Settings, chosen_filter
from insgnss.cli.memory import give_back_what_is_freed
from insgnss.cli.printing import AsJson
from insgnss.cli.progress import telling
from insgnss.cli.replay import check_outputs, tell_run, write_run
from insgnss.cli.rows import Covariance, PointOption, Quaternion, Rate, Times, rows_wanted
from insgnss.log.flight import Flight
from insgnss.results.saving import overwriting
from insgnss.runs.replay import replay as run_replay


def smooth(
    flight: FlightFile,
    output: RunFolder = None,
    filter: FilterName = "tight",
    settings: Settings = None,
    rate: Rate = "gnss",
    times: Times = None,
    point: PointOption = None,
    quaternion: Quaternion = False,
    covariance: Covariance = False,
    integrity: Integrity = False,
    format: FormatName = "parquet",
    report: RunPage = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Run the filter forward and the smoother back over a flight's logs, for post-processing.

    By default there is one row per GNSS epoch, and so none inside an outage: ask for others with --rate or --times.
    """
    began = time.perf_counter()
    give_back_what_is_freed()
    with own_errors_told(), overwriting(force):
        form = table_form(format)
        wanted = rows_wanted(rate, times, point, quaternion=quaternion, covariance=covariance)
        chosen = chosen_filter(filter, settings)
        loaded = Flight.load(flight)
        with overwriting(force, loaded.files()), telling("starting") as tell:
            check_outputs(output, report)
            run = run_replay(loaded, chosen, smooth=True, integrity=integrity, progress=tell, **wanted)
            written = write_run(run, output, report, form, tell)
    tell_run(loaded, run, written, began, as_json=as_json)
