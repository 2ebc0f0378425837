"""Recordings of a radio front end: raw integers, interleaved or real, read and written block by block.

Such a file has no header: the number format, the sampling rate and the intermediate frequency are declared.
Nothing can be checked against the file but its size; a declaration that no signal fits is refused.

    recording = IqFile("gps.bin", Sampling(4e6, is_complex=True), "int8")
    for samples in recording.blocks(1.0): ...
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.errors import ConfigError, InputError, MissingFileError
from insgnss.results.saving import RECORDING_KIND, saving_file, writing
from insgnss.tracking.admissible import require_known, require_number, require_whole
from insgnss.tracking.signal import Sampling, SignalSamples

SAMPLE_TYPES: Final[dict[str, npt.DTypeLike]] = {"int8": np.dtype("<i1"), "int16": np.dtype("<i2")}
ORDERS: Final = ("iq", "qi")  # of the two components of a complex sample
# Standard deviation that noise of variance 1 is written with: 16 of int8 leaves a clipping beyond 8 sigma, and a
# rounding error of 1/12 against 256, 0.0014 dB
NOISE_LSB: Final = {"int8": 16.0, "int16": 1024.0}
_MOST_HZ: Final = 1e10


@dataclass(frozen=True)
class IqFile:
    """A recording and its declarations.

    Raises
    ------
    ConfigError : a path, sampling, type or order that does not exist
    MissingFileError : no such file
    InputError : the file is empty, or does not hold whole samples
    """

    path: Path
    sampling: Sampling
    sample_type: str = "int8"
    order: str = "iq"
    skip_bytes: int = 0  # of a header

    def __post_init__(self) -> None:
        if not isinstance(self.path, str | os.PathLike):
            advice = "give a file of raw samples"
            raise ConfigError(f"{self.path!r} is not a path", key="path", advice=advice)
        object.__setattr__(self, "path", Path(self.path))
        _check_declared(self.sampling, self.sample_type, self.order, self.skip_bytes)
        size = self._size
        if size <= 0:
            held = "is empty" if size + self.skip_bytes == 0 else f"ends before byte {self.skip_bytes}"
            raise InputError(f"the recording {held}", file=self.path, advice="record again")
        if size % self._bytes:
            kind = "complex" if self.sampling.is_complex else "real"
            raise InputError(
                f"{size} bytes are not a whole number of {kind} {self.sample_type} samples of {self._bytes} bytes",
                file=self.path,
                advice="check sample type, complex or real, and skip_bytes; or cut off the incomplete end",
            )

    @property
    def _bytes(self) -> int:
        """Return the size of a sample."""
        return np.dtype(SAMPLE_TYPES[self.sample_type]).itemsize * (2 if self.sampling.is_complex else 1)

    @property
    def _size(self) -> int:
        """Return the number of bytes after those that are skipped."""
        if not self.path.is_file():
            raise MissingFileError("recording not found", file=self.path, advice="give a file of raw samples")
        return self.path.stat().st_size - self.skip_bytes

    @property
    def count(self) -> int:
        """Return the number of samples."""
        return self._size // self._bytes

    @property
    def duration_s(self) -> float:
        """Return the length of the recording."""
        return self.count / self.sampling.rate_hz

    def read(self, first: int, count: int) -> SignalSamples:
        """Return samples as numbers of the file, the two components apart.

        Raises
        ------
        ConfigError : ``first`` or ``count`` is not a whole number from 0 or 1 on
        InputError : they are not in the file, or it cannot be read
        """
        require_whole(0, "give the number of the first sample", first=first)
        require_whole(1, "give how many samples are wanted", count=count)
        if first + count > self.count:
            raise InputError(
                f"samples {first} to {first + count} are needed, the recording holds {self.count}",
                file=self.path,
                advice=f"it lasts {self.duration_s:g} s at {self.sampling.rate_hz:g} Hz",
            )
        per = 2 if self.sampling.is_complex else 1
        try:
            raw = np.fromfile(
                self.path,
                SAMPLE_TYPES[self.sample_type],
                count * per,
                offset=self.skip_bytes + first * self._bytes,
            )
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}", file=self.path) from error
        if per == 1:
            return SignalSamples(self.sampling, raw.astype(np.float64), np.zeros(0))
        i = self.order.index("i")
        return SignalSamples(self.sampling, raw[i::2].astype(np.float64), raw[1 - i :: 2].astype(np.float64))

    def blocks(self, block_s: float = 1.0) -> Iterator[SignalSamples]:
        """Yield the recording in blocks of a length, the last one shorter.

        Raises
        ------
        ConfigError : a length that is not a positive number of seconds
        """
        if not (math.isfinite(require_number("block_s", block_s)) and block_s > 0.0):
            raise ConfigError(
                f"invalid block length of {block_s:g} s", key="block_s", advice="give seconds above 0, as 1.0"
            )
        size = max(1, round(block_s * self.sampling.rate_hz))
        for first in range(0, self.count, size):
            yield self.read(first, min(size, self.count - first))


def rounded(block: SignalSamples, sample_type: str) -> SignalSamples:
    """Return samples with noise of variance 1 as the integers that ``write_iq`` writes and ``IqFile`` reads back.

    Raises
    ------
    ConfigError : a type that does not exist, samples that are not finite, or components of different length
    """
    _require_type(sample_type)
    kind = np.dtype(SAMPLE_TYPES[sample_type])
    limit = np.iinfo(kind)
    lengths = np.shape(block.in_phase), np.shape(block.quadrature)
    if block.sampling.is_complex and lengths[0] != lengths[1]:
        raise ConfigError(
            f"complex samples with {lengths[0]} in-phase and {lengths[1]} quadrature components",
            key="blocks",
            advice="give both components of every sample, or a sampling with is_complex = False",
        )
    if not (np.isfinite(block.in_phase).all() and np.isfinite(block.quadrature).all()):
        raise ConfigError(
            "some samples are not finite: integers cannot represent them",
            key="blocks",
            advice="leave such samples out, or write zeros",
        )
    in_phase, quadrature = (
        np.clip(np.rint(NOISE_LSB[sample_type] * part), limit.min, limit.max)
        for part in (block.in_phase, block.quadrature)
    )
    return SignalSamples(block.sampling, in_phase, quadrature)


def write_iq(
    path: str | Path, blocks: Iterable[SignalSamples], sample_type: str = "int8", order: str = "iq"
) -> int:
    """Write samples with noise of variance 1 as integers; return how many of their numbers are at its limits.

    Raises
    ------
    ConfigError : a type or order that does not exist, or blocks that ``rounded`` refuses
    ResultError : the file cannot be written, or a file of another program is in its place
    """
    _require_type(sample_type)
    require_known(order, ORDERS, "order", "order")
    kind, place = np.dtype(SAMPLE_TYPES[sample_type]), Path(path)
    limit, clipped = np.iinfo(kind), 0
    with writing("the recording", path):
        place.parent.stat()  # refuses a folder that is not there, which a save would make
        with saving_file(place, RECORDING_KIND) as new, open(new, "wb") as file:
            for block in blocks:
                numbers = rounded(block, sample_type)
                parts = [numbers.in_phase]
                if block.sampling.is_complex:
                    parts.insert(order.index("q"), numbers.quadrature)
                file.write(np.stack(parts, axis=-1).astype(kind).tobytes())
                clipped += sum(int(np.isin(part, (limit.min, limit.max)).sum()) for part in parts)
    return clipped


def _check_declared(sampling: Sampling, sample_type: str, order: str, skip_bytes: int) -> None:
    """Refuse impossible declarations of a recording."""
    _require_type(sample_type)
    require_known(order, ORDERS, "order", "order")
    rate = require_number("rate_hz", sampling.rate_hz)
    if not (math.isfinite(rate) and 0.0 < rate <= _MOST_HZ):
        advice = "give samples per second, as 4e6"
        raise ConfigError(f"invalid sampling rate of {rate:g} Hz", key="rate_hz", advice=advice)
    if not math.isfinite(require_number("intermediate_hz", sampling.intermediate_hz)):
        advice = "give the frequency that the carrier without Doppler has in the samples, in Hz"
        raise ConfigError(
            "the intermediate frequency is not a finite number", key="intermediate_hz", advice=advice
        )
    if abs(sampling.intermediate_hz) > 0.5 * rate and not sampling.bandpass:
        raise ConfigError(
            f"an intermediate frequency of {sampling.intermediate_hz:g} Hz lies beyond half the sampling rate",
            key="intermediate_hz",
            advice=f"give {0.5 * rate:g} Hz at most; in Python, Sampling(..., bandpass=True) takes real samples of a"
            " higher Nyquist zone",
        )
    require_whole(0, "give the number of bytes before the samples", skip_bytes=skip_bytes)


def _require_type(sample_type: str) -> None:
    """Refuse a type of samples that does not exist."""
    require_known(sample_type, SAMPLE_TYPES, "sample_type", "sample type")
