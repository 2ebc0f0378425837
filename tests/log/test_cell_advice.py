"""What to do about a column whose cells are numbers in another form."""

from __future__ import annotations

import pytest

from insgnss.log.csv.cell_advice import number_advice


@pytest.mark.parametrize(
    ("cell", "plain"),
    [("\u22120.25", "-0.25"), ("\u0662\u0669\u0663.\u0660\u0661", "293.01"), ("\uff11\uff12", "12")],
)
def test_digits_and_minus_signs_of_other_scripts_are_named(cell: str, plain: str) -> None:
    assert number_advice(cell, ".").endswith(f"as minus sign: {plain}")


def test_other_words_are_of_another_column() -> None:
    assert "which column holds what" in number_advice("m\u00b2", ".")
