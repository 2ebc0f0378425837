"""The consistency study finds what was put in: a noise 1.4 times the assumed, one bad satellite, errors that last."""

from __future__ import annotations

import copy
import dataclasses
import json
import math
import re
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from typer.testing import CliRunner

from insgnss.cli.consistency import number_cell
from insgnss.cli.main import app
from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.errors import ConfigError, ResultError
from insgnss.runs.agreement import HeadingAgreement
from insgnss.runs.replay import replay
from insgnss.runs.result import Run
from insgnss.simulation.observations import NoiseTerms
from insgnss.studies.consistency.error_statistics import independent_in_time
from insgnss.studies.consistency.innovation_statistics import (
    common_factor,
    fitted,
    independent_count,
    truncated_mean,
    whiteness_of,
)
from insgnss.studies.consistency.study import Consistency, consistency_study
from insgnss.studies.consistency.words import verdict
from insgnss.studies.outage.drift import stays_from
from tests.runs.scenes import START_S, flight, turns

BUILT_IN = 1.4


def assumed() -> FilterConfig:
    """Return the filter whose noise is just the simulated receiver's, not adapted to what it sees."""
    base = filter_config("tight17")
    noise = {
        kind: getattr(base, kind).model_copy(update={"correlation_time_s": 0.0})
        for kind in ("pseudorange_noise_m", "range_rate_noise_mps")
    }
    return base.model_copy(update={**noise, "adaptation": base.adaptation.model_copy(update={"on": False})})


@cache
def run_with(range_noise: float = 1.0, rate_noise: float = 1.0) -> Run:
    """Return a run over a flight whose receiver is noisier than the filter believes."""
    base = copy.copy(turns(240.0))
    terms = base.scenario.receiver
    receiver = dataclasses.replace(
        terms,
        pseudorange_noise=scaled(terms.pseudorange_noise, range_noise),
        range_rate_noise=scaled(terms.range_rate_noise, rate_noise),
    )
    base.scenario = dataclasses.replace(base.scenario, receiver=receiver)
    return replay(flight(base), assumed())


def scaled(terms: NoiseTerms, factor: float) -> NoiseTerms:
    return NoiseTerms(floor=terms.floor * factor, elevation=terms.elevation * factor, cn0=terms.cn0 * factor)


def row_of(study: Consistency, kind: str) -> pd.Series:
    return study.kinds.set_index("kind").loc[kind]


@pytest.mark.parametrize("kind", ["pseudorange", "range_rate"])
def test_nis_and_whiteness_of_a_matched_filter_are_inside_their_bounds(kind: str) -> None:
    study = consistency_study(run_with(), confidence=0.999)
    row = row_of(study, kind)

    assert row["low"] < row["mean_nis"] < row["high"]
    assert abs(row["mean_z"]) < row["mean_z_bound"]
    assert study.whiteness.set_index("kind").loc[kind, "p_value"].iloc[0] > 0.001
    of_satellites = study.satellites[study.satellites["kind"] == kind]
    assert of_satellites["mean_nis"].between(of_satellites["low"], of_satellites["high"]).all()


@pytest.mark.parametrize(
    ("kind", "words", "factors"),
    [
        ("pseudorange", "range noise", {"range_noise": BUILT_IN}),
        ("range_rate", "range rate noise", {"rate_noise": BUILT_IN}),
    ],
)
def test_noise_above_the_assumed_is_told_with_its_factor(
    kind: str, words: str, factors: dict[str, float]
) -> None:
    """2000 rows have 1300 degrees of freedom left and know a sigma to 2 %."""
    study = consistency_study(run_with(**factors))

    assert study.noise_factors[kind] == pytest.approx(BUILT_IN, rel=0.06)
    assert any(f": {words} is 1." in text and "times the assumed" in text for text in study.verdict)


def test_noise_below_the_assumed_is_told_too() -> None:
    study = consistency_study(run_with(range_noise=0.5))

    assert study.noise_factors["pseudorange"] == pytest.approx(0.5, rel=0.06)
    assert row_of(study, "pseudorange")["mean_nis"] < row_of(study, "pseudorange")["low"]


