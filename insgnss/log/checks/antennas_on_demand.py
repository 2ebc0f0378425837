"""The findings on several antennas, imported only for flights that have them: the import takes most of a second."""

from __future__ import annotations

from insgnss.log.checks.report import Finding
from insgnss.log.flight import Flight
from insgnss.tables import GnssTable


def antenna_findings(flight: Flight, main: GnssTable | None) -> list[Finding]:
    """Return the findings of ``antennas`` on a flight with an [attitude] block."""
    from insgnss.log.checks import antennas

    return antennas.antenna_findings(flight, main)
