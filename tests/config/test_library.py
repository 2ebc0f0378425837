"""The model library: what is in it, where it is looked for, and what a wrong name gives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insgnss.attitude.two_stage import equivalent_orders
from insgnss.attitude.vehicle import array_of_vehicle
from insgnss.config import library
from insgnss.errors import ConfigError, ModelError

CLOCK = 'h0_s = 1e-20\nh_minus2_per_s = 1e-24\nsource = "{}"\n'


@pytest.fixture(autouse=True)
def _no_library_of_the_user(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("INSGNSS_MODELS", raising=False)


@pytest.mark.parametrize("name", library.names("imus"))
def test_every_grade_can_be_read_and_names_its_source(name: str) -> None:
    assert library.imu_grade(name).source


@pytest.mark.parametrize("name", library.names("oscillators"))
def test_every_oscillator_can_be_read_and_names_its_source(name: str) -> None:
    assert library.oscillator(name).source


def test_grades_get_worse_from_navigation_to_consumer() -> None:
    order = ("navigation", "tactical", "tactical_low", "industrial", "mems_consumer")
    grades = [library.imu_grade(name) for name in order]
    assert set(order) <= set(library.names("imus"))
    for key in (
        "gyro_bias_deg_per_h",
        "gyro_arw_deg_per_sqrt_h",
        "accel_bias_mg",
        "accel_vrw_mps_per_sqrt_h",
    ):
        values = [getattr(grade, key) for grade in grades]
        assert values == sorted(values)


def test_users_folder_comes_before_the_environment_and_that_before_the_repository(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine, environment = tmp_path / "mine", tmp_path / "environment"
    for folder in (mine, environment):
        (folder / "oscillators").mkdir(parents=True)
        (folder / "oscillators" / "tcxo.toml").write_text(CLOCK.format(folder.name))
    assert library.oscillator("tcxo").source not in ("mine", "environment")
    monkeypatch.setenv("INSGNSS_MODELS", str(environment))
    assert library.oscillator("tcxo").source == "environment"
    assert library.oscillator("tcxo", (mine,)).source == "mine"


def test_file_may_lie_directly_in_the_users_folder(tmp_path: Path) -> None:
    (tmp_path / "my_clock.toml").write_text(CLOCK.format("mine"))
    assert library.oscillator("my_clock", (tmp_path,)).source == "mine"


def test_unknown_name_lists_the_nearest() -> None:
    with pytest.raises(ModelError, match="tactical_low"):
        library.imu_grade("tactical_lo")


@pytest.mark.parametrize("name", ["", "../oscillators/tcxo", "/etc/passwd"])
def test_name_cannot_leave_the_library(name: str) -> None:
    with pytest.raises(ModelError):
        library.imu_grade(name)


def test_model_with_a_wrong_key_is_a_settings_error(tmp_path: Path) -> None:
    (tmp_path / "odd.toml").write_text(CLOCK.format("x").replace("h0_s", "h0"))
    with pytest.raises(ConfigError, match="h0_s"):
        library.oscillator("odd", (tmp_path,))


@pytest.mark.parametrize("name", library.names("vehicles"))
def test_every_vehicle_of_the_library_is_an_array_of_antennas(name: str) -> None:
    found = library.vehicle(name)
    array = array_of_vehicle(name)

    assert found.source
    assert array.names == tuple(antenna.name for antenna in found.antenna)
    assert array.lengths_m.min() > 0.1


def test_the_papers_triangles_are_equilateral() -> None:
    for edge_m in (1.0, 2.0):
        array = array_of_vehicle(f"triangle_{edge_m:.0f}m")
        distance = np.linalg.norm(array.positions_b[:, None] - array.positions_b[None], axis=-1)

        assert distance[np.triu_indices(3, 1)] == pytest.approx([edge_m] * 3, abs=1e-6)


def test_an_aircrafts_swapped_cables_can_be_told_apart() -> None:
    assert equivalent_orders(array_of_vehicle("light_aircraft")) == []


def test_a_vehicle_without_the_antenna_asked_for_is_refused() -> None:
    with pytest.raises(ConfigError, match="no antenna 'nose'"):
        array_of_vehicle("light_aircraft", first="nose")
