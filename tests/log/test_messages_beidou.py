"""BeiDou D1 and D2 written bit by bit by the figures of the B1I ICD, parity in between, and what may not be joined."""

from __future__ import annotations

import math

import pytest

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.log.messages.beidou import D1Messages, D2Messages, information_bits
from insgnss.log.messages.broadcast import Broadcast
from insgnss.tables import NavigationData
from tests.log.ubx_writing import Bits

PI = math.pi
BDT_WEEK, SOW = 1025, 408_720
TO_GPS_NS = 1356 * NS_PER_WEEK + 14 * NS_PER_S
NEAR_NS = BDT_WEEK * NS_PER_WEEK + SOW * NS_PER_S + TO_GPS_NS
TOE = 406_800.0
VALUES = {
    "af0": (-4_123_456 * 2.0**-33, 2.0**-33),
    "af1": (-1_234_567 * 2.0**-50, 2.0**-50),
    "af2": (-700 * 2.0**-66, 2.0**-66),
    "delta_n": (-9_876 * 2.0**-43 * PI, 2.0**-43 * PI),
    "cuc": (-71_234 * 2.0**-31, 2.0**-31),
    "m0": (-1_999_888_777 * 2.0**-31 * PI, 2.0**-31 * PI),
    "e": (4_012_345_678 * 2.0**-33, 2.0**-33),
    "cus": (61_234 * 2.0**-31, 2.0**-31),
    "crc": (-31_234 * 2.0**-6, 2.0**-6),
    "crs": (101_234 * 2.0**-6, 2.0**-6),
    "sqrt_a": (2_769_012_345 * 2.0**-19, 2.0**-19),
    "i0": (1_234_567_890 * 2.0**-31 * PI, 2.0**-31 * PI),
    "cic": (-12_345 * 2.0**-31, 2.0**-31),
    "omega_dot": (-4_321_000 * 2.0**-43 * PI, 2.0**-43 * PI),
    "cis": (54_321 * 2.0**-31, 2.0**-31),
    "idot": (-5_432 * 2.0**-43 * PI, 2.0**-43 * PI),
    "omega0": (-1_111_222_333 * 2.0**-31 * PI, 2.0**-31 * PI),
    "omega": (1_777_666_555 * 2.0**-31 * PI, 2.0**-31 * PI),
    "toe_sow_s": (TOE, 8.0),
}
ALPHA = (35 * 2.0**-30, -28 * 2.0**-27, -29 * 2.0**-24, 44 * 2.0**-24)
BETA = (63 * 2.0**11, -23 * 2.0**14, 42 * 2.0**16, -29 * 2.0**16)
IONOSPHERE_SCALES = (2.0**-30, 2.0**-27, 2.0**-24, 2.0**-24, 2.0**11, 2.0**14, 2.0**16, 2.0**16)
# Bits by their number in the subframe of 300, parity included (figures 5-8 to 5-10), word by word
D1_IONOSPHERE = (
    *(((127, 8),), ((135, 8),), ((151, 8),), ((159, 8),)),
    *(((167, 6), (181, 2)), ((183, 8),), ((191, 8),), ((199, 4), (211, 4))),
)
D1_PLACES = {
    1: {
        "af2": ((215, 11),),
        "af0": ((226, 7), (241, 17)),
        "af1": ((258, 5), (271, 17)),
    },
    2: {
        "delta_n": ((43, 10), (61, 6)),
        "cuc": ((67, 16), (91, 2)),
        "m0": ((93, 20), (121, 12)),
        "e": ((133, 10), (151, 22)),
        "cus": ((181, 18),),
        "crc": ((199, 4), (211, 14)),
        "crs": ((225, 8), (241, 10)),
        "sqrt_a": ((251, 12), (271, 20)),
    },
    3: {
        "i0": ((66, 17), (91, 15)),
        "cic": ((106, 7), (121, 11)),
        "omega_dot": ((132, 11), (151, 13)),
        "cis": ((164, 9), (181, 9)),
        "idot": ((190, 13), (211, 1)),
        "omega0": ((212, 21), (241, 11)),
        "omega": ((252, 11), (271, 21)),
    },
}
# Figures 5-14: page, first bit and count of each part
D2_PLACES = {
    "af0": ((3, 101, 12), (3, 121, 12)),
    "af1": ((3, 133, 4), (4, 47, 6), (4, 61, 12)),
    "af2": ((4, 73, 10), (4, 91, 1)),
    "delta_n": ((4, 97, 16),),
    "cuc": ((4, 121, 14), (5, 47, 4)),
    "m0": ((5, 51, 2), (5, 61, 22), (5, 91, 8)),
    "cus": ((5, 99, 14), (5, 121, 4)),
    "e": ((5, 125, 10), (6, 47, 6), (6, 61, 16)),
    "sqrt_a": ((6, 77, 6), (6, 91, 22), (6, 121, 4)),
    "cic": ((6, 125, 10), (7, 47, 6), (7, 61, 2)),
    "cis": ((7, 63, 18),),
    "toe_sow_s": ((7, 81, 2), (7, 91, 15)),
    "i0": ((7, 106, 7), (7, 121, 14), (8, 47, 6), (8, 61, 5)),
    "crc": ((8, 66, 17), (8, 91, 1)),
    "crs": ((8, 92, 18),),
    "omega_dot": ((8, 110, 3), (8, 121, 16), (9, 47, 5)),
    "omega0": ((9, 52, 1), (9, 61, 22), (9, 91, 9)),
    "omega": ((9, 100, 13), (9, 121, 14), (10, 47, 5)),
    "idot": ((10, 52, 1), (10, 61, 13)),
}
D2_IONOSPHERE = (
    *(((47, 6), (61, 2)), ((63, 8),), ((71, 8),), ((79, 4), (91, 4))),
    *(((95, 8),), ((103, 8),), ((111, 2), (121, 6)), ((127, 8),)),
)


