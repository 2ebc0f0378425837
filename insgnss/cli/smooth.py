"""``insgnss smooth``: a flight's logs in, a solution from the whole log out."""

from __future__ import annotations

from insgnss.cli.file_options import FlightFile, Force, FormatName, RunFolder, RunPage, table_form
from insgnss.cli.filter_options import FilterName, Integrity, Settings, chosen_filter
from insgnss.cli.printing import AsJson
from insgnss.cli.replay import run_and_tell
from insgnss.cli.rows import Covariance, PointOption, Quaternion, Rate, Times, rows_wanted
from insgnss.results.saving import overwriting


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
    """Run the filter forward and the smoother backward over a flight's logs, for post-processing.

    By default there is one row per GNSS epoch, and so none inside an outage: ask for others with --rate or --times.
    """
    with overwriting(force):
        outputs = output, report, table_form(format)
        asked = rows_wanted(rate, times, point, quaternion=quaternion, covariance=covariance)
        asked |= {"smooth": True, "integrity": integrity}
        run_and_tell(flight, chosen_filter(filter, settings), outputs, asked, force=force, as_json=as_json)
