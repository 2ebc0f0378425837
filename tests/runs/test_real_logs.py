"""The real logs through the whole engine, held to the numbers that a plain filter reached on them.

The yardsticks stand in each log's note: a 15-state filter, loosely tuned. ``tests/flights`` holds the flight files.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pymap3d
import pytest

import insgnss
from insgnss.config.library import filter_config
from insgnss.filter.setup import FilterSetup
from insgnss.filter.start.fix import fix_epoch
from insgnss.filter.whole_log import run_filter
from insgnss.geodesy.rotations import euler_to_matrix
from insgnss.gpstime import ns_to_week_seconds
from insgnss.log.flight import FlightLogs
from insgnss.runs.result import Run
from insgnss.runs.result_tables import nav_table
from insgnss.runs.setup import setup_filter
from insgnss.tables import Float64
from tests.real_flights import real_flight

pytestmark = pytest.mark.real_data
NAMES = ("xian", "walk", "instinct")
WITHOUT_REFERENCE = {"xian"}


@dataclass(frozen=True)
class Replayed:
    logs: FlightLogs
    setup: FilterSetup
    week: int
    run: Run

    def seconds(self) -> Float64:
        return np.asarray(ns_to_week_seconds(self.logs.gnss.t_ns, self.week))


@pytest.fixture(scope="module")
def replayed(data_root: Path) -> dict[str, Replayed]:
    found = {}
    for name in NAMES:
        flight = real_flight(name)
        logs = flight.read()
        setup = setup_filter(flight, logs, filter_config("tight17"))
        found[name] = Replayed(logs, setup, flight.config.gps_week, insgnss.replay(flight))
    return found


def rms(values: Float64) -> Float64:
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=0)))


# ------------------------------------------------------------------------------------------------ every log


@pytest.mark.parametrize("name", NAMES)
def test_normalised_innovations_are_believable(replayed: dict[str, Replayed], name: str) -> None:
    """Near one where errors are white; below it where they are slow and alike, as pseudoranges under open sky are.

    Above 1.5 sigma would be too small by a fifth, below 0.1 (range) and 0.3 (rate) too large by more than a factor of
    three and two. The 95 % share must be at least 0.9 in both cases.
    """
    summary = replayed[name].run.nis_summary(from_s=-np.inf)  # the whole run, a heading that is open too
    assert 0.1 < summary.loc["pseudorange", "mean_nis"] < 1.5
    assert 0.3 < summary.loc["range_rate", "mean_nis"] < 1.5
    assert summary["share_95"].min() >= 0.9


@pytest.mark.parametrize("name", NAMES)
def test_no_satellite_is_at_odds_with_the_others(replayed: dict[str, Replayed], name: str) -> None:
    """A wrong orbit, signal bias or sign would show as one satellite's mean NIS, whatever the mean of all is."""
    used = replayed[name].run.measurements.query("status == 'used'")
    by_satellite = used.groupby(["kind", "sv"], observed=True)["nis"].agg(["mean", "size"])
    assert by_satellite.loc[by_satellite["size"] >= 30, "mean"].max() < 4.0


@pytest.mark.parametrize("name", NAMES)
def test_ledger_adds_up_to_the_file(replayed: dict[str, Replayed], name: str) -> None:
    found = replayed[name]
    file = pd.concat(pd.read_csv(path) for path in found.run.settings["flight"]["gnss"]["files"])
    counts = found.run.measurements.groupby("kind", observed=True).size()
    assert counts["pseudorange"] == file["pseudorange_m"].notna().sum()
    assert counts["range_rate"] == file["doppler_hz"].notna().sum()
    assert found.run.status_counts().to_numpy().sum() == counts.sum()


@pytest.mark.parametrize("name", NAMES)
def test_solution_is_whole(replayed: dict[str, Replayed], name: str) -> None:
    """A row for each epoch from the start to the end of the inertial log, no NaN, every sigma positive."""
    found = replayed[name]
    nav, epochs = found.run.nav, np.unique(found.logs.gnss.t_ns)
    started = ns_to_week_seconds(epochs, found.week) >= nav["time_s"].iloc[0]
    assert len(nav) == np.count_nonzero(started & (epochs <= found.logs.imu.t_ns[-1]))
    assert np.isfinite(nav.to_numpy(dtype=np.float64)).all()
    assert nav.filter(regex="^sd_(?!slow_)").to_numpy().min() > 0.0


