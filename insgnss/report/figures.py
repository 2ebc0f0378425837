"""Figures for papers, each one function: track, errors within their sigma, innovations, satellites.

They return matplotlib's ``Figure``; ``save`` writes it, as vectors where the file's ending says so (.pdf, .svg). Units stand
on every axis. matplotlib is loaded when a figure is drawn::

    from insgnss.report import figures
    figures.save(figures.errors(run, "position"), "position.pdf")
"""  # noqa: E501 - lines of prose

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, ParamSpec

import numpy as np

from insgnss.errors import ConfigError, ResultError
from insgnss.report.charts import BAND_SIGMAS, PALETTE
from insgnss.report.epochs import satellites_of
from insgnss.report.labels import label, unit_of
from insgnss.report.sections.errors import opening_range
from insgnss.report.sections.motion import SIGMA_GROUPS
from insgnss.report.sections.satellites import state_colour, states_of_the_log
from insgnss.report.sections.track import east_north, horizontal_sigma
from insgnss.report.sentences import name_and_utc
from insgnss.results.matplotlib_figure import new_figure
from insgnss.results.saving import PICTURE_KIND, check_replaceable, saving_file, writing
from insgnss.runs.result import Run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

P = ParamSpec("P")

COLUMN_IN: Final = 3.5  # width of a column of most journals
PAGE_IN: Final = 7.16  # and of both
# one style; text stays text in both kinds of vector files, and the same figure gives the same bytes
STYLE: Final[dict[Any, Any]] = {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "grid.linewidth": 0.5,
    "lines.linewidth": 0.9,
    "axes.linewidth": 0.6,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "insgnss",
}


def _styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Return a drawing function that draws in the one style."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with _style():
            figure = draw(*args, **kwargs)
            run = args[0]
            if isinstance(run, Run) and not run.nav.empty:
                figure.suptitle(_two_lines(name_and_utc(run), figure), fontsize=6.5, color="#555555")
            return figure

    return drawn


def _two_lines(words: str, figure: Figure) -> str:
    """Return name and time below each other where the figure is one column wide."""
    name, _, when = words.rpartition(", ")
    return f"{name}\n{when}" if name and figure.get_figwidth() < PAGE_IN else words


def _style() -> AbstractContextManager[None]:
    """Return the style as a context."""
    import matplotlib as mpl

    return mpl.rc_context(STYLE)


@_styled
def track(run: Run) -> Figure:
    """Return the track in metres east and north of the start, coloured by the horizontal sigma, the reference grey."""
    figure = new_figure(COLUMN_IN, 3.2)
    axes = _axes(figure, 1)[0]
    east, north = east_north(run.nav)
    if run.errors is not None and not run.errors.empty:
        at = np.minimum(np.searchsorted(run.nav["time_s"], run.errors["time_s"]), len(east) - 1)
        reference = east[at] - run.errors["d_e_m"].to_numpy(), north[at] - run.errors["d_n_m"].to_numpy()
        axes.plot(*reference, color="#888888", lw=2.5, label="reference")
        axes.legend()
    sigma = horizontal_sigma(run.nav)
    scale = {"vmin": sigma.min(), "vmax": np.quantile(sigma, 0.98), "cmap": "viridis"}
    drawn = axes.scatter(east, north, c=sigma, s=2, zorder=3, rasterized=True, **scale)
    figure.colorbar(drawn, ax=axes, label="horizontal sigma, m")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    return figure


@_styled
def errors(run: Run, group: str = "position") -> Figure:
    """Return the errors of a group ('position', 'velocity', 'attitude') against the reference, three sigma shaded.

    Raises
    ------
    ResultError : the run has no reference
    ConfigError : no such group
    """
    columns = {name: names for name, _, names in SIGMA_GROUPS}.get(group)
    if columns is None:
        raise ConfigError(f"unknown group of errors '{group}'", advice="write position, velocity or attitude")
    if run.errors is None or run.errors.empty:
        raise ResultError("the run has no reference", advice="name a [reference] in the flight file")
    table = run.errors
    figure = new_figure(COLUMN_IN, 1.2 * len(columns) + 0.5)
    time_s = table["time_s"].to_numpy()
    known_s = run.heading_known_s()
    settled = time_s >= (-np.inf if known_s is None or known_s > time_s[-1] else known_s)
    for place, (axes, column) in enumerate(zip(_axes(figure, len(columns)), columns, strict=True)):
        values, band = table[f"d_{column}"].to_numpy(), BAND_SIGMAS * table[f"sd_{column}"].to_numpy()
        axes.fill_between(time_s, -band, band, color=PALETTE[place], alpha=0.2, lw=0, label="three sigma")
        axes.plot(time_s, values, color=PALETTE[place], label="error")
        axes.set_ylim(*opening_range(values[settled], band[settled]))
        axes.set_ylabel(label(column).axis())
    return _with_time(figure)


