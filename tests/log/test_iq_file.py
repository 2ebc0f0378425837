"""Recordings of raw samples: what is written is read back, and what no recording can be is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insgnss.errors import ConfigError, InputError, MissingFileError, ResultError
from insgnss.log.iq_file import NOISE_LSB, IqFile, rounded, write_iq
from insgnss.results.saving import overwriting
from insgnss.tracking.signal import Sampling, SignalSamples

COMPLEX, REAL = Sampling(4e6, is_complex=True), Sampling(8e6, 2.1e6)


def noise(sampling: Sampling, count: int, rng: np.random.Generator) -> SignalSamples:
    quadrature = rng.standard_normal(count) if sampling.is_complex else np.zeros(0)
    return SignalSamples(sampling, rng.standard_normal(count), quadrature)


@pytest.mark.parametrize("sample_type", ["int8", "int16"])
@pytest.mark.parametrize("order", ["iq", "qi"])
@pytest.mark.parametrize("sampling", [COMPLEX, REAL], ids=["complex", "real"])
def test_recording_comes_back_as_the_rounded_samples(
    sample_type: str, order: str, sampling: Sampling, tmp_path: Path, rng: np.random.Generator
) -> None:
    blocks = [noise(sampling, 1000, rng), noise(sampling, 437, rng)]
    assert write_iq(tmp_path / "a.bin", blocks, sample_type, order) == 0
    recording = IqFile(tmp_path / "a.bin", sampling, sample_type, order)
    assert recording.count == 1437
    assert recording.duration_s == 1437 / sampling.rate_hz
    found = list(recording.blocks(600 / sampling.rate_hz))
    assert [len(block.in_phase) for block in found] == [600, 600, 237]
    for name in ("in_phase", "quadrature"):
        expected = np.concatenate([getattr(rounded(block, sample_type), name) for block in blocks])
        assert np.array_equal(np.concatenate([getattr(block, name) for block in found]), expected)


def test_numbers_stand_in_the_file_as_every_reader_expects(tmp_path: Path) -> None:
    block = SignalSamples(COMPLEX, np.array([1.0, -2.0]), np.array([0.5, 100.0]))
    assert write_iq(tmp_path / "a.bin", [block]) == 1
    assert np.fromfile(tmp_path / "a.bin", np.int8).tolist() == [16, 8, -32, 127]
    write_iq(tmp_path / "b.bin", [block], "int16", "qi")
    scale = NOISE_LSB["int16"]
    assert np.fromfile(tmp_path / "b.bin", "<i2").tolist() == [scale / 2, scale, 32767, -2 * scale]


def test_header_is_skipped(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(b"head" + bytes([1, 2, 3, 4]))
    found = IqFile(tmp_path / "a.bin", COMPLEX, skip_bytes=4).read(1, 1)
    assert (found.in_phase.tolist(), found.quadrature.tolist()) == ([3.0], [4.0])


@pytest.mark.parametrize(
    ("content", "options", "words"),
    [
        (b"", {}, "is empty"),
        (b"123", {}, "not a whole number of complex int8 samples"),
        (b"123456", {"sample_type": "int16"}, "samples of 4 bytes"),
        (b"1234", {"skip_bytes": 4}, "ends before byte 4"),
    ],
)
def test_file_of_a_wrong_size_is_refused(
    content: bytes, options: dict[str, object], words: str, tmp_path: Path
) -> None:
    (tmp_path / "a.bin").write_bytes(content)
    with pytest.raises(InputError, match=words) as raised:
        IqFile(tmp_path / "a.bin", COMPLEX, **options)  # type: ignore[arg-type]
    assert raised.value.file == str(tmp_path / "a.bin")
    assert raised.value.advice


@pytest.mark.parametrize(
    ("sampling", "options", "key"),
    [
        (Sampling(0.0, is_complex=True), {}, "rate_hz"),
        (Sampling(float("nan"), is_complex=True), {}, "rate_hz"),
        (Sampling(1e12, is_complex=True), {}, "rate_hz"),
        (Sampling(4e6, float("inf")), {}, "intermediate_hz"),
        (COMPLEX, {"sample_type": "int4"}, "sample_type"),
        (COMPLEX, {"order": "xy"}, "order"),
        (COMPLEX, {"skip_bytes": -1}, "skip_bytes"),
        (COMPLEX, {"skip_bytes": "4"}, "skip_bytes"),
        (COMPLEX, {"skip_bytes": 0.0}, "skip_bytes"),
        (Sampling("4e6", is_complex=True), {}, "rate_hz"),  # type: ignore[arg-type]
        (Sampling(4e6, None, is_complex=True), {}, "intermediate_hz"),  # type: ignore[arg-type]
        (COMPLEX, {"sample_type": ["int8"]}, "sample_type"),
        (COMPLEX, {"sample_type": np.dtype("int8")}, "sample_type"),
        (COMPLEX, {"order": None}, "order"),
    ],
)
def test_impossible_declaration_is_refused(
    sampling: Sampling, options: dict[str, object], key: str, tmp_path: Path
) -> None:
    (tmp_path / "a.bin").write_bytes(b"1234")
    with pytest.raises(ConfigError) as raised:
        IqFile(tmp_path / "a.bin", sampling, **options)  # type: ignore[arg-type]
    assert raised.value.key == key


def test_what_is_not_a_path_is_refused() -> None:
    with pytest.raises(ConfigError) as raised:
        IqFile(None, COMPLEX)  # type: ignore[arg-type]
    assert raised.value.key == "path"


@pytest.mark.parametrize("block_s", [np.nan, np.inf, 0.0, -1.0, "1", None])
def test_blocks_of_no_length_are_refused(tmp_path: Path, rng: np.random.Generator, block_s: float) -> None:
    sampling = Sampling(4e6, 1e6, is_complex=True)
    write_iq(tmp_path / "x.bin", [noise(sampling, 100, rng)])
    with pytest.raises(ConfigError) as error:
        list(IqFile(tmp_path / "x.bin", sampling).blocks(block_s))
    assert error.value.key == "block_s"


def test_samples_that_are_not_finite_are_not_written(tmp_path: Path, rng: np.random.Generator) -> None:
    sampling = Sampling(4e6, 1e6, is_complex=True)
    block = noise(sampling, 100, rng)
    block.quadrature[7] = np.nan
    with pytest.raises(ConfigError, match="not finite") as error:
        write_iq(tmp_path / "x.bin", [block])
    assert error.value.key == "blocks" and not (tmp_path / "x.bin").exists()


@pytest.mark.parametrize("is_complex", [True, False])
def test_intermediate_frequency_beyond_the_sampling_is_refused(tmp_path: Path, is_complex: bool) -> None:
    (tmp_path / "x.bin").write_bytes(bytes(8))
    with pytest.raises(ConfigError, match="beyond half the sampling rate") as error:
        IqFile(tmp_path / "x.bin", Sampling(4e6, 5e9, is_complex=is_complex))
    assert error.value.key == "intermediate_hz"


def test_missing_file_and_samples_beyond_its_end_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError):
        IqFile(tmp_path / "none.bin", COMPLEX)
    (tmp_path / "a.bin").write_bytes(b"1234")
    recording = IqFile(tmp_path / "a.bin", COMPLEX)
    with pytest.raises(InputError, match="the recording holds 2"):
        recording.read(1, 2)
    for first, count, key in (
        (0.5, 1, "first"),
        (-1, 1, "first"),
        (None, 1, "first"),
        (0, 0, "count"),
        (0, 2.0, "count"),
    ):
        with pytest.raises(ConfigError) as raised:
            recording.read(first, count)  # type: ignore[arg-type]
        assert raised.value.key == key
    (tmp_path / "a.bin").unlink()
    with pytest.raises(MissingFileError):
        recording.read(0, 1)
    with pytest.raises(MissingFileError):
        assert recording.duration_s


def test_unwritable_recording_and_unknown_type_are_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    with pytest.raises(ResultError):
        write_iq(tmp_path / "no" / "a.bin", [noise(COMPLEX, 5, rng)])
    with pytest.raises(ConfigError):
        write_iq(tmp_path / "a.bin", [], "float")
    with pytest.raises(ConfigError):
        rounded(noise(COMPLEX, 5, rng), "float")


@pytest.mark.parametrize("sample_type", [["int8"], None, np.dtype("int8")])
def test_what_is_not_a_sample_type_is_refused(tmp_path: Path, sample_type: object) -> None:
    block = noise(COMPLEX, 5, np.random.default_rng(1))
    for write in (
        lambda: write_iq(tmp_path / "a.bin", [block], sample_type),
        lambda: rounded(block, sample_type),
    ):  # type: ignore[arg-type]
        with pytest.raises(ConfigError) as raised:
            write()
        assert raised.value.key == "sample_type"


@pytest.mark.parametrize("count", [0, 4])
def test_complex_samples_without_their_quadratures_are_not_written(tmp_path: Path, count: int) -> None:
    with pytest.raises(ConfigError, match="in-phase") as raised:
        write_iq(tmp_path / "a.bin", [SignalSamples(COMPLEX, np.ones(5), np.ones(count))])
    assert raised.value.key == "blocks"
    assert not (tmp_path / "a.bin").exists()


def test_file_of_somebody_else_stays_as_it_is(tmp_path: Path) -> None:
    theirs = tmp_path / "a.bin"
    theirs.write_bytes(b"theirs")
    block = noise(COMPLEX, 5, np.random.default_rng(1))
    with pytest.raises(ResultError, match="would replace this file"):
        write_iq(theirs, [block])
    assert theirs.read_bytes() == b"theirs"

    with overwriting():
        write_iq(theirs, [block])
    write_iq(theirs, [block])  # its own may be written anew
    assert IqFile(theirs, COMPLEX).count == 5
