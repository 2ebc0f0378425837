"""A fix at another place is ruled out: many pseudoranges placed the filter, and its way since then was measured."""

from __future__ import annotations

import pytest

from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.recovery import is_ruled_out
from insgnss.filter.loop import note_place
from insgnss.filter.state import DV, Bank, new_bank
from insgnss.filter.update.judging import UpdateOutcome

T_NS = 1_000 * NS_PER_S


def outcome(ranges: tuple[int, int], rates: tuple[int, int]) -> UpdateOutcome:
    return UpdateOutcome(0.0, *ranges, *rates, 0.0, 0.0, 1.0, 0.0)


@pytest.mark.parametrize(
    ("ranges", "rates", "after_s", "placed"),
    [
        ((9, 0), (9, 0), 1.0, "now"),
        ((9, 1), (9, 0), 1.0, "now"),
        ((8, 1), (9, 0), 1.0, "before"),
        ((6, 0), (6, 0), 1.0, "before"),
        ((0, 9), (4, 0), 1.0, "before"),
        ((0, 9), (3, 0), 1.0, "never"),
        ((0, 9), (4, 5), 1.0, "never"),
        ((3, 4), (9, 0), 4.0, "never"),
        ((9, 0), (9, 0), 100.0, "now"),
    ],
)
def test_pseudoranges_place_the_filter_as_long_as_range_rates_measure_its_way(
    ranges: tuple[int, int], rates: tuple[int, int], after_s: float, placed: str
) -> None:
    """Rows used and refused; an epoch ``after_s`` the one that placed the filter."""
    head = new_bank(1, 0).head[0]
    head.epoch_ns, head.placed_ns = T_NS, T_NS
    t_ns = T_NS + round(after_s * NS_PER_S)
    note_place(head, outcome(ranges, rates), t_ns)
    assert head.placed_ns == {"now": t_ns, "before": T_NS, "never": 0}[placed]


def at(r_m: float, v_mps: float, sigma_mps: float, placed_s: float | None) -> Bank:
    bank = new_bank(1, 0)
    bank.state[0].r_e[0], bank.state[0].v_e[1] = r_m, v_mps
    bank.P[0, range(DV, DV + 3), range(DV, DV + 3)] = sigma_mps**2 / 3.0
    bank.head["now_ns"] = T_NS
    bank.head["placed_ns"] = 0 if placed_s is None else T_NS - round(placed_s * NS_PER_S)
    return bank


@pytest.mark.parametrize(
    ("apart_m", "apart_mps", "sigma_mps", "placed_s", "ruled_out"),
    [
        (113.0, 0.02, 0.03, 30.0, True),
        (113.0, 0.02, 0.03, None, False),  # nothing has placed it
        (113.0, 0.02, 0.03, 1000.0, False),  # 4 sqrt(2) 0.03 m/s for so long: 190 m
        (113.0, 4.0, 0.03, 30.0, False),  # the velocities differ by 120 m in that time
        (19.0, 0.0, 0.0, 30.0, False),  # a place is as wrong as pseudoranges are
        (21.0, 0.0, 0.0, 30.0, True),
    ],
)
def test_place_is_ruled_out_that_no_measured_way_leads_to(
    apart_m: float, apart_mps: float, sigma_mps: float, placed_s: float | None, ruled_out: bool
) -> None:
    here, there = at(0.0, 10.0, sigma_mps, placed_s), at(apart_m, 10.0 + apart_mps, sigma_mps, None)
    assert is_ruled_out(here, 0, there, 0) == ruled_out
