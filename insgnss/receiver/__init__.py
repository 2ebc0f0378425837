"""The search supervisor over a run: a receiver's best action for every satellite, tracked or hidden.

::

    from insgnss.receiver import outlook, sightings_of, supervise_run

    view = outlook(setup, satellites, traced)       # what the filter expects of every satellite above the horizon
    result = supervise_run(view, sightings_of(gnss), setup.search, week)
    result.supervision, result.transitions, result.search_times

``insgnss.Engine(settings, supervise=True)`` decides the same live: ``engine.take_supervision()`` (``live``).
"""

from __future__ import annotations

from insgnss.receiver.predictions import Outlook, SupervisionSetup, outlook
from insgnss.receiver.supervised_run import Sightings, SupervisedRun, sightings_of, supervise_run

__all__ = [
    "Outlook",
    "Sightings",
    "SupervisedRun",
    "SupervisionSetup",
    "outlook",
    "sightings_of",
    "supervise_run",
]
