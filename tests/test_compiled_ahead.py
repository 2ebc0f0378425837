"""Processes beside a command fill an empty cache: their code is used, their faults are not, and none outlives it."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import pytest

from tests.test_jit import PACKAGE, python, tiny_package

__all__ = ["tiny_package"]  # a fixture
CHILD = """
import os, pathlib, sys, time
from insgnss.kernels.compiled_ahead import compile_list, end_with_parent
from insgnss.callee import term
end_with_parent()
with open("child", "a") as file: file.write(f"{{os.getpid()}} ")
{body}
"""
PARENT = """
import os, pathlib, sys, time
from insgnss.kernels.compiled_ahead import compiled_ahead, is_complete
from insgnss.callee import term
with compiled_ahead("insgnss.child") as beside:
    {body}
"""
SHARE = "compile_list({term: (1.0,)})"
SHOW = "beside.wait(); print(term(1.0), sum(term.stats.cache_hits.values()), is_complete())"


def run_beside(folder: Path, *, child: str, parent: str, **environment: str) -> str:
    """Run a program that compiles beside itself; return what it printed."""
    shutil.copy(PACKAGE / "kernels" / "compiled_ahead.py", folder / "insgnss" / "kernels")
    (folder / "insgnss" / "child.py").write_text(CHILD.format(body=child), encoding="utf-8")
    settings = {"INSGNSS_CACHE": str(folder / "cache"), **environment}
    return python("-c", PARENT.format(body=parent), folder=folder, **settings)


def children(folder: Path) -> list[int]:
    """Return the numbers of the processes that were started."""
    told = folder / "child"
    return [int(word) for word in told.read_text(encoding="utf-8").split()] if told.exists() else []


def test_kernel_compiled_beside_is_fetched_from_the_cache_and_nothing_started_again(
    tiny_package: Path,
) -> None:
    assert run_beside(tiny_package, child=SHARE, parent=SHOW) == "2.0 1 True"
    assert (before := children(tiny_package))

    assert run_beside(tiny_package, child=SHARE, parent=SHOW) == "2.0 1 True"
    assert children(tiny_package) == before


@pytest.mark.parametrize("fault", ["raise SystemExit(3)", "os.kill(os.getpid(), 9)", "print('noise', 1 / 0)"])
def test_process_that_fails_leaves_the_compilation_to_its_parent(tiny_package: Path, fault: str) -> None:
    assert run_beside(tiny_package, child=fault, parent=SHOW) == "2.0 0 False"


def test_one_process_alone_compiles_a_kernel(tiny_package: Path) -> None:
    told = """import atexit
atexit.register(lambda: term.stats.cache_misses and open(f"did{os.getpid()}", "w").write("x"))
time.sleep(0.3)
"""
    run_beside(tiny_package, child=told + SHARE, parent=SHOW)

    assert len(list(tiny_package.glob("did*"))) == 1


def test_two_commands_at_once_do_not_disturb_each_other(tiny_package: Path) -> None:
    inner = f"""import insgnss.kernels.compiled_ahead as other
    with other.compiled_ahead("insgnss.child") as second: second.wait()
    {SHOW}"""

    assert run_beside(tiny_package, child=SHARE, parent=inner) == "2.0 1 True"


def test_cache_is_not_complete_where_a_process_is_too_slow(tiny_package: Path) -> None:
    slow = "import insgnss.kernels.compiled_ahead as ahead; ahead.LONGEST_S = 0.5; beside.wait(); print(is_complete())"

    assert run_beside(tiny_package, child="time.sleep(30.0)", parent=slow) == "False"
    assert not list((tiny_package / "cache").rglob("taken-*"))


def test_private_cache_is_filled_where_the_named_one_cannot_be_written(tiny_package: Path) -> None:
    (tiny_package / "cache").write_text("a file, no folder", encoding="utf-8")

    assert run_beside(tiny_package, child=SHARE, parent=SHOW) == "2.0 1 True"
    assert (tiny_package / "cache").read_text(encoding="utf-8") == "a file, no folder"


def test_nothing_is_started_for_plain_python(tiny_package: Path) -> None:
    shown = run_beside(
        tiny_package, child="", parent="beside.wait(); print(term(1.0))", NUMBA_DISABLE_JIT="1"
    )

    assert shown == "2.0"
    assert not children(tiny_package)


@pytest.mark.parametrize("end", ["os._exit(0)", "pass", "beside = None"])
def test_process_does_not_outlive_its_parent(tiny_package: Path, end: str) -> None:
    has_begun = "pathlib.Path('child').exists() and pathlib.Path('child').read_text()"
    until_child_runs = f"\n    while not ({has_begun}): time.sleep(0.01)\n    "
    run_beside(tiny_package, child="time.sleep(60.0)", parent=until_child_runs + end)

    left = children(tiny_package)
    deadline = time.monotonic() + 10.0
    while time.monotonic() < deadline and any(Path(f"/proc/{child}").exists() for child in left):
        time.sleep(0.05)
    assert left and not any(Path(f"/proc/{child}").exists() for child in left)
