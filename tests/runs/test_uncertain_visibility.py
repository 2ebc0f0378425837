"""Satellites too near to an antenna's edge for the attitude that is known: kept, hidden, or kept with more noise."""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from insgnss.config.filter import FilterConfig
from insgnss.config.library import scenario_config
from insgnss.filter.engine import FilterEngine
from insgnss.filter.whole_log import run_filter
from insgnss.log.flight import FlightInMemory
from insgnss.runs.replay import replay
from insgnss.runs.result import Run
from insgnss.runs.setup import setup_filter
from insgnss.studies.masking.banked_flight import BankedFlight
from insgnss.studies.masking.cases import _flight_in_memory, _log
from insgnss.studies.scenario_equipment import filter_of
from tests.filter.test_engine import no_delay, stream

SETTINGS = ("keep", "hide", "deweight")
KEYS = ["time_s", "sv", "kind"]
MASKED = "masked_gain"


@cache
def flight() -> FlightInMemory:
    """Return a minute with a bank of 20 s on which a satellite stands near the edge; heading known to 3 deg."""
    base = scenario_config("sokolov_2015")
    parts = {
        "bank": base.bank.model_copy(update={"roll_deg": 35.0, "heading_deg": 60.0}),
        "outage": base.outage.model_copy(update={"from_s": 20.0, "until_s": 40.0}),
        "flight": base.flight.model_copy(update={"duration_s": 60.0, "imu_rate_hz": 50.0}),
    }
    banked = BankedFlight.of(base.model_copy(update=parts), "tactical", "tcxo")
    drawn = banked.draw(np.random.default_rng(4))
    return _flight_in_memory(banked, drawn, _log(drawn, []))


def settings(uncertain: str) -> FilterConfig:
    """Return the paper's filter with its stage and this setting."""
    base = filter_of(scenario_config("sokolov_2015"))
    return base.model_copy(update={"visibility": base.visibility.model_copy(update={"uncertain": uncertain})})


@cache
def run(uncertain: str) -> Run:
    return replay(flight(), settings(uncertain))


def rows(uncertain: str) -> pd.DataFrame:
    """Return the ledger of pseudoranges and range rates by time, satellite and kind."""
    table = run(uncertain).measurements.astype({"sv": "str", "kind": "str", "status": "str"})
    return table.set_index(KEYS).sort_index()


def counted(uncertain: str) -> int:
    """Return how many satellite-epochs the events tell of."""
    told = run(uncertain).events
    return sum(int(d.split()[0]) for d in told.loc[told["kind"] == "masking_uncertain", "detail"])


def first_difference(a: str, b: str) -> pd.DataFrame:
    """Return the rows of the first epoch at which two settings tell different things, those of ``a`` first."""
    both = rows(a).merge(rows(b), left_index=True, right_index=True, suffixes=("_a", "_b"))
    sigma = both[["sd_innovation_a", "sd_innovation_b"]].fillna(0.0)
    other = (both["status_a"] != both["status_b"]) | (sigma["sd_innovation_a"] != sigma["sd_innovation_b"])
    assert other.any()
    time_s = both.index.get_level_values("time_s")
    return both[other.to_numpy() & (time_s == time_s[other.to_numpy()].min())]


def test_hide_refuses_what_keep_uses() -> None:
    first = first_difference("keep", "hide")

    assert (first["status_a"] == "used").all()
    assert (first["status_b"] == MASKED).all()
    assert set(first.index.get_level_values("kind")) == {"pseudorange", "range_rate"}


def test_deweighted_rows_have_the_variance_of_their_doubt() -> None:
    first = first_difference("keep", "deweight")
    added = first["sd_innovation_b"] ** 2 - first["sd_innovation_a"] ** 2
    limits = settings("deweight").visibility

    assert (first["status_b"] == "used").all()
    by_kind = added.unstack("kind")
    # the states are alike up to there: one probability for both kinds, between three sigmas on either side
    p = by_kind["pseudorange"] / limits.false_range_m**2
    np.testing.assert_allclose(p, by_kind["range_rate"] / limits.false_rate_mps**2, rtol=1e-3)
    assert ((p > stats.norm.sf(3.0)) & (p < stats.norm.cdf(3.0))).all()


@pytest.mark.parametrize("uncertain", SETTINGS)
def test_satellite_epochs_within_the_margin_are_counted_in_the_events(uncertain: str) -> None:
    words = {"keep": "stay in use", "hide": "not used", "deweight": "more noise"}
    told = run(uncertain).events
    details = told.loc[told["kind"] == "masking_uncertain", "detail"]

    assert 0 < counted(uncertain) < 60 * 11
    assert all(words[uncertain] in detail for detail in details)
    if uncertain == "hide":
        # hidden by that alone: what keep, which decides by the attitude before, has in use at the same time
        ranges = (slice(None), slice(None), "pseudorange")
        hidden = rows("hide").loc[ranges, "status"] == MASKED
        kept = rows("keep").loc[ranges, "status"] == "used"
        assert 0 < (hidden & kept).sum() <= counted("hide")


def test_noise_levels_are_not_adapted_to_what_was_made_larger() -> None:
    """A row with the noise of a false lock that behaves like its neighbours would make all of them seem better."""
    sigma = {
        name: rows(name).xs("range_rate", level="kind")["sd_innovation"] for name in ("keep", "deweight")
    }
    last = sigma["keep"].index.get_level_values("time_s") > 55.0
    assert sigma["deweight"][last].mean() == pytest.approx(sigma["keep"][last].mean(), rel=0.02)


@pytest.mark.parametrize("uncertain", SETTINGS)
def test_stream_gives_the_bits_and_the_events_of_replay(uncertain: str) -> None:
    own = flight()
    setup = setup_filter(own, own.logs, settings(uncertain))
    engine = FilterEngine(setup)
    stream(engine, own.logs, no_delay())
    results = engine.take_results(all_of_them=True)
    whole = setup.rows(own.logs.gnss, setup.navigation)
    out, events = run_filter(setup, own.logs.imu, whole, "gnss")

    for epoch, result in enumerate(results):
        entries = out.ledger[whole.first[epoch] : whole.first[epoch + 1]]
        assert result.out.ledger.tobytes() == entries.tobytes()
    told = [e for e in events if e.kind == "masking_uncertain"]
    assert told == [e for e in engine.events if e.kind == "masking_uncertain"] != []
