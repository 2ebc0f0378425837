"""Inertial samples on their way into the filter: screened, gaps bridged, events reported.

``screened`` takes a whole log, ``SampleStream`` one sample at a time. Both call the same kernel (``screening``).
"""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.filter.imu.screen_state import (
    BAD_SAMPLE,
    BRIDGE,
    BRIDGE_TOLD,
    CUT,
    EDIT_DTYPE,
    OUT_BEGINS,
    OUT_ENDS,
    REPLACED,
    SPIKE,
    Edits,
    new_screen,
)
from insgnss.filter.imu.screening import ROOM, screen
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.setup import FilterSetup
from insgnss.tables import Event, Float64, ImuTable, Int64

# of a kind that recurs, so many are reported one by one, then the 100th, the 1000th ...
_EACH: Final = 20
_SENSORS: Final = ("gyros", "accelerometers")
_FIRST_ROOM: Final = 1024


class Sample(NamedTuple):
    """One sample as the filter takes it."""

    t_ns: int
    w_ib_b: Float64
    f_b: Float64
    unknown: Float64  # (2,) as in ``ImuSamples``
    logged: bool  # whether it is in the log; else it bridges a gap


class Cut(NamedTuple):
    """Where the filter restarts: after a gap that is too long, or an outage in which the attitude was lost."""

    last_ns: int  # the last sample before
    next_ns: int  # the first sample after
    rotation: float  # variance of the rotation in between [rad^2]
    bridge: Sample | None = None  # by which a smoother crosses a gap


@dataclass
class ScreeningReporter:
    """Writes the verdicts as event texts."""

    counts: Counter[str] = field(default_factory=Counter)

    def events(self, edits: Edits) -> list[Event]:
        """Return the events of verdicts in their order."""
        return [event for edit in edits if (event := self._event(edit)) is not None]

    def _event(self, edit: Any) -> Event | None:
        kind, t_ns, size = int(edit["kind"]), int(edit["t_ns"]), float(edit["amount"])
        if kind == BRIDGE_TOLD:
            detail = f"no inertial sample for {size:.3f} s: bridged, sigma grown"
            return Event(int(edit["axes"]), "imu_gap", detail)
        if kind == CUT and size > 0.0:
            begin_ns = int(edit["axes"])
            return restart_event(begin_ns, begin_ns + round(size * NS_PER_S))
        if kind == CUT:
            back = _SENSORS[int(edit["axes"])]
            detail = f"the {back} are back, but the attitude is lost: the filter restarts from the next fix"
            return Event(t_ns, "restart", detail)
        if kind == BAD_SAMPLE and size == 1.0:
            detail = (
                "an inertial sample has an impossible value: samples up to the next valid one are ignored"
            )
            return self._counted(t_ns, "imu_bad_sample", detail)
        if kind == SPIKE:
            detail = (
                f"the {_SENSORS[int(size)]} jump away and back within three samples: this one is left out"
            )
            return self._counted(t_ns, "imu_spike", detail)
        if kind == OUT_BEGINS:
            axes = int(edit["axes"])
            names = ", ".join("xyz"[i] for i in range(3) if axes >> i & 1)
            what = "are at the end of their range" if axes >> 3 & 1 else "hold their values"
            detail = (
                f"the {_SENSORS[int(size)]} (body axes {names}) {what}: their motion is treated as unknown"
            )
            return self._counted(t_ns, "imu_sensor_out", detail)
        if kind == OUT_ENDS:
            detail = f"the {_SENSORS[int(edit['axes'])]} measure again after {size:.2f} s"
            return self._counted(t_ns, "imu_sensor_back", detail)
        return None

    def _counted(self, t_ns: int, kind: str, detail: str) -> Event | None:
        """Return the event unless there are too many of its kind to report each."""
        self.counts[kind] += 1
        n = self.counts[kind]
        if n <= _EACH:
            return Event(t_ns, kind, detail)
        return Event(t_ns, kind, f"{detail} ({n} so far)") if str(n).strip("0") == "1" else None


def restart_event(last_ns: int, next_ns: int) -> Event:
    """Return the event of a gap too long to bridge."""
    gap = (next_ns - last_ns) / NS_PER_S
    return Event(
        last_ns, "imu_gap", f"no inertial sample for {gap:.3f} s: too long to bridge, the filter restarts"
    )


@dataclass(frozen=True)
class ScreenedLog:
    """A log as the filter takes it."""

    imu: ImuSamples  # all samples, those that bridge gaps among them
    logged_ns: Int64  # times of the log's own
    cuts: list[tuple[int, Cut]]  # each with the index of the first sample after it
    events: list[Event]

    def stretches(self) -> list[tuple[ImuSamples, Cut | None]]:
        """Return the unbroken stretches, each with the cut before it; of a single sample the filter makes nothing."""
        edges = [0, *(first for first, _ in self.cuts), len(self.imu.t_ns)]
        cuts = [None, *(cut for _, cut in self.cuts)]
        pairs = zip(itertools.pairwise(edges), cuts, strict=True)
        return [(self.imu.part(a, b), cut) for (a, b), cut in pairs]


def _new(setup: FilterSetup) -> npt.NDArray[Any]:
    return new_screen(setup.config, setup.grade, setup.lever_arm_m)


