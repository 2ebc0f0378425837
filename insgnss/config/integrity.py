"""The schema of the protection levels: the risk they bound, and how often satellites are expected to be wrong."""

from __future__ import annotations

from pydantic import Field

from insgnss.config.quantities import Probability
from insgnss.config.strict import StrictModel


class Integrity(StrictModel):
    """The risk of a protection level, and the faults that it covers (``replay(..., integrity=True)``)."""

    risk: Probability = Field(
        1e-7,
        description="probability of an error beyond its protection level without an alert, per row; half is vertical",
    )
    false_alert: Probability = Field(
        1e-5, description="probability that a row raises an alert without a fault"
    )
    satellite_fault: Probability = Field(1e-5, description="probability that a satellite in view is faulty")
    constellation_fault: Probability = Field(
        1e-6,
        description="probability that a whole constellation is faulty; monitored where there are two at least",
    )
