"""The input check: findings on each log, on logs compared with each other, and proposals for the flight file.

``insgnss.check_flight(flight)`` (``runs.check``) examines a flight and gives a ``CheckReport``; its ``proposals`` are
keys of the flight file, which ``write_corrected`` puts into a copy of it. Nothing is changed silently.
"""

from __future__ import annotations

from insgnss.log.checks.corrected_file import corrected_flight as corrected_flight
from insgnss.log.checks.corrected_file import corrected_text as corrected_text
from insgnss.log.checks.corrected_file import write_corrected as write_corrected
