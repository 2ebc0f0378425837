"""The events of the compiled loop in words: several depend on the settings."""

from __future__ import annotations

from insgnss.filter.output.writing import MASKING_UNCERTAIN, NO_MEASUREMENTS, TAG_STEP, Output, event_in_words
from insgnss.filter.setup import FilterSetup
from insgnss.filter.states.gnss_time import GNSS_TIME
from insgnss.filter.update.masking import became_of_uncertain
from insgnss.tables import Event


def take_events(out: Output, setup: FilterSetup) -> list[Event]:
    """Return what the loop has reported; ``out`` has room again."""
    count, events = out.counts[0], []
    for row in out.events[: min(count.events, len(out.events))]:
        events.append(_in_words(int(row["t_ns"]), int(row["kind"]), float(row["a"]), setup))
    if count.events > len(out.events):
        events.append(Event(None, "events_lost", f"{count.events - len(out.events)} further events"))
    count.events = 0
    return events


def outage(t_ns: int, setup: FilterSetup) -> Event:
    """Return the event of measurements that have ended."""
    return _in_words(t_ns, int(NO_MEASUREMENTS), 0.0, setup)


def _in_words(t_ns: int, kind: int, a: float, setup: FilterSetup) -> Event:
    why = ""
    if kind == MASKING_UNCERTAIN:
        why = became_of_uncertain(setup.config.visibility)
    elif kind == NO_MEASUREMENTS and setup.own is not None:
        why = f"no GNSS measurement is used: inertial samples and {setup.own.named} alone"
    elif kind == TAG_STEP:
        estimated = setup.may_estimate_gnss_time or setup.layout.at(GNSS_TIME) >= 0
        why = "their offset is estimated from here on" if estimated else "epochs with wrong tags are not used"
    return event_in_words(t_ns, kind, a, why)
