"""The rules by which page, commands and studies assess a run's heading, errors and innovations."""

from __future__ import annotations

from typing import Final, NamedTuple

from insgnss.runs.result import Run

# A sigma nearer to the scatter is as good as right: no setting is worth changing for it
AGREES_WITHIN: Final = 0.05
_HEADING_KNOWN_DEG: Final = 5.0  # where the run's settings do not say


class HeadingAgreement(NamedTuple):
    """Whether and from when the heading was known. After a later loss ``last_deg`` is above the limit."""

    known_s: float | None  # the first row's time where it was given, None where it never was known
    given: bool  # at the start, within the limit
    first_deg: float  # sigma of the first row, the last one, and the smallest
    last_deg: float
    smallest_deg: float
    limit_deg: float  # a heading of a smaller sigma counts as known

    @property
    def is_lost(self) -> bool:
        """Return whether the heading was known but is not at the end."""
        return self.known_s is not None and not self.last_deg < self.limit_deg


def heading_of(run: Run) -> HeadingAgreement:
    """Return a run's heading status: by the filter's own event, else by the sigma that it started with."""
    sigma, settings = run.nav["sd_yaw_deg"].to_numpy(), dict(run.settings.get("filter") or {})
    limit = float(dict(settings.get("heading") or {}).get("known_below_deg", _HEADING_KNOWN_DEG))
    known_s = run.heading_known_s()
    given = known_s is None and bool(sigma[0] < limit)
    if given:
        known_s = float(run.nav["time_s"].iloc[0])
    return HeadingAgreement(known_s, given, float(sigma[0]), float(sigma[-1]), float(sigma.min()), limit)


def times_their_sigma(ratio: float) -> str:
    """Return in words how large errors or innovations are: ``ratio`` is the rms of each over its sigma."""
    if abs(ratio - 1.0) < AGREES_WITHIN:
        return "agree with their sigma"
    return f"are {ratio:.2g} times their sigma"
