"""Channels whose satellites a bank hides, with loops that run: with and without masking by the filter's attitude."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from insgnss.errors import ConfigError
from insgnss.studies import ReceiverOptions, receiver_study
from insgnss.studies.receiver.antennas import gain_dbic
from insgnss.studies.receiver.comparison import ReceiverStudy
from insgnss.studies.receiver.scene import scene_of
from tests.antenna.vehicle import vehicle

# the sky of Sokolov and Yurchenko (2015)
AZIMUTH = (76.0, 320.0, 282.0, 294.0, 240.0, 106.0, 144.0, 172.0, 88.0, 46.0, 126.0)
ELEVATION = (23.0, 20.0, 42.0, 19.0, 50.0, 13.0, 50.0, 82.0, 22.0, 24.0, 27.0)
BANK_S = (74.0, 98.0)


def options(**changed: object) -> ReceiverOptions:
    usual = {
        "duration_s": 105.0,
        "settle_s": 40.0,
        "step_s": 10e-3,
        "azimuth_deg": AZIMUTH,
        "elevation_deg": ELEVATION,
    }
    return ReceiverOptions(**{**usual, **changed})  # type: ignore[arg-type]


@cache
def flown(variant: str, tracking: str, masking: bool) -> ReceiverStudy:
    return receiver_study(
        "masked_bank", variants=(variant,), tracking=tracking, imu="tactical", oscillator="tcxo", cn0=(45.0,), runs=2,
        seed=4, options=options(told_cn0_dbhz=45.0, masking=masking), antennas=vehicle("hemispherical"),
    )  # fmt: skip


def in_the_bank(study: ReceiverStudy, column: str) -> float:
    return float(study.epochs.loc[study.epochs["time_s"].between(*BANK_S), column].max())


def test_bank_hides_what_lies_below_the_wings() -> None:
    scene = scene_of("masked_bank", "noncoherent", "tactical", "tcxo", options())
    truth, gain = scene.setting.truth, gain_dbic(scene.setting.truth, vehicle("hemispherical"))
    k = round(84.0 / truth.step_s)
    in_body = truth.directions(slice(k, k + 1))[0] @ truth.C_eb[k]

    # the pattern's edge is the antenna's horizon
    assert ((gain[k] < -5.0) == (in_body[:, 2] > 0.0)).all() and (gain[k] < -5.0).sum() >= 3
    assert (gain[: round(20.0 / truth.step_s)] > -1.0).all()


def test_loops_of_hidden_channels_walk_away_and_masked_ones_wait_and_come_back() -> None:
    without, masked = (flown("two_stage", "noncoherent", masking) for masking in (False, True))

    assert in_the_bank(without, "position_m") > 5.0 * in_the_bank(masked, "position_m")
    assert without.searches.empty
    searches = masked.searches
    assert (
        searches["lost_s"].between(*BANK_S).mean() > 0.5 and (searches["back_s"] > searches["lost_s"]).all()
    )
    # a channel begins again where the filter expects its signal
    assert searches["within_aperture"].all()


def test_one_stage_that_counts_noise_as_signals_knows_less_than_it_says_and_masked_is_honest() -> None:
    without, masked = (flown("one_stage", "coherent", masking) for masking in (False, True))
    low, high = masked.summary["nees_low"].item(), masked.summary["nees_high"].item()

    assert low < masked.summary["nees"].item() < high
    assert in_the_bank(masked, "nees") < 3.0 < in_the_bank(without, "nees")
    assert without.summary["lost"].item() == masked.summary["lost"].item() == 0.0  # the phases coast


def test_receiver_that_estimates_its_cn0_masks_and_searches_as_one_that_knows_it() -> None:
    found = receiver_study(
        "masked_bank", variants=("one_stage",), tracking="coherent", imu="tactical", oscillator="tcxo", cn0=(45.0,),
        runs=2, seed=4, options=options(estimates_cn0=True, masking=True), antennas=vehicle("hemispherical"),
    )  # fmt: skip
    known = flown("one_stage", "coherent", True).searches

    assert set(found.searches["channel"]) >= set(known["channel"]) and len(known) > 0
    assert np.isfinite(found.searches["tracked_s"]).all()
    low, high = found.summary["nees_low"].item(), found.summary["nees_high"].item()
    assert low < found.summary["nees"].item() < high
    assert found.summary["cn0_estimated_dbhz"].notna().all()


def test_masking_without_antennas_or_attitude_is_refused() -> None:
    for asked in ({"antennas": None}, {"imu": None, "variants": ("one_stage",)}):
        usual = {
            "variants": ("one_stage",),
            "antennas": vehicle("hemispherical"),
            "imu": "tactical",
            "runs": 1,
        }
        with pytest.raises(ConfigError, match="hidden satellites cannot be determined") as error:
            receiver_study("masked_bank", options=options(masking=True), **{**usual, **asked})  # type: ignore[arg-type]
        assert error.value.key == "masking"


def test_isotropic_antenna_changes_no_bit(tmp_path: Path) -> None:
    few = options(duration_s=6.0, settle_s=2.0, azimuth_deg=AZIMUTH[:5], elevation_deg=ELEVATION[:5])
    bare, isotropic = (
        receiver_study(
            "masked_bank", variants=("optimal",), tracking="noncoherent", imu="tactical", cn0=(40.0,), runs=1,
            options=few, antennas=antennas,
        ).epochs
        for antennas in (None, vehicle("isotropic"))
    )  # fmt: skip

    np.testing.assert_array_equal(bare["velocity_mps"], isotropic["velocity_mps"])
