"""Compiled code equals plain Python, and is compiled anew when anything it depends on changes."""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numba
import numpy as np
import pytest

from insgnss.cli.command_errors import own_errors_told
from insgnss.kernels import jit, numba_parts
from insgnss.tables import Float64
from tests.kernels import KernelCase, Recording, all_cases, all_kernels

PACKAGE = Path(jit.__file__).parents[1]


def python(*arguments: str, folder: Path, **environment: str) -> str:
    """Run Python in ``folder`` with a changed environment; return what it printed.

    No bytecode is kept: Python would take that of a file of the same length that was changed within the same second.
    """
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1", **environment},
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
    """Return a copy of the package's sources whose hash ``insgnss.kernels.jit`` now computes."""
    copy = tmp_path / "insgnss"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__", "_models"))
    monkeypatch.setattr(jit, "__file__", str(copy / "kernels" / "jit.py"))
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


def test_each_installation_has_a_folder_of_its_own(tmp_path: Path) -> None:
    """Numba compiles for each place of a file: what is complete for one is not there for the other."""
    program = "from insgnss.kernels import jit; print(jit.CACHE_DIR)"
    names = []
    for place in ("one", "other", "one"):
        if not (tmp_path / place).exists():
            package_with_jit_alone(tmp_path / place)
        names.append(python("-c", program, folder=tmp_path / place, INSGNSS_CACHE=str(tmp_path / "cache")))
    assert names[0] == names[2] != names[1]


def test_code_that_checks_its_indices_has_a_cache_of_its_own(tmp_path: Path) -> None:
    package_with_jit_alone(tmp_path)
    program = "from insgnss.kernels import jit; print(jit.source_hash())"
    plain, checked = (python("-c", program, folder=tmp_path, NUMBA_BOUNDSCHECK=flag) for flag in ("0", "1"))

    assert plain != checked


