"""The command line's manners: exit codes, completion in the shell, nothing but the result on standard output."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from rich.markup import render
from typer.core import TyperGroup
from typer.testing import CliRunner

from insgnss import errors
from insgnss.cli.main import EXIT_CODES, app
from insgnss.version import __version__
from tests.conftest import REPOSITORY

SAMPLE = REPOSITORY / "data" / "sample_flight" / "flight.toml"


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Return what a process of its own says: its standard error is no terminal."""
    command = [sys.executable, "-m", "insgnss.cli", *arguments]
    whole = {**os.environ, **environment}
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=REPOSITORY, env=whole)


def test_the_package_runs_as_a_module() -> None:
    command = [sys.executable, "-m", "insgnss", "--version"]
    told = subprocess.run(command, capture_output=True, text=True, check=False, cwd=REPOSITORY)

    assert (told.returncode, told.stdout) == (0, f"insgnss {__version__}\n")


def test_help_tells_every_exit_code() -> None:
    told = CliRunner(env={"COLUMNS": "200", "TERMINAL_WIDTH": "200"}).invoke(app, ["--help"]).output

    for code, words in EXIT_CODES.items():
        assert f"{code} {words}" in " ".join(told.split())


def test_help_shows_every_word_of_its_texts() -> None:
    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    texts = [
        text
        for command in (group, *group.commands.values())
        for text in (
            command.help,
            command.epilog,
            *(getattr(option, "help", None) for option in command.params),
        )
        if text
    ]

    # square brackets are marks of style there
    assert len(texts) > 100
    assert [text for text in texts if render(text).plain != text] == []


def test_exit_codes_are_those_of_the_errors() -> None:
    tree = [kind for kind in vars(errors).values() if isinstance(kind, type)]
    own = {kind.exit_code for kind in tree if issubclass(kind, errors.InsGnssError)}

    assert own | {0, 130} == set(EXIT_CODES)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("columns", "nav"), 0),
        (("replay", "none.toml"), 3),
        (("replay", "data/sample_flight/flight.toml", "--format", "xlsx"), 2),
        (("replay", "--no-such-option"), 2),
        (("report", "none"), 5),
    ],
)
def test_command_ends_with_the_code_of_the_table(arguments: tuple[str, ...], code: int) -> None:
    done = CliRunner().invoke(app, arguments)

    assert done.exit_code == code
    assert "Traceback" not in done.output
    assert (done.stdout == "") == (code != 0)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("report", str(SAMPLE)), 5, "this is a file; name the folder of the run"),
        (("campaign", "imu_grades", "--output", "PLACE", "--workers", "-2"), 2, "invalid number of workers -2"),
        (("visibility", "none", "--flight", str(SAMPLE), "--threshold", "nan"), 2, "nan is not"),
        (("allan", str(SAMPLE), "--from", "293800", "--to", "293750"), 2, "it lasts from 293700.010 to 294900.000 s"),
    ],
)  # fmt: skip
def test_wrong_use_ends_with_a_sentence_that_says_what_to_do(
    arguments: tuple[str, ...], code: int, words: str, tmp_path: Path
) -> None:
    done = CliRunner().invoke(app, [str(tmp_path / "out") if a == "PLACE" else a for a in arguments])

    assert done.exit_code == code and words in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_result_alone_stands_on_standard_output_of_a_pipe(tmp_path: Path) -> None:
    done = run("track", "--time", "1", "--channels", "2", "--json")

    assert done.returncode == 0
    assert done.stdout.startswith("{") and done.stdout.endswith("}\n")
    assert done.stderr == ""


def test_output_times_outside_the_log_name_the_option_that_gave_them(tmp_path: Path) -> None:
    (tmp_path / "times.csv").write_text("time_s\n1.0\n")

    refused = CliRunner().invoke(app, ["replay", str(SAMPLE), "--times", str(tmp_path / "times.csv")])

    assert refused.exit_code == 2
    assert "'--times, --rate': no output time lies inside" in refused.stderr


def test_shell_completes_the_commands() -> None:
    asked = {"_INSGNSS_COMPLETE": "complete_bash", "COMP_WORDS": "insgnss re", "COMP_CWORD": "1"}

    offered = run(**asked).stdout.split()

    assert sorted(offered) == ["receiver", "replay", "report"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_script_is_shown(shell: str) -> None:
    shown = CliRunner().invoke(app, [], env={"_INSGNSS_COMPLETE": f"source_{shell}"}, prog_name="insgnss")

    assert shown.exit_code == 0
    assert "_INSGNSS_COMPLETE" in shown.output
