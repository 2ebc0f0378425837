"""Protection levels: bound errors with the stated risk, with and without a fault; told by alerts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import insgnss
from insgnss.cli.main import app
from insgnss.config.integrity import Integrity
from insgnss.errors import ConfigError
from insgnss.log.flight import FlightInMemory
from insgnss.runs.integrity.faults import Fault, fault_model
from insgnss.runs.integrity.separation import Separation, protection_level, protection_of
from insgnss.runs.simulate import simulate
from insgnss.tables import Float64
from tests.benchmarks.trust.motions import scenario, turn
from tests.runs.scenes import flight, turns
from tests.sensors.test_fixes_alone import fixes_alone
from tests.statistics_bounds import share_below_bounds

# a filter whose sizes are changed uses its own, not the flight's, in which nothing lasts
OF_A_SKY = {"slow_errors.satellite_m": {"G": 0.6}}
# gates, tests and recovery that would take a fault away before it moves the solution
OPEN = {
    "gates.pseudorange_sigma": 1000.0,
    "gates.range_rate_sigma": 1000.0,
    "faults.residual_sigma": 0.0,
    "faults.drift_sigma": 0.0,
    "adaptation.rate_memory_s": 0.0,
    "faults.weights": "gate",
    "adaptation.on": False,
    "health.recovery": False,
}


def with_fault(flown: FlightInMemory, sv: str, from_s: float, size_m: float) -> FlightInMemory:
    """Return a flight one of whose satellites has ranges that are too long from a time after the start on."""
    gnss = flown.logs.gnss
    wrong = (gnss.sv == gnss.sv_names.index(sv)) & (gnss.t_ns >= gnss.t_ns[0] + round(from_s * 1e9))
    ranges = np.where(wrong, gnss.pseudorange_m + size_m, gnss.pseudorange_m)
    return replace(flown, logs=replace(flown.logs, gnss=replace(gnss, pseudorange_m=ranges)))


def beyond(run: insgnss.Run) -> pd.DataFrame:
    """Return errors over protection levels, horizontal and vertical."""
    assert run.errors is not None
    both = run.errors.merge(run.nav[["time_s", "hpl_m", "vpl_m"]], on="time_s")
    horizontal = np.hypot(both["d_n_m"], both["d_e_m"]) / both["hpl_m"]
    return pd.DataFrame({"horizontal": horizontal, "vertical": both["d_d_m"].abs() / both["vpl_m"]})


def test_level_is_exceeded_no_more_often_than_stated(rng: np.random.Generator) -> None:
    """Faults so frequent, and a risk so large, that 100 000 draws count the exceedances; a fault moves x_0 alone."""
    n, k, p, risk = 100_000, 4, 0.02, 2e-3
    information = rng.uniform(0.5, 2.0, k + 1)  # what each satellite and the INS tell
    noise = rng.standard_normal((k + 1, n)) / np.sqrt(information)[:, None]
    faulty = rng.uniform(size=(k, n)) < p
    faulty &= faulty.sum(axis=0) == 1  # of two at once, no level says anything
    size = np.vstack([np.where(faulty, rng.uniform(-30.0, 30.0, (k, n)), 0.0), np.zeros((1, n))])
    measured = noise + size

    def solution(left_out: int | None) -> tuple[Float64, float]:
        of = np.where(np.arange(k + 1) == left_out, 0.0, information)
        return of @ measured / of.sum(), float(1.0 / np.sqrt(of.sum()))

    x, sigma = solution(None)
    d, of_faults = np.empty((k, n)), np.empty((k, n))
    for i in range(k):
        sub, of_faults[i] = solution(i)
        d[i] = sub - x
    level = protection_level(np.full(n, sigma), d, of_faults, np.full(k, p), risk)
    exceeded = np.abs(x) > level
    most = share_below_bounds(risk, n)[1]
    assert exceeded.mean() <= most
    # a fault is what takes the level up: without the separations it would be exceeded by faults
    alone = protection_level(np.full(n, sigma), np.zeros((k, n)), of_faults, np.full(k, p), risk)
    assert (np.abs(x) > alone).mean() > most


def test_level_of_a_fault_without_a_solution_is_infinite_and_a_rare_one_is_left_out() -> None:
    sigma, d = np.array([1.0, 1.0]), np.array([[0.5, np.nan]])
    level = protection_level(sigma, d, np.array([[2.0, np.nan]]), np.array([1e-3]), 1e-4)
    assert np.isfinite(level[0]) and np.isinf(level[1])
    rare = protection_level(sigma, d, np.array([[2.0, np.nan]]), np.array([1e-6]), 1e-4)
    assert np.isfinite(rare).all()


def test_faultless_flight_stays_below_its_levels_and_keeps_its_solution() -> None:
    flown = flight(turns(120.0), seed=901)
    run, plain = (
        insgnss.replay(flown, integrity=True),
        insgnss.replay(flown),
    )
    pd.testing.assert_frame_equal(run.nav[plain.nav.columns], plain.nav)
    assert (beyond(run) < 1.0).all().all()
    assert run.integrity is not None and not run.integrity["alert_rows"].any()
    assert set(run.integrity["fault"]) >= set(run.satellites["sv"].unique()) - {"-"}
    assert np.median(run.nav["hpl_m"]) < 12.0 * np.median(np.hypot(run.nav["sd_n_m"], run.nav["sd_e_m"]))


@pytest.mark.parametrize("size_m", [8.0, -40.0, 200.0])
def test_fault_that_the_filter_believes_is_within_the_levels_and_told(size_m: float) -> None:
    flown = flight(turns(70.0), seed=902)
    sv = sorted(flown.logs.gnss.sv_names)[1]
    run = insgnss.replay(with_fault(flown, sv, 40.0, size_m), settings=OPEN, integrity=True)
    assert (beyond(run) < 1.0).all().all()
    assert run.integrity is not None and run.errors is not None
    if abs(size_m) > 20.0:
        assert np.hypot(run.errors["d_n_m"], run.errors["d_e_m"]).max() > 3.0  # the filter does believe it
        details = run.events[run.events["kind"] == "integrity_alert"]["detail"].tolist()
        assert [detail.startswith(f"suspect {sv}: ") for detail in details] == [True]


def test_levels_hold_the_errors_that_last() -> None:
    """By six of their sigmas at least, whether they are sd_slow_* or states of the filter."""
    flown = flight(turns(60.0), seed=905)
    run = insgnss.replay(flown, settings=OF_A_SKY, integrity=True)
    assert (run.nav["sd_slow_d_m"].iloc[1:] > run.nav["sd_d_m"].iloc[1:] / 2.0).all()
    assert (run.nav["vpl_m"] > 5.0 * run.nav["sd_d_m"]).all()
    with_states = OF_A_SKY | {"process.range_bias_states": True}
    states = insgnss.replay(flown, settings=with_states, integrity=True).nav
    assert (states["vpl_m"] > 5.0 * states["sd_d_m"]).all()
    assert 0.5 < states["vpl_m"].iloc[-1] / run.nav["vpl_m"].iloc[-1] < 2.0


def test_levels_are_saved_and_loaded(tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("run") / "run"
    run = insgnss.replay(flight(turns(20.0), seed=903), integrity=True)
    run.save(folder)
    loaded = insgnss.Run.load(folder)
    assert run.integrity is not None and loaded.integrity is not None
    pd.testing.assert_frame_equal(loaded.integrity, run.integrity)
    assert {"hpl_m", "vpl_m"} <= set(loaded.nav.columns)


def test_smooth_command_gives_levels_of_the_smoothed_solution(tmp_path: Path) -> None:
    """Smaller than those of the filter, and still above the errors."""
    text = scenario("levels", turn(90.0, 30.0), turn(-90.0, 30.0), speed_mps=60.0)
    (tmp_path / "levels.toml").write_text(text, encoding="utf-8")
    simulate(tmp_path / "levels.toml", 906).save(tmp_path / "logs")
    runs = []
    for command in ("replay", "smooth"):
        folder = tmp_path / command
        wanted = [command, str(tmp_path / "logs" / "flight.toml"), "--integrity", "--output", str(folder)]
        assert CliRunner().invoke(app, wanted).exit_code == 0
        runs.append(insgnss.Run.load(folder))
    filtered, smoothed = runs
    assert smoothed.nav["hpl_m"].median() < filtered.nav["hpl_m"].median()
    assert (beyond(smoothed) < 1.0).all().all()


def test_rows_whose_risk_two_faults_spend_have_no_level_and_one_event_says_so() -> None:
    settings = {"integrity.satellite_fault": 1e-2}
    run = insgnss.replay(flight(turns(20.0), seed=904), settings=settings, integrity=True)
    assert np.isinf(run.nav[["hpl_m", "vpl_m"]].to_numpy()).all()
    (detail,) = run.events[run.events["kind"] == "integrity_risk_spent"]["detail"]
    assert f"{len(run.nav)} of {len(run.nav)} rows" in detail and "integrity.risk" in detail


def test_only_rows_with_too_many_satellites_are_without_a_level() -> None:
    """The risk of each row is its own, not that of the worst row of the log."""
    sigma, none = np.ones((3, 4)), np.zeros((1, 3, 4))
    nav = pd.DataFrame({f"sd_{axis}_m": sigma[0] for axis in "ned"} | {"time_s": np.arange(4.0)})
    fault = Fault("G01", np.array([1]), 1e-5)
    unmonitored = np.array([0.0, 5e-8, 1e-7, 2e-7])
    separation = Separation([fault], unmonitored, none, none + 1.0, np.zeros((1, 4)), np.arange(4))
    protection = protection_of(separation, nav, np.arange(4), Integrity())
    assert np.isfinite(protection.hpl_m).tolist() == [True, True, False, False]
    assert protection.hpl_m[0] < protection.hpl_m[1] < 1.1 * protection.hpl_m[0]
    (event,) = protection.events
    assert event.kind == "integrity_risk_spent" and "2 of 4 rows" in event.detail and event.t_ns == 2


def test_log_without_a_usable_satellite_has_the_levels_of_its_sigmas() -> None:
    assert fault_model([], Integrity()).faults == []
    nav = pd.DataFrame({f"sd_{axis}_m": np.ones(2) for axis in "ned"} | {"time_s": np.arange(2.0)})
    separation = Separation([], np.zeros(2), *[np.zeros((0, 3, 2))] * 2, np.zeros((0, 2)), np.arange(2))
    protection = protection_of(separation, nav, np.arange(2), Integrity())
    assert np.isfinite(protection.hpl_m).all() and not protection.events and not len(protection.faults)
    assert "separation_m" in protection.faults


def test_flight_without_raw_gnss_data_is_refused_before_it_is_read() -> None:
    said: list[str] = []
    with pytest.raises(ConfigError, match="without raw GNSS data") as refused:
        insgnss.replay(fixes_alone(turns(90.0), 2), integrity=True, progress=said.append)
    assert refused.value.key == "integrity" and not said