def begun(number: int, sow: int) -> Bits:
    bits = Bits(300)
    bits.put(0b11100010010, (1, 11))
    bits.put(number, (16, 3))
    bits.put(sow, (19, 8), (31, 12))
    for word in range(1, 10):
        bits.put(0b10101010, (30 * word + 23, 8))  # parity that must not leak into the data
    return bits


def put_all(bits: Bits, places: dict[str, tuple[tuple[int, int], ...]]) -> None:
    for name, parts in places.items():
        bits.put(VALUES[name][0], *parts, scale=VALUES[name][1])


def d1_frame(sow: int = SOW, toc: float = TOE, week: int = BDT_WEEK, health: int = 0) -> list[int]:
    frame = [begun(number, sow + 6 * (number - 1)) for number in (1, 2, 3)]
    for number, bits in enumerate(frame, 1):
        put_all(bits, D1_PLACES[number])
    first, second, third = frame
    first.put(health, (43, 1))
    first.put(2, (49, 4))
    first.put(week, (61, 13))
    first.put(toc, (74, 9), (91, 8), scale=8.0)
    first.put(-57, (99, 10))
    first.put(-123, (109, 4), (121, 6))
    for value, scale, parts in zip((*ALPHA, *BETA), IONOSPHERE_SCALES, D1_IONOSPHERE, strict=True):
        first.put(value, *parts, scale=scale)
    first.put(11, (288, 5))
    toe = format(round(TOE / 8.0), "017b")
    second.put(int(toe[:2], 2), (291, 2))
    third.put(int(toe[2:], 2), (43, 10), (61, 5))
    return [information_bits(bits.words(30)) for bits in frame]


