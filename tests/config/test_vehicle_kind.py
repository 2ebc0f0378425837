"""``[vehicle]``: the defaults of each kind, what may be given instead, what is refused, what ``check`` says."""

from __future__ import annotations

from pathlib import Path

import pytest

from insgnss.config.strict import StrictModel, changed, load_toml
from insgnss.config.vehicle_kind import VEHICLE_KINDS, VehicleRows
from insgnss.errors import ConfigError
from insgnss.log.checks.declaration import vehicle_findings
from insgnss.sensors.vehicle_rows import vehicle_measurements, vehicle_states


class File(StrictModel):
    vehicle: VehicleRows


def read(folder: Path, text: str) -> VehicleRows:
    path = folder / "flight.toml"
    path.write_text(text, encoding="utf-8")
    return load_toml(path, File).vehicle


@pytest.mark.parametrize("kind", VEHICLE_KINDS)
def test_every_kind_has_its_rows_with_numbers_of_its_own(kind: str, tmp_path: Path) -> None:
    vehicle = read(tmp_path, f'[vehicle]\nkind = "{kind}"\n')
    rows = {"car": 3, "train": 3, "ship": 1, "aircraft": 3, "drone": 2, "pedestrian": 2, "none": 0}
    assert len(vehicle.rows) == rows[kind]
    assert [each.name for each in vehicle_measurements(vehicle)] == list(vehicle.rows)
    assert len(vehicle_states(vehicle)) == (kind in ("car", "train", "ship", "aircraft"))
    assert changed(vehicle, {}) == vehicle  # as it is written into a run's settings and read again


def test_number_that_is_given_takes_the_place_of_the_kinds_own_and_the_others_stay(tmp_path: Path) -> None:
    text = '[vehicle]\nkind = "car"\n[vehicle.non_holonomic]\nlateral_mps = 0.2\naxle_m = [-1.2, 0.0, 0.5]\n'
    along = read(tmp_path, text).non_holonomic
    plain = read(tmp_path, '[vehicle]\nkind = "car"\n').non_holonomic
    assert along is not None and plain is not None
    assert (along.lateral_mps, along.vertical_mps) == (0.2, plain.vertical_mps)
    assert (along.axle_sd_m, plain.axle_sd_m) == (0.1, 1.5)  # known once it is given


def test_rows_can_be_switched_off_and_angles_taken_for_exact(tmp_path: Path) -> None:
    text = '[vehicle]\nkind = "car"\nzero_rate = { on = false }\nnon_holonomic = { mounting_sd_deg = 0.0 }\n'
    vehicle = read(tmp_path, text)
    assert vehicle.rows == ("non_holonomic", "zero_velocity")
    assert vehicle_states(vehicle) == ()


WRONG = {
    "kind": ('kind = "bicycle"\n', "vehicle.kind"),
    "no kind": ("period_s = 1.0\n", "missing"),
    "rows of another kind": (
        'kind = "ship"\nnon_holonomic = { on = true }\n',
        "no non_holonomic; it has: course",
    ),
    "misspelt": ('kind = "car"\nnon_holonomic = { lateral = 0.1 }\n', "lateral_mps"),
    "negative": ('kind = "car"\nnon_holonomic = { lateral_mps = -0.1 }\n', "lateral_mps"),
    "too fast": ('kind = "car"\nperiod_s = 0.001\n', "period_s"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_is_refused_with_its_key(case: str, tmp_path: Path) -> None:
    lines, told = WRONG[case]
    with pytest.raises(ConfigError, match=told):
        read(tmp_path, f"[vehicle]\n{lines}")


def test_check_says_which_rows_are_used_and_that_the_axle_is_missing(tmp_path: Path) -> None:
    found = vehicle_findings(read(tmp_path, '[vehicle]\nkind = "car"\nzero_rate = { on = false }\n'))
    assert found[0].text == ("car: rows non_holonomic, zero_velocity every 1 s; switched off: zero_rate")
    assert found[1].severity == "warning" and "axle_m" in found[1].advice
    assert vehicle_findings(read(tmp_path, '[vehicle]\nkind = "none"\n'))[0].text.endswith("no rows")
