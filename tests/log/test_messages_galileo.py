"""Galileo I/NAV and F/NAV pages written bit by bit by the tables of the ICD, and pages that may not be joined."""

from __future__ import annotations

import math

import pytest

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.log.messages.broadcast import Broadcast
from insgnss.log.messages.galileo import FnavMessages, InavMessages, sisa_m
from insgnss.tables import EphemerisTable
from tests.log.ubx_writing import Bits, crc24q

WEEK, TOW = 2381, 408_750
NEAR_NS = WEEK * NS_PER_WEEK + TOW * NS_PER_S
PI = math.pi
# name: value, scale
ORBIT = {
    "toe_sow_s": (407_400, 60.0),
    "m0": (419_001_234 * 2.0**-31 * PI, 2.0**-31 * PI),
    "e": (2_662_233 * 2.0**-33, 2.0**-33),
    "sqrt_a": (2_852_446_123 * 2.0**-19, 2.0**-19),
    "omega0": (-1_631_512_345 * 2.0**-31 * PI, 2.0**-31 * PI),
    "i0": (659_912_345 * 2.0**-31 * PI, 2.0**-31 * PI),
    "omega": (225_712_345 * 2.0**-31 * PI, 2.0**-31 * PI),
    "idot": (-145 * 2.0**-43 * PI, 2.0**-43 * PI),
    "omega_dot": (-16_209 * 2.0**-43 * PI, 2.0**-43 * PI),
    "delta_n": (10_029 * 2.0**-43 * PI, 2.0**-43 * PI),
    "cuc": (-798 * 2.0**-29, 2.0**-29),
    "cus": (2560 * 2.0**-29, 2.0**-29),
    "crc": (7647 * 2.0**-5, 2.0**-5),
    "crs": (-1129 * 2.0**-5, 2.0**-5),
    "cic": (48 * 2.0**-29, 2.0**-29),
    "cis": (-7 * 2.0**-29, 2.0**-29),
    "af0": (-3_486_512 * 2.0**-34, 2.0**-34),
    "af1": (-145 * 2.0**-46, 2.0**-46),
    "af2": (-3 * 2.0**-59, 2.0**-59),
}
# table 41 to 45: first bit and length in words 1 to 4, and in F/NAV pages 1 to 4 (tables 31 to 34)
INAV_PLACES = {
    1: {"toe_sow_s": (17, 14), "m0": (31, 32), "e": (63, 32), "sqrt_a": (95, 32)},
    2: {"omega0": (17, 32), "i0": (49, 32), "omega": (81, 32), "idot": (113, 14)},
    3: {
        **{"omega_dot": (17, 24), "delta_n": (41, 16), "cuc": (57, 16), "cus": (73, 16)},
        **{"crc": (89, 16), "crs": (105, 16)},
    },
    4: {"cic": (23, 16), "cis": (39, 16), "af0": (69, 31), "af1": (100, 21), "af2": (121, 6)},
}
FNAV_PLACES = {
    1: {"af0": (37, 31), "af1": (68, 21), "af2": (89, 6)},
    2: {
        **{"m0": (17, 32), "omega_dot": (49, 24), "e": (73, 32), "sqrt_a": (105, 32)},
        **{"omega0": (137, 32), "idot": (169, 14)},
    },
    3: {
        **{"i0": (17, 32), "omega": (49, 32), "delta_n": (81, 16), "cuc": (97, 16), "cus": (113, 16)},
        **{"crc": (129, 16), "crs": (145, 16), "toe_sow_s": (161, 14)},
    },
    4: {"cic": (17, 16), "cis": (33, 16)},
}


def filled(length: int, kind: int, places: dict[str, tuple[int, int]], iod: int) -> Bits:
    bits = Bits(length)
    bits.put(kind, (1, 6))
    for name, place in places.items():
        bits.put(ORBIT[name][0], place, scale=ORBIT[name][1])
    if kind != 1 or length == 128:
        bits.put(iod, (7, 10))
    return bits


def inav_words(iod: int = 44, svid: int = 7, e1_hs: int = 0, week: int = WEEK) -> list[Bits]:
    words = [filled(128, kind, places, iod) for kind, places in INAV_PLACES.items()]
    words[2].put(107, (121, 8))  # SISA
    words[3].put(svid, (17, 6))
    words[3].put(407_400, (55, 14), scale=60.0)
    status = Bits(128)
    for value, place in ((5, (1, 6)), (637, (7, 11)), (-12, (18, 11)), (621, (29, 14))):
        status.put(value, place)
    for value, place in ((20, (48, 10)), (-21, (58, 10)), (e1_hs, (70, 2))):
        status.put(value, place)
    status.put((week - 1024) % 4096, (74, 12))
    status.put(TOW, (86, 20))
    return [*words, status]


def pages(word: int) -> tuple[int, int]:
    """Return the even and the odd part of a page, 120 bits each."""
    data = [int(b) for b in format(word, "0128b")]
    even = [0, 0, *data[:112]]
    odd = [1, 0, *data[112:], *[0, 1] * 32]  # reserved bits are anything
    check = crc24q([*even, *odd])
    odd_part = [*odd, *[int(b) for b in format(check, "024b")], *[0] * 14]
    return int("".join(map(str, [*even, *[0] * 6])), 2), int("".join(map(str, odd_part)), 2)


def inav(words: list[Bits], sv: str = "E07", near_ns: int | None = NEAR_NS) -> Broadcast:
    broadcast = Broadcast()
    messages = InavMessages(broadcast)
    for word in words:
        messages.add_pages(sv, *pages(word.value()), near_ns)
    return broadcast


