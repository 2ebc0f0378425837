"""Every number that a command takes: wrong ones are refused in words that name the option, before any work.

The options come from the parsers themselves: a new one must refuse wrong numbers, or be entered in ``MEANINGFUL``.
"""

from __future__ import annotations

import math
import typing
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from insgnss.cli.main import EXAMPLES, app
from insgnss.errors import ConfigError
from insgnss.studies.outage.study import Banked, Periodic, Random, Windows, outage_study

SAMPLE = Path(__file__).resolve().parents[1] / "data" / "sample_flight" / "flight.toml"
NO_NUMBERS = ("nan", "inf", "-inf", "", "word")
NUMBERS = ("-1", "0", "1e300", "1e-300")
# what stands beside the option: enough to reach the check of it, too little to work
BESIDE: dict[str, tuple[str, ...]] = {
    "acquire": ("no_recording", "--rate", "4e6"),
    "allan": ("no_log.csv",),
    "campaign": ("imu_grades", "--output", "PLACE"),
    "consistency": ("no_run",),
    "iq": ("at_rest", "--record", "PLACE/samples.bin"),
    "margin": ("--no-pictures",),
    "outage": (str(SAMPLE), "--random", "2"),
    "point": (str(SAMPLE),),
    "receiver": ("--runs", "1", "--cn0", "40", "--variants", "scalar"),
    "replay": (str(SAMPLE),),
    "simulate": ("at_rest", "--output", "PLACE"),
    "track": ("--time", "0.1", "--channels", "1"),
    "visibility": ("no_run", "--flight", str(SAMPLE)),
}
# numbers that mean something to an option
MEANINGFUL: dict[str, set[str]] = {
    "acquire --intermediate": {"-1", "0", "1e-300"},
    "acquire --skip": {"0"},
    "acquire --start": {"0", "1e-300"},
    "acquire --doppler": {"0", "1e-300"},
    "acquire --pfa": {"1e-300"},
    "allan --from": {"0", "1e-300"},
    "allan --to": {"0", "1e-300"},
    "campaign --workers": {"0"},
    "consistency --confidence": {"1e-300"},
    "consistency --from": {"0", "1e-300"},
    "iq --loss": {"-1", "0", "1e-300"},
    "iq --seed": {"0"},
    "margin --acceleration": {"0", "1e-300"},
    "margin --cn0": {"-1", "0", "1e-300"},
    "margin --seed": {"0"},
    "point --false-alarm": {"1e-300"},
    "point --missed-detection": {"1e-300"},
    "outage --bank": {"0", "1e-300"},
    "outage --after": {"0", "1e-300"},
    "outage --seed": {"0"},
    "receiver --assumed-cn0": {"-1", "0", "1e-300"},
    "receiver --latency": {"0", "1e-300"},
    "receiver --min-cn0": {"-1", "0", "1e-300"},
    "receiver --seed": {"0"},
    "receiver --settle": {"0", "1e-300"},
    "simulate --seed": {"0"},
    "track --acceleration": {"-1", "0", "1e-300"},
    "track --cn0": {"-1", "0", "1e-300"},
    "track --frequency-bandwidth": {"0", "1e-300"},
    "track --jerk": {"-1", "0", "1e-300"},
    "track --seed": {"0"},
    "track --wander": {"0", "1e-300"},
    "visibility --step": {"0", "1e-300"},
    "visibility --threshold": {"-1", "0", "1e-300"},
    "margin --step": {"0", "1e-300"},
}


def types_in(annotation: object) -> set[object]:
    """Return the types in an annotation, at any depth."""
    inside = typing.get_args(annotation)
    return {annotation}.union(*map(types_in, inside)) if inside else {annotation}


def numeric_options() -> Iterator[tuple[str, str]]:
    """Yield each command with each of its options that takes numbers."""
    group = typer.main.get_command(app)
    for function in EXAMPLES:
        hints = typing.get_type_hints(function)
        for option in group.commands[function.__name__].params:  # type: ignore[attr-defined]
            kinds = types_in(hints[option.name])
            if option.param_type_name == "option" and kinds & {int, float}:
                yield function.__name__, option.opts[0]


OPTIONS = list(numeric_options())


@pytest.fixture
def refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """Return a call of a command that has to refuse its options; it returns the message."""
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("TERMINAL_WIDTH", "200")

    def call(*arguments: str) -> str:
        given = [argument.replace("PLACE", str(tmp_path)) for argument in arguments]
        done = CliRunner().invoke(app, given)
        assert done.exit_code == 2, done.output
        assert isinstance(done.exception, SystemExit) and done.stdout == ""
        assert list(tmp_path.iterdir()) == []
        return " ".join(done.stderr.split())

    return call


def test_parsers_have_numbers_and_the_tables_name_no_option_that_is_gone() -> None:
    names = {f"{command} {option}" for command, option in OPTIONS}

    assert len(names) > 50
    assert set(MEANINGFUL) <= names
    assert {command for command, _ in OPTIONS} == set(BESIDE)


@pytest.mark.parametrize(("command", "option"), OPTIONS, ids=[" ".join(one) for one in OPTIONS])
def test_wrong_number_is_refused_by_the_name_of_its_option(
    command: str, option: str, refused: Callable[..., str]
) -> None:
    wrong = [number for number in NUMBERS if number not in MEANINGFUL.get(f"{command} {option}", ())]
    for value in (*NO_NUMBERS, *wrong):
        told = refused(command, *BESIDE[command], f"{option}={value}")
        assert f"'{option}'" in told, (value, told)
        assert "->" in told, (value, told)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("visibility", "no_run", "--flight", str(SAMPLE), "--step", ""), "'--step': the value is empty"),
        (("replay", ""), "an argument is empty"),
        (("simulate", "at_rest", "--output="), "'--output' / '-o': the value is empty"),
        (("track", "--code-bandwidth", "1e9"), "option '--code-bandwidth': B T"),
        (("track", "--frequency-bandwidth", "1e9"), "option '--frequency-bandwidth': B T"),
        (("receiver", "--settle", "30", "--average-from", "20"), "average from --settle on"),
        (("receiver", "--cn0", "40,nan"), "option '--cn0': '40,nan' is not a list of numbers"),
        (("replay", str(SAMPLE), "--rate", "nan"), "option '--rate': output rate nan Hz"),
        (("outage", str(SAMPLE), "--window", "nan:3"), "option '--window': nan to 3 s is not a window"),
        (("campaign", "imu_grades", "-o", "PLACE/out", "--workers", "-2"), "option '--workers': invalid number"),
    ],
)  # fmt: skip
def test_message_names_the_option_as_it_was_typed(
    arguments: tuple[str, ...], words: str, refused: Callable[..., str]
) -> None:
    assert words in refused(*arguments)


@pytest.mark.parametrize(
    ("windows", "key"),
    [
        (Periodic(math.inf, 60.0), "length_s"),
        (Periodic(30.0, math.nan), "every_s"),
        (Random(30.0, 0), "random"),
        (Banked(-1.0), "bank_deg"),
        ([(5.0, 3.0)], "windows"),
    ],
)
def test_windows_that_no_log_can_hold_are_refused_before_a_log_is_read(windows: Windows, key: str) -> None:
    with pytest.raises(ConfigError) as refusal:
        outage_study("no_flight.toml", windows)

    assert refusal.value.key == key
