"""Ionosphere, troposphere, base station and slow faults over whole simulated flights: an aircraft over the airfield."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insgnss
from insgnss.config.flight import Base
from insgnss.constants import C_MPS, NS_PER_S
from insgnss.errors import NavigationDataError
from insgnss.gnss.ionosphere_rows import ionosphere_rows
from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.runs.gnss_rows import corrected_rows
from insgnss.runs.setup import setup_filter
from insgnss.simulation.atmosphere import broadcast_atmosphere, vacuum
from insgnss.simulation.faults import range_ramp
from insgnss.simulation.observations import NoiseTerms
from insgnss.simulation.sample_trajectories import AIRFIELD, static
from insgnss.simulation.simulated_log import SimulatedLog, Simulator
from insgnss.tables import Float64, GnssTable, NavigationData
from tests.runs.corrected_flights import (
    SETTLED_S,
    replayed,
    settings,
    statuses,
    two_clocks,
    under,
)
from tests.runs.scenes import (
    START_S,
    FlightInMemory,
    after,
    assert_honest,
    flight,
    paper_sky,
    position_error_m,
    simulator,
    turns,
    with_faults,
)


def test_residual_zenith_delay_is_estimated() -> None:
    """A wet delay of 0.25 m at the zenith beyond the model, ranges good to 2 cm."""
    standard = broadcast_atmosphere(None)

    def wetter(
        geodetic: Float64, azimuth: Float64, elevation: Float64, week_s: Float64, ionosphere: float = 1.0
    ) -> Float64:
        return np.asarray(
            standard(geodetic, azimuth, elevation, week_s, ionosphere) + 0.25 / np.sin(elevation)
        )

    base = under(turns(), wetter, pseudorange_noise=NoiseTerms(0.02))
    config = settings(ionosphere="none", zenith_delay=True, elevation_mask_deg=15.0)
    sharp = config.pseudorange_noise_m.model_copy(
        update={"floor": 0.02, "elevation": 0.0, "cn0_at_45_dbhz": 0.0, "correlation_time_s": 0.0}
    )
    run = replayed(flight(base), config.model_copy(update={"pseudorange_noise_m": sharp}))
    # 1 / sin and the model's mapping differ by 1 % at 15 deg; a tenth of the delay is left
    assert run.nav["zenith_delay_m"].iloc[-1] == pytest.approx(0.25, abs=0.03)
    assert "zenith_delay_m" not in replayed(flight(base), settings(ionosphere="none")).nav


COEFFICIENTS = {
    "galileo": np.array([120.0, 0.4, 0.01]),
    "beidou": np.array([2.2e-8, 3e-8, -4e-7, 6e-7, 1.1e5, 1e5, -5e5, 3e5]),
}


@cache
def errorless() -> tuple[Simulator, SimulatedLog, NavigationData]:
    """Return a flight without any error or air, and the messages with every model's coefficients."""
    base = under(turns(60.0), vacuum)
    return base, base.draw(None), replace(paper_sky(), ionosphere=COEFFICIENTS)


def delayed(model: str) -> tuple[FlightInMemory, Float64]:
    """Return the flight with the ionosphere of a model, evaluated at the true places, and the delays."""
    base, log, navigation = errorless()
    if model == "klobuchar":
        delays = under(turns(60.0), _only_klobuchar).draw(None).gnss.pseudorange_m - log.gnss.pseudorange_m
    else:
        states = satellite_states(log.gnss, navigation)
        delays = ionosphere_rows(
            log.gnss, navigation, model, log.at_gnss.t_ns, log.at_gnss.r_e, states.position
        )
    gnss = replace(log.gnss, pseudorange_m=log.gnss.pseudorange_m + delays)
    return flight(base, log, gnss=gnss, navigation=navigation), delays


def _only_klobuchar(
    geodetic: Float64, azimuth: Float64, elevation: Float64, week_s: Float64, ionosphere: float = 1.0
) -> Float64:
    with_air, without = (
        broadcast_atmosphere(k)(geodetic, azimuth, elevation, week_s, ionosphere)
        for k in (paper_sky().klobuchar, None)
    )
    return np.asarray(with_air - without)