# ------------------------------------------------------------------------------------------------ car, Xi'an


def antenna_against_fixes(found: Replayed) -> tuple[Float64, Float64]:
    """Return antenna position and velocity of the solution minus those of each epoch's own fix, NED (n, 3)."""
    nav = found.run.nav
    rows, par = found.setup.rows(found.logs.gnss, found.setup.navigation), found.setup.parameters()[0]
    times = ns_to_week_seconds(rows.epoch_ns, found.week)
    position, velocity = [], []
    for row in nav.itertuples():
        fix = fix_epoch(rows, int(np.argmin(np.abs(times - row.time_s))), par, found.setup.ties, 20.0)
        if fix is None or fix.v_a is None:
            continue
        lever_n = body_to_ned(row) @ np.array(found.setup.lever_arm_m)
        here = row.lat_deg, row.lon_deg, row.h_m
        position.append(lever_n - np.array(pymap3d.ecef2ned(*fix.r_a, *here)))
        velocity.append(
            [row.vn_mps, row.ve_mps, row.vd_mps] - np.array(pymap3d.ecef2nedv(*fix.v_a, *here[:2]))
        )
    return np.array(position), np.array(velocity)


def body_to_ned(row: object) -> Float64:
    C_nb = np.zeros((3, 3))
    euler_to_matrix(*(np.radians(getattr(row, f"{a}_deg")) for a in ("roll", "pitch", "yaw")), C_nb)
    return C_nb


@pytest.mark.xfail(
    strict=True,
    reason="the log has no coefficients of the ionosphere, by which Doppler and code drift apart; gravity's share of"
    " the scale factor in the accelerometer's prior lets the vertical follow (0.9 m): states for what lasts come later",
)
def test_car_stays_as_near_to_the_single_point_solution_as_a_plain_filter(
    replayed: dict[str, Replayed],
) -> None:
    """The note: 0.24/0.32/0.55 m and 0.12/0.09/0.17 m/s, north, east, down."""
    position, velocity = antenna_against_fixes(replayed["xian"])
    assert len(position) >= 130
    assert np.all(rms(position) <= [0.24, 0.32, 0.55])
    assert np.all(rms(velocity) <= [0.12, 0.09, 0.17])


@pytest.mark.xfail(
    strict=True,
    reason="the log has no coefficients of the ionosphere, by which Doppler and code drift apart; gravity's share of"
    " the scale factor in the accelerometer's prior lets the vertical follow (0.9 m): states for what lasts come later",
)
def test_car_drifts_less_than_a_metre_in_twenty_seconds_without_satellites(
    replayed: dict[str, Replayed],
) -> None:
    """The note: 0.9 m over 185608 to 185628 s, against the solution that had all satellites."""
    found = replayed["xian"]
    seconds = found.seconds()
    hidden = (seconds > 185_608.0) & (seconds <= 185_628.0)
    assert hidden.sum() > 100
    gnss = found.logs.gnss.take(np.flatnonzero(~hidden))
    coasting = solution(found, dataclasses.replace(found.logs, gnss=gnss)).set_index("time_s")
    aided = solution(found, found.logs).set_index("time_s")
    drift = []
    for at_s in (185_613.0, 185_618.0, 185_623.0, 185_627.9):
        a, b = aided.loc[at_s], coasting.loc[at_s]
        ned = pymap3d.geodetic2ned(b.lat_deg, b.lon_deg, b.h_m, a.lat_deg, a.lon_deg, a.h_m)
        drift.append(float(np.linalg.norm(ned)))
        assert np.all(np.abs(ned) <= 3.0 * b[["sd_n_m", "sd_e_m", "sd_d_m"]].to_numpy())
    assert max(drift) <= 0.9


