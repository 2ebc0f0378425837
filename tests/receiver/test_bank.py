"""The supervisor over a hand-made run: a left bank hides five of eleven satellites, and every consequence is known."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pymap3d
import pytest

from insgnss.aiding.trace import Covariances, FilterTrace, TraceSamples, trace_rows
from insgnss.antenna.visibility import HIDDEN, IS_UNCERTAIN, IS_VISIBLE
from insgnss.config.search import Search
from insgnss.constants import C_MPS, NS_PER_S
from insgnss.errors import InputError
from insgnss.filter.state import DR, PSI
from insgnss.gnss.signals import L1_HZ
from insgnss.receiver import Outlook, SupervisedRun, outlook, sightings_of, supervise_run
from insgnss.receiver.events import LOCK, LOSS, SEARCHES, ReceiverEvents
from insgnss.receiver.predictions import scales
from insgnss.receiver.supervised_run import presence
from insgnss.receiver.tracking_state import MISSING, NOT_KNOWN, PRESENT
from insgnss.simulation.constellation import satellite_states
from insgnss.simulation.sample_trajectories import AIRFIELD
from insgnss.simulation.sky import PAPER_SKY
from insgnss.tables import GnssTable
from tests.antenna.vehicle import HIDDEN_FIVE
from tests.receiver.banking import (
    BANK_S,
    banking_run,
    is_banked,
    sightings_without,
    sky,
    supervision_setup,
    times_ns,
    usual_covariance,
)
from tests.runs.scenes import START_NS, START_S, WEEK, paper_sky

ALL = tuple(f"G{track.number:02d}" for track in PAPER_SKY)
WAVELENGTH_M = C_MPS / L1_HZ
STEP_S = 0.1


@cache
def banked_view(pattern: str | None = "cardioid") -> Outlook:
    return outlook(supervision_setup(pattern), sky(), banking_run())


@cache
def banked(pattern: str | None = "cardioid") -> SupervisedRun:
    """Return the run with a receiver that sees the hidden five again 0.3 s after the bank."""
    sightings = sightings_without(HIDDEN_FIVE, BANK_S[1] + 0.3)
    return supervise_run(banked_view(pattern), sightings, Search(), WEEK)


def story(result: SupervisedRun, sv: str) -> list[tuple[float, str, str, str]]:
    """Return time since the start [s], states and reason of each transition of a satellite."""
    rows = result.transitions[result.transitions["sv"] == sv]
    return [
        (round(float(r.time_s) - START_S, 3), str(r.from_state), str(r.to_state), str(r.reason))
        for r in rows.itertuples()
    ]


def test_bank_gives_the_hidden_five_and_them_alone_every_transition() -> None:
    result = banked()

    begins = [(0.0, "absent", "track", "tracked_at_start")]
    for sv in ALL:
        bank = [
            (80.0, "track", "hold", "hidden"),
            (100.2, "hold", "control_detection", "visible_again"),  # visible for 0.2 s
            (100.3, "control_detection", "resume", "detected"),
            (100.8, "resume", "track", "pulled_in"),
        ]
        assert story(result, sv) == begins + (bank if sv in HIDDEN_FIVE else []), sv
    assert len(result.transitions) == 11 + 5 * 4
    assert result.transitions["time_s"].is_monotonic_increasing


def test_hidden_satellites_stay_predicted_as_the_others() -> None:
    table = banked().supervision

    assert len(table) == 11 * len(times_ns())
    held = table[table["state"] == "hold"]
    assert set(held["sv"].astype("str")) == HIDDEN_FIVE
    # 20 s of the bank and 0.2 s until a detection is tried
    assert held.groupby("sv", observed=True).size().tolist() == [202] * 5
    assert np.isfinite(table.select_dtypes("number")).all(axis=None)
    # the cardioid's gain stands for 5 deg in the body, and the link budget is 45 dBHz
    assert (held["gain_dbi"][held["decision"] == "hidden"] < -5.3).all()
    np.testing.assert_allclose(table["cn0_dbhz"], 45.0 + table["gain_dbi"], rtol=1e-12)


def test_elevations_are_those_of_the_simulated_satellites() -> None:
    table = banked().supervision
    t_ns = times_ns()[[0, 700, 1199]]
    lat_deg, lon_deg, h_m = AIRFIELD
    # 75 ms of light time, and what the Earth turns meanwhile: 5e-6 rad
    r_e = satellite_states(
        paper_sky().ephemerides, START_NS, (t_ns - START_NS)[:, None] / NS_PER_S - 0.075
    ).r_e
    _, elevation_deg, _ = pymap3d.ecef2aer(*np.moveaxis(r_e, -1, 0), lat_deg, lon_deg, h_m)
    names = list(paper_sky().ephemerides.sv_names)
    found = table.pivot(index="time_s", columns="sv", values="el_deg")[names].iloc[[0, 700, 1199]]

    np.testing.assert_allclose(found, elevation_deg, atol=np.degrees(1e-5))


def test_predicted_doppler_is_the_rate_of_the_predicted_pseudorange() -> None:
    for _, rows in banked().supervision.groupby("sv", observed=True):
        delay = rows["pseudorange_m"].to_numpy()
        rate = (delay[2:] - delay[:-2]) / (2.0 * STEP_S)
        # h^2 / 6 of a jerk below 2e-4 m/s^3 is 3e-7 m/s; 2.3e7 m have 4e-9 m of rounding
        np.testing.assert_allclose(-rows["doppler_hz"].to_numpy()[1:-1] * WAVELENGTH_M, rate, atol=2e-6)


def test_transition_rows_hold_the_prediction_of_their_time() -> None:
    result = banked()
    table = result.supervision.set_index(["time_s", "sv"])
    for row in result.transitions.itertuples():
        same = table.loc[(row.time_s, row.sv)]
        assert row.pseudorange_m == same["pseudorange_m"]
        assert row.doppler_hz == pytest.approx(same["doppler_hz"], rel=1e-12)
        assert row.sd_range_m == same["sd_range_m"]
        # position 1 m and clock 1 m; velocity and drift 0.03 m/s each, position through 3 km/s over 20 000 km
        assert row.sd_range_m == pytest.approx(np.sqrt(2.0), rel=1e-12)
        assert row.sd_doppler_hz * WAVELENGTH_M == pytest.approx(np.hypot(0.03, 0.03), rel=1e-4)


@pytest.mark.parametrize("pattern", ["isotropic", None])
def test_isotropic_antenna_holds_nothing(pattern: str | None) -> None:
    result = banked(pattern)

    assert "hold" not in set(result.transitions["to_state"].astype("str"))
    assert (result.supervision["decision"] == "visible").all()
    assert (result.supervision["gain_dbi"].abs() < 1e-12).all()


def test_without_attitude_the_same_loss_is_searched_for() -> None:
    result = banked(None)

    for sv in HIDDEN_FIVE:
        reasons = [reason for *_, reason in story(result, sv)]
        assert reasons[1:4] == ["signal_lost", "control_failed", "search_failed"], sv


def test_receiver_without_supervisor_searches_while_the_supervised_one_waits() -> None:
    times = banked().search_times.set_index("sv")
    hidden, others = times.loc[sorted(HIDDEN_FIVE)], times.drop(index=sorted(HIDDEN_FIVE))

    assert (hidden["search_s"] == 0.0).all()
    np.testing.assert_allclose(hidden["hold_s"], 20.2, atol=1e-9)
    # in vain from 80.0 to 100.2 s, the last time without the signal, then half a sweep of 3.16 s
    np.testing.assert_allclose(hidden["unsupervised_in_vain_s"], 20.2, atol=1e-9)
    np.testing.assert_allclose(hidden["unsupervised_s"], 20.2 + 0.5 * 3.163, atol=1e-3)
    assert (others.drop(columns="predicted_s") == 0.0).all(axis=None)
    np.testing.assert_allclose(times["predicted_s"], 119.9, atol=1e-9)


@pytest.mark.parametrize(
    ("sigma_m", "way"),
    [(45.0, ("control_detection", "visible_again")), (60.0, ("search", "aperture_exceeded"))],
)
def test_hidden_satellite_resumes_at_the_predicted_place_only_within_the_aperture(
    sigma_m: float, way: tuple[str, str]
) -> None:
    P = np.tile(usual_covariance(), (len(times_ns()), 1, 1))
    # three sigma of 45 m are 135 m, of 60 m 180 m: half a chip is 147 m
    P[is_banked(times_ns() - NS_PER_S), DR : DR + 3, DR : DR + 3] = sigma_m**2 * np.eye(3)
    setup = supervision_setup()
    result = supervise_run(
        outlook(setup, sky(), banking_run(P)), sightings_without(HIDDEN_FIVE), setup.search, WEEK
    )

    for sv in HIDDEN_FIVE:
        assert story(result, sv)[2] == (100.2, "hold", *way)
    back = result.transitions[result.transitions["from_state"] == "hold"]
    within = result.supervision.set_index(["time_s", "sv"])["within_aperture"]
    assert {bool(within[(r.time_s, r.sv)]) for r in back.itertuples()} == {sigma_m == 45.0}
    np.testing.assert_allclose(back["sd_range_m"], np.hypot(sigma_m, 1.0), rtol=1e-12)


def test_satellite_below_the_elevation_mask_is_held() -> None:
    setup = supervision_setup("isotropic")
    masked = type(setup)(setup.aiding, setup.antennas, setup.visibility, setup.search, 21.0)
    result = supervise_run(outlook(masked, sky(), banking_run()), None, setup.search, WEEK)

    held = result.supervision[result.supervision["state"] == "hold"]
    assert set(held["sv"].astype("str")) == {"G02", "G10", "G16"}
    assert (held["decision"] == "hidden").all()
    assert (held["el_deg"] < 21.0).all()


def test_heading_too_uncertain_to_mask_by_hides_nothing() -> None:
    P = np.tile(usual_covariance(), (len(times_ns()), 1, 1))
    P[:, PSI : PSI + 3, PSI : PSI + 3] = np.radians(10.0) ** 2 * np.eye(3)
    setup = supervision_setup()
    result = supervise_run(outlook(setup, sky(), banking_run(P)), None, setup.search, WEEK)

    assert (result.supervision["decision"] == "uncertain_visible").all()
    assert "hold" not in set(result.transitions["to_state"].astype("str"))


def test_supervisor_takes_for_hidden_what_the_filter_hides_as_uncertain() -> None:
    P = np.tile(usual_covariance(), (len(times_ns()), 1, 1))
    P[:, PSI : PSI + 3, PSI : PSI + 3] = np.radians(4.5) ** 2 * np.eye(3)
    sure = outlook(supervision_setup(), sky(), banking_run()).predicted.decision
    found = {}
    for name in ("keep", "hide", "deweight"):
        setup = supervision_setup()
        setup = replace(setup, visibility=setup.visibility.model_copy(update={"uncertain": name}))
        found[name] = outlook(setup, sky(), banking_run(P)).predicted.decision

    undecided = (found["keep"] & IS_UNCERTAIN) != 0
    assert undecided.sum() > 100
    np.testing.assert_array_equal(found["deweight"], found["keep"])
    assert (found["hide"][undecided] == HIDDEN).all()
    assert ((found["hide"] & IS_VISIBLE) <= (sure & IS_VISIBLE)).all()
    assert ((found["keep"] & IS_VISIBLE) > (sure & IS_VISIBLE)).any()


def test_covariance_of_the_attitude_is_that_of_the_body_axes() -> None:
    P = np.tile(usual_covariance(), (len(times_ns()), 1, 1))
    run = banking_run(P)
    # uncertain about the body's x axis alone, which is the vector C e_x in ECEF
    axis = run.trace.C_eb[:, :, 0]
    P[:, PSI : PSI + 3, PSI : PSI + 3] = np.radians(1.0) ** 2 * axis[:, :, None] * axis[:, None, :]
    view = outlook(supervision_setup(), sky(), run)

    # of the cardioid 20 log10((1 + s) / 2), s = -u_z: a roll phi changes s by u_y phi, the gain by 8.686 u_y / (1 + s)
    s = 2.0 * 10.0 ** (view.gain[0, :, 0] / 20.0) - 1.0
    level = np.sqrt(1.0 - s**2)
    azimuth = np.radians([t.azimuth_deg[0] for t in PAPER_SKY]) - np.radians(355.5)
    slope = 8.686 * np.abs(level * np.sin(azimuth)) / (1.0 + s) * np.radians(1.0)
    # the pattern is bilinear between elevations 1 deg apart, and the sky is within 0.03 deg of its table
    np.testing.assert_allclose(view.gain[0, :, 1], slope, rtol=0.05, atol=1e-3)


def test_gap_in_the_trace_ends_the_predictions_and_begins_them_anew() -> None:
    whole = banking_run()
    kept = np.r_[0:200, 300:400]
    trace = type(whole.trace)(*(np.ascontiguousarray(column[kept]) for column in whole.trace))
    view = outlook(supervision_setup(None), sky(), FilterTrace(trace, whole.covariances, whole.samples))
    result = supervise_run(view, None, Search(), WEEK)

    assert len(result.supervision) == 11 * 300
    for sv in ALL:
        ends = [
            (t, reason) for t, _, _, reason in story(result, sv) if reason in ("prediction_ended", "appeared")
        ]
        # no row from 19.9 to 30.0 s
        assert ends == [(0.0, "appeared"), (20.0, "prediction_ended"), (30.0, "appeared")]
    np.testing.assert_allclose(result.search_times["predicted_s"], 20.0 + 9.9, atol=1e-9)


def test_trace_before_its_first_covariance_predicts_nothing() -> None:
    whole = banking_run()
    late = Covariances(whole.covariances.t_ns[50:], whole.covariances.P[50:])
    view = outlook(supervision_setup(), sky(), FilterTrace(whole.trace, late, whole.samples))
    result = supervise_run(view, None, Search(), WEEK)

    assert result.supervision["time_s"].min() == START_S + 5.0
    assert (result.transitions["time_s"] >= START_S + 5.0).all()


def test_empty_trace_gives_empty_tables() -> None:
    whole = banking_run()
    nothing = FilterTrace(
        trace_rows(whole.trace, slice(0, 0)), whole.covariances, TraceSamples(*whole.samples)
    )
    result = supervise_run(outlook(supervision_setup(), sky(), nothing), None, Search(), WEEK)

    assert (len(result.supervision), len(result.transitions), len(result.search_times)) == (0, 0, 0)


def test_predictions_for_other_times_than_the_samples_are_carried_there() -> None:
    run = banking_run()
    late = outlook(supervision_setup(), sky(), run, run.trace.t_ns + 40_000_000)
    exact = banked_view().predicted

    # between rows at 0.1 s the series is within jerk 0.1^3; 0.04 s of 0.7 km/s would be 28 m
    expected = exact.delay_m[:-1] + 0.4 * np.diff(exact.delay_m, axis=0)
    np.testing.assert_allclose(late.predicted.delay_m[:-1], expected, atol=2e-3)
    rates = exact.range_rate_mps[:-1] + 0.4 * np.diff(exact.range_rate_mps, axis=0)
    level = slice(0, 790)  # a bank within one sample has no acceleration that is right
    np.testing.assert_allclose(late.predicted.range_rate_mps[level], rates[level], atol=1e-5)
    np.testing.assert_array_equal(late.predicted.t_ns, run.trace.t_ns + 40_000_000)


def test_other_number_of_times_than_rows_is_refused() -> None:
    with pytest.raises(InputError, match="10 times for a trace of 1200 rows"):
        outlook(supervision_setup(), sky(), banking_run(), times_ns()[:10])


def test_events_of_the_receiver_are_judged_and_its_searches_counted() -> None:
    t_s = np.array([80.1, 85.0, 95.0, 100.6])
    log = ReceiverEvents(
        START_NS + np.rint(t_s * NS_PER_S).astype(np.int64),
        np.array([0, 0, 1, 0], np.int16),
        np.array([LOSS, SEARCHES, SEARCHES, LOCK], np.int8),
        ("G16", "R05"),
    )
    result = supervise_run(banked_view(), None, Search(), WEEK, log)

    assert result.receiver_events is not None
    verdicts = result.receiver_events["verdict"].astype("str").tolist()
    assert verdicts == ["agrees", "search_while_hidden", "not_covered", "agrees"]
    times = result.search_times.set_index("sv")
    assert list(times.index) == [*sorted(ALL), "R05"]
    assert times.loc["G16", ["n_events", "n_agree", "n_differ"]].tolist() == [3, 2, 1]
    # searched from 85.0 s until the lock; held until 100.2 s
    assert times.loc["G16", "receiver_search_s"] == pytest.approx(15.6, abs=1e-9)
    assert times.loc["G16", "receiver_inhibited_s"] == pytest.approx(15.2, abs=1e-9)
    assert times.loc["R05", "n_not_covered"] == 1
    assert np.isnan(times.loc["R05", "hold_s"])
    assert times.loc["G01", "n_events"] == 0


def test_presence_is_that_of_the_newest_epoch_until_one_was_left_out() -> None:
    nan = np.nan
    gnss = GnssTable(
        t_ns=np.array([0, 0, 1, 1, 2, 5], np.int64) * NS_PER_S,
        sv=np.array([0, 1, 0, 1, 0, 0], np.int16),
        signal=np.zeros(6, np.int16),
        pseudorange_m=np.array([2e7, 2e7, 2e7, nan, 2e7, 2e7]),
        doppler_hz=np.zeros(6),
        range_rate_mps=np.full(6, nan),
        cn0_dbhz=np.full(6, 40.0),
        sv_names=("G01", "G02"),
        signal_names=("C1C",),
    )
    t_ns = np.array([-1, 0, 5, 10, 12, 20, 34, 36, 50]) * (NS_PER_S // 10)
    found = presence(sightings_of(gnss), t_ns, ("G02", "G01", "G03"))

    unknown = [NOT_KNOWN] * 3
    first, later = [PRESENT, PRESENT, MISSING], [MISSING, PRESENT, MISSING]
    expected = [unknown, first, first, later, later, later, later, unknown, later]
    assert found.tolist() == expected


def test_each_satellite_has_the_scale_of_its_own_signal() -> None:
    setup = supervision_setup()
    config = setup.aiding.config.model_copy(
        update={"signals": {"G": "C1C", "R": "C1C", "C": "C2I", "E": "C7Q"}}
    )
    aiding = type(setup.aiding)(config, setup.aiding.sensor, setup.aiding.clock, channels={"R01": 1})
    scale = scales(aiding, ("G01", "R01", "C20", "E05"), setup.search.grid)

    # chips of C/A, GLONASS (half its rate), B1I (twice); one that is not listed has the grid's
    np.testing.assert_allclose(scale.chip_m, C_MPS / np.array([1.023e6, 0.511e6, 2.046e6, 1.023e6]))
    np.testing.assert_allclose(scale.wavelength_m[1], C_MPS / 1602.5625e6)
    assert list(scale.code_chips) == [1023, 511, 2046, 1023]