def d2_cycle(sow: int = SOW, week: int = BDT_WEEK) -> list[int]:
    cycle = [begun(1, sow + 3 * k) for k in range(10)]
    for page, bits in enumerate(cycle, 1):
        bits.put(page, (43, 4))
    first = cycle[0]
    first.put(2, (61, 4))
    first.put(week, (65, 13))
    first.put(TOE, (78, 5), (91, 12), scale=8.0)
    first.put(-57, (103, 10))
    first.put(-123, (121, 10))
    for value, scale, parts in zip((*ALPHA, *BETA), IONOSPHERE_SCALES, D2_IONOSPHERE, strict=True):
        cycle[1].put(value, *parts, scale=scale)
    cycle[3].put(11, (92, 5))
    for name, places in D2_PLACES.items():
        value, scale = VALUES[name]
        total = sum(count for _, _, count in places)
        text = format(round(value / scale) % (1 << total), f"0{total}b")
        for page, at, count in places:
            cycle[page - 1].put(int(text[:count], 2), (at, count))
            text = text[count:]
    return [information_bits(bits.words(30)) for bits in cycle]


def collected(
    messages: type[D1Messages] | type[D2Messages], subframes: list[int], near_ns: int | None = NEAR_NS
) -> Broadcast:
    broadcast = Broadcast()
    collector = messages(broadcast)
    for subframe in subframes:
        collector.add("C21", subframe, near_ns)
    return broadcast


def assert_written(navigation: NavigationData | None, message: str) -> None:
    assert navigation is not None
    table = navigation.ephemerides
    assert (table.sv_names, table.message) == (("C21",), (message,))
    for name, (value, _) in VALUES.items():
        assert getattr(table, name)[0] == pytest.approx(value, rel=1e-15), name
    assert table.toe_ns[0] == table.toc_ns[0] == BDT_WEEK * NS_PER_WEEK + round(TOE) * NS_PER_S + TO_GPS_NS
    assert table.group_delay_s[0].tolist() == pytest.approx([-5.7e-9, -12.3e-9], rel=1e-12)
    assert (table.health[0], table.accuracy_m[0], table.issue[0]) == (0.0, 4.0, 11.0)
    assert navigation.ionosphere["beidou"].tolist() == [*ALPHA, *BETA]


def test_d1_subframes_come_back_as_the_message_written() -> None:
    assert_written(collected(D1Messages, d1_frame()).navigation(), "D1")


def test_d2_pages_come_back_as_the_message_written() -> None:
    assert_written(collected(D2Messages, d2_cycle()).navigation(), "D2")


def test_frames_that_repeat_give_one_message_and_a_change_of_health_another() -> None:
    again = [*d1_frame(), *d1_frame(SOW + 30), *d1_frame(SOW + 60, health=1)]

    assert [message.health for message in collected(D1Messages, again).ephemerides] == [0.0, 1.0]
    assert len(collected(D2Messages, [*d2_cycle(), *d2_cycle(SOW + 30)]).ephemerides) == 1


def test_parts_of_different_frames_are_not_joined() -> None:
    one, two = d1_frame(), d1_frame(SOW + 30)
    assert not collected(D1Messages, [one[0], one[1], two[2]]).ephemerides

    first, second = d2_cycle(), d2_cycle(SOW + 30)
    assert not collected(D2Messages, [*first[:5], *second[5:]]).ephemerides


def test_frame_whose_clock_and_orbit_have_different_times_is_refused() -> None:
    broadcast = collected(D1Messages, d1_frame(toc=TOE + 3600.0))

    assert not broadcast.ephemerides and sum(broadcast.refused.values()) == 1


def test_week_alone_dates_a_message_and_one_against_the_receiver_time_is_refused() -> None:
    assert_written(collected(D1Messages, d1_frame(), None).navigation(), "D1")

    wrong = collected(D1Messages, d1_frame(week=BDT_WEEK - 2))
    assert not wrong.ephemerides and sum(wrong.refused.values()) == 1


def test_subframe_without_preamble_or_page_number_is_counted() -> None:
    d1 = collected(D1Messages, [d1_frame()[0] ^ 1 << 223])
    d2 = collected(D2Messages, [d2_cycle()[0] | 0b1111 << (224 - 42)])

    assert sum(d1.refused.values()) == sum(d2.refused.values()) == 1
