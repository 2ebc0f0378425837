"""Codes: the published first chips of the interface documents, a second way of making them, and their correlation."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.errors import ConfigError
from insgnss.tracking.codes import (
    RangingCode,
    autocorrelation,
    code_names,
    code_of,
    correlation,
    glonass_st,
    gps_ca,
    lfsr,
    triangle,
)

# First 10 chips, one binary digit and three octal ones: IS-GPS-200N, table 3-Ia (PRN 1 to 37)
FIRST_CHIPS_TABLE_3_IA = (
    "1440 1620 1710 1744 1133 1455 1131 1454 1626 1504 1642 1750 1764 1772 1775 1776 1156 1467 1633 1715 1746 1763 "
    "1063 1706 1743 1761 1770 1774 1127 1453 1625 1712 1745 1713 1134 1456 1713"
).split()
# The same of PRN 96 to 125: IS-GPS-200H, table 6-I, sheet 2
FIRST_CHIPS_TABLE_6_I = (
    "1517 0322 0242 1031 0744 0564 1067 1056 0014 0026 1342 1042 1006 1637 1666 1121 0761 1315 0766 1225 1732 0673 "
    "1220 1413 0671 0536 1510 1545 0160 0701"
).split()
# Stages of G2 whose sum is the delayed G2: IS-GPS-200N, table 3-Ia
PHASE_SELECT = (
    "2+6 3+7 4+8 5+9 1+9 2+10 1+8 2+9 3+10 2+3 3+4 5+6 6+7 7+8 8+9 9+10 1+4 2+5 3+6 4+7 5+8 6+9 1+3 4+6 5+7 6+8 7+9 "
    "8+10 1+6 2+7 3+8 4+9 5+10 4+10 1+7 2+8 4+10"
).split()
# GLONASS ICD 5.1, 3.3.2.1: the first 40 chips from an all-ones register, worked out independently
GLONASS_FIRST_40 = "1111111000001111011111000101110011001000"
THESIS_REGISTER = "111111100"  # the ICD's "first group" taken for the register's state
THESIS_FIRST_20 = "11111111100000111101"


def bits_of(chips: np.ndarray) -> str:
    return "".join(str(int(b)) for b in (1 - chips) // 2)


def octal(chips: np.ndarray) -> str:
    bits = bits_of(chips[:10])
    return bits[0] + "".join(str(int(bits[k : k + 3], 2)) for k in (1, 4, 7))


def test_glonass_code_begins_as_published() -> None:
    assert bits_of(glonass_st().chips[:40]) == GLONASS_FIRST_40


def test_glonass_code_from_the_first_group_as_register_state_is_the_same_two_chips_late() -> None:
    slipped = lfsr((5, 9), THESIS_REGISTER, 511, 7)
    assert "".join(map(str, slipped[:20])) == THESIS_FIRST_20
    assert np.array_equal(np.roll((1 - glonass_st().chips) // 2, 2), slipped)


def test_glonass_chip_changes_after_seven_chips_as_in_the_figure_of_the_thesis() -> None:
    # Fig. 14: a change at 13.7 us; seven chips of 1 / 511 kHz are 13.70 us, the program's nine would be 17.6 us
    chips = glonass_st().chips
    first_change = int(np.flatnonzero(np.diff(chips))[0]) + 1
    assert first_change / glonass_st().rate_hz == pytest.approx(13.70e-6, abs=0.01e-6)


def test_glonass_code_is_a_maximum_length_sequence() -> None:
    code = glonass_st()
    assert np.sum(code.chips == -1) == 256 and np.sum(code.chips == 1) == 255
    found = np.rint(autocorrelation(code) * 511)
    assert found[0] == 511 and np.all(found[1:] == -1)
    # not by the transform: summed
    assert [int(np.dot(code.chips.astype(int), np.roll(code.chips, m))) for m in (1, 2, 100)] == [-1, -1, -1]


def test_ca_codes_begin_as_published() -> None:
    assert [octal(gps_ca(prn).chips) for prn in range(1, 38)] == FIRST_CHIPS_TABLE_3_IA
    assert [octal(gps_ca(prn).chips) for prn in range(96, 126)] == FIRST_CHIPS_TABLE_6_I
    assert bits_of(gps_ca(64).chips[:10]) == "1101010011"  # IS-GPS-200H, note to table 6-I


@pytest.mark.parametrize("prn", range(1, 38))
def test_ca_code_by_delay_equals_the_code_by_two_taps(prn: int) -> None:
    g1 = lfsr((3, 10), "1" * 10, 1023, 10)
    first, second = (
        lfsr((2, 3, 6, 8, 9, 10), "1" * 10, 1023, int(stage)) for stage in PHASE_SELECT[prn - 1].split("+")
    )
    assert np.array_equal((1 - gps_ca(prn).chips) // 2, g1 ^ first ^ second)


def test_all_ca_codes_are_balanced_gold_codes_and_no_two_are_equal() -> None:
    # PRN 34 and 37 share one code by definition (table 3-Ia), all others differ
    codes = [gps_ca(prn).chips.tobytes() for prn in range(1, 211)]
    assert len(set(codes)) == 209 and codes[33] == codes[36]
    for prn in range(1, 211):
        sides = np.rint(autocorrelation(gps_ca(prn))[1:] * 1023)
        assert set(sides) == {-65.0, -1.0, 63.0}  # three-valued, as Gold codes of length 2^10 - 1 are


def sampled(code: RangingCode, t_s: np.ndarray, delay_s: float = 0.0) -> np.ndarray:
    """Return the code's chip at each time, as +1 or -1, for a signal that is late by a delay.

    Equation: h(t) = chip[floor((t - delay) rate) mod length]                                              [(3.2)]
    """
    phase = (t_s - delay_s) * code.rate_hz
    return np.asarray(code.chips[np.floor(phase).astype(np.int64) % code.length])


def test_sampled_code_changes_at_the_chip_edges_and_is_late_by_its_delay() -> None:
    code = glonass_st()
    t = (np.arange(511) + 0.5) / code.rate_hz
    assert np.array_equal(sampled(code, t), code.chips)
    assert np.array_equal(sampled(code, t, 3.0 / code.rate_hz), np.roll(code.chips, 3))
    assert np.array_equal(sampled(code, t + code.period_s), code.chips)


def test_correlation_between_chips_equals_that_of_a_finely_sampled_code() -> None:
    code = gps_ca(3)
    t = (np.arange(1023 * 50) + 0.5) / (50 * code.rate_hz)
    reference = sampled(code, t).astype(float)
    for offset in (0.0, 0.3, -0.74, 1.5, 200.26):
        shifted = sampled(code, t, offset / code.rate_hz)
        # offsets in 1/50 chips: exact but for the rounding of the sample times
        assert float(correlation(code, offset)) == pytest.approx(np.mean(reference * shifted), abs=1e-3)


def test_triangle_is_the_correlation_of_a_long_random_code() -> None:
    x = np.linspace(-2.0, 2.0, 81)
    # the code's own side values: -1/511
    assert np.max(np.abs(triangle(x) - correlation(glonass_st(), x))) <= 1.0 / 511 + 1e-12


@pytest.mark.parametrize(
    ("name", "advice"), [("glonass-sd", "glonass-st"), ("gps-ca-211", "gps-ca-21"), ("GPS-CA-7", "gps-ca-7")]
)
def test_unknown_code_is_refused_with_the_nearest_name(name: str, advice: str) -> None:
    with pytest.raises(ConfigError, match=f"nearest: '{advice}"):
        code_of(name)


def test_every_listed_code_has_its_period() -> None:
    for name in code_names()[::20]:
        assert code_of(name).name == name and code_of(name).period_s == pytest.approx(1e-3)


@pytest.mark.parametrize("start", ["000000000", "", "11112"])
def test_register_that_never_changes_or_is_none_is_refused(start: str) -> None:
    with pytest.raises(ConfigError, match=r"invalid start .* of a shift register"):
        lfsr((5, 9), start, 10, 7)


def test_register_without_the_tapped_stage_is_refused() -> None:
    with pytest.raises(ConfigError, match="from 1 to 9"):
        lfsr((5, 10), "1" * 9, 10, 7)
    with pytest.raises(ConfigError, match="1 to 210"):
        gps_ca(0)