def test_cache_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("INSGNSS_CACHE", str(tmp_path / "named"))
    assert jit.cache_root() == tmp_path / "named"

    monkeypatch.delenv("INSGNSS_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert jit.cache_root() == tmp_path / "xdg" / "insgnss"


def test_caller_is_compiled_anew_when_its_callee_in_another_file_changes(tmp_path: Path) -> None:
    package = package_with_jit_alone(tmp_path)
    (package / "caller.py").write_text(
        "from insgnss.callee import term\nfrom insgnss.kernels.jit import kernel\n\n"
        "@kernel\ndef total(x):\n    return 100.0 + term(x)\n",
        encoding="utf-8",
    )
    results = []
    for factor in (2.0, 3.0):
        (package / "callee.py").write_text(
            f"from insgnss.kernels.jit import kernel\n\n@kernel\ndef term(x):\n    return {factor} * x\n",
            encoding="utf-8",
        )
        program = "from insgnss.caller import total; print(total(1.0))"
        results.append(python("-c", program, folder=tmp_path, INSGNSS_CACHE=str(tmp_path / "cache")))

    assert results == ["102.0", "103.0"]
    assert len(list((tmp_path / "cache").iterdir())) == 2


def compiled_code(root: Path, name: str, unused_days: float) -> Path:
    """Return a new folder of compiled code that was last used so many days ago."""
    folder = root / name
    (folder / "fusion_0").mkdir(parents=True)
    (folder / "fusion_0" / "loop.run_epochs-1.py311.nbi").write_bytes(b"")
    then = time.time() - unused_days * 86_400.0
    os.utime(folder, (then, then))
    return folder


def test_new_cache_folder_removes_what_nobody_has_used_for_a_month(tmp_path: Path) -> None:
    old = compiled_code(tmp_path, "0123456789abcdef", unused_days=31.0)
    recent = compiled_code(tmp_path, "0123456789abcde0", unused_days=29.0)
    foreign = compiled_code(tmp_path, "somebody_else", unused_days=400.0)
    empty = tmp_path / "0123456789abcde1"
    empty.mkdir()
    os.utime(empty, (0.0, 0.0))

    jit.tend_caches(tmp_path / "fedcba9876543210")

    assert not old.exists()
    assert recent.exists() and foreign.exists() and empty.exists()


def test_known_cache_folder_is_marked_as_used_and_removes_nothing(tmp_path: Path) -> None:
    own = compiled_code(tmp_path, "fedcba9876543210", unused_days=40.0)
    old = compiled_code(tmp_path, "0123456789abcdef", unused_days=40.0)

    jit.tend_caches(own)

    assert old.exists()
    assert time.time() - own.stat().st_mtime < 60.0


def package_with_jit_alone(folder: Path) -> Path:
    """Make a package with the real ``jit`` and nothing else; return its folder."""
    package = folder / "insgnss"
    (package / "kernels").mkdir(parents=True)
    for name in ("__init__.py", "kernels/__init__.py"):
        (package / name).write_text("", encoding="utf-8")
    for name in ("jit.py", "numba_parts.py"):
        shutil.copy(PACKAGE / "kernels" / name, package / "kernels")
    return package


@pytest.fixture
def tiny_package(tmp_path: Path) -> Path:
    """Return a folder with a package of one kernel and the real ``jit``."""
    package = package_with_jit_alone(tmp_path)
    kernel = "from insgnss.kernels.jit import kernel\n\n@kernel\ndef term(x):\n    return 2.0 * x\n"
    (package / "callee.py").write_text(kernel, encoding="utf-8")
    return tmp_path


@jit.kernel
def _row(x: Float64) -> Float64:
    first: Float64 = x[0]
    return first


@jit.kernel
def _sum_of_row(x: Float64) -> float:
    return float(_row(x)[0])


@jit.kernel
def _sum_of_copy(x: Float64) -> float:
    return float(x.copy()[0, 0])


@jit.kernel(inline=True)
def _woven(x: Float64) -> float:
    return _sum_of_row(x) + float(_row(x)[0])


@jit.kernel
def _sum_of_woven(x: Float64) -> float:
    return _woven(x)


@jit.kernel
def _first(x: Float64) -> float:
    return float(x[0, 0])


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="the compiler is switched off")
def test_kernel_borrows_its_arrays_unless_it_makes_or_is_handed_one() -> None:
    counts = [k.targetoptions["_nrt"] for k in (_row, _sum_of_row, _sum_of_copy, _sum_of_woven)]  # type: ignore[attr-defined]

    assert counts == [True] * 4
    assert not _first.targetoptions["_nrt"]  # type: ignore[attr-defined]


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="the compiler is switched off")
def test_kernel_that_makes_an_array_unseen_is_refused() -> None:
    def doubled(x: Float64) -> float:
        twice = 2.0 * x
        return float(twice[0])

    with pytest.raises(numba.core.errors.NumbaError, match="NRT required"):
        jit.kernel(doubled)(np.ones(3))


# ------------------------------------------------------------------------------------------- damage and other users

CALL = "from insgnss.callee import term; print(term(1.0), sum(term.stats.cache_hits.values()))"


def cached_files(folder: Path) -> list[Path]:
    return sorted(path for path in (folder / "cache").rglob("*.nb[ic]"))


ENDINGS, DAMAGES = (".nbi", ".nbc"), ("flip", "cut", "empty", "text")


@pytest.fixture(scope="module")
def around_damage(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, str]]:
    """Return what each kernel gave, and from how many files, in three processes: before, after the damage, and then.

    A kernel for each damage of each file, all in one module: a process takes longer to start than to compile them.
    """
    folder = tmp_path_factory.mktemp("damage")
    names = [f"{ending[1:]}_{damage}" for ending in ENDINGS for damage in DAMAGES]
    kernels = "".join(f"\n\n@kernel\ndef {name}(x):\n    return 2.0 * x\n" for name in names)
    module = package_with_jit_alone(folder) / "callee.py"
    module.write_text(f"from insgnss.kernels.jit import kernel\n{kernels}", encoding="utf-8")
    call = (
        "import insgnss.callee as callee\n"
        f"for name in {names}:\n"
        "    term = getattr(callee, name)\n"
        "    print(name, term(1.0), sum(term.stats.cache_hits.values()))"
    )
    told = []
    for _ in range(3):
        printed = python("-c", call, folder=folder, INSGNSS_CACHE=str(folder / "cache"))
        told.append(dict(line.split(" ", 1) for line in printed.splitlines()))
        if len(told) == 1:
            for name in names:
                damage_files(folder, name)
    return told


