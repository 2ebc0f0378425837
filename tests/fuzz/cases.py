"""Cases are numbered: seed and number give the damaged bytes again, whatever else ran before."""

from __future__ import annotations

import resource
import signal
import traceback
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import numpy as np

from insgnss.errors import InsGnssError
from tests.fuzz.mutations import damaged
from tests.fuzz.targets import Target

LONGEST_S = 10.0  # of the processor, of a case: a busy machine is no failure
LARGEST_BYTES = 1_500_000_000  # of the process


@dataclass(frozen=True)
class Failure:
    """A case that ended as none may."""

    seed: int
    number: int
    target: str
    file: Path
    told: str


class TooSlow(BaseException):
    """No reader may catch it."""


def _stop(signal_number: int, frame: FrameType | None) -> None:
    raise TooSlow(f"still at work after {LONGEST_S:g} s")


def case(targets: Sequence[Target], seed: int, number: int) -> tuple[Target, bytes]:
    """Return what a case reads."""
    rng = np.random.default_rng([seed, number])
    weights = np.array([target.weight for target in targets])
    target = targets[int(rng.choice(len(targets), p=weights / weights.sum()))]
    return target, damaged(rng, target.seeds[int(rng.integers(len(target.seeds)))])


def failures(targets: Sequence[Target], seed: int, numbers: Iterable[int], folder: Path) -> Iterator[Failure]:
    """Yield the cases that ended with an exception that is not ours, took too long or too much memory."""
    signal.signal(signal.SIGPROF, _stop)
    for number in numbers:
        target, data = case(targets, seed, number)
        path = folder / f"case{target.ending}"
        path.write_bytes(data)  # it stays there when the process itself dies
        (folder / "number").write_text(f"{seed} {number} {target.name}")
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
        try:
            target.read(path)
        except InsGnssError as error:
            str(error).encode("utf-8")
            told = ""
        except (Exception, TooSlow):
            told = traceback.format_exc()
        else:
            told = ""
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        if not told and most > max(LARGEST_BYTES, before):
            told = f"memory rose from {before / 1e6:.0f} to {most / 1e6:.0f} MB"
        if told:
            kept = folder / f"{target.name.replace(' ', '_')}_{seed}_{number}"
            kept.write_bytes(data)
            yield Failure(seed, number, target.name, kept, told)
