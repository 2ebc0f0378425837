"""``run.aiding``: what a replay hands back, how it is kept, and how it stands against a receiver's measurements."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import insgnss
from insgnss.aiding.sources import aiding_sources
from insgnss.aiding.table import COLUMNS
from insgnss.aiding.uncertainty import PARTS
from insgnss.cli.main import app
from insgnss.config.aiding import AidingConfig
from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config, find
from insgnss.config.strict import load_toml
from insgnss.constants import C_MPS
from insgnss.errors import ConfigError, NavigationDataError
from insgnss.gnss.orbits.satellite_state import range_rates, satellite_states
from insgnss.gnss.signals import wavelength_m
from insgnss.gpstime import ns_to_week_seconds
from insgnss.log.flight import Flight
from insgnss.log.messages.broadcast import Broadcast
from insgnss.runs.result import Run
from insgnss.runs.setup import setup_filter
from insgnss.simulation.faults import outage
from tests.real_flights import without_knock
from tests.runs.files import write_flight
from tests.runs.scenes import START_S, flight, turns, with_faults

SECONDS = 60.0


@pytest.fixture(scope="module")
def run() -> Run:
    """A replay of which one satellite is hidden from 30 s to 50 s."""
    hidden = with_faults(turns(SECONDS), (outage(["G13"], 30.0, 50.0),))
    return insgnss.replay(flight(hidden), aiding=20)


def test_aiding_is_given_where_asked_for_alone(run: Run) -> None:
    assert run.aiding is not None and run.aiding_budget is not None
    assert tuple(run.aiding.columns) == COLUMNS
    assert run.settings["aiding"]["rate_hz"] == 20.0
    plain = insgnss.replay(flight(turns(SECONDS)))
    assert plain.aiding is None and plain.aiding_budget is None
    assert plain.settings["aiding"] is None


def test_rows_come_at_the_rate_for_each_satellite_the_hidden_one_too(run: Run) -> None:
    assert run.aiding is not None
    times = run.aiding["time_s"].unique()
    assert np.diff(times) == pytest.approx(0.05, abs=1e-6)
    assert times[0] == pytest.approx(run.nav["time_s"].iloc[0], abs=0.06)
    assert set(run.aiding["sv"].cat.categories) == set(run.satellites["sv"].cat.categories)
    hidden = run.aiding[
        (run.aiding["sv"] == "G13") & run.aiding["time_s"].between(START_S + 30, START_S + 50)
    ]
    assert len(hidden) == pytest.approx(400, abs=2)
    assert np.isfinite(hidden.drop(columns="sv").to_numpy(np.float64)).all()


def test_row_takes_the_memory_that_is_written_down(run: Run) -> None:
    assert run.aiding is not None
    sv = run.aiding["sv"].cat.codes
    assert run.aiding.drop(columns="sv").memory_usage(index=False).sum() / len(run.aiding) == 84.0
    assert sv.dtype == np.int8


def test_budget_adds_up_to_the_sigma_that_the_rows_hold(run: Run) -> None:
    assert run.aiding is not None and run.aiding_budget is not None
    both = run.aiding_budget.merge(run.aiding, on=["time_s", "sv"])
    assert len(both) == len(run.aiding_budget) > 500
    for kind, cross, total in (
        ("rate_{}_mps", "cross_rate_m2ps2", both["sd_doppler_hz"]),
        ("acceleration_{}_mps2", "cross_acceleration_m2ps4", both["sd_doppler_rate_hz_per_s"]),
    ):
        parts = np.column_stack([both["sd_" + kind.format(name)] for name in PARTS]).astype(np.float64)
        variance = np.sum(parts**2, axis=1) + both[cross]
        # numbers of four bytes
        np.testing.assert_allclose(np.sqrt(variance), total * wavelength_m("G", "C1C"), rtol=1e-4)


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_saved_aiding_is_the_same_after_loading(run: Run, tmp_path: Path, form: str) -> None:
    loaded = Run.load(run.save(tmp_path / form, form))  # type: ignore[arg-type]
    for name in ("aiding", "aiding_budget"):
        pd.testing.assert_frame_equal(getattr(loaded, name), getattr(run, name), check_exact=True)
    assert loaded.settings["aiding"] == run.settings["aiding"]


def test_filter_file_has_the_settings_and_the_argument_has_the_rate(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    text = find("filters", "tight17").read_text(encoding="utf-8")
    path.write_text(text + "\n[aiding]\nlatency_s = 0.02\nhorizon_deg = 30.0\n", encoding="utf-8")
    assert load_toml(path, FilterConfig).aiding == AidingConfig(latency_s=0.02, horizon_deg=30.0)
    aided = insgnss.replay(flight(turns(SECONDS)), str(path), aiding=10)
    assert aided.aiding is not None
    assert aided.settings["aiding"]["latency_s"] == 0.02
    assert (aided.aiding["age_s"] == np.float32(0.02)).all()
    assert aided.aiding["sv"].nunique() < 11


def test_impossible_rate_is_an_error() -> None:
    for wrong in (0.0, -5.0, np.nan, "fast"):
        with pytest.raises(ConfigError, match="invalid aiding rate"):
            insgnss.replay(flight(turns(SECONDS)), aiding=wrong)  # type: ignore[arg-type]


def test_log_with_satellite_states_in_its_rows_needs_messages_beside_it() -> None:
    flown = flight(turns(SECONDS))
    gnss = flown.logs.gnss
    sat = satellite_states(gnss, flown.logs.navigation).sat
    alone = dataclasses.replace(
        flown, logs=dataclasses.replace(flown.logs, gnss=dataclasses.replace(gnss, sat=sat), navigation=None)
    )
    with pytest.raises(NavigationDataError, match="needs messages"):
        insgnss.replay(alone, aiding=10)
    broadcast = Broadcast()
    broadcast.ionosphere_of("gps", (1e-8,) * 4 + (1e5,) * 4)
    coefficients = broadcast.navigation()
    with pytest.raises(NavigationDataError, match="needs messages"):
        insgnss.replay(
            dataclasses.replace(alone, logs=dataclasses.replace(alone.logs, navigation=coefficients)),
            aiding=10,
        )
    setup = setup_filter(alone, alone.logs, filter_config("tight17"))
    sources = aiding_sources(
        dataclasses.replace(setup, navigation=flown.logs.navigation), setup.config.aiding
    )
    first_ns = int(gnss.t_ns[0])
    assert sources.arcs(first_ns, first_ns).sv_names == tuple(sorted(gnss.sv_names))


def test_command_writes_the_aiding_and_tells_of_it(tmp_path: Path) -> None:
    path = write_flight(tmp_path / "flight", turns(SECONDS))
    out = tmp_path / "out"
    told = CliRunner().invoke(app, ["replay", str(path), "--aiding", "50", "-o", str(out)])
    assert told.exit_code == 0, told.output
    assert "aiding at 50 Hz" in told.output
    assert {"aiding.parquet", "aiding_budget.parquet"} <= {p.name for p in out.iterdir()}


# ------------------------------------------------------------------------------------------------ real logs


def against_receiver(loaded: Flight, settled_s: float) -> pd.DataFrame:
    """Return the predicted less the measured range rate of each used Doppler [m/s], and the filter's own innovation.

    A value is carried on from the last inertial sample before its epoch.
    """
    gnss = loaded.read().gnss
    # an aid at every sample. It predicts the Doppler at the antenna; the filter would add the receiver's lag
    run = insgnss.replay(loaded, settings={"process.range_rate_lag_sigma_s": 0.0}, aiding=1000)
    assert run.aiding is not None
    codes = filter_config("tight17").aiding.signals
    words = {"sv": str, "signal": str}
    used = run.measurements[
        (run.measurements["kind"] == "range_rate") & (run.measurements["status"] == "used")
    ]
    used = used[used["time_s"] > run.nav["time_s"].iloc[0] + settled_s].astype(words)
    used = used[used["signal"] == used["sv"].str[0].map(codes)]
    measured = pd.DataFrame(
        {
            "time_s": ns_to_week_seconds(gnss.t_ns, loaded.config.gps_week),
            "sv": np.array(gnss.sv_names)[gnss.sv],
            "signal": np.array(gnss.signal_names)[gnss.signal],
            "measured_mps": range_rates(gnss),
        }
    )
    aiding = run.aiding.astype({"sv": str}).rename(columns={"time_s": "at_s"})
    aiding["rate_mps"] = aiding["code_delay_rate_s_per_s"] * C_MPS
    aiding = aiding[["at_s", "sv", "rate_mps", "range_acceleration_mps2", "sd_range_rate_mps"]]
    values = used.merge(measured, on=["time_s", "sv", "signal"]).sort_values("time_s")
    both = pd.merge_asof(values, aiding, left_on="time_s", right_on="at_s", by="sv", tolerance=0.02).dropna()
    lag_s = both["time_s"] - both["at_s"]
    both["miss_mps"] = both["measured_mps"] - both["rate_mps"] - lag_s * both["range_acceleration_mps2"]
    return both


@pytest.mark.real_data
@pytest.mark.parametrize(("name", "settled_s"), [("instinct", 10.0), ("xian", 20.0), ("walk", 60.0)])
def test_predicted_doppler_misses_the_measured_one_as_the_filters_own_prediction_does(
    name: str, settled_s: float
) -> None:
    """At the last sample before an epoch the aiding has not seen the epoch's Doppler: an honest prediction."""
    both = against_receiver(without_knock(name), settled_s)
    miss, own, sigma = (both[c].to_numpy() for c in ("miss_mps", "innovation", "sd_innovation"))
    assert len(both) > 400
    # the same prediction by other code: satellite pieces, slopes of the samples, extrapolation by up to 10 ms of lag
    assert np.sqrt(np.mean((miss - own) ** 2)) < 0.01
    ratio = float(np.sqrt(np.mean((miss / sigma) ** 2)))
    assert ratio == pytest.approx(float(np.sqrt(np.mean((own / sigma) ** 2))), rel=0.02)
    # measured: 0.68, 1.02, 0.95
    assert 0.3 < ratio < 1.25
