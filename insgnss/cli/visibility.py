"""``insgnss visibility``: which satellites the antennas saw along a run or a reference trajectory."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from insgnss.cli.ending import own_errors_told
from insgnss.errors import ConfigError

if TYPE_CHECKING:
    from rich.table import Table

    from insgnss.visibility import VisibilityStudy


def visibility(
    source: Annotated[Path, typer.Argument(help="A saved run (its folder) or a reference trajectory (CSV).")],
    flight: Annotated[
        Path, typer.Option("--flight", help="The flight file: week, satellites' messages, antennas.")
    ],
    antenna: Annotated[
        str | None,
        typer.Option("--antenna", "-a", help="A pattern's name in the library, or a file (.csv)."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for tables and pictures; none is written without it."),
    ] = None,
    filter: Annotated[
        str, typer.Option("--filter", "-f", help="A filter's name in the library, or a file: thresholds.")
    ] = "tight17",
    threshold: Annotated[
        float | None, typer.Option("--threshold", help="Least gain in dBic, in place of the filter's.")
    ] = None,
    step: Annotated[float, typer.Option("--step", help="Seconds between two attitudes; 0 takes all.")] = 1.0,
    format: Annotated[str, typer.Option("--format", help="'parquet' or 'csv'.")] = "parquet",
    pictures: Annotated[bool, typer.Option(help="Draw the pictures (needs matplotlib).")] = True,
) -> None:
    """Tell which satellites antennas and airframe hid, when, and what that cost in geometry."""
    began = time.perf_counter()
    with own_errors_told():
        form = _form(format)
        if not step >= 0.0:
            raise ConfigError(f"{step} is no step", key="--step", advice="give seconds, 0 for every row")
        # pandas and the compiled code are loaded only once the options are known to be right
        from rich.console import Console

        from insgnss.library import filter_config
        from insgnss.log.flight import Flight
        from insgnss.visibility.figures import save_figures
        from insgnss.visibility.sources import visibility_of

        config = filter_config(filter)
        if threshold is not None:
            settings = {"threshold": "gain", "threshold_gain_dbic": threshold}
            changed = config.visibility.model_copy(update=settings)
            config = config.model_copy(update={"visibility": changed})
        with Console(stderr=True).status("studying ...") as status:
            study = visibility_of(source, Flight.load(flight), config, antenna, step)
            written: list[Path] = []
            if output is not None:
                status.update("saving ...")
                written.append(study.save(output, form))
                written += save_figures(study, output) if pictures else []
    console = Console(file=sys.stdout, width=120)
    console.print(_satellite_table(study))
    console.print(_dop_line(study), highlight=False)
    for _, event in study.events.iterrows():
        console.print(f"{event['time_s']:.1f} s: {event['kind']}: {event['detail']}", highlight=False)
    where = f"wrote {output}" if written else "nothing was written (no --output)"
    typer.echo(f"{where}; {time.perf_counter() - began:.2f} s in all")


def _form(text: str) -> Literal["parquet", "csv"]:
    if text == "parquet":
        return "parquet"
    if text == "csv":
        return "csv"
    raise ConfigError(f"'{text}' is no format", key="--format", advice="write 'parquet' or 'csv'")


def _satellite_table(study: VisibilityStudy) -> Table:
    """Return, per satellite, the share of its time above the horizon's mask in each state."""
    from rich.table import Table

    table = Table(title="share of the time above the elevation mask")
    names = ("satellite", "seen", "uncertain", "gain too low", "behind the airframe", "lowest gain, dBic")
    for name in names:
        table.add_column(name, justify="left" if name == "satellite" else "right")
    above = study.satellites[study.satellites["reason"] != "masked_elevation"]
    for sv, rows in above.groupby("sv", observed=True):
        decision, reason = rows["decision"].astype("str"), rows["reason"].astype("str")
        shares = (
            decision.isin(["visible", "uncertain_visible"]),
            decision.str.startswith("uncertain"),
            reason == "masked_gain",
            reason == "masked_obstruction",
        )
        cells = (f"{100.0 * share.mean():.1f} %" for share in shares)
        table.add_row(str(sv), *cells, f"{rows['gain_dbic'].min():.1f}")
    return table


def _dop_line(study: VisibilityStudy) -> str:
    """Return the medians of satellites and dilution, without and with the stage."""
    middle = study.dop.drop(columns="time_s").median()
    worst = study.dop["pdop_seen"].max()
    return (
        f"median satellites {middle['n_all']:.0f} -> {middle['n_seen']:.0f}, "
        f"PDOP {middle['pdop_all']:.2f} -> {middle['pdop_seen']:.2f} (largest {worst:.2f})"
    )