def altered(run: Run, sv: str, factor: float) -> Run:
    """Return a run in whose ledger one satellite's ranges are ``factor`` times as far from the predicted."""
    table = run.measurements.copy()
    rows = (table["sv"] == sv) & (table["kind"] == "pseudorange")
    table.loc[rows, "innovation"] *= factor
    return dataclasses.replace(run, measurements=table)


def test_satellite_noisier_than_the_others_is_named() -> None:
    study = consistency_study(altered(run_with(), "G13", 2.0))

    named = [text for text in study.verdict if "times the assumed" in text and text.startswith("G")]
    assert len(named) == 1
    assert named[0].startswith("G13: range noise")


def test_masked_rows_do_not_count_and_gated_ones_do() -> None:
    run = run_with()
    table = run.measurements.astype({"status": "str"})
    ranges = np.flatnonzero((table["kind"] == "pseudorange") & (table["status"] == "used"))
    table.loc[ranges[-100:-50], "status"] = "masked_gain"
    table.loc[ranges[-50:], "status"] = "gated"
    study = consistency_study(dataclasses.replace(run, measurements=table))
    before = row_of(consistency_study(run), "pseudorange")
    row = row_of(study, "pseudorange")

    assert row["used"] == before["used"] - 100
    assert row["refused"] == before["refused"] + 50


def test_mean_of_squares_behind_a_gate_agrees_with_drawn_ones() -> None:
    z = np.random.default_rng(1).standard_normal(400_000)
    for gate in (1.0, 2.0, 3.0):
        cut = z[np.abs(z) < gate] ** 2
        assert cut.mean() == pytest.approx(truncated_mean(gate), abs=4.0 * cut.std() / np.sqrt(len(cut)))


def drawn_rows(noise: float, rng: np.random.Generator) -> pd.DataFrame:
    """Return rows of 500 epochs of nine satellites: the state's error common to an epoch, and noise."""
    n_epochs, n = 500, 9
    u = rng.standard_normal((n_epochs, n, 3))
    u /= np.linalg.norm(u, axis=2)[..., None]
    state = rng.standard_normal((n_epochs, 4)) * 2.0
    r = rng.uniform(0.5, 2.0, (n_epochs, n))
    nu = -np.einsum("eij,ej->ei", u, state[:, :3]) + state[:, 3:]
    nu += noise * np.sqrt(r) * rng.standard_normal((n_epochs, n))
    table = {
        "time_s": np.repeat(np.arange(n_epochs), n),
        "clock": "G",
        "innovation": nu.ravel(),
        "r": r.ravel(),
    }
    table["share"] = 1.0 - r.ravel() / (r.ravel() + 8.0)  # sigma 2 along the line of sight and of the clock
    return pd.DataFrame(table | dict(zip(("u_n", "u_e", "u_d"), u.reshape(-1, 3).T, strict=True)))


def test_noise_factor_does_not_see_the_states_error() -> None:
    """4500 rows of 2500 degrees of freedom know a sigma to 1.4 %; the innovations themselves are 3 sigmas wide."""
    rows = drawn_rows(BUILT_IN, np.random.default_rng(6))
    rows["residual"], rows["leverage"] = fitted(rows)

    assert common_factor(rows, 30.0) == pytest.approx(BUILT_IN, rel=0.05)
    assert np.std(rows["innovation"] / np.sqrt(rows["r"])) > 2.5


def test_noise_factor_behind_a_tight_gate_is_that_of_the_noise() -> None:
    """Behind 2.5 sigmas what is left would pass for 1.9 or less instead of 2: the gate's share is put back."""
    rows = drawn_rows(2.0, np.random.default_rng(7))
    z = rows["innovation"] / np.sqrt(rows["r"] / (1.0 - rows["share"]))
    seen = rows[(np.abs(z) < 2.5).to_numpy()].copy()
    seen["residual"], seen["leverage"] = fitted(seen)

    assert common_factor(seen, 30.0) < 1.95
    assert common_factor(seen, 2.5) == pytest.approx(2.0, rel=0.05)


