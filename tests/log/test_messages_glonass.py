"""GLONASS strings written bit by bit by table 4.5 of the ICD, with the checksums of its section 4.7."""

from __future__ import annotations

import datetime as dt
import math

import pytest

from insgnss.constants import NS_PER_S
from insgnss.gpstime import datetime_to_ns
from insgnss.log.messages.broadcast import Broadcast
from insgnss.log.messages.glonass_strings import GlonassMessages, parity_holds

# Reference time 15:45 Moscow time on 29 June 2023 = 12:45 UTC = 12:45:18 GPS
TB_QUARTERS = 63
T_NS = datetime_to_ns(dt.datetime(2023, 6, 29, 12, 45, 18))
NEAR_NS = T_NS - 240 * NS_PER_S
# Data bits of each checksum, as the ICD lists them
C1 = {9, 10, 12, 13, 15, 17, 19, 20, 22, 24, 26, 28, 30, 32, 34, 35, *range(37, 66, 2), *range(66, 85, 2)}
C2 = {9, 11, 12, 14, 15, 18, 19, 21, 22, 25, 26, 29, 30, 33, 34, 36, 37, 40, 41, 44, 45, 48, 49, 52, 53}
C2 |= {56, 57, 60, 61, 64, 65, 67, 68, 71, 72, 75, 76, 79, 80, 83, 84}
C3 = {*range(10, 13), *range(16, 20), *range(23, 27), *range(31, 35), *range(38, 42), *range(46, 50)}
C3 |= {*range(54, 58), *range(62, 66), *range(69, 73), *range(77, 81), 85}
C4 = {*range(13, 20), *range(27, 35), *range(42, 50), *range(58, 66), *range(73, 81)}
C5 = {*range(20, 35), *range(50, 66), *range(81, 86)}
C6 = {*range(35, 66)}
C7 = {*range(66, 86)}


class String:
    """A string whose bits have the ICD's numbers, 85 sent first."""

    def __init__(self, number: int) -> None:
        self.bits = dict.fromkeys(range(1, 86), 0)
        self.put(number, 84, 81)

    def put(self, value: int, high: int, low: int) -> None:
        assert 0 <= value < 1 << (high - low + 1)
        for k, digit in enumerate(format(value, f"0{high - low + 1}b")):
            self.bits[high - k] = int(digit)

    def put_signed(self, value: float, high: int, low: int, scale: float) -> None:
        self.put(int(value < 0), high, high)
        self.put(round(abs(value) / scale), high - 1, low)

    def value(self) -> int:
        for check, covered in enumerate((C1, C2, C3, C4, C5, C6, C7), 1):
            self.bits[check] = sum(self.bits[k] for k in covered) % 2
        self.bits[8] = sum(bit for k, bit in self.bits.items() if k != 8) % 2
        return int("".join(str(self.bits[k]) for k in range(85, 0, -1)), 2)


# km, km/s, km/s^2 of the three axes, on the grid of the message
R_KM = (-9_876_543 * 2.0**-11, 34_567_890 * 2.0**-11, 12_345_678 * 2.0**-11)
V_KMPS = (-3_123_456 * 2.0**-20, 1_234_567 * 2.0**-20, -98_765 * 2.0**-20)
A_KMPS2 = (3 * 2.0**-30, -2 * 2.0**-30, 0.0)
TAU_S, GAMMA, DELTA_TAU_S = -123_456 * 2.0**-30, 7 * 2.0**-40, -5 * 2.0**-30


def strings(
    slot: int = 7, unhealthy: int = 0, quarters: int = TB_QUARTERS, no_delay: bool = False
) -> list[int]:
    result = []
    for k in range(3):
        string = String(k + 1)
        string.put_signed(V_KMPS[k], 64, 41, 2.0**-20)
        string.put_signed(A_KMPS2[k], 40, 36, 2.0**-30)
        string.put_signed(R_KM[k], 35, 9, 2.0**-11)
        if k == 1:
            string.put(unhealthy << 2, 80, 78)
            string.put(quarters, 76, 70)
        if k == 2:
            string.put_signed(GAMMA, 79, 69, 2.0**-40)
        result.append(string.value())
    fourth = String(4)
    fourth.put_signed(TAU_S, 80, 59, 2.0**-30)
    fourth.put_signed(DELTA_TAU_S, 58, 54, 2.0**-30)
    if no_delay:
        fourth.put(0b10000, 58, 54)
    fourth.put(slot, 15, 11)
    return [*result, fourth.value()]


def collected(messages: list[int], near_ns: int | None = NEAR_NS, frame: int = 3) -> Broadcast:
    broadcast = Broadcast()
    glonass = GlonassMessages(broadcast)
    for string in messages:
        glonass.add("R07", string, frame, near_ns, 5)
    return broadcast


def test_strings_come_back_as_the_state_written() -> None:
    navigation = collected(strings()).navigation()
    assert navigation is not None and navigation.state_vectors is not None
    table = navigation.state_vectors

    assert table.sv_names == ("R07",)
    assert table.t_ns.tolist() == [T_NS]
    assert table.r_e[0].tolist() == [1000.0 * x for x in R_KM]
    assert table.v_e[0].tolist() == [1000.0 * x for x in V_KMPS]
    assert table.a_e[0].tolist() == [1000.0 * x for x in A_KMPS2]
    assert (table.clock_s[0], table.clock_rate[0], table.group_delay_s[0]) == (-TAU_S, GAMMA, DELTA_TAU_S)
    assert (table.health[0], table.channel[0]) == (0.0, 5)
    assert navigation.ephemerides.sv_names == ()


def test_health_flag_and_missing_delay_are_kept() -> None:
    state = next(iter(collected(strings(unhealthy=1, no_delay=True)).states))

    assert state.health == 1.0 and math.isnan(state.group_delay_s)


@pytest.mark.parametrize("seconds", [-39_600, 39_600])
def test_day_is_the_one_in_which_the_reference_time_is_near(seconds: int) -> None:
    # the receiver time is on another Moscow day for one of the two
    near_ns = T_NS + seconds * NS_PER_S

    assert next(iter(collected(strings(), near_ns).states)).t_ns == T_NS


def test_every_single_wrong_bit_is_found() -> None:
    sent = strings()[0]

    assert parity_holds(sent)
    assert not any(parity_holds(sent ^ 1 << k) for k in range(85))
    assert not any(parity_holds(sent ^ 1 << k ^ 1 << (k + 7) % 85) for k in range(85))


def test_strings_of_different_frames_or_out_of_order_are_not_joined() -> None:
    one = strings()
    broadcast = Broadcast()
    glonass = GlonassMessages(broadcast)
    for string, frame in zip(one, (1, 1, 2, 2), strict=True):
        glonass.add("R07", string, frame, NEAR_NS, 5)
    glonass.add("R07", one[0], 0, NEAR_NS, 5)
    for string in one[1:]:
        glonass.add("R07", string, 0, NEAR_NS + 60 * NS_PER_S, 5)

    assert not broadcast.states
    assert not collected([one[0], one[2], one[1], one[3]]).states


@pytest.mark.parametrize(
    ("sent", "near_ns"),
    [(strings(slot=8), NEAR_NS), (strings(quarters=0), NEAR_NS), ([strings()[0] ^ 1 << 20], NEAR_NS)],
)
def test_what_cannot_be_used_is_counted(sent: list[int], near_ns: int) -> None:
    broadcast = collected(sent, near_ns)

    assert not broadcast.states and sum(broadcast.refused.values()) == 1
    assert sum(collected(strings(), None).refused.values()) == 4
