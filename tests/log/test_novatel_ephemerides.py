"""Ephemerides that a NovAtel receiver decoded: ours against NovAtel's own library, which reads the same bytes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insgnss.log.messages.galileo import sisa_m
from insgnss.log.novatel.navigation import DECODED
from insgnss.tables import EphemerisTable
from tests.log.novatel_encoder import TOW_S, WEEK, message, range_b
from tests.log.test_novatel import SKY, read

BDT_BEHIND_S = 14
TOE_S = 511_200
NUMBERS = {7: 9, 1336: 194, 1122: 11, 1309: 12, 1310: 13, 1696: 20}  # satellite of each kind of message
# our column, and its names in the library's messages
THEIRS = {
    **{
        name: (name,)
        for name in ("m0", "delta_n", "i0", "omega0", "omega", "omega_dot", "cuc", "cus", "crc", "crs")
    },
    **{
        "cic": ("cic",),
        "cis": ("cis",),
        "e": ("ecc", "eccentricity"),
        "idot": ("i_dot",),
        "sqrt_a": ("root_a",),
    },
    **{name: (name, name[1:]) for name in ("af0", "af1", "af2")},
    "issue": ("iode1", "iode", "io_dnav", "iod_nav"),
}


def body(kind: int, rng: np.random.Generator, number: int) -> bytes:
    """Return the body of a message with a number of its own in each field."""
    row = np.zeros(1, DECODED[kind][0])
    for name in row.dtype.names or ():
        if row.dtype[name].kind == "f":
            row[name] = rng.uniform(1e-3, 1.0)
        elif not name.startswith("_"):
            row[name] = rng.integers(1, 8)
    for name in ("toe", "toc", "fnav_toc", "inav_toc"):
        if name in (row.dtype.names or ()):
            row[name] = TOE_S
    row["prn"] = number
    return row.tobytes()


def library_s(data: bytes) -> dict[str, Any]:
    """Return the fields of a message by NovAtel's library."""
    oem = pytest.importorskip("novatel_edie.oem", reason="NovAtel's own library is not installed")
    parser = oem.Parser()
    parser.write(data)
    (found,) = parser
    fields: dict[str, Any] = found.to_dict()
    return fields


def decoded(folder: Path, data: bytes) -> EphemerisTable:
    navigation = read(folder, data + range_b(SKY)).navigation
    assert navigation is not None
    return navigation.ephemerides


def check_elements(ours: EphemerisTable, row: int, theirs: dict[str, Any]) -> None:
    compared = 0
    for column, names in THEIRS.items():
        for name in names:
            if name in theirs:
                assert getattr(ours, column)[row] == theirs[name], column
                compared += 1
    assert compared >= 13


@pytest.mark.parametrize("kind", [7, 1336, 1309, 1310, 1696])
def test_elements_are_those_of_the_vendors_library(
    kind: int, tmp_path: Path, rng: np.random.Generator
) -> None:
    data = message(kind, body(kind, rng, NUMBERS[kind]))
    theirs, ours = library_s(data), decoded(tmp_path, data)

    names = {7: ("G09", "LNAV"), 1336: ("J02", "LNAV"), 1309: ("E12", "INAV"), 1310: ("E13", "FNAV")}
    assert (*ours.sv_names, *ours.message) == names.get(kind, ("C20", "D1"))
    check_elements(ours, 0, theirs)
    ahead_s = BDT_BEHIND_S if kind == 1696 else 0
    assert ours.toe_ns.tolist() == ours.toc_ns.tolist() == [(WEEK * 604_800 + TOE_S + ahead_s) * 10**9]
    if "a" in theirs:
        assert ours.sqrt_a[0] == math.sqrt(theirs["a"])
        assert ours.accuracy_m[0] == math.sqrt(theirs["eph_var"])
        assert ours.group_delay_s[0].tolist() == [theirs["tgd"], 0.0]
        assert ours.health[0] == theirs["health7"]
    elif kind == 1696:
        assert ours.group_delay_s[0].tolist() == [theirs["tgd1"], theirs["tgd2"]]
        assert ours.accuracy_m[0] == theirs["ura"] and ours.health[0] == theirs["sat_h1"] & 1
    else:
        assert ours.group_delay_s[0].tolist() == [theirs["e1_e5a_bgd"], theirs.get("e1_e5b_bgd", 0.0)]
        assert ours.accuracy_m[0] == sisa_m(theirs["sisa"])


def test_message_of_both_galileo_clocks_gives_two(tmp_path: Path, rng: np.random.Generator) -> None:
    data = message(1122, body(1122, rng, NUMBERS[1122]))
    theirs, ours = library_s(data), decoded(tmp_path, data)

    assert ours.sv_names == ("E11", "E11") and sorted(ours.message) == ["FNAV", "INAV"]
    for row, kind in enumerate(ours.message):
        clock = {f"af{k}": theirs[f"{kind.lower()}_af{k}"] for k in range(3)}
        check_elements(ours, row, theirs | clock)
        assert ours.group_delay_s[row].tolist() == [theirs["e1_e5a_bgd"], theirs["e1_e5b_bgd"]]


def test_ionosphere_and_leap_seconds_are_those_of_the_vendors_library(tmp_path: Path) -> None:
    terms = [1e-8, 2e-8, -6e-8, -1.2e-7, 9e4, 1.3e5, -6.5e4, -4.6e5]
    packed = np.array(terms).tobytes() + np.array([WEEK, 61_440], "<u4").tobytes()
    packed += np.array([1e-9, 2e-15]).tobytes() + np.array([1929, 7, 18, 18, 0], "<i4").tobytes()
    data = message(8, packed)
    theirs, navigation = library_s(data), read(tmp_path, data + range_b(SKY)).navigation

    assert navigation is not None and navigation.klobuchar is not None
    assert navigation.klobuchar.tolist() == [theirs[f"{row}{k}"] for row in "ab" for k in range(4)]
    assert navigation.leap_seconds == theirs["delta_tls"] == 18


@pytest.mark.parametrize("wrong", ["satellite", "number"])
def test_message_that_cannot_be_used_is_refused(wrong: str, tmp_path: Path, rng: np.random.Generator) -> None:
    sound = message(1696, body(1696, rng, 21))
    damaged = np.frombuffer(body(1696, rng, 99 if wrong == "satellite" else 20), DECODED[1696][0]).copy()
    damaged["m0"] = np.nan if wrong == "number" else damaged["m0"]
    log = read(tmp_path, sound + message(1696, damaged.tobytes(), TOW_S) + range_b(SKY))

    assert log.navigation is not None and log.navigation.ephemerides.sv_names == ("C21",)
    assert any("refused" in event.detail for event in log.events)
