"""Pieces of a page: sections, tables, and the page itself with style, script and Plotly inside."""

from __future__ import annotations

import html
import importlib.resources
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from insgnss.report.charts import Chart, as_json
from insgnss.results.saving import PAGE_KIND, write_file, writing


@dataclass(frozen=True)
class Section:
    """One part of the page: a head, HTML before the charts, the charts, HTML after them."""

    name: str  # the page's anchor
    title: str
    before: str = ""
    charts: Sequence[Chart] = field(default=())
    after: str = ""

    def html(self) -> str:
        """Return the section's HTML; the charts are places that the script fills."""
        charts = "".join(_place(chart) for chart in self.charts)
        charts = f'<div class="charts">{charts}</div>' if charts else ""
        head = f"<h2>{text(self.title)}</h2>"
        return f'<section id="{text(self.name)}">{head}{self.before}{charts}{self.after}</section>'


# what is set to the right: a number, the unit of a time, or the dash in the place of one
_NUMBER: Final = re.compile(r"-|[-+]?[\d.]+(e[-+]?\d+)?( s)?")


def text(value: object) -> str:
    """Return anything as text that cannot be taken for HTML."""
    return html.escape(str(value))


def table(
    head: Sequence[str],
    rows: Iterable[Sequence[object]],
    *,
    name: str = "",
    searchable: bool = False,
) -> str:
    """Return a table whose columns the reader can sort by, and filter by a word or a choice if ``searchable``.

    Parameters
    ----------
    head : the columns' names
    rows : of each row its cells
    name : the table's place on the page
    searchable : whether a field above it filters the rows; the second column's words can be chosen then
    """
    cells = "".join(f'<th scope="col"><button type="button">{text(word)}</button></th>' for word in head)
    body = "".join(_row(row) for row in rows)
    place = f' id="{text(name)}"' if name else ""
    form = _FILTER.format(name=text(name)) if searchable else ""
    return (
        f'{form}<div class="wide"><table{place} class="sortable"><thead><tr>{cells}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def paragraphs(sentences: Iterable[str]) -> str:
    """Return each sentence as an entry of a list."""
    return "<ul>" + "".join(f"<li>{text(sentence)}</li>" for sentence in sentences) + "</ul>"


def key_figures(figures: Iterable[tuple[str, str, str]]) -> str:
    """Return the few numbers that a reader looks for first.

    Parameters
    ----------
    figures : of each its name, its value, and a word about it
    """
    cells = (
        f"<div><dt>{text(name)}</dt><dd>{text(value)}<small>{text(about)}</small></dd></div>"
        for name, value, about in figures
    )
    return f'<dl class="figures">{"".join(cells)}</dl>'


def folded(title: str, inside: str) -> str:
    """Return HTML that shows once its title is touched."""
    return f"<details><summary>{text(title)}</summary>{inside}</details>"


def page(
    title: str, sections: Sequence[Section], foot: str, utc_origin_ms: int | None = None, *, about: str = ""
) -> str:
    """Return the page, one file that needs no other: style, script, charts and Plotly are inside.

    Parameters
    ----------
    title, sections, foot : the content of the page
    utc_origin_ms : Unix time of time 0 of the charts; with it a button switches their time axes to UTC
    about : what a picture that is saved from the page carries above it; the title when left out
    """
    charts = [chart for section in sections for chart in section.charts]
    links = "".join(f'<a href="#{text(s.name)}">{text(s.title)}</a>' for s in sections)
    plotly = f"<script>{_plotly()}</script>" if charts else ""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark"><link rel="icon" href="data:,">'
        f"<title>{text(title)}</title><style>{_asset('page.css')}</style></head>\n"
        f'<body data-about="{text(about or title)}"><header>'
        f"<h1>{text(title)}</h1><nav>{links}</nav>{_utc_button(utc_origin_ms)}</header>\n<main>"
        + "\n".join(section.html() for section in sections)
        + f"</main>\n<footer>{text(foot)}</footer>\n"
        f'<script type="application/json" id="charts">{as_json(charts)}</script>\n'
        f"{plotly}\n<script>{_asset('page.js')}</script>\n</body></html>\n"
    )


def write(path: str | Path, content: str) -> Path:
    """Write a page or another text file, the folder made if needed; return its path.

    Raises
    ------
    ResultError : it cannot be written
    """
    path = Path(path)
    with writing("the file", path, "give another --output"):
        write_file(path, content.encode("utf-8", "backslashreplace"), PAGE_KIND)
    return path


def _place(chart: Chart) -> str:
    caption = f"<figcaption>{text(chart.caption)}</figcaption>" if chart.caption else ""
    place = f'<div class="chart" id="{text(chart.name)}" style="height:{chart.height_px}px"></div>{caption}'
    if chart.on_request:
        return f'<figure class="request">{folded(chart.on_request, place)}</figure>'
    return f"<figure><h3>{text(chart.title)}</h3>{place}</figure>"


def _row(row: Sequence[object]) -> str:
    cells = (
        f'<td class="number">{text(cell)}</td>' if _NUMBER.fullmatch(str(cell)) else f"<td>{text(cell)}</td>"
        for cell in row
    )
    return "<tr>" + "".join(cells) + "</tr>"


def _utc_button(origin_ms: int | None) -> str:
    if origin_ms is None:
        return ""
    about = f'id="utc" class="scale" data-origin-ms="{origin_ms}" aria-pressed="false"'
    return f'<button type="button" {about}>Time axes in UTC</button>'


def _asset(name: str) -> str:
    return importlib.resources.files("insgnss.report").joinpath("assets", name).read_text(encoding="utf-8")


def _plotly() -> str:
    """Return Plotly's script, which is loaded only for a page with charts."""
    from plotly.offline import get_plotlyjs

    return str(get_plotlyjs())


_FILTER = (
    '<p class="filter"><label>contains <input type="search" data-table="{name}"></label> '
    '<label>kind <select data-table="{name}"><option value="">all</option></select></label> '
    '<output data-table="{name}"></output></p>'
)