def test_rows_that_share_the_states_error_are_worth_fewer() -> None:
    time_s = np.repeat(np.arange(100.0), 10)

    assert independent_count(time_s, np.zeros(1000)) == pytest.approx(1000.0)
    assert independent_count(time_s, np.full(1000, 0.5)) == pytest.approx(1000.0 / 3.25)


def sequence(correlation: float, seed: int) -> pd.DataFrame:
    """Return scaled innovations of eight satellites, each first-order Gauss-Markov from epoch to epoch."""
    rng = np.random.default_rng(seed)
    n, z = 400, np.zeros((8, 400))
    z[:, 0] = rng.standard_normal(8)
    for k in range(1, n):
        z[:, k] = correlation * z[:, k - 1] + np.sqrt(1.0 - correlation**2) * rng.standard_normal(8)
    names = np.repeat([f"G{i:02d}" for i in range(8)], n)
    table = {
        "time_s": np.tile(np.arange(n) * 0.5, 8),
        "sv": names,
        "signal": "C1C",
        "z": z.ravel(),
        "share": 0.0,
    }
    return pd.DataFrame(table)


def test_whiteness_of_white_innovations_has_the_chance_it_states() -> None:
    """Of 200 white sequences 1 % may be called correlated; six are beyond what a binomial allows once in 3000."""
    found = [whiteness_of(sequence(0.0, seed), 0.5, 10, 0.99) for seed in range(200)]
    p_values = np.array([w.p_value for w in found if w is not None])

    assert np.count_nonzero(p_values < 0.01) <= stats.binom.ppf(0.9997, 200, 0.01)
    assert stats.kstest(p_values, "uniform").pvalue > 0.001


def test_whiteness_of_lasting_errors_gives_their_correlation_and_time() -> None:
    found = whiteness_of(sequence(0.6, 3), 0.5, 10, 0.99)

    assert found is not None
    assert found.correlation[:2] == pytest.approx([0.6, 0.36], abs=0.06)
    assert found.correlation_time_s == pytest.approx(-0.5 / np.log(0.6), rel=0.15)
    assert found.p_value < 1e-6


def test_series_of_lasting_errors_is_worth_what_theory_says() -> None:
    """A first-order series: sum of rho^2k gives n (1 - r^2) / (1 + r^2)."""
    z = sequence(0.9, 4)["z"].to_numpy()

    assert independent_in_time(z) == pytest.approx(len(z) * 0.19 / 1.81, rel=0.3)


def test_state_is_known_from_where_its_sigma_stays_below_the_limit() -> None:
    t, sigma = np.arange(6.0), np.array([9.0, 4.0, 9.0, 4.0, 3.0, 2.0])

    assert stays_from(t, sigma < 5.0) == 3.0
    assert np.isnan(stays_from(t, sigma < 2.0))
    assert stays_from(t, sigma < 10.0) == 0.0


def test_heading_and_biases_are_told_from_when_on_they_are_known() -> None:
    run = run_with()
    study = consistency_study(run)
    heading = study.observability.set_index("state").loc["yaw_deg"]

    assert heading["known_s"] == run.heading_known_s() > START_S
    assert any(text.startswith(f"heading known from t = {heading['known_s']:g} s") for text in study.verdict)


def test_errors_larger_than_their_sigma_are_called_too_confident() -> None:
    run = run_with()
    assert run.errors is not None
    worse = run.errors.copy()
    worse[["d_n_m", "d_e_m", "d_d_m"]] *= 5.0
    sound, found = consistency_study(run), consistency_study(dataclasses.replace(run, errors=worse))

    assert not any("overconfident" in text for text in sound.verdict)
    assert any(text.startswith("position") and "overconfident" in text for text in found.verdict)


def test_run_without_reference_has_no_errors_and_adapting_filter_is_told() -> None:
    run = run_with()
    adapting = {**run.settings, "filter": {**run.settings["filter"], "adaptation": {"on": True}}}
    study = consistency_study(dataclasses.replace(run, errors=None, settings=adapting))

    assert study.states.empty
    assert any("adapts its noise levels" in text for text in study.verdict)
    assert not any("adapts its noise levels" in text for text in consistency_study(run).verdict)


