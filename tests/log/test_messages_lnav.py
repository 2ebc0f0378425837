"""LNAV subframes against an independent encoder, and what may not be joined into a message."""

from __future__ import annotations

import math

import pytest
import sidereon

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.log.messages.broadcast import Broadcast
from insgnss.log.messages.gps_lnav import LnavMessages, data_bits, ura_m
from tests.log.ubx_writing import Bits

WEEK = 2381
TOW = 68_200  # in units of 6 s
SENT_NS = WEEK * NS_PER_WEEK + TOW * 6 * NS_PER_S
PARAMS = {
    "week_number": WEEK % 1024,
    "l2_code": 1,
    "l2_p_data_flag": 0,
    "ura_index": 2,
    "sv_health": 0,
    "iodc": 0x261,
    "tgd": -5 * 2.0**-31,
    "toc": 410_400,
    "af0": -123_456 * 2.0**-31,
    "af1": -99 * 2.0**-43,
    "af2": 3 * 2.0**-55,
    "iode": 0x61,
    "crs": -447 * 2.0**-5,
    "delta_n": 10_599 * 2.0**-43 * math.pi,
    "m0": -1_545_367_123 * 2.0**-31 * math.pi,
    "cuc": -499 * 2.0**-29,
    "eccentricity": 89_491_234 * 2.0**-33,
    "cus": 4732 * 2.0**-29,
    "sqrt_a": 2_701_938_765 * 2.0**-19,
    "toe": 410_400,
    "fit_interval_flag": 0,
    "aodo": 27,
    "cic": 86 * 2.0**-29,
    "omega0": 830_750_123 * 2.0**-31 * math.pi,
    "cis": -28 * 2.0**-29,
    "i0": 676_956_789 * 2.0**-31 * math.pi,
    "crc": 7136 * 2.0**-5,
    "omega": -1_585_623_456 * 2.0**-31 * math.pi,
    "omega_dot": -21_028 * 2.0**-43 * math.pi,
    "idot": 1382 * 2.0**-43 * math.pi,
}
ANGLES = ("delta_n", "m0", "omega0", "i0", "omega", "omega_dot", "idot")
NAMES = {"e": "eccentricity", "toe_sow_s": "toe"}


def words_of(bits: list[int]) -> list[int]:
    """Return ten words of 30 bits as a u-blox receiver writes them: right-aligned, data bits not inverted."""
    words = []
    last = (0, 0)
    for k in range(0, 300, 30):
        word = bits[k : k + 30]
        data = [bit ^ last[1] for bit in word[:24]]
        words.append(int("".join(map(str, data + word[24:])), 2))
        last = (word[28], word[29])
    return words


def subframes(**changes: float) -> list[int]:
    """Return the 240 data bits of subframes 1 to 3."""
    params = PARAMS | changes
    frames = sidereon.lnav_encode(_in_semicircles(params), tow=TOW)
    return [data_bits(words_of(list(bits))) for bits in frames]


def _in_semicircles(params: dict[str, float]) -> dict[str, float]:
    """Return the parameters with angles in the encoder's unit."""
    return {key: value / math.pi if key in ANGLES else value for key, value in params.items()}


def collected(messages: list[tuple[str, int]], near_ns: int | None = SENT_NS) -> Broadcast:
    broadcast = Broadcast()
    lnav = LnavMessages(broadcast)
    for sv, subframe in messages:
        lnav.add(sv, subframe, near_ns)
    return broadcast


def test_published_parameters_come_back_from_subframes_of_another_encoder() -> None:
    navigation = collected([("G10", s) for s in subframes()]).navigation()
    assert navigation is not None
    table = navigation.ephemerides

    assert table.sv_names == ("G10",) and table.message == ("LNAV",)
    for name in ("af0", "af1", "af2", "sqrt_a", "e", "toe_sow_s", "cuc", "cus", "crc", "crs", "cic", "cis"):
        assert getattr(table, name)[0] == PARAMS[NAMES.get(name, name)]
    for name in ANGLES:  # pi is rounded once more
        assert getattr(table, name)[0] == pytest.approx(PARAMS[name], rel=1e-15)
    assert table.toe_ns[0] == table.toc_ns[0] == WEEK * NS_PER_WEEK + 410_400 * NS_PER_S
    assert table.group_delay_s[0].tolist() == [PARAMS["tgd"], 0.0]
    assert (table.health[0], table.accuracy_m[0], table.issue[0]) == (0.0, 4.0, 0x61)
    assert table.fit_interval_s[0] == 14_400.0


