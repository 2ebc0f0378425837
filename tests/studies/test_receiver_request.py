"""A saved receiver study can be flown again from its folder alone: motion, antennas, emitters and options are there."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from insgnss.config.flight import MountedAntenna
from insgnss.errors import ResultError
from insgnss.studies import RECEIVERS, ReceiverOptions, receiver_request, receiver_study
from insgnss.studies.receiver.comparison import ReceiverStudy
from insgnss.studies.receiver.saved_request import antenna_settings, antennas_of
from tests.antenna.vehicle import vehicle
from tests.studies.test_receiver_study import LOW, motion, small

HULL = """
frame = "body_forward_right_down"
source = "test"
[[sector]]
azimuth_deg = [150.0, 210.0]
elevation_deg = [-90.0, 30.0]
"""


def again(study: ReceiverStudy, folder: Path) -> ReceiverStudy:
    return receiver_study(**receiver_request(study.save(folder, pictures=False)))


def is_same(one: ReceiverStudy, two: ReceiverStudy) -> bool:
    for name in ReceiverStudy.TABLES:
        pd.testing.assert_frame_equal(getattr(one, name), getattr(two, name), check_exact=True)
    return one.asked == two.asked


def test_study_with_antennas_own_receiver_and_pilot_flies_again_bit_for_bit(tmp_path: Path) -> None:
    turned = MountedAntenna(
        pattern="patch_l1", lever_arm_m=(1.0, 0.2, -0.5), mounting_rpy_deg=(20.0, -10.0, 70.0)
    )
    wide = replace(RECEIVERS["two_stage"], words="wide", widening=30.0)
    study = receiver_study(
        motion(), variants=("one_stage", wide), imu=LOW, oscillator={"drift_density": 30.0}, cn0=(44.0,), runs=2,
        seed=9, antennas=vehicle("hemispherical", turned),
        options=small(symbol_s=math.inf, imu_gaps_s=((12.0, 12.2),)),
    )  # fmt: skip

    assert is_same(study, again(study, tmp_path / "out"))


def test_flight_past_emitters_flies_again_bit_for_bit(tmp_path: Path) -> None:
    study = receiver_study(
        "jammed_approach", variants=("one_stage",), tracking="noncoherent", imu="tactical", oscillator="tcxo",
        runs=1, emitters="jammed_approach", options=ReceiverOptions(duration_s=60.0, step_s=10e-3),
    )  # fmt: skip

    assert is_same(study, again(study, tmp_path / "out"))


def test_antennas_are_what_they_were_after_json(tmp_path: Path) -> None:
    (tmp_path / "hull.toml").write_text(HULL, encoding="utf-8")
    hidden = MountedAntenna(pattern="cardioid", obstruction=Path("hull.toml"))
    before = vehicle("choke_ring", hidden, folder=tmp_path)
    after = antennas_of(json.loads(json.dumps(antenna_settings(before))))

    assert after is not None and before.is_obstructed.tolist() == [False, True]
    for one, two in zip((*before.pattern, *before[1:]), (*after.pattern, *after[1:]), strict=True):
        assert np.array_equal(one, two) and one.dtype == two.dtype
    assert antennas_of(antenna_settings(None)) is None
    none = antennas_of([])
    assert none is not None and none.lever_b.shape == (0, 3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "no receiver study is saved here"),
        ("{", "damaged"),
        ('{"scenario": "x", "antennas": 1, "own_variants": {}}', "do not describe a study"),
        ("[]", "do not describe a study"),
    ],
)
def test_folder_without_a_study_says_so(tmp_path: Path, text: str | None, words: str) -> None:
    if text is not None:
        (tmp_path / "receiver_settings.json").write_text(text, encoding="utf-8")
    with pytest.raises(ResultError, match=words) as refused:
        receiver_request(tmp_path)

    assert refused.value.file == str(tmp_path / "receiver_settings.json") and refused.value.advice
