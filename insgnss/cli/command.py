"""What every command has in common: how it refuses wrong options, and how its errors end."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import typer
from typer.core import TyperCommand

from insgnss.cli.command_errors import names_of_options, own_errors_told


class OwnCommand(TyperCommand):
    """A command whose numbers are finite, whose options are not empty, and whose errors name its options."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the options; a refused value is followed by what the option is.

        Raises
        ------
        typer.BadParameter : a value is empty, not finite, or not what its option takes
        """
        options = {name: option for option in self.params for name in option.opts}
        try:
            _refuse_empty(ctx, args, options)
            left = super().parse_args(ctx, args)
            for option in self.params:
                _refuse_infinite(ctx, option)
        except typer.BadParameter as error:
            help_text = getattr(error.param, "help", None)
            if help_text and error.message:
                error.message = f"{error.message}\n-> {help_text}"
            raise
        return left

    def invoke(self, ctx: Any) -> Any:
        """Run the command; an error of ours ends it with a sentence."""
        options = {str(option.name): option.opts[0] for option in self.params}
        with own_errors_told(names_of_options(options)):
            return super().invoke(ctx)


def _refuse_empty(ctx: Any, args: Sequence[str], options: dict[str, Any]) -> None:
    """Refuse values without a character, such as that of a shell's variable which is not set.

    Raises
    ------
    typer.BadParameter : there is one
    """
    for before, value in zip(("", *args), args, strict=False):
        name, is_assigned, assigned = value.partition("=")
        if value == "":
            option = options.get(before)
        elif is_assigned and not assigned and name in options:
            option = options[name]
        else:
            continue
        raise typer.BadParameter("the value is empty" if option else "an argument is empty", ctx, option)


def _refuse_infinite(ctx: Any, option: Any) -> None:
    """Refuse numbers that are not finite.

    Raises
    ------
    typer.BadParameter : there is one
    """
    value = ctx.params.get(str(option.name))
    for number in value if isinstance(value, list | tuple) else [value]:
        if isinstance(number, float) and not math.isfinite(number):
            raise typer.BadParameter(f"{number} is not a finite number", ctx, option)


def at_least(limit: float, most: float = math.inf) -> Callable[[Any], Any]:
    """Return the check of an option whose numbers are from ``limit`` on and not above ``most``."""
    words = f"at least {limit:g}" + ("" if most == math.inf else f" and at most {most:g}")

    def check(value: Any) -> Any:
        for number in value if isinstance(value, list | tuple) else [value]:
            if number is not None and not limit <= number <= most:
                raise typer.BadParameter(f"{number:g} is not {words}")
        return value

    return check
