"""Ctrl-C before a command runs: one line, exit code 130."""

from __future__ import annotations

import subprocess
import sys

import pytest

# interrupts the process when a module that the package needs is looked for
LOAD = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background process ignores it from the start
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "numpy":
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Interrupting())
sys.argv = [NAME]
import insgnss.cli.main
"""


@pytest.mark.parametrize(("name", "code"), [("/usr/bin/insgnss", 130), ("own_program.py", -2)])
def test_interrupt_while_the_package_is_loaded(name: str, code: int) -> None:
    """It was a traceback of up to 60 lines; a program that imports the package still gets its KeyboardInterrupt."""
    ended = subprocess.run(
        [sys.executable, "-c", LOAD.replace("NAME", repr(name))], capture_output=True, text=True, check=False
    )
    assert ended.returncode == code
    assert (ended.stderr == "insgnss: interrupted\n") == (code == 130), ended.stderr
