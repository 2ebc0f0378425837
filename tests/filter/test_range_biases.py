"""The lasting errors of satellites' ranges as states: which satellite has which, and what a row says of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from insgnss.config.library import filter_config, imu_grade, oscillator
from insgnss.constants import NS_PER_S
from insgnss.errors import ConfigError
from insgnss.filter.layout import GaussMarkov, Layout, StateBlock
from insgnss.filter.setup import FilterSetup
from insgnss.filter.state import MAX_RANGE_BIASES, OFFSETS, Bank, new_bank
from insgnss.filter.states.ionosphere import IONOSPHERE
from insgnss.filter.states.range_biases import RANGE_BIASES
from insgnss.filter.states.zenith_delay import ZENITH_DELAY
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.prior_rows import predict_measurements
from insgnss.filter.update.range_biases import place_range_biases
from insgnss.filter.whole_log import run_blocks
from insgnss.gnss.observation_rows import N_BANDS, PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.tables import ImuTable
from tests.filter.scene import START_NS, new_filter, parameters, perfect_rows, place, sky

K = 5  # states in these tests
HOUR_S = 3600.0


def numbers(k: int = K) -> npt.NDArray[Any]:
    return parameters(at_range_biases=OFFSETS, n_slow=k, n_optional=k)


def empty(k: int = K, members: int = 1) -> Bank:
    bank = new_bank(members, k)
    rng = np.random.default_rng(4)
    for P in bank.P:
        root = rng.normal(size=P.shape)
        P[:] = root @ root.T
    bank.state["optional"][:, :k] = rng.normal(size=(members, k))
    return bank


def epochs(*satellites: tuple[int, ...]) -> GnssRows:
    """Return a log whose epochs, a second apart, have these satellites."""
    at = place()
    most = max(len(each) for each in satellites)
    times = START_NS + np.arange(len(satellites)) * NS_PER_S
    log = perfect_rows(new_filter(at), parameters(), times, sky(at)[:most], w_ib_b=np.zeros(3))
    assert all(len(each) == most for each in satellites)
    log.observation["slot"] = np.array(satellites).ravel() * N_BANDS + 1
    log.observation["bias_sigma"] = 0.5
    return log


def places(bank: Bank, log: GnssRows, epoch: int) -> list[int]:
    """Return the state of each row of an epoch, -1 for none."""
    lines = new_epoch(12, OFFSETS + K).lines
    lines["bias"] = 99
    place_range_biases(bank, numbers()[0], log, epoch, lines)
    return [int(n) - 1 for n in lines["bias"][: log.first[epoch + 1] - log.first[epoch]]]


def test_satellite_keeps_its_state_and_a_new_one_takes_that_of_the_one_longest_unseen() -> None:
    log, bank = epochs((3, 7, 9, 7), (9, 3, 11, 12), (12, 20, 9, 11), (3, 9, 7, 12)), empty(members=2)
    assert places(bank, log, 0) == [0, 1, 2, 1]
    assert places(bank, log, 1) == [2, 0, 3, 4]
    before = bank.P.copy()
    assert places(bank, log, 2) == [4, 1, 2, 3]  # 20 takes the state of 7, which was in the first epoch alone
    at = OFFSETS + 1
    for member in range(2):
        assert bank.state[member].optional[1] == 0.0
        assert bank.P[member, at, at] == 1.0
        assert not np.delete(bank.P[member, at], at).any()
        rest = np.delete(np.arange(OFFSETS + K), at)
        np.testing.assert_array_equal(bank.P[member][np.ix_(rest, rest)], before[member][np.ix_(rest, rest)])
    assert places(bank, log, 3) == [0, 2, 1, 4]  # 3 still has its own; 7 takes that of 20


def test_free_state_is_taken_before_one_in_use() -> None:
    log, bank = epochs((1, 2, 3), (4, 5, 6)), empty()
    places(bank, log, 0)
    P = bank.P[0].copy()
    assert sorted(places(bank, log, 1)[:2]) == [3, 4]
    np.testing.assert_array_equal(
        bank.P[0, OFFSETS + 3], P[OFFSETS + 3] * (np.arange(OFFSETS + K) != OFFSETS)
    )


def test_rows_beyond_the_states_get_none_and_take_none() -> None:
    log = epochs((1, 2, 3, 4, 5, 6, 7), (7, 6, 5, 4, 3, 2, 1))
    bank = empty()
    assert places(bank, log, 0) == [0, 1, 2, 3, 4, -1, -1]
    assert places(bank, log, 1) == [-1, -1, 4, 3, 2, 1, 0]


def test_satellites_without_a_lasting_error_need_no_state() -> None:
    log, bank = epochs((1, 2, 3)), empty()
    log.observation["bias_sigma"][1] = 0.0
    assert places(bank, log, 0) == [0, -1, 1]


def test_pseudorange_grows_by_the_bias_in_sigmas_and_no_other_kind_does() -> None:
    log, bank, at = epochs((1, 2, 3)), empty(), place()
    log.observation["bias_sigma"] = [0.5, 0.3, 2.0]
    small = new_filter(at)
    bank.state[0], bank.head[0] = small.state[0], small.head[0]
    rows = []
    for value in (0.0, 1.5):
        work = new_epoch(3, OFFSETS + K)
        bank.state[0].optional[:K] = value
        place_range_biases(bank, numbers()[0], log, 0, work.lines)
        predict_measurements(bank.state[0], bank.P[0], numbers()[0], log, 0, np.zeros(3), np.zeros(3), work)
        rows.append(work.lines.copy())
    none, some = rows
    np.testing.assert_allclose(
        (none["innovation"] - some["innovation"])[:, PSEUDORANGE],
        1.5 * log.observation["bias_sigma"],
        atol=1e-6,
    )
    np.testing.assert_array_equal(none["innovation"][:, RANGE_RATE], some["innovation"][:, RANGE_RATE])
    for j, line in enumerate(some):
        count = line["count"][PSEUDORANGE]
        entries = dict(zip(line["columns"][PSEUDORANGE, :count], line["h"][PSEUDORANGE, :count], strict=True))
        assert entries[OFFSETS + j] == pytest.approx(log.observation["bias_sigma"][j])
        assert not {OFFSETS + i for i in range(K) if i != j} & set(entries)


def setup(**settings: Any) -> FilterSetup:
    config = filter_config("tight", {"process.range_bias_states": True, **settings})
    return FilterSetup(config, imu_grade("tactical"), oscillator("tcxo"))


def test_blocks_have_the_sizes_of_the_settings() -> None:
    made = setup(**{"slow_errors.no_ionosphere_zenith_m": 2.0, "slow_errors.air_time_s": 600.0})
    blocks = {block.name: block for block in made.layout.blocks}
    assert blocks[IONOSPHERE].sigma == 2.0
    assert blocks[IONOSPHERE].process == GaussMarkov(2.0, 600.0)
    assert blocks[ZENITH_DELAY].process == GaussMarkov(0.05, 600.0)
    assert blocks[RANGE_BIASES].process == GaussMarkov(1.0, 3600.0)
    assert not blocks[RANGE_BIASES].shown
    assert made.slow_sizes.satellite["G"] == 0.5


def test_constellation_that_the_settings_do_not_name_has_the_largest_error() -> None:
    made = setup()
    slow = made.config.slow_errors.model_copy(update={"satellite_m": {"G": 0.4, "E": 0.9}})
    made = replace(made, config=made.config.model_copy(update={"slow_errors": slow}))
    sizes = made.slow_sizes.satellite
    assert (sizes["G"], sizes["E"], sizes["R"], sizes["C"]) == (0.4, 0.9, 0.9, 0.9)


def test_base_station_leaves_its_share_of_each() -> None:
    made = replace(setup(), with_base=True)
    blocks = {block.name: block for block in made.layout.blocks}
    assert blocks[IONOSPHERE].sigma == pytest.approx(0.5)  # of the 5 m without a model's coefficients
    assert blocks[ZENITH_DELAY].sigma == pytest.approx(0.005)
    assert made.slow_sizes.satellite["E"] == pytest.approx(0.03)


def test_no_ionosphere_is_estimated_where_none_is_left() -> None:
    for off in ({"measurements.ionosphere": "ionosphere_free"}, {"slow_errors.no_ionosphere_zenith_m": 0.0}):
        assert IONOSPHERE not in setup(**off).layout.names


def test_there_are_at_most_as_many_as_there_is_room_for() -> None:
    made = replace(setup(), n_satellites=10 * MAX_RANGE_BIASES)
    assert next(b for b in made.layout.blocks if b.name == RANGE_BIASES).size == MAX_RANGE_BIASES


def test_smoother_needs_a_state_for_every_satellite() -> None:
    made = replace(setup(), n_satellites=MAX_RANGE_BIASES + 1)
    nothing = ImuTable(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)))
    with pytest.raises(ConfigError, match=f"{MAX_RANGE_BIASES + 1} satellites"):
        run_blocks(made, nothing, [], "gnss", smooth=True)


def test_without_the_setting_nothing_is_a_state() -> None:
    made = FilterSetup(filter_config("tight"), imu_grade("tactical"), oscillator("tcxo"))
    assert RANGE_BIASES not in made.layout.names
    assert made.parameters()[0].at_range_biases < 0


def test_layout_places_them_last() -> None:
    block = StateBlock(RANGE_BIASES, ("range_bias_0",), "sigma", 1.0, shown=False)
    assert Layout((block,)).at(RANGE_BIASES) == OFFSETS
