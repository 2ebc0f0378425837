"""The supervisor over replays: simulated flights with an antenna that hides, saving, the command, and real logs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import insgnss
from insgnss.cli.main import app
from insgnss.config.flight import MountedAntenna
from insgnss.constants import C_MPS, NS_PER_S
from insgnss.errors import NavigationDataError
from insgnss.gnss.signals import L1_HZ
from insgnss.gpstime import ns_to_week_seconds
from insgnss.receiver.sources import epoch_samples
from insgnss.receiver.tracking_state import STATE_NAMES
from insgnss.runs.result import Run
from tests.conftest import REPOSITORY
from tests.real_flights import without_knock
from tests.runs.scenes import WEEK, FlightInMemory, flight, turns

WAVELENGTH_M = C_MPS / L1_HZ
SUPERVISOR_TABLES = ("supervision", "transitions", "search_times")


@cache
def banked_flight() -> FlightInMemory:
    """Return a flight in turns of 35 deg of bank under a narrow antenna that lets the receiver lose what it hides."""
    whole = flight(turns(60.0))
    antenna = MountedAntenna(pattern="hemispherical")
    gnss = whole.config.gnss.model_copy(update={"antenna": (antenna,)})
    return replace(whole, config=whole.config.model_copy(update={"gnss": gnss}))


@cache
def banked(supervise: bool = True, aiding: float | None = None, bias_alone: bool = False) -> Run:
    # the supervisor predicts the signal at the time of the tags; the filter would add their offset and the lag
    exact = {"process.imu_time_sigma_s": 0.0}
    settings = {**exact, "process.sensor_error_states": []} if bias_alone else exact
    return insgnss.replay(banked_flight(), settings=settings, supervise=supervise, aiding=aiding)


def check_states_add_up(run: Run) -> None:
    """Check that rows, transitions and seconds of the supervisor tell one story."""
    table, transitions, times = run.supervision, run.transitions, run.search_times
    assert table is not None and transitions is not None and times is not None
    epochs = np.unique(table["time_s"])
    assert not table.duplicated(["time_s", "sv"]).any()
    assert not table["state"].isna().any()
    for sv, rows in table.groupby("sv", observed=True):
        own = transitions[transitions["sv"] == sv]
        # each transition begins where the one before has led to
        chain = ["absent", *own["to_state"].astype("str")]
        assert own["from_state"].astype("str").tolist() == chain[:-1], sv
        # and between two of them the state stays
        last = np.searchsorted(own["time_s"], rows["time_s"], side="right")
        assert [chain[i] for i in last] == rows["state"].astype("str").tolist(), sv
    assert set(table["state"].cat.categories) == set(STATE_NAMES)
    # a state lasts until the next epoch, the last one no longer; a gap is longer than an interval and is not counted
    step = np.diff(epochs)
    usual = float(np.median(step))
    lasts = np.append(np.where(step > max(5.0 * usual, 2.0), usual, step), 0.0)
    seconds = lasts[np.searchsorted(epochs, table["time_s"])]
    held = pd.Series(seconds * (table["state"] == "hold")).groupby(table["sv"], observed=False).sum()
    np.testing.assert_allclose(times.set_index("sv")["hold_s"], held[times["sv"]], atol=1e-6)
    assert (times["in_vain_s"] <= times["search_s"] + times["control_s"] + 1e-9).all()
    assert (times["unsupervised_in_vain_s"] <= times["unsupervised_s"] + 1e-9).all()


def test_replay_that_is_not_asked_has_no_tables_of_the_supervisor() -> None:
    run = banked(supervise=False)

    assert [getattr(run, name) for name in (*SUPERVISOR_TABLES, "receiver_events")] == [None] * 4


def test_supervision_changes_no_bit_of_the_other_tables() -> None:
    for name in ("nav", "measurements", "satellites", "events"):
        pd.testing.assert_frame_equal(getattr(banked(), name), getattr(banked(supervise=False), name))


def test_states_of_a_banked_flight_add_up() -> None:
    run = banked()

    check_states_add_up(run)
    assert "hidden" in set(run.transitions["reason"].astype("str"))


def test_supervision_has_a_row_for_each_satellite_and_epoch_with_the_filters_own_sigma() -> None:
    """Of a filter whose gyros have biases alone.

    A row of the filter leaves scale factors out of the lever arm's velocity, 0.5 % of the sigma of a range rate; the
    trace has them.
    """
    run = banked(bias_alone=True)
    both = run.supervision.merge(run.satellites, on=["time_s", "sv"], suffixes=("", "_filter"))

    # eleven satellites at every epoch after the start
    assert len(run.supervision) == 11 * run.supervision["time_s"].nunique()
    assert len(both) == len(run.supervision)
    np.testing.assert_allclose(both["el_deg"], both["el_deg_filter"], atol=1e-3)
    # the pattern's edge falls by 40 dB within a degree
    np.testing.assert_allclose(both["gain_dbi"], both["gain_dbi_filter"], atol=40e-3)
    # until the heading is known the ledger has the D of one hypothesis, the trace that of all
    known = both["sd_range_m_filter"].notna() & (both["time_s"] > run.heading_known_s())
    assert known.sum() > 11 * 40
    # the last sample stands at the epoch, the ledger has single precision
    for name, rtol in (("sd_range_m", 1e-5), ("sd_range_rate_mps", 1e-3)):
        np.testing.assert_allclose(both.loc[known, name], both.loc[known, f"{name}_filter"], rtol=rtol)


def test_decision_of_the_supervisor_is_that_of_the_filters_mask() -> None:
    run = banked()
    both = run.supervision.merge(run.satellites, on=["time_s", "sv"], suffixes=("", "_filter"))
    masked = both["state_filter"] == "masked_gain"

    assert masked.sum() > 50
    hidden = both["decision"].astype("str").isin(["hidden", "uncertain_hidden"])
    # the filter looks at them from its first epoch on, the supervisor from the second: an uncertain one may differ
    assert (hidden == masked).mean() > 0.99


def test_measured_minus_predicted_is_the_filters_innovation() -> None:
    run, gnss = banked(), banked_flight().logs.gnss
    key = ["time_s", "sv"]
    logged = pd.DataFrame(
        {
            "time_s": ns_to_week_seconds(gnss.t_ns, WEEK),
            "sv": [gnss.sv_names[i] for i in gnss.sv],
            "pseudorange": gnss.pseudorange_m,
            "range_rate": -gnss.doppler_hz * WAVELENGTH_M,
        }
    )
    supervision = run.supervision.astype({"sv": "str"})
    supervision["range_rate_mps"] = -supervision["doppler_hz"] * WAVELENGTH_M
    both = supervision.merge(logged, on=key)
    for kind, name, atol in (("pseudorange", "pseudorange_m", 2e-3), ("range_rate", "range_rate_mps", 0.02)):
        innovation = run.measurements[run.measurements["kind"] == kind].astype({"sv": "str"})
        compared = both.merge(innovation[[*key, "innovation"]].dropna(), on=key)
        late = compared[compared["time_s"] > run.heading_known_s()]

        assert len(late) > 11 * 40
        # hidden ones and tracked ones: light time, Sagnac, clocks and air, each computed twice; the filter takes the
        # mean of the last gyro sample where this takes its end, 2 mm/s at the lever when a roll of 0.3 rad/s^2 begins;
        # the growth of the air's delays, up to 19 mm/s at 6 deg, is in the filter's range rates alone
        np.testing.assert_allclose(late[kind] - late[name], late["innovation"], atol=atol)


def test_aiding_beside_supervision_keeps_its_rows_and_values() -> None:
    alone, both = banked(supervise=False, aiding=20.0), banked(aiding=20.0)

    assert alone.aiding is not None and both.aiding is not None
    sigma = [name for name in alone.aiding.columns if name.startswith(("sd_", "cross_"))]
    # at whole seconds both read a covariance of that instant
    pd.testing.assert_frame_equal(both.aiding.drop(columns=sigma), alone.aiding.drop(columns=sigma))
    for name in SUPERVISOR_TABLES:
        pd.testing.assert_frame_equal(getattr(both, name), getattr(banked(), name))


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_saved_run_is_loaded_with_the_supervisors_tables(form: str, tmp_path: Path) -> None:
    run = banked()
    loaded = Run.load(run.save(tmp_path / form, form))  # type: ignore[arg-type]

    for name in SUPERVISOR_TABLES:
        table, again = getattr(run, name), getattr(loaded, name)
        pd.testing.assert_frame_equal(again, table, check_exact=True)
    assert loaded.receiver_events is None


def test_log_of_the_receivers_events_is_compared(tmp_path: Path) -> None:
    log = tmp_path / "events.csv"
    hold = banked().transitions[banked().transitions["reason"] == "hidden"].iloc[0]
    log.write_text(
        f"time_s,sv,event\n{hold.time_s:.1f},{hold.sv},loss\n{hold.time_s + 0.5:.1f},{hold.sv},search\n"
    )
    whole = banked_flight()
    gnss = whole.config.gnss.model_copy(update={"receiver_events": log})
    run = insgnss.replay(
        replace(whole, config=whole.config.model_copy(update={"gnss": gnss})), supervise=True
    )

    assert run.receiver_events is not None
    assert run.receiver_events["verdict"].astype("str").tolist() == ["agrees", "search_while_hidden"]
    assert run.search_times.set_index("sv").loc[hold.sv, "n_events"] == 2


def test_log_that_alone_knows_its_satellites_cannot_be_supervised() -> None:
    whole = banked_flight()
    states = np.zeros((len(whole.logs.gnss.t_ns), 8))
    logs = replace(whole.logs, gnss=replace(whole.logs.gnss, sat=states), navigation=None)

    with pytest.raises(NavigationDataError, match="satellite states in its rows"):
        insgnss.replay(replace(whole, logs=logs), supervise=True)


def test_sample_of_an_epoch_is_the_last_one_before_it() -> None:
    imu_ns = np.array([0, 10, 20, 30, 300, 310]) * (NS_PER_S // 1000)
    epoch_ns = np.array([-5, 10, 21, 24, 29, 140, 301, 305]) * (NS_PER_S // 1000)
    samples_ns, taken_ns = epoch_samples(imu_ns, epoch_ns)

    # of three epochs after one sample the last; none after 110 ms without samples, none before the first
    assert (samples_ns // 1_000_000).tolist() == [10, 20, 300]
    assert (taken_ns // 1_000_000).tolist() == [10, 29, 305]


def test_receiver_that_is_silent_for_ten_seconds_leaves_its_satellites_predicted() -> None:
    whole = banked_flight()
    gnss, begin = whole.logs.gnss, float(banked().supervision["time_s"].min()) + 20.0
    time_s = ns_to_week_seconds(gnss.t_ns, WEEK)
    heard = np.flatnonzero((time_s < begin) | (time_s >= begin + 10.0))
    logs = replace(whole.logs, gnss=gnss.take(heard))
    run = insgnss.replay(replace(whole, logs=logs), supervise=True)

    check_states_add_up(run)
    assert "prediction_ended" not in set(run.transitions["reason"].astype("str"))
    silent = run.supervision[run.supervision["time_s"].between(begin, begin + 9.5)]
    # one a second, of which the first still counts by the epoch before
    assert len(silent) == 11 * 10
    assert ((silent["receiver"] == "not_known") == (silent["time_s"] > begin + 0.5)).all()
    # the filter coasts: the clock's drift alone, 0.036 m^2/s^3, makes 0.6 m/s of ten seconds
    ends = run.supervision.groupby("time_s")["sd_range_rate_mps"].median()
    assert ends[begin + 9.0] > 0.55 > 2.0 * ends[begin - 1.0]


def test_command_tells_transitions_and_the_time_in_search(tmp_path: Path) -> None:
    sample = REPOSITORY / "data" / "sample_flight" / "flight.toml"
    result = CliRunner().invoke(
        app, ["replay", str(sample), "--supervise", "--output", str(tmp_path / "out")]
    )

    assert result.exit_code == 0, result.output
    assert "supervisor: " in result.output
    assert "without the supervisor" in result.output
    check_states_add_up(Run.load(tmp_path / "out"))


@pytest.mark.real_data
@pytest.mark.parametrize("name", ["xian", "walk", "instinct"])
def test_real_log_runs_through_with_a_patch_antenna_and_its_states_add_up(name: str, data_root: Path) -> None:
    read = without_knock(name)
    gnss = read.config.gnss.model_copy(update={"antenna": (MountedAntenna(pattern="patch_l1"),)})
    run = insgnss.replay(replace(read, config=read.config.model_copy(update={"gnss": gnss})), supervise=True)

    check_states_add_up(run)
    assert run.supervision["sd_range_m"].median() < 10.0
    tracked = run.supervision["state"] == "track"
    assert tracked.mean() > 0.5
