"""Which carrier differences a log offers, and which of them a cycle slip spoils."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insgnss.constants import C_MPS
from insgnss.gnss.carrier_rows import ABSENT, carrier_rows
from insgnss.gnss.observation_rows import (
    CARRIER,
    N_KINDS,
    GnssRows,
    from_epoch,
    joined_epochs,
    prepare_rows,
    some_epochs,
)
from insgnss.gnss.signals import L1_HZ, L5_HZ
from insgnss.status import (
    BAD_VALUE,
    CONSTELLATION_NOT_USED,
    HALF_CYCLE,
    NO_EPOCH_BEFORE,
    NO_RANGE,
    SLIP_DOPPLER,
    SLIP_GEOMETRY_FREE,
    SLIP_INDICATED,
    SWITCHED_OFF,
    USED,
)
from insgnss.tables import Float64, GnssTable

EPOCHS, SATELLITES = 6, 5
T0_NS, STEP_NS = 1_300_000_000_000_000_000, 500_000_000
L1_M, L5_M = C_MPS / L1_HZ, C_MPS / L5_HZ


def log(seed: int = 3, step_ns: int = STEP_NS) -> GnssTable:
    """Return six epochs of five satellites on L1 and L5; range rates of their own, a clock of 80 m/s."""
    rng = np.random.default_rng(seed)
    rate = np.repeat(rng.uniform(-700.0, 700.0, SATELLITES) + 80.0, 2)
    t = np.arange(EPOCHS)[:, None] * step_ns * 1e-9
    distance = 2.2e7 + rate * t + 0.5 * 3.0 * t**2
    wavelength = np.tile([L1_M, L5_M], SATELLITES)
    n = EPOCHS * 2 * SATELLITES
    return GnssTable(
        t_ns=np.repeat(T0_NS + np.arange(EPOCHS) * step_ns, 2 * SATELLITES).astype(np.int64),
        sv=np.tile(np.repeat(np.arange(SATELLITES), 2), EPOCHS).astype(np.int16),
        signal=np.tile([0, 1], EPOCHS * SATELLITES).astype(np.int16),
        pseudorange_m=distance.ravel(),
        doppler_hz=np.full(n, np.nan),
        range_rate_mps=(rate + 3.0 * t + np.zeros((EPOCHS, 1))).ravel(),
        cn0_dbhz=np.full(n, 45.0),
        sv_names=("G01", "G02", "G03", "G04", "E05"),
        signal_names=("C1C", "C5Q"),
        sat=np.tile([2.2e7, 0.0, 1.0e7, 0.0, 3e3, 0.0, 50.0, 0.0], (n, 1)),
        carrier_cycles=(distance / wavelength + rng.integers(-1000, 1000, 2 * SATELLITES)).ravel(),
        lli=np.zeros(n, np.int8),
    )


def rows_of(table: GnssTable, carrier: bool | None = True, **changes: object) -> GnssRows:
    """Return the rows with both bands of GPS and Galileo in use."""
    codes = ("C1C", "C5Q")
    return prepare_rows(
        table, None, None, clock_groups=("G", "E"), signals={"G": codes, "E": codes}, every_band=True,
        carrier=carrier, **changes,
    )  # fmt: skip


def place(epoch: int, satellite: int, band: int) -> int:
    """Return the row of a signal."""
    return (epoch * SATELLITES + satellite) * 2 + band


def moved(table: GnssTable, row: int, cycles: float) -> GnssTable:
    """Return the log with the carrier of a signal shifted from a row on: a cycle slip."""
    carrier = np.array(table.carrier_cycles)
    later = np.arange(row, len(carrier), 2 * SATELLITES)
    carrier[later] += cycles
    return replace(table, carrier_cycles=carrier)


def status_of(table: GnssTable, **changes: object) -> Float64:
    """Return the statuses of the carrier differences, (epochs, satellites, bands)."""
    return rows_of(table, **changes).carrier["status"].reshape(EPOCHS, SATELLITES, 2)


def test_difference_is_the_way_of_the_range_between_two_epochs() -> None:
    table = log()
    rows = rows_of(table)
    way = np.diff(table.pseudorange_m.reshape(EPOCHS, -1), axis=0)
    value = rows.carrier["value"].reshape(EPOCHS, -1)

    assert np.all(rows.carrier["status"].reshape(EPOCHS, -1)[0] == NO_EPOCH_BEFORE)
    assert np.all(rows.carrier["status"].reshape(EPOCHS, -1)[1:] == USED)
    # 1e8 cycles are rounded to 1.5e-8 of a cycle
    assert np.max(np.abs(value[1:] - way)) < 1e-7
    assert rows.before_ns.tolist() == [0, *rows.epoch_ns[:-1].tolist()]
    assert np.all(rows.before[10:] == rows.sat[:-10, :8])


def test_receivers_own_flag_spoils_the_difference_that_ends_at_it() -> None:
    table = log()
    lli = np.array(table.lli)
    lli[place(3, 1, 0)] = 1
    status = status_of(replace(table, lli=lli))

    assert status[3, 1, 0] == SLIP_INDICATED
    assert np.count_nonzero(status[1:] != USED) == 1


def test_half_cycle_flag_spoils_only_the_differences_across_its_change() -> None:
    table = log()
    lli = np.array(table.lli)
    for epoch in (2, 3):
        lli[place(epoch, 0, 1)] = 2
    status = status_of(replace(table, lli=lli))

    assert status[2, 0, 1] == HALF_CYCLE and status[4, 0, 1] == HALF_CYCLE
    assert status[3, 0, 1] == USED


def test_slip_of_many_cycles_disagrees_with_the_doppler() -> None:
    status = status_of(moved(log(), place(2, 3, 0), 40.0))

    assert status[2, 3, 0] == SLIP_DOPPLER
    assert np.all(status[3:] == USED)


@pytest.mark.parametrize(
    ("interval_s", "cycles", "found"), [(0.2, 2.0, True), (0.1, 1.0, True), (1.0, 8.0, False)]
)
def test_slip_stands_out_from_the_doppler_by_its_rate(interval_s: float, cycles: float, found: bool) -> None:
    """The Doppler is good to a metre per second, so at 5 Hz it shows a slip that it does not show at 1 Hz."""
    status = status_of(moved(log(step_ns=round(interval_s * 1e9)), place(2, 3, 0), cycles))

    assert (status[2, 3, 0] == SLIP_DOPPLER) == found


def test_step_of_the_receiver_clock_is_no_slip() -> None:
    table = log()
    cycles = np.array(table.carrier_cycles).reshape(EPOCHS, -1)
    cycles[3:] += 30.0 / np.tile([L1_M, L5_M], SATELLITES)

    assert np.all(status_of(replace(table, carrier_cycles=cycles.ravel()))[1:] == USED)


@pytest.mark.parametrize("cycles", [1.0, -1.0, 2.0])
def test_slip_of_one_cycle_shows_between_two_carriers(cycles: float) -> None:
    status = status_of(moved(log(), place(4, 2, 1), cycles))

    assert status[4, 2].tolist() == [SLIP_GEOMETRY_FREE] * 2
    assert np.count_nonzero(status[1:] != USED) == 2


def test_epochs_too_far_apart_are_not_differenced() -> None:
    assert np.all(status_of(log(), carrier_max_interval_s=0.4) == NO_EPOCH_BEFORE)


def test_signal_missing_in_an_epoch_starts_anew() -> None:
    table = log()
    keep = np.ones(len(table.t_ns), np.bool_)
    keep[place(2, 0, 0)] = False
    rows = rows_of(table.take(np.flatnonzero(keep)))
    of_signal = (rows.observation["sv"] == 0) & (np.flatnonzero(keep) % 2 == 0)

    assert rows.carrier["status"][of_signal].tolist() == [NO_EPOCH_BEFORE, USED, NO_EPOCH_BEFORE, USED, USED]


def test_row_without_carrier_has_no_entry_and_zero_means_none() -> None:
    table = log()
    cycles = np.array(table.carrier_cycles)
    cycles[place(1, 0, 0)], cycles[place(1, 1, 0)] = np.nan, 0.0
    status = status_of(replace(table, carrier_cycles=cycles))

    assert status[1, 0, 0] == ABSENT and status[1, 1, 0] == ABSENT
    assert status[2, 0, 0] == NO_EPOCH_BEFORE


def test_infinite_carrier_is_a_bad_value_and_none_to_count_from() -> None:
    table = log()
    cycles = np.array(table.carrier_cycles)
    cycles[place(1, 0, 0)] = np.inf
    status = status_of(replace(table, carrier_cycles=cycles))

    assert status[1, 0, 0] == BAD_VALUE and status[2, 0, 0] == NO_EPOCH_BEFORE
    assert np.count_nonzero(status[1:] != USED) == 2


@pytest.mark.parametrize("pseudorange", [np.nan, 3.0e8])
def test_carrier_whose_time_of_transmission_nothing_tells_is_refused(pseudorange: float) -> None:
    """Unless the log itself holds the satellites' states."""
    table = log()
    ranges = table.pseudorange_m.copy()
    ranges[place(2, 3, 0)] = pseudorange
    table = replace(table, pseudorange_m=ranges)
    known = rows_of(table).carrier["status"].reshape(EPOCHS, SATELLITES, 2)
    usable, sat = np.zeros(len(ranges), np.int8), np.asarray(table.sat)
    times, first = np.unique(table.t_ns, return_index=True)
    carriers, _ = carrier_rows(
        replace(table, sat=None), usable, sat, None, np.tile([L1_M, L5_M], len(ranges) // 2),
        table.range_rate_mps, epoch_ns=times, first=np.append(first, len(ranges)),
        max_interval_s=2.0, wanted=True,
    )  # fmt: skip
    status = carriers["status"].reshape(EPOCHS, SATELLITES, 2)

    assert np.all(known[1:] == USED)
    assert status[2, 3, 0] == NO_RANGE and status[3, 3, 0] == NO_EPOCH_BEFORE
    assert np.count_nonzero(status[1:] != USED) == 2


def test_settings_name_why_a_carrier_is_not_used() -> None:
    table = log()
    off = rows_of(table, carrier=False)
    others = prepare_rows(
        table, None, None, clock_groups=("G",), signals={"G": ("C1C",)}, carrier=True
    ).carrier["status"].reshape(EPOCHS, SATELLITES, 2)  # fmt: skip

    assert np.all(off.carrier["status"] == SWITCHED_OFF)
    assert np.all(others[:, 4] == CONSTELLATION_NOT_USED)
    assert len(rows_of(table, carrier=None).carrier) == 0


def test_last_epoch_alone_knows_what_the_whole_log_knew() -> None:
    whole = rows_of(log())
    part = from_epoch(whole, len(whole.epoch_ns) - 1)
    tail = slice(-2 * SATELLITES, None)

    assert part.first.tolist() == [0, 2 * SATELLITES]
    for name in ("observation", "sat", "carrier", "before"):
        assert repr(getattr(part, name).tolist()) == repr(getattr(whole, name)[tail].tolist())
    assert part.before_ns.tolist() == whole.epoch_ns[-2:-1].tolist()
    assert CARRIER == N_KINDS - 1


@pytest.mark.parametrize("carrier", [True, False])
def test_parts_of_a_log_joined_are_the_log(carrier: bool) -> None:
    whole = rows_of(log(), carrier)
    parts = [some_epochs(whole, begin, end) for begin, end in [(0, 1), (1, 4), (4, 4), (4, EPOCHS)]]
    joined = joined_epochs(parts)
    for name in GnssRows._fields:
        # not their bytes: those between the fields of a record have no value
        assert repr(getattr(joined, name).tolist()) == repr(getattr(whole, name).tolist())
        assert getattr(joined, name).dtype == getattr(whole, name).dtype
