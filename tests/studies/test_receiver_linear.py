"""The linear theory of a receiver study: its lines go through the dots where signals are strong, and it says what it
does not know.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from insgnss.interference import UnknownAcceleration, channel_model, one_stage_model, phase_threshold
from insgnss.studies import receiver_study
from insgnss.studies.receiver.comparison import ReceiverStudy
from insgnss.studies.receiver.linear_theory import NOTHING, LinearTheory, with_one_process
from insgnss.studies.receiver.scene import StudyScene, scene_of
from insgnss.studies.receiver.variants import VARIANTS
from tests.studies.test_receiver_study import LOW, motion, small

DRIFT = {"drift_density": 100.0}


def scene(tracking: str = "coherent", with_ins: bool = True, **changed: Any) -> StudyScene:
    options = small(**{"carrier_hz": 1.6e9, "chip_hz": 1.022e6, **changed})
    return scene_of(motion(), tracking, LOW if with_ins else None, DRIFT, options)


@cache
def without_ins() -> ReceiverStudy:
    return receiver_study(
        motion(), variants=("scalar", "one_stage"), imu=None, oscillator=DRIFT, cn0=(45.0, 40.0), runs=3, seed=2,
        options=small(duration_s=40.0, carrier_hz=1.6e9, chip_hz=1.022e6),
    )  # fmt: skip


def test_receivers_without_ins_have_the_errors_of_the_theory() -> None:
    table = without_ins().summary

    # 30 s of an acceleration that lasts 3.3 s; the theory without the length of an integration is off by 16 %
    assert table["phase_rad"].to_numpy() == pytest.approx(table["linear_phase_rad"].to_numpy(), rel=0.05)
    velocity = table["linear_velocity_mps"].to_numpy()
    assert table["velocity_mps"].to_numpy() == pytest.approx(velocity, rel=0.08)
    assert table["linear_attitude_deg"].isna().all()


def test_figure_draws_runs_as_dots_and_the_theory_as_lines() -> None:
    panels = without_ins().figure().get_axes()
    of_velocity = panels[1].get_lines()
    marks = [(str(line.get_marker()), str(line.get_linestyle())) for line in of_velocity]

    assert panels[1].get_ylabel().startswith("velocity") and panels[4].get_ylabel().startswith("phase")
    assert marks == [("o", "None"), ("None", "-")] * 2
    table = without_ins().summary
    expected = table[table["variant"] == "scalar"]["linear_velocity_mps"]
    assert np.array_equal(np.asarray(of_velocity[1].get_ydata()), expected.to_numpy())


def test_thresholds_without_ins_are_those_of_the_steady_models() -> None:
    of = scene(with_ins=False)
    unknown = UnknownAcceleration(of.setting.unknown.sigma, of.setting.unknown.time_s)
    scalar, one = (LinearTheory.of(of, VARIANTS[name]) for name in ("scalar", "one_stage"))

    channel = phase_threshold(channel_model(unknown, 100.0, 1.6e9), scalar.loop)
    whole = phase_threshold(one_stage_model(unknown, 100.0, 1.6e9, one.sky), one.loop)
    assert (scalar.threshold_dbhz(), one.threshold_dbhz()) == (channel.cn0_dbhz, whole.cn0_dbhz)


def test_biases_that_wander_are_in_the_theory_of_one_stage() -> None:
    """Constant and instability together are one process; it had been the constant part alone."""
    one = with_one_process(LOW)
    assert one.gyro_bias_deg_per_h == pytest.approx(80.0)
    assert one.accel_bias_mg == pytest.approx(LOW.accel_bias_instability_mg)
    assert one.gyro_correlation_time_s == pytest.approx(600.0)
    both = with_one_process(LOW.model_copy(update={"gyro_bias_deg_per_h": 60.0}))
    assert both.gyro_bias_deg_per_h == pytest.approx(100.0)
    # as much noise in a second
    assert both.gyro_bias_deg_per_h**2 / both.gyro_correlation_time_s == pytest.approx(80.0**2 / 600.0)


def test_theory_says_nothing_of_what_it_does_not_know() -> None:
    of, aided = scene(), VARIANTS["two_stage"]

    assert LinearTheory.of(scene("noncoherent"), aided).errors(40.0) == NOTHING
    assert LinearTheory.of(of, VARIANTS["optimal"]).errors(40.0) == NOTHING
    wide = LinearTheory.of(of, replace(aided, widening=100.0))
    assert wide.errors(40.0) == NOTHING and math.isnan(wide.threshold_dbhz())
    assert LinearTheory.of(of, aided).errors(-20.0) == NOTHING
    known = LinearTheory.of(of, aided).errors(40.0)
    assert known.phase_rad > 0.0 and known.channels_mps > 0.0 and math.isnan(known.velocity_mps)
