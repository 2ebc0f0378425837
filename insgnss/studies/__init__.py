"""Studies: questions put to the engine, each a library call that gives tables and pictures.

::

    from insgnss.studies import hidden_satellite_variance, masking_study

    study = hidden_satellite_variance("sokolov_2015", imu="tactical", oscillator="tcxo", outage="bank")
    study.at([79, 100, 101, 110]); study.figure(); study.save("out/")

    cases = masking_study("sokolov_2015", runs=20)
    cases.cases, cases.false_locks, cases.reacquisition; cases.save("out/")
"""

from __future__ import annotations

from insgnss.studies.hidden_variance import HiddenVariance, hidden_satellite_variance
from insgnss.studies.masking import MaskingStudy, masking_study

__all__ = ["HiddenVariance", "MaskingStudy", "hidden_satellite_variance", "masking_study"]
