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
from tests.fuzz.targets import Target, replace_file

LONGEST_S = 10.0  # of the processor, of a case: a busy machine is no failure
GOLDEN_RATIO = 0.5 * (np.sqrt(5.0) - 1.0)  # whose multiples, modulo one, are the most even
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


def target_of(targets: Sequence[Target], number: int) -> Target:
    """Return the target of a case: in any row of numbers each has its share, by its weight, to a few cases."""
    upto = np.cumsum([target.weight for target in targets])
    place = number * GOLDEN_RATIO % 1.0
    return targets[int(np.searchsorted(upto, place * upto[-1], side="right"))]


def case(targets: Sequence[Target], seed: int, number: int) -> tuple[Target, bytes]:
    """Return what a case reads."""
    rng = np.random.default_rng([seed, number])
    target = target_of(targets, number)
    return target, damaged(rng, target.seeds[int(rng.integers(len(target.seeds)))])


def failures(targets: Sequence[Target], seed: int, numbers: Iterable[int], folder: Path) -> Iterator[Failure]:
    """Yield the cases that ended with an exception that is not ours, took too long or too much memory."""
    signal.signal(signal.SIGPROF, _stop)
    for number in numbers:
        target, data = case(targets, seed, number)
        path = folder / f"case{target.ending}"
        replace_file(path, data)  # it stays there when the process itself dies
        replace_file(folder / "number", f"{seed} {number} {target.name}".encode())
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