def solution(found: Replayed, logs: FlightLogs) -> pd.DataFrame:
    """Return the navigation table of other logs of the same flight, ten rows a second."""
    setup = dataclasses.replace(found.setup)
    out, _ = run_filter(setup, logs.imu, setup.rows(logs.gnss, setup.navigation), 10.0)
    nav = nav_table(out, found.week, setup)
    return nav.assign(time_s=nav["time_s"].round(1))


def test_car_finds_the_heading_of_its_note(replayed: dict[str, Replayed]) -> None:
    """The note: about -58 deg where the drive begins and +1.7 deg at its end, by a filter of its own."""
    run = replayed["xian"].run
    assert (run.events["kind"] == "heading_known").sum() == 1
    nav = run.nav.set_index("time_s")
    known = run.events.query("kind == 'heading_known'")["time_s"].item()
    assert nav.loc[known:, "yaw_deg"].min() == pytest.approx(-58.0, abs=3.0)
    last = nav.iloc[-1]
    assert last["yaw_deg"] == pytest.approx(1.7, abs=2.0)
    assert 0.02 < last["sd_yaw_deg"] < 1.0


# ------------------------------------------------------------------------------------------------ walk


def test_walk_is_as_near_to_its_reference_as_a_plain_filter(replayed: dict[str, Replayed]) -> None:
    """The note, after 20 s, the reference's constant offset removed: 0.26 and 0.46 m, 0.12 m/s (to two digits)."""
    errors = replayed["walk"].run.errors
    assert errors is not None
    errors = errors[errors["time_s"] > errors["time_s"].iloc[0] + 20.0]
    assert len(errors) > 400
    horizontal = errors[["d_n_m", "d_e_m"]] - errors[["d_n_m", "d_e_m"]].median()
    distance = np.hypot(horizontal["d_n_m"], horizontal["d_e_m"])
    assert distance.quantile(0.5) <= 0.26
    assert distance.quantile(0.95) <= 0.46
    velocity = errors[["d_vn_mps", "d_ve_mps", "d_vd_mps"]].to_numpy()
    assert rms(velocity).max() < 0.125


def test_walk_finds_its_heading(replayed: dict[str, Replayed]) -> None:
    """It stands at first, then turns many ways. The pole sways by 40 deg, but on the whole it points ahead."""
    run = replayed["walk"].run
    known = run.events.query("kind == 'heading_known'")["time_s"]
    assert len(known) == 1
    assert known.item() - run.nav["time_s"].iloc[0] < 60.0
    assert run.nav["sd_yaw_deg"].iloc[-1] < 6.0
    walking = run.nav[
        (run.nav["time_s"] > known.item()) & (np.hypot(run.nav["vn_mps"], run.nav["ve_mps"]) > 1.0)
    ]
    course = np.degrees(np.arctan2(walking["ve_mps"], walking["vn_mps"]))
    off = (walking["yaw_deg"] - course + 180.0) % 360.0 - 180.0
    assert len(off) > 200 and abs(off.median()) < 30.0


# ------------------------------------------------------------------------------------------------ static


def test_static_antenna_is_where_its_receiver_says(replayed: dict[str, Replayed]) -> None:
    """The note: bias -1.6/1.9/9.1 m, 9.4 m in all, against the receiver's own fix; velocity rms 0.01 m/s."""
    errors = replayed["instinct"].run.errors
    assert errors is not None and len(errors) > 150
    assert np.linalg.norm(errors[["d_n_m", "d_e_m", "d_d_m"]].mean()) <= 9.4
    assert rms(errors[["d_vn_mps", "d_ve_mps", "d_vd_mps"]].to_numpy()).max() <= 0.01


def test_static_antenna_tells_its_gap_and_admits_that_its_heading_is_open(
    replayed: dict[str, Replayed],
) -> None:
    run = replayed["instinct"].run
    assert "imu_gap" in set(run.events["kind"])
    assert "heading_known" not in set(run.events["kind"])
    assert run.nav["sd_yaw_deg"].iloc[-1] > 20.0
