"""The memory of the attitude stage of several antennas from epoch to epoch."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from insgnss.gnss.antenna_phases import Channel

Key = tuple[int, int, Channel]  # antenna from, antenna to, satellite and signal


@dataclass
class CycleMemory:
    """Which whole cycles are known, and the stage's waiting times."""

    cycles: dict[Key, int] = field(default_factory=dict)
    seen_ns: dict[Key, int] = field(default_factory=dict)
    refused: dict[Key, int] = field(default_factory=dict)  # epochs in a row
    candidate: dict[Key, int] = field(default_factory=dict)  # cycles found, but not confirmed yet
    confirmed: int = 0
    misfits: int = 0
    failures: int = 0
    next_search_ns: int = 0
    strained: int = 0
    is_lost: bool = False
    waits_for: str = ""

    def copied(self) -> CycleMemory:
        """Return a copy that shares nothing."""
        return replace(
            self,
            cycles=dict(self.cycles),
            seen_ns=dict(self.seen_ns),
            refused=dict(self.refused),
            candidate=dict(self.candidate),
        )
