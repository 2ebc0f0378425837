"""The supervisor epoch by epoch gives the bits of the whole history; bad input and bad settings are named."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from insgnss.config.search import Detection, Grid, Guards, Search, UnsupervisedReceiver
from insgnss.config.strict import load_toml
from insgnss.errors import ConfigError, InputError, TimeError
from insgnss.receiver.detection import detector
from insgnss.receiver.search_window import signal_scale
from insgnss.receiver.supervisor import Predictions, Supervisor, rules_of, supervise
from insgnss.receiver.tracking_state import STATE_NAMES
from tests.antenna.gain_history import predictions
from tests.antenna.test_supervisor import random_scene


def slices(predicted: Predictions, first: int, last: int) -> Predictions:
    return Predictions(*(values[first:last] for values in predicted))


@pytest.mark.parametrize("method", ["albersheim", "exact"])
@pytest.mark.parametrize("limit_s", [None, 0.02])
def test_live_supervisor_gives_the_same_bits(method: str, limit_s: float | None) -> None:
    detection = Detection(method=method, coherent_limit_s=limit_s, max_looks=100)  # type: ignore[arg-type]
    settings = Search(detection=detection)
    predicted, present = random_scene(21, n=1500, m=5)
    whole = supervise(predicted, present, settings)
    live = Supervisor(5, settings)
    # single epochs, and pieces of several lengths (an empty one too)
    edges = np.unique(np.concatenate([np.arange(700), [700, 703, 750, 1001, 1500]]))
    pieces = [live.epoch(slices(predicted, a, b), present[a:b]) for a, b in pairwise(edges)]
    pieces.append(live.epoch(slices(predicted, 1500, 1500), present[1500:]))
    assert np.array_equal(np.vstack([piece.state for piece in pieces]), whole.state)
    for i, name in enumerate(whole.transitions._fields):
        joined = np.concatenate([piece.transitions[i] for piece in pieces])
        assert joined.tobytes() == whole.transitions[i].tobytes(), name
    for i, name in enumerate(whole.window._fields):
        joined = np.concatenate([piece.window[i] for piece in pieces])
        assert joined.tobytes() == whole.window[i].tobytes(), name
    assert all(np.array_equal(a, b) for a, b in zip(live.totals, whole.totals, strict=True))
    assert np.array_equal(live.state, whole.state[-1])


def test_satellites_do_not_know_each_other() -> None:
    predicted, present = random_scene(22, n=800, m=4)
    whole = supervise(predicted, present)
    for s in range(4):
        alone = Predictions(predicted.t_ns, *(np.asarray(v)[:, s : s + 1] for v in predicted[1:]))
        assert np.array_equal(supervise(alone, present[:, s : s + 1]).state[:, 0], whole.state[:, s])


def test_each_satellite_has_the_scale_of_its_signal() -> None:
    scale = signal_scale(Grid())._replace(chip_m=np.array([293.0, 29.3]))
    result = supervise(predictions(d_range_m2=np.full((3, 2), 100.0)), scale=scale)
    # 30 m is inside half a chip of 293 m and outside of half a chip of 29.3 m
    assert [STATE_NAMES[i] for i in result.state[0]] == ["control_detection", "search"]


def test_no_satellites_and_no_epochs_are_no_fault() -> None:
    assert supervise(predictions(decision=np.zeros((4, 0)))).state.shape == (4, 0)
    empty = slices(predictions(n=3), 0, 0)
    assert supervise(empty).state.shape == (0, 1)


@pytest.mark.parametrize(
    ("change", "column"),
    [
        ({"cn0_dbhz": np.zeros((3, 1))}, "cn0_dbhz"),
        ({"d_range_m2": np.full((5, 1), -1.0)}, "d_range_m2"),
        ({"d_rate_m2ps2": np.full((5, 1), -1e-9)}, "d_rate_m2ps2"),
        ({"decision": np.full((5, 1), 7, np.int8)}, "decision"),
    ],
)
def test_bad_predictions_are_named(change: dict[str, np.ndarray], column: str) -> None:
    with pytest.raises(InputError) as error:
        supervise(predictions(n=5)._replace(**change))
    assert error.value.column == column and error.value.advice


@pytest.mark.parametrize("present", [np.zeros((4, 1)), np.full((5, 1), 2)])
def test_bad_presence_is_named(present: np.ndarray) -> None:
    with pytest.raises(InputError, match="present"):
        supervise(predictions(n=5), present)


def test_time_that_stands_or_falls_is_refused_also_between_calls() -> None:
    predicted = predictions(n=5)
    with pytest.raises(TimeError, match="epoch 3"):
        supervise(predicted._replace(t_ns=predicted.t_ns[[0, 1, 1, 2, 3]]))
    live = Supervisor(1)
    live.epoch(predicted)
    with pytest.raises(TimeError, match="epoch 1"):
        live.epoch(slices(predicted, 4, 5))


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("[detection]\npd = 1.5", "detection.pd"),
        ("[detection]\npd = 0.9\npfa = 0.95", "detection.pfa"),
        ('[detection]\nmethod = "marcum"', "detection.method"),
        ("[guards]\nrise_s = -1.0", "guards.rise_s"),
        ("[guards]\ncontrol_attempts = 0", "guards.control_attempts"),
        ("[grid]\ncorrelators = 0", "grid.correlators"),
        ("[aperture]\ndelay_chips = 0.0", "aperture.delay_chips"),
        ("[unsupervised]\ndelay_cels = 5", "unsupervised.delay_cels"),
        ("[guards]\nthreshold_cn0_dbhz = nan", "guards.threshold_cn0_dbhz"),
    ],
)
def test_bad_settings_are_named_with_their_key(text: str, key: str, tmp_path: Path) -> None:
    path = tmp_path / "search.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as error:
        load_toml(path, Search)
    assert error.value.key == key and error.value.line is not None


def test_misspelt_key_names_the_nearest(tmp_path: Path) -> None:
    path = tmp_path / "search.toml"
    path.write_text("[unsupervised]\ndelay_cels = 5\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"unsupervised\.delay_cells"):
        load_toml(path, Search)


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        (Search(guards=Guards(threshold_cn0_dbhz=10.0)), "guards.threshold_cn0_dbhz"),
        (Search(unsupervised=UnsupervisedReceiver(cn0_dbhz=10.0)), "unsupervised.cn0_dbhz"),
    ],
)
def test_threshold_below_what_can_be_detected_is_a_contradiction(settings: Search, key: str) -> None:
    detection = Detection(coherent_limit_s=0.02, max_looks=50)
    contradiction = settings.model_copy(update={"detection": detection})
    with pytest.raises(ConfigError) as error:
        rules_of(contradiction, detector(detection))
    assert error.value.key == key