@pytest.mark.parametrize(
    ("system", "flag", "iodc", "hours"),
    [
        ("G", 0, 5, 4),
        ("G", 1, 5, 6),
        ("G", 1, 245, 8),
        ("G", 1, 250, 14),
        ("G", 1, 500, 26),
        ("J", 0, 5, 2),
    ],
)
def test_fit_interval_follows_from_flag_and_issue(system: str, flag: int, iodc: int, hours: float) -> None:
    sent = subframes(fit_interval_flag=flag, iodc=iodc, iode=iodc % 256)
    navigation = collected([(f"{system}03", s) for s in sent]).navigation()

    assert navigation is not None and navigation.ephemerides.fit_interval_s[0] == hours * 3600.0


def test_week_of_ten_bits_is_completed_from_the_receiver_time_across_the_rollover() -> None:
    # GPS week 2048 is sent as 0; toe lies in it, the message was sent at the end of week 2047
    sent_ns = 2048 * NS_PER_WEEK - 1800 * NS_PER_S
    frames = sidereon.lnav_encode(
        _in_semicircles(PARAMS | {"week_number": 1023, "toe": 3600, "toc": 3600}), tow=100_800 - 300
    )
    messages = [("G10", data_bits(words_of(list(bits)))) for bits in frames]
    navigation = collected(messages, sent_ns).navigation()

    assert navigation is not None
    assert navigation.ephemerides.toe_ns[0] == 2048 * NS_PER_WEEK + 3600 * NS_PER_S


def test_repeated_subframes_give_one_message_and_a_change_of_health_another() -> None:
    same, ill = subframes(), subframes(sv_health=63)
    broadcast = collected([("G10", s) for s in [*same, *same, *ill, *ill]])

    assert [message.health for message in broadcast.ephemerides] == [0.0, 63.0]


def test_subframes_of_different_issues_are_not_joined() -> None:
    old, new = subframes(), subframes(iode=0x62, iodc=0x262, toe=417_600, toc=417_600)
    assert not collected([("G10", old[0]), ("G10", new[1]), ("G10", old[2])]).ephemerides

    assert not collected([("G10", old[0]), ("G10", new[1]), ("G10", new[2])]).ephemerides

    # nor are those of different satellites
    assert not collected([("G10", old[0]), ("G11", old[1]), ("G10", old[2])]).ephemerides

    whole = collected([("G10", s) for s in (*old, new[2], new[0], new[1])])
    assert [message.issue for message in whole.ephemerides] == [0x61, 0x62]


@pytest.mark.parametrize(
    ("near_ns", "reason"),
    [(None, "without a receiver time"), (SENT_NS + 5 * NS_PER_WEEK, "contradicts the receiver time")],
)
def test_message_is_refused_with_a_reason_when_its_week_cannot_be_told(
    near_ns: int | None, reason: str
) -> None:
    broadcast = collected([("G10", s) for s in subframes()], near_ns)

    assert not broadcast.ephemerides
    assert reason in next(iter(broadcast.refused))


def test_damaged_preamble_is_counted() -> None:
    broken = subframes()[0] ^ 1 << 239

    assert sum(collected([("G10", broken)]).refused.values()) == 1


def test_page_18_gives_klobuchar_coefficients_and_leap_seconds_of_its_system() -> None:
    alpha = (0.1118e-07, -0.7451e-08, -0.5961e-07, 0.1192e-06)
    beta = (116_736.0, -98_304.0, -131_072.0, 983_040.0)
    page = Bits(240)
    page.put(0x8B, (1, 8))
    page.put(4, (44, 3))
    page.put(1, (49, 2))  # data identifier
    page.put(56, (51, 6))
    for k, (value, scale) in enumerate(zip(alpha, (2.0**-30, 2.0**-27, 2.0**-24, 2.0**-24), strict=True)):
        page.put(value, (57 + 8 * k, 8), scale=scale)
    for k, (value, scale) in enumerate(zip(beta, (2.0**11, 2.0**14, 2.0**16, 2.0**16), strict=True)):
        page.put(value, (89 + 8 * k, 8), scale=scale)
    page.put(18, (193, 8))
    broadcast = collected([("G10", page.value()), ("J02", page.value())])
    navigation = broadcast.navigation()

    assert navigation is not None and navigation.klobuchar is not None
    # the published numbers are rounded to four digits
    assert navigation.klobuchar.tolist() == pytest.approx([*alpha, *beta], rel=1e-3)
    assert navigation.ionosphere["qzss"].tolist() == navigation.klobuchar.tolist()
    assert navigation.leap_seconds == 18
    assert navigation.ephemerides.sv_names == ()


def test_accuracy_index_means_metres_of_the_interface_document() -> None:
    assert [ura_m(k) for k in range(8)] == [2.0, 2.8, 4.0, 5.7, 8.0, 11.3, 16.0, 32.0]
    assert math.isnan(ura_m(15))
