"""Ionosphere coefficients of every system, from the header of RINEX 3 and the messages of RINEX 4."""

from __future__ import annotations

import pytest

from insgnss.log.rinex.navigation import read_ionosphere

END = "".ljust(60) + "END OF HEADER\n"
ALPHA = [1e-8, 2e-8, -3e-8, -4e-8]
BETA = [1e5, 2e5, -3e5, -4e5]


def line(name: str, values: list[float]) -> str:
    return (f"{name:<5}" + "".join(f"{v:12.4E}" for v in values)).ljust(60) + "IONOSPHERIC CORR\n"


def sent(system: str, kind: str, values: list[float]) -> str:
    fields = [f"{v:19.12E}" for v in values]
    rows = [f"    2023 06 29 10 00 00{''.join(fields[:3])}"]
    rows += ["    " + "".join(fields[i : i + 4]) for i in range(3, len(fields), 4)]
    return f"> ION {system}05 {kind}\n" + "\n".join(rows) + "\n"


@pytest.mark.parametrize(("name", "system"), [("BDS", "beidou"), ("QZS", "qzss"), ("IRN", "navic")])
def test_header_gives_the_eight_of_each_system(name: str, system: str) -> None:
    text = line(name + "A", ALPHA) + line(name + "B", BETA) + line("GPSA", [9e-9] * 4) + END
    found = read_ionosphere(text)
    assert list(found) == [system] and found[system].tolist() == ALPHA + BETA


def test_header_gives_the_three_of_galileo() -> None:
    found = read_ionosphere(line("GAL", [38.25, 0.12891, 0.0066833, 0.0]) + END)
    assert found["galileo"].tolist() == [38.25, 0.12891, 0.0066833]


@pytest.mark.parametrize(
    ("system", "kind", "name"),
    [("C", "D1D2", "beidou"), ("J", "LNAV", "qzss"), ("J", "CNVX", "qzss"), ("I", "LNAV", "navic")],
)
def test_message_gives_the_eight_of_each_system(system: str, kind: str, name: str) -> None:
    found = read_ionosphere(END + sent(system, kind, ALPHA + BETA))
    assert list(found) == [name] and found[name].tolist() == ALPHA + BETA


def test_message_gives_the_three_of_galileo() -> None:
    found = read_ionosphere(END + sent("E", "IFNV", [100.0, 0.2, 0.003, 0.0]))
    assert found["galileo"].tolist() == [100.0, 0.2, 0.003]


def test_first_set_of_a_system_counts() -> None:
    text = END + sent("C", "D1D2", ALPHA + BETA) + sent("C", "D1D2", BETA + ALPHA)
    assert read_ionosphere(text)["beidou"].tolist() == ALPHA + BETA


@pytest.mark.parametrize(
    "text",
    [
        END,
        line("GAL", [0.0] * 4) + END,  # never filled in
        line("BDSA", ALPHA) + END,  # half a set
        line("BDSA", ALPHA).replace("E-08", "E-x8") + line("BDSB", BETA) + END,
        END + sent("C", "CNVX", ALPHA + BETA + [1.0]),  # another model, of nine coefficients
        END + sent("C", "D1D2", ALPHA + BETA).replace("E+05", "E+x5"),
        END + sent("C", "D1D2", ALPHA + BETA)[:100],
        END + "> ION C05 D1D2",
        END + "> ION",
    ],
)
def test_missing_or_damaged_set_is_none(text: str) -> None:
    assert read_ionosphere(text) == {}