@_styled
def innovations(run: Run, kind: str = "pseudorange") -> Figure:
    """Return the innovations of a kind over time with their 95 % bound, and divided by sigma against the normal law.

    Raises
    ------
    ResultError : none of that kind was used
    """
    rows = run.measurements[(run.measurements["kind"] == kind) & (run.measurements["status"] == "used")]
    if rows.empty:
        raise ResultError(f"no {kind} was used", advice="the run's ledger says why: run.status_counts()")
    figure = new_figure(COLUMN_IN, 3.2)
    upper, lower = figure.subplots(2, 1)
    ratio = (rows["innovation"] / rows["sd_innovation"]).to_numpy()
    upper.plot(rows["time_s"], rows["innovation"], ".", ms=1.5, color=PALETTE[0], rasterized=True)
    bound = rows.groupby("time_s")["sd_innovation"].median() * 1.96
    for sign in (-1.0, 1.0):
        upper.plot(bound.index, sign * bound, color=PALETTE[1], lw=0.8)
    upper.set_ylabel(f"innovation, {unit_of(run, kind)}")
    _label_time(upper, figure)
    grid = np.linspace(-5.0, 5.0, 201)
    lower.hist(np.clip(ratio, -5.0, 5.0), bins=np.linspace(-5.0, 5.0, 41), density=True, color=PALETTE[5])
    lower.plot(grid, np.exp(-(grid**2) / 2.0) / np.sqrt(2.0 * np.pi), color=PALETTE[1])
    lower.set_xlabel("innovation / sigma, -")
    lower.set_ylabel("density, -")
    return figure


@_styled
def satellites(run: Run) -> Figure:
    """Return a line per satellite of the log over time, coloured by its status.

    Raises
    ------
    ResultError : the run has seen no satellite
    """
    table = states_of_the_log(run)
    if run.satellites.empty:
        raise ResultError("the run has no satellite", advice="its events state the reason")
    place, names = satellites_of(table)
    figure = new_figure(PAGE_IN, 0.9 + 0.14 * len(names))
    axes = _axes(figure, 1)[0]
    for state, _ in table["state"].value_counts().items():
        here = (table["state"] == state).to_numpy()
        if here.any():
            colour, words = state_colour(str(state)), str(state).replace("_", " ")
            axes.plot(
                table["time_s"][here], place[here], "|", ms=5, color=colour, label=words, rasterized=True
            )
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_ylabel("satellite")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4)
    return _with_time(figure)


def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure in the form that the file's ending names (.pdf and .svg are vectors); return the path.

    Raises
    ------
    ResultError : the file cannot be written
    ConfigError : matplotlib does not know the ending
    """
    path = Path(path)
    # no date inside: the same figure is the same file
    metadata = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}.get(path.suffix, {})
    try:
        with writing("the figure", path), _style(), saving_file(path, PICTURE_KIND) as new:
            figure.savefig(new, dpi=300, metadata=metadata)
    except ValueError as error:
        raise ConfigError(
            f"unsupported figure format '{path.suffix}': {error}", advice="write .pdf or .svg"
        ) from error
    return path


def save_figures(run: Run, folder: str | Path, ending: str = "pdf") -> list[Path]:
    """Write every figure that the run has something for into a folder; return the paths.

    Raises
    ------
    ConfigError, ResultError : as of ``check_figures``
    """
    check_figures(run, folder, ending)
    return [save(draw(), Path(folder) / f"{name}.{ending}") for name, draw in _figures_of(run).items()]


def check_figures(run: Run, folder: str | Path, ending: str = "pdf") -> None:
    """Refuse what ``save_figures`` could not write, before anything is drawn.

    Raises
    ------
    ConfigError : no format of figures has this ending
    ResultError : there is a file that may not be replaced, or nothing can be written into the folder
    """
    if ending.lower() not in new_figure(1.0, 1.0).canvas.get_supported_filetypes():
        advice = "write pdf, svg or png"
        raise ConfigError(f"unsupported figure format '{ending}'", key="--figure-format", advice=advice)
    check_replaceable(Path(folder), [f"{name}.{ending}" for name in _figures_of(run)], PICTURE_KIND)


def _figures_of(run: Run) -> dict[str, Callable[[], Figure]]:
    """Return how to draw each figure that the run has something for, by its name."""
    wanted: dict[str, Callable[[], Figure]] = {"track": partial(track, run)}
    if run.errors is not None and not run.errors.empty:
        for group, _, columns in SIGMA_GROUPS:
            if run.errors[f"d_{columns[0]}"].notna().any():
                wanted[f"errors_{group}"] = partial(errors, run, group)
    for kind in run.nis_summary().index:
        wanted[f"innovations_{kind}"] = partial(innovations, run, str(kind))
    if not run.satellites.empty:
        wanted["satellites"] = partial(satellites, run)
    return wanted


def _axes(figure: Figure, n: int) -> list[Any]:
    """Return n axes below each other with one axis of time."""
    return list(np.atleast_1d(np.asarray(figure.subplots(n, 1, sharex=True), dtype=object)))


def _with_time(figure: Figure) -> Figure:
    _label_time(figure.axes[-1], figure)
    figure.align_ylabels()
    return figure


def _label_time(axes: Any, figure: Figure) -> None:
    axes.set_xlabel("time, s of the GPS week")
    axes.locator_params(axis="x", nbins=4 if figure.get_figwidth() < PAGE_IN else 8)