def damage_files(folder: Path, name: str) -> None:
    """Damage the files of one kind of one kernel, as its name says."""
    ending, damage = name.split("_")
    paths = [
        path for path in cached_files(folder) if path.name.endswith(f".{ending}") and f".{name}-" in path.name
    ]
    assert len(paths) == 1
    data = paths[0].read_bytes()
    at = len(data) // 2
    flipped = data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]
    paths[0].write_bytes({"flip": flipped, "cut": data[:at], "empty": b"", "text": b"no code"}[damage])


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("ending", ENDINGS)
def test_damaged_cache_is_compiled_again(
    around_damage: list[dict[str, str]], ending: str, damage: str
) -> None:
    assert [told[f"{ending[1:]}_{damage}"] for told in around_damage] == ["2.0 0", "2.0 0", "2.0 1"]


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give files away")
@pytest.mark.parametrize("whose", ["folder", "files"])
def test_code_of_another_user_is_not_loaded(tiny_package: Path, whose: str) -> None:
    settings = {"INSGNSS_CACHE": str(tiny_package / "cache")}
    python("-c", CALL, folder=tiny_package, **settings)
    for path in [tiny_package / "cache"] if whose == "folder" else cached_files(tiny_package):
        os.chown(path, 12345, -1)

    assert python("-W", "ignore", "-c", CALL, folder=tiny_package, **settings) == "2.0 0"


def test_cache_of_another_user_is_told_and_replaced_by_a_folder_of_our_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("INSGNSS_CACHE", str(tmp_path))
    monkeypatch.setattr(jit, "is_trusted", lambda status: False)
    monkeypatch.setattr(numba_parts, "_warnings_to_give", told := [])
    private = jit.trusted_cache(tmp_path)

    assert len(told) == 1 and "belongs to another user" in told[0]
    assert private != tmp_path and private.stat().st_mode & 0o077 == 0
    assert os.environ["INSGNSS_CACHE"] == str(private)


def test_cache_that_cannot_be_written_is_told_and_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("INSGNSS_CACHE", str(tmp_path))
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    monkeypatch.setattr(numba_parts, "_warnings_to_give", told := [])

    assert jit.trusted_cache(tmp_path) != tmp_path
    assert len(told) == 1 and told[0].startswith(
        f"compiled code cannot be kept in {tmp_path}: the folder is not writable; each command compiles for a minute"
    )


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="the compiler is switched off")
def test_file_in_place_of_the_cache_is_told_when_the_first_kernel_is_called(tiny_package: Path) -> None:
    cache = tiny_package / "cache"
    cache.write_text("a file", encoding="utf-8")
    program = (
        "import warnings\n"
        "with warnings.catch_warnings(record=True) as told:\n"
        "    warnings.simplefilter('always')\n"
        "    from insgnss.callee import term\n"
        "    print(len(told), term(1.0), term(2.0))\n"
        "print(*(warning.message for warning in told), sep='\\n')"
    )
    first, *warned = python("-c", program, folder=tiny_package, INSGNSS_CACHE=str(cache)).splitlines()

    assert first == "0 2.0 4.0"
    assert len(warned) == 1
    assert warned[0].startswith(
        f"compiled code cannot be kept in {cache}: it is a file; each command compiles"
    )


def test_command_shows_a_warning_of_ours_as_a_sentence_and_others_as_before(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = lambda *place, **more: print("as before", place[1].__name__)
        with own_errors_told():
            warnings.warn("no folder", numba_parts.CacheWarning, stacklevel=1)
            warnings.warn("old", DeprecationWarning, stacklevel=1)
    told = capsys.readouterr()

    assert told.err == "warning: no folder\n"
    assert told.out == "as before DeprecationWarning\n"


@pytest.mark.skipif(os.name != "posix", reason="access by groups is POSIX's")
def test_cache_folder_is_closed_to_others(tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    folder.mkdir()
    folder.chmod(0o777)

    assert jit.trusted_cache(folder) == folder
    assert folder.stat().st_mode & 0o777 == 0o755
