"""What a receiver study refuses: numbers and names that make no sense, and settings that cannot give an answer."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from insgnss.cli.main import app
from insgnss.errors import ConfigError
from insgnss.studies import RECEIVERS, ReceiverOptions, receiver_study
from insgnss.studies.campaign.study import CampaignConfig, run_campaign
from insgnss.studies.receiver.admission import wanted_variants
from insgnss.studies.receiver.comparison import ReceiverStudy
from insgnss.studies.receiver.variants import Variant

NAN = math.nan
THREE = {"azimuth_deg": (10.0, 130.0, 250.0), "elevation_deg": (30.0, 40.0, 50.0)}
CONE = {"azimuth_deg": (10.0, 80.0, 150.0, 220.0, 300.0), "elevation_deg": (30.0,) * 5}


def flown(changed: dict[str, Any] | None = None, **asked: Any) -> ReceiverStudy:
    options = ReceiverOptions(**{"duration_s": 4.0, "settle_s": 1.0, **(changed or {})})
    usual = {"variants": ("one_stage",), "imu": "tactical", "cn0": (40.0,), "runs": 1, "options": options}
    return receiver_study("manoeuvring_5g", **{**usual, **asked})


@pytest.mark.parametrize(
    ("key", "asked"),
    [
        ("drift_density", {"oscillator": {"drift_density": 1e30}}),
        ("drift_density", {"oscillator": {"drift_density": "a"}}),
        *(("drift_density", {"oscillator": {"drift_density": least}}) for least in (1e-30, -1.0, NAN)),
        ("oscillator", {"oscillator": 5.0}),
        *(("runs", {"runs": runs}) for runs in (2.5, NAN, True, 0)),
        *(("seed", {"seed": seed}) for seed in (1.5, NAN, -1)),
        ("threads", {"threads": 1.5}),
        ("cn0", {"cn0": ("x",)}),
        ("cn0", {"cn0": (NAN,)}),
        ("imu", {"imu": 5}),
        ("tracking", {"tracking": None}),
        ("variants", {"variants": (5,)}),
        ("variants", {"variants": None}),
        ("cn0", {"cn0": True}),
        ("antennas", {"antennas": ()}),
        ("options", {"options": None}),
        ("report", {"report": 5}),
    ],
)
def test_call_that_makes_no_sense_is_refused_by_its_key(key: str, asked: dict[str, Any]) -> None:
    with pytest.raises(ConfigError) as error:
        flown(**asked)
    assert error.value.key == key and error.value.advice


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("phase_kind", (None, "q", "atan2")),
        ("step_s", ("a", None, 0.0, NAN)),
        ("azimuth_deg", (("a",), None, (NAN,), "1")),
        ("elevation_deg", ((None,), 5.0)),
        ("masking", ("no", 1, None)),
        ("estimates_cn0", ("yes", NAN)),
        ("imu_gaps_s", (None, "1", ((1,),), (("a", "b"),), (1.0,), ((1.001, 1.002),))),
        ("told_cn0_dbhz", (NAN, math.inf, 500.0, -50.0)),
        ("least_cn0_dbhz", (NAN, 100.0)),
        ("carrier_hz", (1e-30, 1e30)),
        ("chip_hz", (1e-9, 1e15)),
        ("orbit_radius_m", (1e20, 1e6)),
        ("replica_step_m", (1e9,)),
        ("replica_step_mps", (1e9,)),
        ("interval_s", (1e9,)),
        ("unknown_mps2", (1e30,)),
        ("unknown_s", (1e30, 1e-6)),
        ("symbol_s", (NAN, 0.0, -1.0)),
    ],
)
def test_option_that_makes_no_sense_is_refused_by_its_key(key: str, values: tuple[Any, ...]) -> None:
    for value in values:
        with pytest.raises(ConfigError) as error:
            flown({key: value})
        assert error.value.key == key and error.value.advice


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("kind", (99, -1, 1.5, None, True)),
        ("words", (5, "")),
        ("inflation", (NAN, 0.0, -1.0, None, math.inf)),
        ("widening", (NAN, 0.0, "a")),
        ("with_code", (1, "a", None, True)),
    ],
)
def test_receiver_that_makes_no_sense_is_refused_by_its_key(key: str, values: tuple[Any, ...]) -> None:
    for value in values:
        with pytest.raises(ConfigError) as error:
            replace(RECEIVERS["two_stage"], **{key: value})
        assert error.value.key == key and error.value.advice


def test_limit_of_cn0_that_no_channel_reaches_is_refused() -> None:
    with pytest.raises(ConfigError, match="no channel is ever used") as error:
        flown({"least_cn0_dbhz": 50.0})
    assert error.value.key == "least_cn0_dbhz"


def test_cn0_that_is_told_and_estimated_is_refused() -> None:
    with pytest.raises(ConfigError, match="estimates its C/N0 too") as error:
        flown({"told_cn0_dbhz": 40.0, "estimates_cn0": True})
    assert error.value.key == "told_cn0_dbhz"


@pytest.mark.parametrize(
    ("key", "value"), [("latency_s", 0.05), ("imu_rate_hz", 100.0), ("imu_gaps_s", ((1.0, 2.0),))]
)
def test_setting_of_an_inertial_system_that_is_not_there_is_refused(key: str, value: object) -> None:
    with pytest.raises(ConfigError, match="no inertial system") as error:
        flown({key: value}, imu=None)
    assert error.value.key == key


def test_divergence_of_phase_and_code_that_no_receiver_sees_is_refused() -> None:
    with pytest.raises(ConfigError, match="no receiver compares") as error:
        flown({"divergence_density": 1e-3})
    assert error.value.key == "divergence_density"
    wandered = flown({"divergence_density": 1e-3}, variants=("one_stage", "one_stage_code")).summary
    assert wandered["lost"].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("tracking", ["coherent", "noncoherent"])
def test_oscillator_too_fast_for_the_integration_is_refused(tracking: str) -> None:
    with pytest.raises(ConfigError, match="B T is too large") as error:
        flown({"step_s": 20e-3}, oscillator={"drift_density": 1e7}, tracking=tracking)
    assert error.value.key == "step_s"


def test_channels_that_follow_an_oscillator_without_drift_are_refused() -> None:
    with pytest.raises(ConfigError, match="and it has none") as error:
        flown(oscillator={"drift_density": 0.0}, variants=("two_stage",))
    assert error.value.key == "oscillator"
    # a filter that takes the observations itself needs no drift
    assert flown(oscillator={"drift_density": 0.0}).summary["lost"].item() == 0.0


@pytest.mark.parametrize(("sky", "reason"), [(THREE, "there are 3 satellites"), (CONE, "on one cone")])
def test_least_squares_without_a_geometry_says_why_not_and_one_stage_goes_on(
    sky: dict[str, Any], reason: str
) -> None:
    with pytest.raises(ConfigError, match=reason) as error:
        flown(sky, variants=("scalar",))
    assert error.value.key == "azimuth_deg"
    summary = flown(sky).summary

    assert summary["lost"].item() == 0.0 and np.isfinite(summary["velocity_mps"].item())
    assert np.isnan(summary["channels_mps"].item())  # the least squares of its channels


def test_pilot_is_integrated_beyond_a_symbol() -> None:
    study = flown({"symbol_s": math.inf, "step_s": 0.04, "interval_s": 0.2, "phase_kind": "q"})

    assert study.summary["lost"].item() == 0.0
    json.dumps(study.asked["options"], allow_nan=False)  # settings are written as a file


def test_settings_hold_every_number_of_a_receiver_of_ones_own() -> None:
    own = replace(RECEIVERS["two_stage"], words="wide", widening=9.0)
    asked = json.loads(json.dumps(flown(variants=("one_stage", own)).asked))

    assert asked["variants"] == ["one_stage", "wide"]
    assert {name: Variant(**numbers) for name, numbers in asked["own_variants"].items()} == {"wide": own}


def test_two_receivers_of_one_name_are_refused() -> None:
    wide = replace(RECEIVERS["two_stage"], widening=9.0)
    with pytest.raises(ConfigError, match="two different receivers") as refused:
        flown(variants=(RECEIVERS["two_stage"], wide))
    assert refused.value.key == "variants"
    # one receiver twice is one receiver
    assert list(wanted_variants(["two_stage", "two_stage"])) == ["two_stage"]


@pytest.mark.parametrize(
    ("options", "asked"),
    [
        ({"latency_s": 0.05}, {"variants": ("scalar",)}),
        ({"imu_gaps_s": ((1.0, 2.0),)}, {"variants": ("scalar",)}),
        ({"phase_kind": "atan"}, {"tracking": "noncoherent"}),
        ({"spacing_chips": 0.5}, {"variants": ("one_stage", "two_stage")}),
        ({"interval_s": 0.2}, {"variants": ("scalar", "one_stage")}),
    ],
)
def test_option_that_no_receiver_uses_is_refused(options: dict[str, Any], asked: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=r"no inertial system|no receiver (tracks|uses|has)") as error:
        flown(options, **asked)
    assert error.value.key == next(iter(options)) and error.value.advice


def test_option_that_no_case_of_a_campaign_uses_is_refused_before_it_runs(tmp_path: Path) -> None:
    """A scalar receiver has no second stage; beside one that has, an interval is part of the comparison."""
    grid = {"variant": ("scalar", "one_stage"), "cn0_dbhz": (5.0,)}
    fixed = {"interval_s": 0.2, "duration_s": 4.0, "settle_s": 1.0, "average_s": 1.0}
    asked = {"name": "few", "case": "receiver", "seeds": 1, "fixed": fixed}
    with pytest.raises(ConfigError, match="second stage") as error:
        run_campaign(CampaignConfig(**asked, grid=grid), tmp_path / "one", workers=0)
    assert error.value.key == "interval_s" and not (tmp_path / "one").exists()

    both = CampaignConfig(**asked, grid={**grid, "variant": ("scalar", "optimal")})
    assert run_campaign(both, tmp_path / "two", workers=0).n_failed == 0


@pytest.mark.parametrize("step_s", [0.0, -0.02, "fast"])
def test_case_with_a_step_that_is_not_positive_fails_alone(tmp_path: Path, step_s: object) -> None:
    grid = {"variant": ("scalar",), "step_s": (step_s, 0.02)}
    fixed = {"cn0_dbhz": 45.0, "duration_s": 4.0, "settle_s": 1.0, "average_s": 1.0}
    asked = CampaignConfig(name="steps", case="receiver", seeds=1, grid=grid, fixed=fixed)
    assert run_campaign(asked, tmp_path / "steps", workers=0).n_failed == 1


def test_cn0_beside_emitters_is_refused_by_the_command() -> None:
    """The C/N0 is that of the path past them."""
    told = CliRunner().invoke(app, ["receiver", "jammed_approach", "-e", "jammed_approach", "--cn0", "33"])
    assert told.exit_code == 2 and "--cn0 is not used with --emitters" in told.stderr


def test_options_that_one_receiver_uses_are_taken() -> None:
    both = flown({"latency_s": 0.01, "spacing_chips": 0.5}, variants=("scalar", "one_stage_code"))
    assert set(both.summary["variant"]) == {"scalar", "one_stage_code"}
    assert set(flown({"spacing_chips": 0.5}, tracking="noncoherent").summary["variant"]) == {"one_stage"}
