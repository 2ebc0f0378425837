"""The time tags of a live stream of inertial samples: tags that fall back, and one far ahead of the next."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

from insgnss.constants import NS_PER_S
from insgnss.tables import Event, Float64

LEAP_NS: Final = NS_PER_S  # a tag further ahead is believed when the next one follows it
SET_BACK_NS: Final = NS_PER_S  # for so long tags must go on behind the newest one before they are believed
Tagged = tuple[int, Float64, Float64]  # tag, rate, specific force


class ReleasedSamples(NamedTuple):
    """The samples released by a sample."""

    samples: list[Tagged]
    events: list[Event]
    set_back: bool = False  # the tags before were wrong: restart


@dataclass
class TagGuard:
    """Lets samples through in increasing time.

    A leap ahead is a gap or a wrong tag. The next sample decides: it follows the jump, or continues where the stream
    was.
    Tags that go on behind for a second say that those before were wrong.
    """

    last_ns: int | None = None
    _leapt: Tagged | None = None
    _behind: list[Tagged] = field(default_factory=list)

    def take(self, t_ns: int, w_ib_b: Float64, f_b: Float64) -> ReleasedSamples:
        """Take a sample; return the samples to process."""
        new = (t_ns, w_ib_b, f_b)
        if self.last_ns is not None and t_ns <= self.last_ns:
            return self._fallen_back(new)
        self._behind = []
        if self._leapt is None:
            if self.last_ns is not None and t_ns - self.last_ns > LEAP_NS:
                self._leapt = new
                return ReleasedSamples([], [])
            return self._passed([new], [])
        leapt, self._leapt = self._leapt, None
        if t_ns > leapt[0]:  # which was a gap
            before = self._passed([leapt], [])
            after = self.take(*new)
            return ReleasedSamples(before.samples + after.samples, after.events)
        if t_ns == leapt[0]:
            self._leapt = leapt
            return ReleasedSamples([], [_refused(t_ns, "the time tag of an inertial sample is repeated")])
        ahead = (leapt[0] - t_ns) / NS_PER_S
        event = _refused(leapt[0], f"an inertial sample {ahead:.6g} s ahead of the next one")
        after = self.take(*new)
        return ReleasedSamples(after.samples, [event, *after.events])

    def _passed(self, samples: list[Tagged], events: list[Event]) -> ReleasedSamples:
        self.last_ns = samples[-1][0]
        return ReleasedSamples(samples, events)

    def _fallen_back(self, new: Tagged) -> ReleasedSamples:
        """Refuse a sample that is not later than the newest; restart if such samples go on for long."""
        assert self.last_ns is not None
        follows = bool(self._behind) and 0 < new[0] - self._behind[-1][0] <= LEAP_NS
        self._behind = [*self._behind, new] if follows else [new]
        if new[0] - self._behind[0][0] >= SET_BACK_NS:
            samples, self._behind, self._leapt = self._behind, [], None
            back = (self.last_ns - samples[0][0]) / NS_PER_S
            self.last_ns = samples[-1][0]
            detail = f"the inertial samples continue {back:.6g} s earlier: earlier tags were wrong, the filter restarts"
            return ReleasedSamples(samples, [Event(samples[0][0], "restart", detail)], set_back=True)
        if follows:
            return ReleasedSamples([], [])  # reported with the first of them
        behind = (self.last_ns - new[0]) / NS_PER_S
        return ReleasedSamples(
            [], [_refused(new[0], f"an inertial sample {behind:.6f} s behind the one before it")]
        )


def _refused(t_ns: int, detail: str) -> Event:
    return Event(t_ns, "imu_refused", f"{detail}: refused")
