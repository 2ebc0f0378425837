"""Damaged messages are refused with a word; sound ones never are."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from insgnss.errors import InsGnssError
from insgnss.gnss.observation_rows import prepare_rows
from insgnss.gnss.orbits.ephemeris_choice import broadcast_messages
from insgnss.gnss.orbits.plausible_messages import (
    faults_of_ephemerides,
    faults_of_states,
    is_ionosphere,
    is_plausible,
    limit_of,
    plausible_klobuchar,
    refused_messages,
)
from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.log.rinex.navigation import read_navigation
from insgnss.log.sbf.reader import read_sbf
from insgnss.log.ubx.reader import read_ubx
from insgnss.status import BAD_VALUE, NO_EPHEMERIS, USED
from insgnss.tables import EphemerisTable, GnssTable, NavigationData, StateVectorTable
from tests.gnss.broadcast_sample import TOE_NS, navigation_table, observations
from tests.gnss.glonass_sample import glonass_table

SAMPLE = Path(__file__).resolve().parents[2] / "data" / "sample_flight" / "nav.rnx"
NOT_NUMBERS = ("sv_names", "message", "toe_ns", "toc_ns")
# None of these makes a satellite of a message, or of its clock
NOT_ORBIT = ("health", "accuracy_m", "issue", "fit_interval_s")
WILD = [np.nan, np.inf, -np.inf, 1e29, -1e30, 1e308]


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> EphemerisTable:
    return navigation_table(tmp_path_factory.mktemp("navigation"))


def log_of(table: EphemerisTable) -> GnssTable:
    names = tuple(table.sv_names)
    return observations(
        names, np.full(len(names), TOE_NS), np.full(len(names), 2.4e7), sv=np.arange(len(names))
    )


@pytest.mark.parametrize("value", WILD)
@pytest.mark.parametrize(
    "name", [f.name for f in fields(EphemerisTable) if f.name not in (*NOT_NUMBERS, *NOT_ORBIT)]
)
def test_message_with_a_wild_number_gives_no_satellite_and_an_event(
    table: EphemerisTable, name: str, value: float
) -> None:
    if name == "group_delay_s" and np.isnan(value):
        pytest.skip("NaN says that there is none")
    changed = getattr(table, name).copy()
    changed[3] = value
    damaged = replace(table, **{name: changed})

    states = satellite_states(log_of(table), damaged)

    assert states.status[3] == NO_EPHEMERIS
    assert np.isnan(states.sat[3]).all()
    assert np.isnan(states.clock_m[3])
    np.testing.assert_array_equal(
        np.delete(states.status, 3), np.delete(satellite_states(log_of(table), table).status, 3)
    )
    (event,) = refused_messages(NavigationData(damaged, None, None))
    assert event.kind == "ephemeris_refused"
    assert event.detail.startswith(f"{table.sv_names[3]}: 1 message(s)")
    assert name in event.detail


@pytest.mark.parametrize(
    ("name", "value"), [("delta_n", -1e30), ("sqrt_a", 5e9), ("sqrt_a", 100.0), ("e", 0.9)]
)
def test_numbers_of_the_field_trial_are_refused(table: EphemerisTable, name: str, value: float) -> None:
    changed = np.full(len(table.sv_names), value)

    assert not is_plausible(faults_of_ephemerides(replace(table, **{name: changed})), len(changed)).any()


@pytest.mark.parametrize(
    "name", ["delta_n", "cuc", "crs", "idot", "omega_dot", "af0", "af1", "af2", "group_delay_s"]
)
def test_largest_number_that_a_message_can_hold_is_believed(table: EphemerisTable, name: str) -> None:
    """A limit is twice the field's; a satellite at the field's end (C19's clock was once at 0.99 of it) passes."""
    most = np.array([limit_of(sv[0], name) for sv in table.sv_names]) / 2.0
    values = np.column_stack([most, -most]) if name == "group_delay_s" else most

    assert is_plausible(faults_of_ephemerides(replace(table, **{name: values})), len(most)).all()


def test_limits_are_those_of_the_documents() -> None:
    # IS-GPS-200N, table 20-III: 16 bits of 2^-43 semicircles/s; 22 bits of 2^-31 s. Galileo: 31 bits of 2^-34 s
    assert limit_of("G", "delta_n") == pytest.approx(2.0 * np.pi * 2.0**-28)
    assert limit_of("G", "af0") == pytest.approx(2.0 * 9.765625e-4)
    assert limit_of("E", "af0") == pytest.approx(2.0 * 0.0625)
    assert limit_of("C", "crc") == 2.0 * 2048.0
    assert limit_of("I", "crc") == 2.0 * 1024.0


def test_fit_interval_that_none_is_gives_way_to_the_usual_one(table: EphemerisTable) -> None:
    wild = broadcast_messages(replace(table, fit_interval_s=np.full(len(table.sv_names), 1e29)))
    usual = broadcast_messages(replace(table, fit_interval_s=np.full(len(table.sv_names), np.nan)))

    np.testing.assert_array_equal(wild.index.validity_ns, usual.index.validity_ns)


@pytest.mark.parametrize("value", WILD)
@pytest.mark.parametrize("name", ["r_e", "v_e", "a_e", "clock_s", "clock_rate", "group_delay_s"])
def test_glonass_state_with_a_wild_number_is_refused(tmp_path: Path, name: str, value: float) -> None:
    table: StateVectorTable = glonass_table(tmp_path)
    changed = getattr(table, name).copy()
    changed[1] = value
    kept = is_plausible(faults_of_states(replace(table, **{name: changed})), len(table.sv_names))

    none_given = name == "group_delay_s" and np.isnan(value)
    assert np.flatnonzero(~kept).tolist() == ([] if none_given else [1])


@pytest.mark.parametrize("value", WILD)
def test_wild_coefficients_of_an_ionosphere_are_none(value: float) -> None:
    usual = np.array([1.2e-8, 7.5e-9, -6e-8, -6e-8, 9e4, 3.3e4, -2e5, -6.5e4])
    for k in range(8):
        wild = usual.copy()
        wild[k] = value
        assert plausible_klobuchar(wild) is None
        assert not is_ionosphere(wild)
    assert plausible_klobuchar(usual) is usual
    assert is_ionosphere(np.array([236.8, -0.39, 0.013]))


# --- the log's own states --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [np.inf, -np.inf, 1e29, -1e308])
@pytest.mark.parametrize("column", range(8))
def test_wild_state_of_the_log_is_a_bad_value(table: EphemerisTable, column: int, value: float) -> None:
    log = log_of(table)
    states = satellite_states(log, table)
    sat = np.column_stack([states.sat[:, :6], states.clock_m, states.drift_mps])
    sat[5, column] = value
    sat[6, 0] = np.nan  # an empty cell
    rows = prepare_rows(
        replace(log, sat=sat, range_rate_mps=np.zeros(len(log.t_ns))),
        None, None, clock_groups=("G",), signals={"G": ("C1C",)},
    )  # fmt: skip

    assert satellite_states(replace(log, sat=sat), None).status.tolist()[5:7] == [BAD_VALUE, NO_EPHEMERIS]
    assert rows.observation["status"][5].tolist() == [BAD_VALUE, BAD_VALUE]
    assert rows.observation["no_satellite"][5] == 1
    assert (rows.observation["status"][[7, 8], 0] == USED).all()


def test_state_without_a_velocity_has_a_range_and_no_range_rate(table: EphemerisTable) -> None:
    log = log_of(table)
    states = satellite_states(log, table)
    sat = np.column_stack([states.sat[:, :6], states.clock_m, states.drift_mps])
    sat[5, 4] = np.nan
    rows = prepare_rows(
        replace(log, sat=sat, range_rate_mps=np.zeros(len(log.t_ns))),
        None, None, clock_groups=("G",), signals={"G": ("C1C",)},
    )  # fmt: skip

    assert rows.observation["status"][5].tolist() == [USED, NO_EPHEMERIS]


# --- what is sound is never refused ----------------------------------------------------------------------------------


def test_no_message_of_the_sample_flight_is_refused() -> None:
    data, _ = read_navigation([SAMPLE])

    assert len(data.ephemerides.sv_names) > 10
    assert refused_messages(data) == []


def test_no_message_of_the_real_logs_is_refused(data_root: Path) -> None:
    count = 0
    for path in sorted(path for path in data_root.rglob("*") if path.is_file()):
        found = _messages(path)
        if found is not None:
            assert refused_messages(found) == [], path.name
            count += len(found.ephemerides.sv_names)
    assert count > 100


def _messages(path: Path) -> NavigationData | None:
    """Return the messages of a file, None where it is no file of messages that can be read."""
    kind = path.suffix.lower()
    try:
        if kind == ".ubx":
            return read_ubx([path]).navigation
        if kind == ".sbf":
            return read_sbf(path).navigation
        if kind in (".rnx", ".nav") or kind.endswith(("n", "g", "p")):
            return read_navigation([path])[0]
    except InsGnssError:
        return None
    return None