def table_of(broadcast: Broadcast) -> EphemerisTable:
    navigation = broadcast.navigation()
    assert navigation is not None
    return navigation.ephemerides


def assert_orbit(table: EphemerisTable) -> None:
    for name, (value, _) in ORBIT.items():
        assert getattr(table, name)[0] == pytest.approx(value, rel=1e-15), name


def test_inav_words_come_back_as_the_message_written() -> None:
    broadcast = inav(inav_words())
    table = table_of(broadcast)

    assert (table.sv_names, table.message) == (("E07",), ("INAV",))
    assert_orbit(table)
    assert table.toe_ns[0] == table.toc_ns[0] == WEEK * NS_PER_WEEK + 407_400 * NS_PER_S
    assert table.group_delay_s[0].tolist() == [20 * 2.0**-32, -21 * 2.0**-32]
    assert (table.issue[0], table.health[0], table.accuracy_m[0]) == (44.0, 0.0, pytest.approx(3.12))
    assert broadcast.ionosphere == {"galileo": (159.25, -12 * 2.0**-8, 621 * 2.0**-15)}


def test_inav_health_stands_at_the_bits_of_rinex() -> None:
    assert table_of(inav(inav_words(e1_hs=3))).health[0] == 6.0


def test_inav_words_of_different_issues_or_satellites_are_not_joined() -> None:
    words = inav_words()
    words[1] = inav_words(iod=45)[1]
    assert not inav(words).ephemerides

    foreign = inav(inav_words(svid=8))
    assert not foreign.ephemerides and foreign.refused["I/NAV word of another satellite"] == 1


def test_inav_page_with_one_wrong_bit_is_refused_and_counted() -> None:
    broadcast = Broadcast()
    messages = InavMessages(broadcast)
    even, odd = pages(inav_words()[0].value())
    for bit in (6, 50, 119):
        messages.add_pages("E07", even ^ 1 << bit, odd, NEAR_NS)
    messages.add_pages("E07", odd, even, NEAR_NS)

    assert sum(broadcast.refused.values()) == 4


def test_inav_week_is_completed_or_stands_alone_and_a_wrong_one_is_refused() -> None:
    alone = table_of(inav(inav_words(), near_ns=None))
    assert alone.toe_ns[0] == WEEK * NS_PER_WEEK + 407_400 * NS_PER_S

    # in 2078 the twelve bits start again
    late = inav(inav_words(week=1024 + 4096 + 3), near_ns=NEAR_NS + (1024 + 4096 + 3 - WEEK) * NS_PER_WEEK)
    assert table_of(late).toe_ns[0] == (1024 + 4096 + 3) * NS_PER_WEEK + 407_400 * NS_PER_S

    wrong = inav(inav_words(), near_ns=NEAR_NS + NS_PER_WEEK)
    assert not wrong.ephemerides and sum(wrong.refused.values()) == 1


def test_word_6_gives_leap_seconds() -> None:
    word = Bits(128)
    word.put(6, (1, 6))
    word.put(18, (63, 8))

    assert inav([word]).leap_seconds == 18


def fnav_pages(iod: int = 44, svid: int = 7, dvs: int = 0) -> list[int]:
    result = []
    for kind, places in FNAV_PLACES.items():
        page = filled(214, kind, places, iod)
        if kind == 1:
            page.put(svid, (7, 6))
            page.put(iod, (13, 10))
            page.put(407_400, (23, 14), scale=60.0)
            for value, place in ((107, (95, 8)), (637, (103, 11)), (20, (144, 10)), (dvs, (188, 1))):
                page.put(value, place)
        week_at = {1: 156, 2: 183, 3: 175}.get(kind)
        if week_at is not None:
            page.put(WEEK - 1024, (week_at, 12))
            page.put(TOW, (week_at + 12, 20))
        result.append(page.value() << 24 | crc24q(page.bits))
    return result


def fnav(pages: list[int]) -> Broadcast:
    broadcast = Broadcast()
    messages = FnavMessages(broadcast)
    for page in pages:
        messages.add("E07", page, NEAR_NS)
    return broadcast


def test_fnav_pages_come_back_as_the_message_written() -> None:
    table = table_of(fnav(fnav_pages(dvs=1)))

    assert (table.sv_names, table.message) == (("E07",), ("FNAV",))
    assert_orbit(table)
    assert table.toe_ns[0] == table.toc_ns[0] == WEEK * NS_PER_WEEK + 407_400 * NS_PER_S
    assert table.group_delay_s[0].tolist() == [20 * 2.0**-32, 0.0]
    assert (table.issue[0], table.health[0], table.accuracy_m[0]) == (44.0, 8.0, pytest.approx(3.12))


def test_fnav_pages_that_do_not_belong_together_give_nothing() -> None:
    pages = fnav_pages()
    assert not fnav([*pages[:3], fnav_pages(iod=45)[3]]).ephemerides
    assert not fnav(fnav_pages(svid=8)).ephemerides
    assert sum(fnav([page ^ 1 << 100 for page in pages]).refused.values()) == 4


def test_accuracy_index_has_four_steps_and_no_prediction_at_its_end() -> None:
    assert [sisa_m(k) for k in (49, 50, 75, 100, 125)] == pytest.approx([0.49, 0.5, 1.0, 2.0, 6.0])
    assert math.isnan(sisa_m(255)) and math.isnan(sisa_m(126))
