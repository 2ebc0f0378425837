"""A receiver past emitters: C/N0 of the link, channels that go and come back where the filter expects them."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from insgnss.config.interference import Emitter, InterferenceConfig, LoopReceiver
from insgnss.constants import C_MPS
from insgnss.errors import ModelError
from insgnss.geodesy.local_level import geodetic
from insgnss.gnss.signals import signal_of
from insgnss.interference.spectra import modulation_of
from insgnss.runs.margin.loops import separation
from insgnss.studies import ReceiverOptions, receiver_study
from insgnss.studies.receiver.antennas import emitters_of, jammed_cn0_dbhz
from insgnss.studies.receiver.comparison import ReceiverStudy
from insgnss.studies.receiver.flight import FlightRequest, receiver_flight
from insgnss.studies.receiver.scene import StudyScene, scene_of
from insgnss.studies.receiver.tables import ALL_LOST, TRACKED_AGAIN, spans_without_a_channel, tracked
from insgnss.studies.receiver.variants import VARIANTS

OPTIONS = ReceiverOptions(duration_s=170.0, settle_s=30.0, step_s=10e-3, least_cn0_dbhz=20.0)


@cache
def scene() -> StudyScene:
    return scene_of("jammed_approach", "noncoherent", "tactical", "tcxo", OPTIONS)


@cache
def flown() -> ReceiverStudy:
    return receiver_study(
        "jammed_approach",
        variants=("optimal", "one_stage"),
        tracking="noncoherent",
        imu="tactical",
        runs=6,
        seed=3,
        options=OPTIONS,
        emitters="jammed_approach",
    )


def test_cn0_is_that_of_free_space() -> None:
    truth = scene().setting.truth
    emitter = Emitter(lat_deg=59.9, lon_deg=30.3, h_m=50.0, eirp_dbw=-10.0, bandwidth_hz=20e6)
    config = InterferenceConfig(emitter=(emitter,), receiver=LoopReceiver(cn0_dbhz=44.0, signal_dbw=-158.0))
    found = jammed_cn0_dbhz(truth, config, scene().start_s)
    lat, lon, h = np.radians(59.9), np.radians(30.3), 50.0
    e2, a = 6.69437999014e-3, 6378137.0
    N = a / math.sqrt(1.0 - e2 * math.sin(lat) ** 2)
    mast = np.array(
        [
            (N + h) * math.cos(lat) * math.cos(lon),
            (N + h) * math.cos(lat) * math.sin(lon),
            (N * (1.0 - e2) + h) * math.sin(lat),
        ]
    )
    distance = np.linalg.norm(truth.r_e - mast, axis=1)
    received = -10.0 + 20.0 * np.log10(C_MPS / (4.0 * math.pi * 1575.42e6 * distance))
    signal = signal_of("G", "C1C")
    assert signal is not None
    kappa = separation(modulation_of(signal), 20e6, 1575.42e6, emitter)
    expected = -10.0 * np.log10(10.0**-4.4 + 10.0 ** (0.1 * (received + 158.0)) * kappa)

    assert found == pytest.approx(np.tile(expected[:, None], (1, found.shape[1])), abs=0.01)
    assert geodetic(truth.r_e[:1])[0, 2] == pytest.approx(900.0, abs=1.0)


def test_study_past_emitters_lasts_as_long_as_the_motion_unless_it_is_told() -> None:
    asked = FlightRequest(
        "jammed_approach", "noncoherent", "tactical", "tcxo", ReceiverOptions(step_s=0.02), "jammed_approach"
    )
    wanted = {"one_stage": VARIANTS["one_stage"]}
    whole = receiver_flight(asked, wanted, [45.0])
    half = receiver_flight(asked._replace(options=replace(asked.options, duration_s=90.0)), wanted, [45.0])

    assert whole.scene.options.duration_s == whole.scene.course.whole_s - whole.scene.begins_s
    assert min(whole.profiles) < 16.0  # the emitter is passed
    assert half.scene.options.duration_s == 90.0


def test_library_of_emitters_goes_from_45_dbhz_below_16_and_back() -> None:
    found = jammed_cn0_dbhz(scene().setting.truth, emitters_of("jammed_approach"), scene().start_s)

    assert found[0].min() == pytest.approx(45.0, abs=0.1)
    assert found.min() < 16.0
    with pytest.raises(ModelError, match="file of emitters"):
        emitters_of("nothing")


def test_channels_come_back_where_the_filter_expects_them() -> None:
    searches: pd.DataFrame = flown().searches

    assert set(searches["variant"]) == {"optimal", "one_stage"}
    assert (searches["back_s"] - searches["lost_s"]).between(10.0, 60.0).all()
    assert (searches["tracked_s"] >= searches["back_s"]).all()
    delay, rate = (
        (searches[off] / searches[sd]).to_numpy()
        for off, sd in (("off_m", "sd_delay_m"), ("off_mps", "sd_rate_mps"))
    )
    assert np.abs(delay).max() < 4.5 and np.abs(rate).max() < 4.5
    # all channels of a run have one clock and one path: six runs are six looks
    assert (delay**2).mean() < 3.7 and (rate**2).mean() < 3.7  # chi^2 of six over six, 1e-3


def test_loss_of_the_last_channel_is_an_event_and_so_is_its_end() -> None:
    study = flown()
    lost, found = (study.events[study.events["kind"] == kind] for kind in (ALL_LOST, TRACKED_AGAIN))
    of_run = study.searches.groupby(["variant", "run"])

    assert lost["time_s"].tolist() == of_run["lost_s"].max().tolist()
    assert found["time_s"].tolist() == of_run["tracked_s"].min().tolist()


def test_no_channel_is_tracked_where_all_spans_overlap() -> None:
    """Two channels: the first is gone twice, the second once and then loses lock."""

    def spans(lost_s: list[float], *gone: tuple[int, float, float]) -> list[tuple[float, float]]:
        searches = [SimpleNamespace(channel=c, lost_s=a, tracked_s=b) for c, a, b in gone]
        run: Any = SimpleNamespace(lost_s=np.array(lost_s), searches=searches)
        return spans_without_a_channel(run)

    held = never = math.inf
    assert spans([held, held], (0, 2.0, 5.0), (1, 4.0, 7.0), (0, 6.0, 9.0)) == [(4.0, 5.0), (6.0, 7.0)]
    assert spans([held, 8.0], (0, 2.0, 5.0), (0, 6.0, 9.0)) == [(8.0, 9.0)]
    assert spans([3.0, 8.0]) == [(8.0, never)]
    assert spans([3.0, held], (1, 1.0, 3.0)) == []
    assert spans([held, held]) == []


def test_filter_coasts_and_is_honest() -> None:
    study = flown()
    summary = study.summary.set_index("variant")

    assert (summary["lost"] == 0.0).all()
    assert (summary["nees"] < summary["nees_high"]).all()
    epochs = study.epochs[study.epochs["variant"] == "one_stage"]
    coasted, after = epochs[epochs["time_s"].between(125.0, 135.0)], epochs[epochs["time_s"] > 160.0]
    assert coasted["velocity_mps"].max() > after["velocity_mps"].max()
    # and its sigma says so, while no channel is tracked
    assert coasted["velocity_sd_mps"].max() > 1.5 * after["velocity_sd_mps"].max()
    assert coasted["tracked"].min() == 0.0 and (after["tracked"] == 1.0).all()
    ratio = epochs["velocity_mps"] / epochs["velocity_sd_mps"]
    assert ratio[epochs["time_s"] > 30.0].max() < 3.0


def test_tracked_channels_are_neither_lost_nor_looked_for() -> None:
    search: Any = SimpleNamespace(channel=1, lost_s=2.0, tracked_s=4.0)
    run: Any = SimpleNamespace(lost_s=np.array([3.0, math.inf]), searches=[search])

    assert tracked(run, np.array([1.0, 2.0, 3.0, 4.0])).tolist() == [1.0, 0.5, 0.0, 0.5]


@pytest.mark.parametrize("tracking", ["coherent", "noncoherent"])
def test_channels_that_never_come_back_are_in_the_table_while_the_filter_coasts(tracking: str) -> None:
    options = ReceiverOptions(duration_s=12.0, settle_s=6.0, average_s=6.0, least_cn0_dbhz=30.0)
    study = receiver_study(
        "manoeuvring_5g", variants=("optimal", "one_stage"), tracking=tracking, imu="tactical", cn0=(45.0, 10.0),
        runs=2, seed=4, options=options,
    )  # fmt: skip

    assert (study.searches["cn0_dbhz"] == 10.0).all()
    counts = study.searches.groupby(["variant", "run"])["channel"].nunique()
    assert counts.tolist() == [len(options.azimuth_deg)] * 4 and len(study.searches) == counts.sum()
    assert study.searches["lost_s"].to_numpy() == pytest.approx(6.0)
    assert np.isinf(study.searches[["back_s", "tracked_s"]].to_numpy()).all()
    assert study.events["time_s"].to_numpy() == pytest.approx(6.0)
    assert len(study.events) == 4 and set(study.events["kind"]) == {ALL_LOST}
    summary = study.summary.set_index(["variant", "cn0_dbhz"])
    for name in ("optimal", "one_stage"):
        assert summary.loc[(name, 10.0), "lost"] == 0.0
        assert summary.loc[(name, 10.0), "velocity_mps"] > 2.0 * summary.loc[(name, 45.0), "velocity_mps"]
    assert (summary["nees"] < summary["nees_high"]).all()