def largest_innovation_m(flown: FlightInMemory, model: str) -> float:
    run = insgnss.replay(flown, settings(ionosphere=model, troposphere="none"))
    rows = run.measurements
    settled = (
        (rows["kind"] == "pseudorange") & (rows["time_s"] > START_S + SETTLED_S) & (rows["status"] == "used")
    )
    return float(rows.loc[settled, "innovation"].abs().max())


@pytest.mark.parametrize("model", ["nequick", "beidou", "own"])
def test_model_that_the_truth_was_made_with_leaves_nothing(model: str) -> None:
    """0.3 m: the filter's own errors in the turns, and NeQuick between its nodes."""
    flown, delays = delayed("klobuchar" if model == "own" else model)
    assert np.nanmin(delays) > 0.5
    right = largest_innovation_m(flown, model)
    wrong = largest_innovation_m(flown, "none")
    assert right < 0.3
    assert wrong > 3.0 * right


def test_prepared_delays_are_the_models_and_told() -> None:
    flown, delays = delayed("beidou")
    setup = setup_filter(flown, flown.logs, settings(ionosphere="beidou"))
    rows, events = corrected_rows(setup, flown.logs, flown)
    given = rows.observation["ionosphere_m"]
    # the place of the minute's single-point solution is tens of metres off, plus half a minute's straight flight
    assert np.nanmax(np.abs(given - delays)) < 0.02
    assert [e.kind for e in events] == ["ionosphere_models"] and "G beidou" in events[0].detail


@pytest.mark.parametrize("model", ["nequick", "beidou"])
def test_model_without_coefficients_is_a_typed_error(model: str) -> None:
    base, log, _ = errorless()
    with pytest.raises(NavigationDataError, match="coefficients"):
        insgnss.replay(flight(base, log), settings(ionosphere=model))


def test_model_for_a_log_without_messages_is_a_typed_error() -> None:
    """States in the log bring no coefficients: a constant delay of a model without them would be worse than none."""
    flight = two_clocks(0.0)
    flight = replace(flight, logs=replace(flight.logs, navigation=None))
    with pytest.raises(NavigationDataError, match="coefficients"):
        insgnss.replay(flight, settings(ionosphere="own"))


# ------------------------------------------------------------------------------------------------ two carriers


def stormy(
    geodetic: Float64, azimuth: Float64, elevation: Float64, week_s: Float64, ionosphere: float = 1.0
) -> Float64:
    """Return three times the ionosphere of the messages."""
    return broadcast_atmosphere(paper_sky().klobuchar)(geodetic, azimuth, elevation, week_s, 3.0 * ionosphere)


def test_combination_of_two_carriers_flies_through_an_ionosphere_that_no_message_tells() -> None:
    log = under(turns(), stormy, signals=("C1C", "C5Q")).draw(np.random.default_rng(1))
    alone = np.isin(log.gnss.sv_names, ["G01", "G30"])[log.gnss.sv] & (log.gnss.signal == 1)
    gnss = log.gnss.take(np.flatnonzero(~alone))
    flown = flight(under(turns(), stormy), log, gnss=gnss)
    run = replayed(flown, settings(ionosphere="ionosphere_free"))
    assert_honest(run, 0.0)
    counts = statuses(run, "G")
    assert sum(counts.values()) == len(gnss.t_ns) == run.status_counts()["pseudorange"].sum()
    pairs = int(np.sum((gnss.signal == 1) & np.isfinite(gnss.pseudorange_m)))
    assert counts["combined"] == pairs
    assert counts["no_second_signal"] == len(gnss.t_ns) - 2 * pairs
    assert set(statuses(run, "G", kind="range_rate")) == {"used", "used_for_start", "not_started"}
    # the noise of the combination is 2.6 times that of L1, so the height is good to metres at best
    free, single = (
        np.median(np.abs(after(r, 30.0)["d_d_m"])) for r in (run, replayed(flown, settings(every_band=False)))
    )
    assert free < 2.5 and single > 2.0 * free


# ------------------------------------------------------------------------------------------------ base station


