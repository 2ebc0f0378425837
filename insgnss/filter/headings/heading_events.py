"""Events of the heading: it is open, one is left, it is known."""

from __future__ import annotations

from insgnss.constants import NS_PER_S
from insgnss.filter.headings.heading_bank import heading_deg
from insgnss.filter.state import Bank
from insgnss.tables import Event


def heading_single(bank: Bank) -> Event:
    """Return the event that one heading is left."""
    yaw, sd = heading_deg(bank)
    return _event(bank, "heading_single", f"one heading is left: {yaw:.1f} deg, sigma {sd:.1f} deg")


def heading_open(bank: Bank, sd_deg: float) -> Event:
    """Return the event that a heading which counted as known is open again; ``sd_deg`` is what its sigma was then."""
    many = f"{len(bank.state)} heading hypotheses"
    return _event(bank, "heading_open", f"the heading's sigma has grown to {sd_deg:.0f} deg: {many}")


def heading_known(bank: Bank, started_ns: int | None) -> Event:
    """Return the event that the heading is known, and how long after the start."""
    yaw, sd = heading_deg(bank)
    t_ns = int(bank.head[0].now_ns)
    after = (t_ns - (started_ns or t_ns)) / NS_PER_S
    return _event(
        bank, "heading_known", f"heading {yaw:.1f} deg, sigma {sd:.1f} deg, {after:.1f} s after the start"
    )


def _event(bank: Bank, kind: str, detail: str) -> Event:
    return Event(int(bank.head[0].now_ns), kind, detail)