def screened(table: ImuTable, setup: FilterSetup) -> ScreenedLog:
    """Return a whole log screened."""
    w, f = np.ascontiguousarray(table.w_ib_b), np.ascontiguousarray(table.f_b)
    state, edits, count = _new(setup), np.zeros(_FIRST_ROOM, EDIT_DTYPE), np.zeros(1, np.int64)
    scratch, decided = np.zeros(6), 0
    while True:
        decided = screen(state[0], table.t_ns, w, f, decided, edits, count, scratch)
        if count[0] + ROOM <= len(edits):
            break
        edits = np.concatenate([edits, np.zeros(len(edits), EDIT_DTYPE)])
    edits = edits[: count[0]]
    events = ScreeningReporter().events(edits)
    whole = ImuSamples(table.t_ns[:decided], w[:decided], f[:decided])
    if not len(edits):
        return ScreenedLog(whole, whole.t_ns, [], events)
    return _edited(whole, edits, events)


def _edited(imu: ImuSamples, edits: Edits, events: list[Event]) -> ScreenedLog:
    """Return a log with its verdicts carried out."""
    at, kind = edits["sample"], edits["kind"]
    kept = np.ones(len(imu.t_ns), np.bool_)
    kept[at[(kind == BAD_SAMPLE) | (kind == SPIKE)]] = False
    w, f, unknown = imu.w_ib_b.copy(), imu.f_b.copy(), np.zeros((len(imu.t_ns), 2))
    replaced = edits[kind == REPLACED]
    w[replaced["sample"]], f[replaced["sample"]] = replaced["w"], replaced["f"]
    unknown[replaced["sample"]] = replaced["unknown"]
    place = np.cumsum(kept) - 1  # of each kept sample among them
    bridge = edits[(kind == BRIDGE) | (kind == BRIDGE_TOLD)]
    before = place[bridge["sample"]]
    logged_ns = imu.t_ns[kept]

    def bridged(own: npt.NDArray[Any], name: str) -> npt.NDArray[Any]:
        return np.ascontiguousarray(np.insert(own[kept], before, bridge[name], axis=0))

    edited = ImuSamples(
        bridged(imu.t_ns, "t_ns"), bridged(w, "w"), bridged(f, "f"), bridged(unknown, "unknown")
    )
    cuts = []
    for edit in edits[kind == CUT]:
        first = int(place[edit["sample"]])
        first += int(np.searchsorted(bridge["sample"], edit["sample"], side="right"))
        last_ns = int(logged_ns[max(place[edit["sample"]] - 1, 0)])
        cuts.append((first, _cut(edit, last_ns, int(imu.t_ns[edit["sample"]]))))
    return ScreenedLog(edited, logged_ns, cuts, events)


def _put_in(edit: Any) -> Sample:
    """Return the sample that bridges a gap."""
    return Sample(int(edit["t_ns"]), edit["w"].copy(), edit["f"].copy(), edit["unknown"].copy(), logged=False)


def _cut(edit: Any, last_ns: int, next_ns: int) -> Cut:
    """Return a cut between the samples at two times."""
    if edit["amount"] == 0.0:
        return Cut(last_ns, next_ns, float(edit["unknown"][0]))
    bridge = _put_in(edit)
    return Cut(last_ns, next_ns, float(bridge.unknown[0]) * (bridge.t_ns - last_ns) / NS_PER_S, bridge)


class SampleStream:
    """A log screened sample by sample: those without a verdict yet wait."""

    def __init__(self, setup: FilterSetup) -> None:
        """Begin without a sample."""
        self.teller = ScreeningReporter()
        self._state = _new(setup)
        self._edits = np.zeros(4 * ROOM, EDIT_DTYPE)
        self._scratch = np.zeros(6)
        self._waiting: list[npt.NDArray[Any]] = [np.zeros(64, np.int64), np.zeros((64, 3)), np.zeros((64, 3))]
        self._n = 0
        self._last_ns = 0

    def take(self, t_ns: int, w_ib_b: Float64, f_b: Float64) -> list[Sample | Cut | Event]:
        """Take a sample later than those before it; return the samples that are certain now, in order."""
        if self._n == len(self._waiting[0]):
            self._waiting = [np.concatenate([column, np.zeros_like(column)]) for column in self._waiting]
        times, rates, forces = self._waiting
        times[self._n], rates[self._n], forces[self._n] = t_ns, w_ib_b, f_b
        self._n += 1
        items: list[Sample | Cut | Event] = []
        done = 0
        while True:
            count = np.zeros(1, np.int64)
            t, w, f = times[: self._n], rates[: self._n], forces[: self._n]
            begin, done = done, int(screen(self._state[0], t, w, f, done, self._edits, count, self._scratch))
            edits = self._edits[: count[0]]
            for k in range(begin, done):
                items += self._certain(k, edits[edits["sample"] == k] if len(edits) else edits)
            if done == begin or done == self._n:
                break
        if done:
            for column in self._waiting:
                column[: self._n - done] = column[done : self._n].copy()
            self._n -= done
        return items

    def _certain(self, k: int, edits: npt.NDArray[Any]) -> list[Sample | Cut | Event]:
        """Return the filter's action on a sample with its verdicts."""
        t_ns = int(self._waiting[0][k])
        w, f = self._waiting[1][k].copy(), self._waiting[2][k].copy()
        unknown = np.zeros(2)
        items: list[Sample | Cut | Event] = list(self.teller.events(edits)) if len(edits) else []
        for edit in edits:
            kind = int(edit["kind"])
            if kind in (BAD_SAMPLE, SPIKE):
                return items
            if kind in (BRIDGE, BRIDGE_TOLD):
                items.append(_put_in(edit))
            elif kind == CUT:
                items.append(_cut(edit, self._last_ns, t_ns))
            elif kind == REPLACED:
                w, f, unknown = edit["w"].copy(), edit["f"].copy(), edit["unknown"].copy()
        self._last_ns = t_ns
        return [*items, Sample(t_ns, w, f, unknown, logged=True)]
