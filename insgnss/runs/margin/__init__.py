"""The interference margin along a flown path: the effect of emitters on the ground on every phase loop.

::

    from insgnss.runs.margin import flown_margin, picture

    study = flown_margin(insgnss.Run.load("out/"), "emitters.toml")
    study.satellites, study.emitters, study.events, study.summary()
    picture(study, "lock.png")
"""

from __future__ import annotations

from insgnss.runs.margin.figures import flown_figure, picture
from insgnss.runs.margin.study import FlownMargin, flown_margin

__all__ = ["FlownMargin", "flown_figure", "flown_margin", "picture"]
