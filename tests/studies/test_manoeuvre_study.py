"""The manoeuvre study: a bank hides what lies behind it, steeper ones more, and D agrees with the paper's scenario."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from insgnss.config.library import scenario_config
from insgnss.errors import ConfigError, ModelError
from insgnss.studies import ManoeuvreStudy, hidden_satellite_variance, manoeuvre_study

BANKS_DEG = (-45.0, 0.0, 30.0, 45.0)
HEADINGS_DEG = (0.0, 90.0, 180.0)


@cache
def studied() -> ManoeuvreStudy:
    return manoeuvre_study(banks_deg=BANKS_DEG, headings_deg=HEADINGS_DEG)


def case(study: ManoeuvreStudy, bank: float, heading: float) -> pd.Series:
    rows = study.cases[(study.cases["bank_deg"] == bank) & (study.cases["heading_deg"] == heading)]
    assert len(rows) == 1
    return rows.iloc[0]


def test_the_papers_manoeuvre_has_the_numbers_of_its_own_study() -> None:
    config = scenario_config("sokolov_2015")
    study = manoeuvre_study(
        config, banks_deg=(config.bank.roll_deg,), headings_deg=(config.bank.heading_deg,)
    )
    alone = hidden_satellite_variance(config, outage="bank", until_s=101.0)
    expected = alone.at([100.0]).iloc[0]

    row = study.cases.iloc[0]
    assert row["hidden"] == "G01 G16 G30 G31 G32"
    assert row["d_worst_m2"] == expected.max()
    found = study.satellites.set_index("sv").loc[list(expected.index), "d_range_m2"]
    assert found.to_numpy() == pytest.approx(expected.to_numpy(), rel=1e-12)


def test_level_hides_nothing_and_a_steeper_bank_hides_at_least_as_much() -> None:
    for heading in HEADINGS_DEG:
        level, gentle, steep = (case(studied(), bank, heading) for bank in (0.0, 30.0, 45.0))
        assert level["n_hidden"] == 0
        assert np.isnan(level["d_worst_m2"])
        assert set(gentle["hidden"].split()) <= set(steep["hidden"].split())
        assert level["pdop"] <= gentle["pdop"] <= steep["pdop"]
        assert level["sd_position_m"] < gentle["sd_position_m"]


def test_manoeuvre_does_not_depend_on_those_before_it() -> None:
    alone = manoeuvre_study(banks_deg=(45.0,), headings_deg=(180.0,))

    assert alone.cases.iloc[0].to_dict() == case(studied(), 45.0, 180.0).to_dict()


def test_bank_to_the_left_hides_the_other_side() -> None:
    """To the north right wing down hides the west, left wing down the east, as the other way round to the south."""
    rows = studied().satellites.query("hidden")
    for bank, heading, side in ((45.0, 0.0, "west"), (-45.0, 0.0, "east"), (45.0, 180.0, "east")):
        hidden = rows[(rows["bank_deg"] == bank) & (rows["heading_deg"] == heading)]
        east = np.sin(np.radians(hidden["az_deg"])) > 0.0
        assert len(hidden) >= 3
        assert (east if side == "east" else ~east).all()


def test_dilution_is_that_of_the_satellites_left() -> None:
    rows = studied().satellites
    left = rows[(rows["bank_deg"] == 45.0) & (rows["heading_deg"] == 0.0) & ~rows["hidden"]]
    az, el = np.radians(left["az_deg"]), np.radians(left["el_deg"])
    H = np.column_stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el), np.ones(len(left))])
    Q = np.linalg.inv(H.T @ H)

    row = case(studied(), 45.0, 0.0)
    assert row["n_seen"] == len(left)
    assert row["pdop"] == pytest.approx(np.sqrt(np.trace(Q[:3, :3])), rel=1e-3)
    assert row["gdop"] == pytest.approx(np.sqrt(np.trace(Q)), rel=1e-3)


def test_better_imu_predicts_the_hidden_better_and_an_even_antenna_hides_nothing() -> None:
    study = manoeuvre_study(
        banks_deg=(45.0,),
        headings_deg=(180.0,),
        imus=("navigation", "industrial"),
        antennas=("cardioid", "isotropic"),
    )
    worst = study.cases.set_index(["imu", "antenna"])["d_worst_m2"]

    assert worst["navigation", "cardioid"] < 0.5 * worst["industrial", "cardioid"]
    assert np.isnan(worst["navigation", "isotropic"])


def test_study_writes_tables_and_heat_maps(tmp_path: Path) -> None:
    studied().save(tmp_path)

    assert len(pd.read_csv(tmp_path / "manoeuvre_cases.csv")) == len(BANKS_DEG) * len(HEADINGS_DEG)
    assert len(pd.read_csv(tmp_path / "manoeuvre_satellites.csv")) == 11 * 12
    assert (tmp_path / "manoeuvre_d_worst_m2.png").stat().st_size > 10_000
    assert (tmp_path / "manoeuvre_pdop.png").exists()


def test_impossible_grid_is_refused_by_its_key() -> None:
    for key, grid in (("banks_deg", {"banks_deg": (90.0,)}), ("headings_deg", {"headings_deg": ()})):
        with pytest.raises(ConfigError) as caught:
            manoeuvre_study(**grid)  # type: ignore[arg-type]
        assert caught.value.key == key
    with pytest.raises(ModelError):
        manoeuvre_study(imus=("nothing",))
    with pytest.raises(ConfigError, match="no column"):
        studied().heat_map("hidden")
