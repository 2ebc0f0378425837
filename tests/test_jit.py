"""Compiled code equals plain Python, and is compiled anew when anything it depends on changes."""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from insgnss import jit
from tests.kernels import KernelCase, Recording, all_cases, all_kernels

PACKAGE = Path(jit.__file__).parent


def python(*arguments: str, folder: Path, **environment: str) -> str:
    """Run Python in ``folder`` with a changed environment; return what it printed."""
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture(scope="module")
def interpreted(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Return what all cases gave in a process in which nothing is compiled."""
    file = tmp_path_factory.mktemp("kernels") / "interpreted.pickle"
    python("-m", "tests.kernels", str(file), folder=PACKAGE.parent, NUMBA_DISABLE_JIT="1")
    recording: Recording = pickle.loads(file.read_bytes())
    return recording


@pytest.mark.parametrize("case", all_cases(), ids=lambda case: case.name)
def test_kernel_gives_the_same_numbers_compiled_and_as_plain_python(
    case: KernelCase, interpreted: Recording
) -> None:
    assert case.name not in interpreted.errors, interpreted.errors[case.name]
    for compiled, plain in zip(case.run(), interpreted.numbers[case.name], strict=True):
        largest = float(np.max(np.abs(plain), initial=0.0, where=np.isfinite(plain)))
        np.testing.assert_allclose(compiled, plain, rtol=case.rtol, atol=case.rtol * largest)


def test_every_kernel_runs_in_a_sample_call(interpreted: Recording) -> None:
    missing = sorted(all_kernels() - interpreted.entered)

    assert not missing, f"tests/kernels/ has no KernelCase that runs: {', '.join(missing)}"


def test_sample_calls_have_unique_names() -> None:
    names = [case.name for case in all_cases()]

    assert sorted(set(names)) == sorted(names)


@pytest.fixture
def package_copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a copy of the package's sources whose hash ``insgnss.jit`` now computes."""
    copy = tmp_path / "insgnss"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__", "_models"))
    monkeypatch.setattr(jit, "__file__", str(copy / "jit.py"))
    return copy


def test_source_hash_of_an_equal_copy_is_equal(package_copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copied = jit.source_hash()
    monkeypatch.undo()

    assert copied == jit.source_hash()


@pytest.mark.parametrize("change", ["edit", "add", "rename", "remove"])
def test_source_hash_changes_with_any_source(package_copy: Path, change: str) -> None:
    before = jit.source_hash()
    file = package_copy / "geodesy" / "gravity.py"
    if change == "edit":
        file.write_text(file.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    elif change == "add":
        (package_copy / "geodesy" / "new.py").write_text("", encoding="utf-8")
    elif change == "rename":
        file.rename(file.with_name("gravitation.py"))
    else:
        file.unlink()

    assert jit.source_hash() != before


def test_cache_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("INSGNSS_CACHE", str(tmp_path / "named"))
    assert jit.cache_root() == tmp_path / "named"

    monkeypatch.delenv("INSGNSS_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert jit.cache_root() == tmp_path / "xdg" / "insgnss"


def test_caller_is_compiled_anew_when_its_callee_in_another_file_changes(tmp_path: Path) -> None:
    package = tmp_path / "insgnss"
    package.mkdir()
    (package / "__init__.py").write_text("", encoding="utf-8")
    shutil.copy(PACKAGE / "jit.py", package)
    (package / "caller.py").write_text(
        "from insgnss.callee import term\nfrom insgnss.jit import kernel\n\n"
        "@kernel\ndef total(x):\n    return 100.0 + term(x)\n",
        encoding="utf-8",
    )
    results = []
    for factor in (2.0, 3.0):
        (package / "callee.py").write_text(
            f"from insgnss.jit import kernel\n\n@kernel\ndef term(x):\n    return {factor} * x\n",
            encoding="utf-8",
        )
        program = "from insgnss.caller import total; print(total(1.0))"
        results.append(python("-c", program, folder=tmp_path, INSGNSS_CACHE=str(tmp_path / "cache")))

    assert results == ["102.0", "103.0"]
    assert len(list((tmp_path / "cache").iterdir())) == 2
