"""Tabs in RINEX files, whose fields stand in columns: what an editor saved as tabs is read as blanks."""

from __future__ import annotations

from collections.abc import Callable

from insgnss.tables import Event


def without_tabs(
    text: str, path: str, is_in_columns: Callable[[str], bool], name_width: int, lost: str
) -> tuple[str, list[Event]]:
    """Return a RINEX text with blanks for its tabs, and an event of it.

    A tab stands for blanks up to the next of every eight columns, as editors write it, or for one blank: for that with
    which the fields of its line are in their columns. A line that is so with neither keeps only its satellite.

    Parameters
    ----------
    is_in_columns : whether the fields of a line after the header are where they belong
    name_width : columns at the start of a line that name its satellite
    lost : what a line holds that is refused, in the plural
    """
    if "\t" not in text:
        return text, []
    lines = text.split("\n")
    body = next((k for k, line in enumerate(lines) if "END OF HEADER" in line), len(lines)) + 1
    tabbed = [k for k, line in enumerate(lines) if "\t" in line]
    unclear = []
    for k in tabbed:
        ways = (lines[k].expandtabs(), lines[k].replace("\t", " "))
        lines[k] = next((way for way in ways if k < body or is_in_columns(way)), "")
        if not lines[k] and ways[1].strip():
            lines[k] = ways[1][:name_width]
            unclear.append(str(k + 1))
    detail = f"{path}:{tabbed[0] + 1}: tabs in {len(tabbed)} line(s) read as blanks"
    if unclear:
        detail += f"; the columns of {len(unclear)} of them are not clear, their {lost} are refused: line(s) "
        detail += ", ".join(unclear[:5]) + (", ..." if unclear[5:] else "")
    return "\n".join(lines), [Event(None, "rinex_tabs", detail)]
