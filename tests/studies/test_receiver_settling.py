"""When the errors of a receiver study have settled after C/N0 has fallen, and from when it averages them."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from insgnss.cli.main import app
from insgnss.errors import ConfigError
from insgnss.studies import ReceiverOptions, receiver_study
from insgnss.studies.receiver.comparison import ReceiverStudy
from insgnss.studies.receiver.runs import run_once
from insgnss.studies.receiver.scene import StudyScene, scene_of
from insgnss.studies.receiver.settling import SETTLED, Fall, NoErrors, settling_s
from insgnss.studies.receiver.variants import VARIANTS
from insgnss.tables import Float64
from insgnss.tracking.vector_loop import levels_of
from tests.studies.test_receiver_study import LOW

FALL_S = 20.0


@cache
def scene(tracking: str, duration_s: float = 180.0) -> StudyScene:
    step = 5e-3 if tracking == "coherent" else 10e-3
    options = ReceiverOptions(duration_s=duration_s, settle_s=FALL_S, step_s=step)
    return scene_of("manoeuvring_5g", tracking, LOW, {"drift_density": 100.0}, options)


def fall(of: StudyScene, cn0_dbhz: float) -> Fall:
    steady = np.full((len(of.setting.truth.t_s), 1), cn0_dbhz)
    fallen = steady.copy()
    fallen[: of.fall] = max(45.0, cn0_dbhz)
    return Fall(of.fall, fallen, steady, cn0_dbhz)


def predicted_position(of: StudyScene, profile: Float64, every: slice = slice(None)) -> Float64:
    sd = run_once(of.setting, VARIANTS["one_stage"], profile, NoErrors()).sd[every, :3]
    return np.asarray(np.sqrt((sd**2).sum(axis=1)))


# the second C/N0 has no fall: the run's begin is forgotten
@pytest.mark.parametrize(("cn0_dbhz", "low_s", "high_s"), [(28.0, 25.0, 60.0), (45.0, 1.0, 30.0)])
def test_position_without_phase_is_at_its_later_level_when_it_has_settled(
    cn0_dbhz: float, low_s: float, high_s: float
) -> None:
    of = scene("noncoherent")
    wait_s = settling_s(of.setting, VARIANTS["one_stage"], fall(of, cn0_dbhz))["position"]
    position = predicted_position(of, fall(of, cn0_dbhz).fallen)
    settled, half = (position[round((FALL_S + s) / 0.1)] for s in (wait_s, 0.3 * wait_s))
    # a manoeuvre moves the steady covariance too: the mean over 20 s, a minute later
    late = float(np.sqrt(np.mean(position[-300:-100] ** 2)))

    assert low_s <= wait_s <= high_s
    assert settled == pytest.approx(late, rel=2.0 * SETTLED)
    assert abs(half / late - 1.0) > SETTLED


def test_receivers_that_track_the_phase_settle_within_seconds_and_a_code_position_never() -> None:
    of = scene("coherent", 80.0)
    for name in ("two_stage", "optimal", "one_stage", "one_stage_code"):
        found = settling_s(of.setting, VARIANTS[name], fall(of, 28.0))
        late = {error for error, wait_s in found.items() if wait_s > 10.0}

        assert late == ({"position", "clock"} if name == "one_stage_code" else set())


def test_channel_settles_as_its_own_riccati_equation_says() -> None:
    of = scene("noncoherent")
    found = settling_s(of.setting, VARIANTS["scalar"], fall(of, 28.0))
    # range, rate, acceleration
    T, k, alpha, sigma = 10e-3, 2.0 * math.pi * 1575.42e6 / 299792458.0, 0.3, 49.03
    drift = 0.5 * 100.0 / k**2
    F = np.array([[1.0, T, T**2 / 2], [0.0, 1.0, T], [0.0, 0.0, math.exp(-alpha * T)]])
    q = 2.0 * alpha * sigma**2
    W = q * np.array(
        [[T**5 / 20, T**4 / 8, T**3 / 6], [T**4 / 8, T**3 / 3, T**2 / 2], [T**3 / 6, T**2 / 2, T]]
    ) + drift * np.array([[T**3 / 3, T**2 / 2, 0.0], [T**2 / 2, T, 0.0], [0.0, 0.0, 0.0]])

    def on(P: Float64, cn0_dbhz: float) -> Float64:
        H, R = np.eye(2, 3), np.diag(of.setting.channels.table[levels_of(cn0_dbhz), [2, 4]])
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        return np.asarray(F @ (P - K @ H @ P) @ F.T + W)

    P, steps = np.diag([10.0, 1.0, 100.0]), 12000
    for _ in range(steps):
        P = on(P, 45.0)
    history = []
    for _ in range(steps):
        history.append(math.sqrt(P[0, 0]))
        P = on(P, 28.0)
    late = np.flatnonzero(np.abs(np.array(history) / history[-1] - 1.0) > SETTLED)[-1] + 1

    assert found["position"] == pytest.approx(T * late, rel=0.01)
    assert settling_s(of.setting, VARIANTS["scalar"], fall(of, 45.0)) == {"position": 0.0, "velocity": 0.0}


def study(tracking: str = "noncoherent", **changed: Any) -> ReceiverStudy:
    options = ReceiverOptions(**{"step_s": 10e-3, **changed})
    return receiver_study(
        "manoeuvring_5g", variants=("one_stage",), tracking=tracking, imu=LOW, cn0=(28.0,), runs=8,
        oscillator={"drift_density": 100.0}, options=options,
    )  # fmt: skip


def test_average_begins_when_errors_have_settled_and_can_be_asked_for_from_the_fall_on() -> None:
    settled, at_once = study(), study(average_s=40.0)
    position = [float(found.summary["position_m"].iloc[0]) for found in (settled, at_once)]
    options = settled.asked["options"]
    waited = options["average_s"] - options["settle_s"]

    assert 25.0 < waited < 60.0 and options["duration_s"] == options["average_s"] + 40.0
    assert settled.summary["unsettled"].to_list() == [""]
    assert at_once.summary["unsettled"].to_list() == ["position, velocity, attitude, clock, clock drift"]
    assert at_once.asked["options"]["duration_s"] == 80.0
    assert position[1] < 0.9 * position[0]
    again = study(average_s=options["average_s"], duration_s=options["duration_s"])
    assert again.summary.equals(settled.summary)


def test_average_leaves_half_of_a_short_run_and_says_what_has_not_settled() -> None:
    short = study(duration_s=60.0)

    assert short.asked["options"]["average_s"] == 50.0
    assert "position" in short.summary["unsettled"].iloc[0]


@pytest.mark.parametrize(
    ("key", "changed"),
    [
        ("average_s", {"average_s": 30.0}),
        ("average_s", {"average_s": 80.0, "duration_s": 80.0}),
        ("average_s", {"average_s": math.nan}),
        ("average_s", {"average_s": "late"}),
        ("average_s", {"average_s": 500.0}),
        ("settle_s", {"settle_s": 400.0}),
        ("settle_s", {"settle_s": None}),
        ("duration_s", {"duration_s": math.nan}),
    ],
)
def test_times_that_do_not_fit_are_refused_by_their_key(key: str, changed: dict[str, Any]) -> None:
    with pytest.raises(ConfigError) as error:
        study(**changed)
    assert error.value.key == key and error.value.advice


def test_manoeuvre_begins_when_cn0_falls_in_a_short_study_too() -> None:
    options = ReceiverOptions(duration_s=30.0, settle_s=10.0)
    truth = scene_of("manoeuvring_5g", "coherent", LOW, "tcxo", options).setting.truth
    speed = np.linalg.norm(truth.v_e, axis=1)
    at = round(10.0 / truth.step_s)

    assert np.ptp(speed[: at - 100]) < 1.0
    assert np.ptp(speed[at:]) > 100.0
    assert study(duration_s=30.0, settle_s=10.0, average_s=10.0).asked["begins_s"] == 20.0
    # a flight that is straight throughout: no manoeuvre comes that could begin earlier
    assert scene_of("at_rest", "coherent", LOW, "tcxo", options).begins_s == 1.0


def test_command_tells_from_when_it_averages_and_what_has_not_settled() -> None:
    asked = "receiver --tracking noncoherent --step 0.01 --cn0 28 --runs 1 --variants one_stage --duration 60"
    shown = CliRunner().invoke(app, asked.split())

    assert "averaged from 50 s to 60 s of each run; C/N0 falls at 40 s" in shown.output
    assert "not settled by then: position" in shown.output and "one_stage at 28 dBHz" in shown.output
