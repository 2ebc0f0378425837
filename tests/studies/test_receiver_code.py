"""One stage with code and phase, a state for each phase; replicas set in steps; receivers in a campaign."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from insgnss.errors import ConfigError
from insgnss.studies.campaign.cases import receiver
from insgnss.studies.campaign.columns import COLUMNS
from insgnss.studies.campaign.results import data_set
from insgnss.studies.campaign.study import run_campaign
from insgnss.studies.receiver.comparison import receiver_study
from insgnss.studies.receiver.linear_theory import crossing
from insgnss.studies.receiver.options import ReceiverOptions
from insgnss.studies.receiver.runs import run_many
from insgnss.studies.receiver.scene import scene_of
from insgnss.studies.receiver.variants import VARIANTS
from tests.studies.test_receiver_study import (
    ATTITUDE,
    LOW,
    POSITION,
    VELOCITY,
    flown,
    motion,
    nees_within_bounds,
    setting,
    settled,
    small,
)

RUNS = 8


def test_states_for_the_phases_leave_motion_and_threshold_as_they_are() -> None:
    of = setting("coherent", True, 100.0)
    pseudo, code = (flown(of, VARIANTS[name], 35.0, 5, 21) for name in ("one_stage", "one_stage_code"))
    # velocity is correlated over 2 s or so: 90 s of 5 runs are 600 looks and more at three axes
    for block, looks in ((VELOCITY, 600), (ATTITUDE, 60)):
        low, high = stats.f.interval(0.999, looks, looks)
        assert low < (settled(of, code, block) / settled(of, pseudo, block)) ** 2 < high
    runs_at = {17.0: 12, 18.0: 24, 19.0: 24, 20.0: 12}
    levels = np.array(list(runs_at))
    shares = [
        np.array(
            [
                np.mean([run.lost for run in flown(of, VARIANTS[name], level, runs, 22)])
                for level, runs in runs_at.items()
            ]
        )
        for name in ("one_stage", "one_stage_code")
    ]
    # where half are lost: a share of 24 runs has a sigma of 0.1, and falls by 0.3 in a decibel
    assert all(share[0] > 0.9 and share[-1] < 0.2 for share in shares)
    assert crossing(levels, shares[0]) == pytest.approx(crossing(levels, shares[1]), abs=0.8)


def test_position_and_phases_own_states_are_as_far_off_as_they_say() -> None:
    of = setting("coherent", True, 100.0)
    runs = flown(of, VARIANTS["one_stage_code"], 35.0, RUNS, 23)
    ratio = np.array([np.mean((run.apart[-1, :, 0] / run.apart[-1, :, 1]) ** 2) for run in runs])
    # the errors of the eight channels are mostly one, of the clock: a run is one look
    low, high = stats.chi2.interval(0.999, RUNS)
    sigma = runs[0].apart[:, 0, 1]
    seconds = of.truth.step_s * of.record_every * np.arange(len(sigma))

    assert low < ratio.sum() < high
    assert nees_within_bounds(of, runs)
    assert 0.02 < settled(of, runs, POSITION) < 2.0
    # once it knows more than the start, it falls with the root of time
    late = seconds > 20.0
    assert sigma[late] * np.sqrt(seconds[late]) == pytest.approx(sigma[-1] * math.sqrt(seconds[-1]), rel=0.05)


def test_phase_and_code_that_wander_apart_are_followed() -> None:
    constant = setting("coherent", True, 100.0)
    known = flown(constant, VARIANTS["one_stage_code"], 40.0, 1, 24)[0].apart[-1, :, 1]
    runs = flown(
        replace(constant, options=replace(constant.options, divergence_density=1e-3)),
        VARIANTS["one_stage_code"],
        40.0,
        RUNS,
        24,
    )
    ratio = np.array([np.mean((run.apart[-1, :, 0] / run.apart[-1, :, 1]) ** 2) for run in runs])
    low, high = stats.chi2.interval(0.999, RUNS)

    assert (runs[0].apart[-1, :, 1] > 1.5 * known).all()
    assert low < ratio.sum() < high


def test_replicas_in_steps_are_off_by_a_twelfth_of_a_step_squared_and_cost_the_filter_nothing() -> None:
    fine = setting("coherent", True, 100.0)
    step_m = 0.3 / fine.channels.radians_per_m
    runs, coarse = (
        flown(of, VARIANTS["one_stage"], 40.0, 4, 25)
        for of in (fine, replace(fine, options=replace(fine.options, replica_step_m=step_m)))
    )
    before, after = (np.mean([run.rms[:, 0] ** 2 for run in each]) for each in (runs, coarse))

    assert after - before == pytest.approx(step_m**2 / 12.0, rel=0.05)
    assert settled(fine, coarse, VELOCITY) == pytest.approx(settled(fine, runs, VELOCITY), rel=0.05)


def test_clock_of_interval_messages_is_honest_however_long_the_interval() -> None:
    of = setting("coherent", True, 100.0)
    first, ratio, motion_ratio = math.ceil(of.settle / of.record_every), [], []
    for interval in (20, 4):
        runs = flown(replace(of, interval=interval), VARIANTS["optimal"], 40.0, 4, 26)
        errors = [run.error[first:] / run.sd[first:] for run in runs]
        ratio.append(float(np.mean([e[:, 10] ** 2 for e in errors])))
        motion_ratio.append(float(np.mean([e[:, VELOCITY] ** 2 for e in errors])))
    # the drift of a second is another one: 60 s of 4 runs are 200 looks
    low, high = stats.chi2.interval(0.999, 200)

    assert all(low < 200 * of_drift < high for of_drift in ratio)
    assert motion_ratio[0] == pytest.approx(motion_ratio[1], rel=0.2)


def test_code_and_phase_without_a_phase_are_refused() -> None:
    with pytest.raises(ConfigError, match="no phase is tracked") as error:
        receiver_study(
            motion(), variants=("one_stage_code",), tracking="noncoherent", imu=LOW, cn0=(40.0,), runs=1,
            options=small(step_s=0.01),
        )  # fmt: skip

    assert error.value.key == "variants"


CAMPAIGN = """
name = "receivers"
case = "receiver"
seeds = [3, 4]
seeds_per_task = 2
[fixed]
oscillator = 100.0
duration_s = 12.0
settle_s = 6.0
average_s = 6.0
[grid]
imu = ["tactical", ""]
cn0_dbhz = [45.0, 5.0]
"""


def test_campaign_of_receivers_gives_the_runs_of_the_study(tmp_path: Path) -> None:
    file = tmp_path / "receivers.toml"
    file.write_text(CAMPAIGN, encoding="utf-8")
    done = run_campaign(file, tmp_path / "out", workers=0)
    table = data_set(tmp_path / "out").to_table().to_pandas().set_index(["case_imu", "case_cn0_dbhz", "seed"])
    options = ReceiverOptions(duration_s=12.0, settle_s=6.0, average_s=6.0)
    of = scene_of("manoeuvring_5g", "coherent", "tactical", {"drift_density": 100.0}, options).setting
    runs = run_many(of, VARIANTS["one_stage"], np.float64(45.0), 1, 4, 1)

    assert (done.n_runs, done.n_failed) == (8, 0)
    own = (
        *COLUMNS["receiver"],
        "case",
        "error",
        *(f"case_{n}" for n in ("oscillator", "duration_s", "settle_s", "average_s")),
    )
    assert set(table.columns) == set(own)
    assert (table["lost"] == [0.0, 0.0, 1.0, 1.0] * 2).all()
    assert np.isfinite(table["lost_s"]).to_list() == [False, False, True, True] * 2
    row = table.loc[("tactical", 45.0, 4)]
    assert row["velocity_mps"] == pytest.approx(settled(of, runs, VELOCITY), rel=1e-12)
    assert row["nees"] == pytest.approx(runs[0].nees[60:].mean(), rel=1e-12)
    assert table["velocity_mps"].isna().to_list() == [False, False, True, True] * 2


def test_case_of_a_receiver_with_an_unknown_key_or_receiver_says_so() -> None:
    with pytest.raises(ConfigError, match="no key 'cno'"):
        receiver({"cno": 40.0}, 1)
    with pytest.raises(ConfigError, match="unknown receiver"):
        receiver({"variant": "two", "duration_s": 12.0, "settle_s": 6.0}, 1)
