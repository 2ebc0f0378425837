"""The input doctor: holds the logs of a flight against each other and proposes what its flight file should declare.

``examine(Flight.load("flight.toml"))`` gives a ``CheckReport``; its ``proposals`` are keys of the flight file, which
``write_corrected`` puts into a copy of it. Nothing is changed silently.
"""

from __future__ import annotations

from insgnss.doctor.corrected_file import corrected_flight as corrected_flight
from insgnss.doctor.corrected_file import corrected_text as corrected_text
from insgnss.doctor.corrected_file import write_corrected as write_corrected
from insgnss.doctor.examination import examine as examine