def test_filter_that_widens_its_sigma_for_lasting_errors_has_the_plain_factor() -> None:
    """The library's filter weighs ranges of 1 Hz less by 2.5; its ledger and the factor are beside the plain sigma."""
    base = filter_config("tight17")
    config = base.model_copy(update={"adaptation": base.adaptation.model_copy(update={"on": False})})
    study = consistency_study(replay(flight(turns(240.0)), config))

    assert base.pseudorange_noise_m.correlation_time_s == 2.5
    assert study.noise_factors["pseudorange"] == pytest.approx(1.0, abs=0.06)


def test_time_after_the_run_is_refused_with_advice() -> None:
    with pytest.raises(ResultError, match="too few measurements"):
        consistency_study(run_with(), from_s=1e9)
    with pytest.raises(ConfigError, match="confidence"):
        consistency_study(run_with(), confidence=1.0)


def test_command_prints_the_verdict_and_writes_tables_and_picture(tmp_path: Path) -> None:
    run_with(range_noise=BUILT_IN).save(tmp_path / "run")
    result = CliRunner().invoke(app, ["consistency", str(tmp_path / "run"), "-o", str(tmp_path / "out")])

    assert result.exit_code == 0, result.output
    assert "range noise is 1.4 times the assumed" in result.output
    kinds = pd.read_csv(tmp_path / "out" / "consistency_kinds.csv").set_index("kind")
    shown = re.findall(r"^│ (pseudorange|range_rate) +│ +(\d+) │", result.output, re.MULTILINE)
    assert {kind: int(used) for kind, used in shown} == kinds["used"].to_dict()
    told = json.loads((tmp_path / "out" / "consistency_verdict.json").read_text(encoding="utf-8"))
    assert told["noise_factors"]["pseudorange"] == pytest.approx(BUILT_IN, rel=0.06)
    assert (tmp_path / "out" / "consistency.png").stat().st_size > 10_000
    assert len(pd.read_csv(tmp_path / "out" / "consistency_kinds.csv")) == 2


@pytest.mark.parametrize(
    ("number", "shown"),
    [(11513.0, "11513"), (1.05149, "1.051"), (20, "20"), (math.nan, ""), (math.inf, "inf")],
)
def test_count_is_printed_with_all_its_digits(number: float, shown: str) -> None:
    assert number_cell(number) == shown


@pytest.mark.parametrize(
    ("nis", "low", "high", "factor", "words"),
    [
        (0.981, 0.903, 1.102, 1.1, "agree with their sigma: range rate noise is as assumed"),
        (0.981, 0.903, 1.102, 1.3, "range rate noise is 1.3 times the assumed, judged by the residuals"),
        (1.15, 0.8, 1.2, 1.1, "are 1.1 times their sigma, within chance: range rate noise is as assumed"),
        (1.15, 0.9, 1.1, 1.1, "are 1.1 times their sigma: range rate noise is 1.1 times the assumed"),
        (1.06, 0.98, 1.02, 1.07, "within 3 %, not by chance: range rate noise is 1.1 times the assumed"),
        (1.06, 0.98, 1.02, 1.02, "within 3 %, not by chance: range rate noise is as assumed within 2 %"),
        (1.15, 0.9, 1.1, np.nan, "are 1.1 times their sigma: range rate noise is above the assumed"),
    ],
)
def test_innovations_and_noise_are_judged_once(
    nis: float, low: float, high: float, factor: float, words: str
) -> None:
    row = {"mean_nis": nis, "low": low, "high": high, "factor": factor, "refused": 0, "used": 100, "dof": 100}
    none = pd.DataFrame({"kind": "", "state": "", "reduction": 0.0, "known_s": 0.0}, index=[])
    kinds = pd.DataFrame([{"kind": "range_rate", **row}])
    heading = HeadingAgreement(None, False, 90.0, 90.0, 90.0, 5.0)
    told = verdict(kinds, none, none, none, none, 0.01, heading, adapts=False)[0]

    assert f"{words} (mean NIS {nis:.3f}, bounds" in told