@cache
def wrong_messages() -> NavigationData:
    """Return messages whose satellites are off by tens of metres along the track and in their clocks."""
    rng = np.random.default_rng(7)
    table = paper_sky().ephemerides
    n = len(table.sv_names)
    off = replace(
        table,
        m0=table.m0 + rng.normal(0.0, 15.0, n) / 2.66e7,
        af0=table.af0 + rng.normal(0.0, 8.0, n) / C_MPS,
    )
    return replace(paper_sky(), ephemerides=off)


def with_base(flown: FlightInMemory, base: GnssTable, **place: Any) -> FlightInMemory:
    lat, lon, h = AIRFIELD
    station = Base(
        files=(Path("base.rnx"),), lat_deg=lat, lon_deg=lon, h_m=place.get("h_m", h), max_age_s=10.0
    )
    config = flown.config.model_copy(update={"gnss": flown.config.gnss.model_copy(update={"base": station})})
    return replace(flown, config=config, logs=replace(flown.logs, base=base))


@cache
def base_log() -> GnssTable:
    """Return the log of a receiver at rest on the airfield, with the same sky and air and a clock of its own."""
    still = simulator(static(120.0, *AIRFIELD), 120.0)
    still = under(
        still,
        still.scenario.receiver.atmosphere,
        lever_arm_b=(0.0, 0.0, 0.0),
        pseudorange_noise=NoiseTerms(0.3),
    )
    return still.draw(np.random.default_rng(5)).gnss


def test_base_station_takes_out_what_both_receivers_share() -> None:
    spoilt = flight(turns(), navigation=wrong_messages())
    helped = with_base(spoilt, base_log())
    plain, corrected = (insgnss.replay(f, settings()) for f in (spoilt, helped))
    before, behind = (position_error_m(after(run, 30.0)) for run in (plain, corrected))
    assert np.median(before) > 5.0
    assert behind.max() < 2.5
    assert_honest(corrected, SETTLED_S)
    told = corrected.events[corrected.events["kind"] == "base_station"]["detail"].iloc[0]
    assert "100 %" in told


@pytest.mark.parametrize("model", ["own", "none"])
def test_base_station_and_flight_use_the_same_ionosphere(model: str) -> None:
    flown = with_base(flight(turns()), base_log())
    run = insgnss.replay(flown, settings(ionosphere=model))
    assert position_error_m(after(run, 30.0)).max() < 2.5
    assert_honest(run, SETTLED_S)


def test_base_station_of_another_day_is_a_typed_error() -> None:
    elsewhere = replace(base_log(), t_ns=base_log().t_ns + 600 * NS_PER_S)
    with pytest.raises(NavigationDataError, match="base station has no correction"):
        insgnss.replay(with_base(flight(turns()), elsewhere), settings())


def test_rows_that_the_base_does_not_see_are_named() -> None:
    base = base_log()
    hidden = base.take(np.flatnonzero(base.sv != base.sv_names.index("G13")))
    run = insgnss.replay(with_base(flight(turns()), hidden), settings())
    rows = run.measurements
    of_victim = rows[(rows["sv"] == "G13") & (rows["kind"] == "pseudorange")]
    assert set(of_victim["status"]) == {"no_correction"}
    assert_honest(run, SETTLED_S)


# ------------------------------------------------------------------------------------------------ slow faults


@pytest.mark.parametrize(("rate_mps", "found_s"), [(1.0, 25.0), (0.3, 60.0)])
def test_ramp_of_one_satellite_is_found_before_it_pulls_the_position_along(
    rate_mps: float, found_s: float
) -> None:
    run = replayed(flight(with_faults(turns(), [range_ramp("G13", rate_mps, 40.0)])), settings())
    rows = run.measurements
    mine = rows[(rows["sv"] == "G13") & (rows["kind"] == "pseudorange")]
    late = mine[mine["time_s"] > START_S + 40.0 + found_s]
    assert set(late["status"]) <= {"drifting", "gated", "inconsistent"}
    others = rows[
        (rows["sv"] != "G13") & (rows["kind"] == "pseudorange") & (rows["time_s"] > START_S + SETTLED_S)
    ]
    assert (others["status"] == "used").mean() > 0.995
    assert position_error_m(after(run, SETTLED_S)).max() < 3.0
    assert_honest(run, 0.0)
