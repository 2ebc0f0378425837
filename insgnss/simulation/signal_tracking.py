"""When a receiver tracks a signal: strong enough, and for some time already; what a loss does to its carrier."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insgnss.simulation.observations import MOST_AMBIGUITY_CYCLES, SignalObservations
from insgnss.tables import LLI_SLIP, Bool, Float64


@dataclass(frozen=True)
class TrackingRules:
    """The least C/N0, the time to find a signal again, and slips of the carrier while it is tracked."""

    threshold_dbhz: float = 28.0
    reacquire_s: float = 2.0
    slips_per_hour: float = 0.0  # of each carrier
    slips_indicated: float = 1.0  # share that the receiver notices

    def apply(
        self, seen: SignalObservations, strength_dbhz: Float64, rng: np.random.Generator | None
    ) -> SignalObservations:
        """Return the observations that the receiver makes of signals of the given mean C/N0 (m, n).

        A signal counts as received from the first epoch if it is strong enough there. Every new beginning brings the
        carrier a new ambiguity, which the indicator marks.
        """
        tracked = self.tracked(seen.tag_s, seen.tracked & (strength_dbhz >= self.threshold_dbhz))
        seen = replace(seen, tracked=tracked)
        if seen.carrier_cycles is None or seen.lli is None or rng is None:
            return seen
        begins = tracked.copy()
        begins[1:] &= ~tracked[:-1]
        begins[0] = False
        first = tracked & (np.cumsum(tracked, axis=0) == 1)
        lost = begins & ~first
        slips, indicated = self._slips(seen.tag_s, tracked, rng)
        size = MOST_AMBIGUITY_CYCLES
        added = np.where(lost, rng.integers(-size, size, lost.shape), slips)
        lli = np.where(lost | indicated, seen.lli | LLI_SLIP, seen.lli).astype(np.int8)
        return replace(seen, carrier_cycles=seen.carrier_cycles + np.cumsum(added, axis=0), lli=lli)

    def tracked(self, tag_s: Float64, received: Bool) -> Bool:
        """Return what is tracked of signals received (m, n): not before ``reacquire_s`` after their return."""
        tracked = received.copy()
        waits_until = np.full(received.shape[1], -np.inf)
        for k in range(1, len(tag_s)):
            returned = received[k] & ~received[k - 1]
            waits_until[returned] = tag_s[k] + self.reacquire_s
            tracked[k] &= tag_s[k] >= waits_until
        return tracked

    def _slips(self, tag_s: Float64, tracked: Bool, rng: np.random.Generator) -> tuple[Float64, Bool]:
        """Return the cycles slipped before each epoch, one to ten up or down, and which ones the receiver notices."""
        step = np.diff(tag_s, prepend=tag_s[:1])[:, None]
        happens = (rng.random(tracked.shape) < self.slips_per_hour * step / 3600.0) & tracked
        cycles = rng.integers(1, 11, tracked.shape) * rng.choice([-1, 1], tracked.shape)
        return np.where(happens, cycles, 0), happens & (rng.random(tracked.shape) < self.slips_indicated)
