"""The study without a filter: tables, dilution, sources, pictures and the command."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import typer
from typer.testing import CliRunner

from insgnss.cli.command import OwnCommand
from insgnss.cli.visibility import visibility as command
from insgnss.config.filter import Visibility
from insgnss.config.library import filter_config
from insgnss.errors import ConfigError, InputError, NavigationDataError
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.log.flight import Flight
from insgnss.log.rinex.navigation import read_navigation
from insgnss.runs.visibility import (
    AttitudeHistory,
    SatelliteDirections,
    VisibilityStudy,
    sky_of_navigation,
    sky_of_table,
    visibility,
)
from insgnss.runs.visibility.sources import visibility_of
from insgnss.runs.visibility.study import DOPS, dilutions
from insgnss.simulation.constellation import satellite_states
from insgnss.tables import ReferenceTable
from tests.antenna.vehicle import HIDDEN_FIVE, attitudes, paper_sky, vehicle

SAMPLE = Path(__file__).resolve().parents[2] / "data" / "sample_flight"
WEEK = 2385
APP = typer.Typer()
APP.command(cls=OwnCommand)(command)


def paper_table() -> pd.DataFrame:
    """Return the study's satellites at start and end of its 20 minutes."""
    rows = []
    for at_s in (0.0, 1200.0):
        names, azimuth, elevation = paper_sky(at_s)
        rows.append(pd.DataFrame({"time_s": at_s, "sv": names, "az_deg": azimuth, "el_deg": elevation}))
    return pd.concat(rows)


def banking_study(settings: Visibility, pattern: str = "cardioid") -> VisibilityStudy:
    """Return the study's 200 s: on heading 355.5 deg, banked by 43.5 deg to the left from 80 to 100 s."""
    at_s = np.arange(0.0, 200.0)
    roll = np.where((at_s >= 80.0) & (at_s < 100.0), -43.5, 0.0)
    history = attitudes(np.column_stack([roll, np.zeros(len(at_s)), np.full(len(at_s), 355.5)]), step_s=1.0)
    return visibility(history, sky_of_table(history, paper_table(), WEEK), vehicle(pattern), settings)


SEED_SETTINGS = Visibility(threshold_gain_dbic=-5.3, hysteresis_db=0.0)


def test_study_of_the_bank_gives_the_dilution_of_the_study() -> None:
    dop = banking_study(SEED_SETTINGS).dop.set_index("time_s").loc[90.0]

    # printed with three decimals
    expected = {"gdop_all": 2.242, "pdop_all": 2.008, "hdop_all": 1.069, "vdop_all": 1.700}
    expected |= {"gdop_seen": 4.292, "pdop_seen": 3.707}
    assert dop[list(expected)].to_dict() == pytest.approx(expected, abs=5.1e-4)
    assert (dop["n_all"], dop["n_seen"]) == (11.0, 6.0)


def test_study_of_the_bank_hides_its_satellites_while_it_lasts() -> None:
    table = banking_study(SEED_SETTINGS).satellites
    hidden = table[table["decision"] == "hidden"]

    assert set(hidden["sv"].astype("str")) == HIDDEN_FIVE
    assert sorted(set(hidden["time_s"])) == list(np.arange(80.0, 100.0))
    assert set(hidden["reason"].astype("str")) == {"masked_gain"}
    assert len(table) == 200 * 11


def test_isotropic_antenna_changes_no_dilution_to_the_last_bit() -> None:
    dop = banking_study(SEED_SETTINGS, "isotropic").dop

    for name in ("n", *DOPS):
        np.testing.assert_array_equal(dop[f"{name}_seen"], dop[f"{name}_all"])


def test_stage_switched_off_changes_no_dilution() -> None:
    dop = banking_study(SEED_SETTINGS.model_copy(update={"on": False})).dop

    np.testing.assert_array_equal(dop["n_seen"], dop["n_all"])


def test_threshold_that_masks_everything_is_told_once_and_has_no_dilution() -> None:
    study = banking_study(Visibility(threshold_gain_dbic=40.0))

    assert study.events["kind"].tolist() == ["few_satellites_seen"]
    assert study.events["detail"].tolist() == ["fewer than four satellites visible for 199.0 s"]
    assert (study.dop["n_seen"] == 0).all()
    assert study.dop["pdop_seen"].isna().all()


def test_body_directions_are_the_level_ones_when_the_vehicle_stands_level_to_the_north() -> None:
    history = attitudes([0.0, 0.0, 0.0])
    table = visibility(history, sky_of_table(history, paper_table(), WEEK), vehicle("patch_l1")).satellites

    np.testing.assert_allclose(table["body_az_deg"], table["az_deg"], atol=1e-9)
    np.testing.assert_allclose(table["body_el_deg"], table["el_deg"], atol=1e-9)


def test_satellite_under_the_horizons_mask_counts_in_neither_dilution() -> None:
    history = attitudes([0.0, 0.0, 0.0])
    sky = sky_of_table(history, paper_table(), WEEK)
    study = visibility(history, sky, vehicle("isotropic"), elevation_mask_deg=22.5)
    low = study.satellites["el_deg"] < 22.5

    assert study.dop["n_all"].tolist() == [11 - low.sum()]
    assert (study.satellites.loc[low, "reason"] == "masked_elevation").all()


def test_uncertain_decisions_are_counted_and_hidden_where_that_is_asked_for() -> None:
    history = attitudes(np.tile([-25.0, 0.0, 0.0], (10, 1)), sd_deg=3.0, step_s=1.0)
    sky = sky_of_table(history, paper_table(), WEEK)
    studies = {
        name: visibility(
            history, sky, vehicle("cardioid"), SEED_SETTINGS.model_copy(update={"uncertain": name})
        )
        for name in ("keep", "hide", "deweight")
    }
    for name, study in studies.items():
        undecided = study.satellites["decision"].astype("str").str.startswith("uncertain")
        assert study.events["kind"].tolist() == ["masking_uncertain"]
        assert study.events["detail"].iloc[0].startswith(f"{undecided.sum()} of 110 decisions")
        assert undecided.sum() > 0 and ("hidden" in study.events["detail"].iloc[0]) == (name == "hide")
    lost = studies["keep"].dop["n_seen"].sum() - studies["hide"].dop["n_seen"].sum()
    undecided = studies["hide"].satellites["decision"].astype("str") == "uncertain_hidden"
    assert lost == undecided.sum()
    pd.testing.assert_frame_equal(studies["keep"].dop, studies["deweight"].dop)


def test_heading_not_yet_known_is_told() -> None:
    history = attitudes(np.tile([-60.0, 0.0, 0.0], (10, 1)), sd_deg=10.0, step_s=1.0)
    study = visibility(history, sky_of_table(history, paper_table(), WEEK), vehicle("cardioid"))

    assert study.events["kind"].tolist() == ["masking_waits"]
    assert (study.dop["n_seen"] == 11).all()


# --- dilution ------------------------------------------------------------------------------------------------------


def test_further_constellation_adds_its_clock_and_a_lone_satellite_of_it_nothing() -> None:
    names, azimuth, elevation = paper_sky(90.0)
    sky = SatelliteDirections(
        (*names, "E07"),
        np.append(np.radians(azimuth), 2.0)[None],
        np.append(np.radians(elevation), 0.7)[None],
    )
    u_n = sky.directions()
    alone = np.ones((1, 12), np.bool_)
    without = alone.copy()
    without[0, -1] = False

    np.testing.assert_allclose(dilutions(u_n, sky.sv_names, alone), dilutions(u_n, sky.sv_names, without))
    assert dilutions(u_n, (*names, "G99"), alone)[0, 0] < dilutions(u_n, sky.sv_names, without)[0, 0]


def test_three_satellites_or_four_in_one_direction_have_no_dilution() -> None:
    names, azimuth, elevation = paper_sky(0.0)
    u_n = SatelliteDirections(names, np.radians(azimuth)[None], np.radians(elevation)[None]).directions()
    three = np.zeros((1, 11), np.bool_)
    three[0, :3] = True

    assert np.isnan(dilutions(u_n, names, three)).all()
    assert np.isnan(dilutions(np.repeat(u_n[:, :1], 4, axis=1), names[:4], np.ones((1, 4), np.bool_))).all()


# --- sources -------------------------------------------------------------------------------------------------------


def test_sky_of_messages_is_where_an_independent_orbit_has_the_satellites() -> None:
    navigation, _ = read_navigation([SAMPLE / "nav.rnx"])
    position = np.array([[math.radians(59.97), math.radians(30.32), 20.0]])
    t_ns = np.array([(WEEK * 604_800 + 293_700) * 10**9])
    sky = sky_of_navigation(AttitudeHistory(t_ns, position, np.eye(3)[None], np.zeros((1, 3, 3))), navigation)
    r_e, C_ne = np.zeros(3), np.zeros((3, 3))
    geodetic_to_ecef(*position[0], r_e)
    ecef_to_ned_matrix(*position[0, :2], C_ne)
    order = [navigation.ephemerides.sv_names.index(name) for name in sky.sv_names]
    placed = satellite_states(navigation.ephemerides, int(t_ns[0]), np.zeros((1, len(order)))).r_e[0, order]
    towards = (placed - r_e) @ C_ne.T
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    angle = np.degrees(np.arcsin(np.linalg.norm(np.cross(sky.directions()[0], towards), axis=1)))

    # the independent orbit is that of the reception: within the 75 ms of flight a satellite moves 300 m, 8e-4 deg
    assert angle.max() < 1e-3


def test_messages_of_another_year_are_refused() -> None:
    navigation, _ = read_navigation([SAMPLE / "nav.rnx"])
    history = attitudes([0.0, 0.0, 0.0])
    late = AttitudeHistory(history.t_ns + 52 * 604_800 * 10**9, history.position, history.C_nb, history.P_b)

    with pytest.raises(NavigationDataError, match="no navigation message covers"):
        sky_of_navigation(late, navigation)


def test_sky_of_a_table_ends_with_its_rows_and_at_a_gap() -> None:
    table = pd.DataFrame(
        {"time_s": [1.0, 2.0, 12.0], "sv": "G05", "az_deg": [359.0, 1.0, 21.0], "el_deg": [10.0, 20.0, 30.0]}
    )
    history = attitudes(np.zeros((14, 3)), step_s=1.0)
    whole = sky_of_table(history, table, WEEK)
    parted = sky_of_table(history, table, WEEK, longest_gap_s=5.0)

    assert np.flatnonzero(np.isfinite(whole.elevation[:, 0])).tolist() == list(range(1, 13))
    assert np.flatnonzero(np.isfinite(parted.elevation[:, 0])).tolist() == [1, 2, 12]
    assert np.degrees(whole.azimuth[7, 0]) == pytest.approx(11.0)
    assert np.degrees(whole.elevation[7, 0]) == pytest.approx(25.0)


def test_reference_without_attitude_is_refused_and_single_rows_are_left_out() -> None:
    n = 5
    reference = ReferenceTable(
        np.arange(n) * 10**9, *np.full((3, n), 10.0), np.zeros((n, 3)), np.full((n, 3), np.nan), np.ones(n)
    )
    with pytest.raises(InputError, match=r"reference\.csv: no row has position and attitude"):
        AttitudeHistory.of_reference(reference, file=Path("reference.csv"))

    reference.rpy_deg[1:4] = 0.0
    history, events = AttitudeHistory.of_reference(reference)
    assert history.t_ns.tolist() == [10**9, 2 * 10**9, 3 * 10**9]
    assert "2 of 5 rows" in events[0].detail


def test_history_by_quaternion_is_that_by_angles() -> None:
    by_angles = attitudes([30.0, 0.0, 0.0])
    half = math.radians(15.0)
    by_quaternion = AttitudeHistory.from_quaternion(
        by_angles.t_ns, np.array([[2.0 * math.cos(half), 2.0 * math.sin(half), 0.0, 0.0]]), by_angles.position
    )

    np.testing.assert_allclose(by_quaternion.C_nb, by_angles.C_nb, atol=1e-15)


@pytest.mark.parametrize("times", [[], [0, 0], [1, 0]])
def test_history_whose_times_do_not_increase_is_refused(times: list[int]) -> None:
    n = len(times)
    with pytest.raises(InputError, match="times that increase"):
        AttitudeHistory.from_rpy(np.array(times, np.int64), np.zeros((n, 3)), np.zeros((n, 3)))


def test_angles_sigmas_become_a_covariance_in_the_body() -> None:
    rpy, step = np.radians([20.0, -35.0, 80.0]), 1e-7
    place = np.zeros((1, 3))
    sd = np.array([[0.01, 0.02, 0.05]])
    P_b = AttitudeHistory.from_rpy(np.zeros(1, np.int64), rpy[None], place, sd).P_b[0]
    C = AttitudeHistory.from_rpy(np.zeros(1, np.int64), rpy[None], place).C_nb[0]
    columns = []
    for k in range(3):
        moved = AttitudeHistory.from_rpy(
            np.zeros(1, np.int64), (rpy + step * np.eye(3)[k])[None], place
        ).C_nb[0]
        skew = C.T @ moved / step
        columns.append([skew[2, 1], skew[0, 2], skew[1, 0]])
    E = np.array(columns).T

    np.testing.assert_allclose(P_b, E @ np.diag(sd[0] ** 2) @ E.T, rtol=1e-5, atol=1e-9)


def test_sample_flight_has_its_low_satellites_hidden_in_its_turns() -> None:
    study = visibility_of(
        SAMPLE / "reference.csv",
        Flight.load(SAMPLE / "flight.toml"),
        filter_config("tight17"),
        "cardioid",
        step_s=5.0,
    )
    hidden = study.satellites[study.satellites["decision"] == "hidden"]

    assert set(hidden["sv"].astype("str")) >= {"G16", "G31"}
    assert "G23" not in set(hidden["sv"].astype("str"))
    # hidden until the gain is 1 dB above the threshold of -5 dBic: at 15.2 deg
    assert 7.0 < hidden["body_el_deg"].max() < 15.2
    assert study.dop["pdop_seen"].max() > 1.2 * study.dop["pdop_all"].max()


def test_flight_without_antenna_and_without_a_pattern_is_refused() -> None:
    with pytest.raises(ConfigError, match="no antenna is described"):
        visibility_of(SAMPLE / "reference.csv", Flight.load(SAMPLE / "flight.toml"), filter_config("tight17"))


def sample_with_antenna(folder: Path) -> Path:
    """Return a flight file of the sample flight with an antenna, an obstruction and absolute paths."""
    text = (SAMPLE / "flight.toml").read_text(encoding="utf-8")
    for name in ("imu.csv.gz", "gnss.csv", "nav.rnx", "reference.csv"):
        text = text.replace(f'"{name}"', f'"{(SAMPLE / name).as_posix()}"')
    mounted = '[[gnss.antenna]]\nname = "top"\npattern = "patch_l1"\nobstruction = "tail.toml"\n\n[reference]'
    (folder / "flight.toml").write_text(text.replace("[reference]", mounted), encoding="utf-8")
    (folder / "tail.toml").write_text(
        'frame = "body_forward_right_down"\nsource = "test"\n[[sector]]\n'
        "azimuth_deg = [150.0, 210.0]\nelevation_deg = [-90.0, 30.0]\n",
        encoding="utf-8",
    )
    return folder / "flight.toml"


def test_antenna_of_the_flight_file_has_its_lever_arm_and_obstruction(tmp_path: Path) -> None:
    flight = Flight.load(sample_with_antenna(tmp_path))
    study = visibility_of(SAMPLE / "reference.csv", flight, filter_config("tight17"), step_s=20.0)

    assert study.antennas.lever_b.tolist() == [[0.8, 0.0, -1.1]]
    assert (study.satellites["reason"] == "masked_obstruction").any()


# --- the command ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_command_writes_tables_and_pictures(tmp_path: Path, form: str) -> None:
    options = ["--flight", str(sample_with_antenna(tmp_path)), "--step", "20", "--format", form]
    out = tmp_path / "out"
    result = CliRunner().invoke(APP, [str(SAMPLE / "reference.csv"), *options, "--output", str(out)])

    assert result.exit_code == 0, result.output
    assert "behind the airframe" in result.output
    tables = {f"visibility_{name}.{form}" for name in ("satellites", "dop", "events")}
    pictures = {f"visibility_{name}.png" for name in ("sky", "timeline", "dop")}
    assert {path.name for path in out.glob("[!.]*")} == tables | pictures
    assert all((out / name).read_bytes().startswith(b"\x89PNG") for name in pictures)
    read = pd.read_parquet if form == "parquet" else pd.read_csv
    assert len(read(out / f"visibility_dop.{form}")) == 61


def saved_run(folder: Path) -> Path:
    """Return the folder of a run of 100 s, banked 60 deg to the left, whose heading is known from its middle on."""
    folder.mkdir()
    at_s = np.arange(293_800.0, 293_900.0)
    columns = {"time_s": at_s, "lat_deg": 59.97, "lon_deg": 30.32, "h_m": 20.0, "roll_deg": -60.0}
    columns |= {"pitch_deg": 0.0, "yaw_deg": 0.0, "sd_roll_deg": 0.1, "sd_pitch_deg": 0.1}
    nav = pd.DataFrame(columns | {"sd_yaw_deg": np.where(at_s < 293_850.0, 30.0, 1.0)})
    seen = paper_table()[lambda table: table["time_s"] == 0.0].drop(columns="time_s")
    tables = {
        "nav": nav,
        "measurements": pd.DataFrame({"time_s": at_s, "sv": "G01"}),
        "satellites": pd.concat([seen.assign(time_s=293_800.0), seen.assign(time_s=293_850.0)]),
        "events": pd.DataFrame({"time_s": [0.0], "kind": ["a"], "detail": ["b"]}),
    }
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False)
    (folder / "settings.json").write_text("{}", encoding="utf-8")
    return folder


def test_command_studies_a_saved_run_with_the_runs_own_sigmas(tmp_path: Path) -> None:
    options = ["--flight", str(SAMPLE / "flight.toml"), "-a", "cardioid", "--no-pictures"]
    run = str(saved_run(tmp_path / "run"))
    result = CliRunner().invoke(APP, [run, *options, "-o", str(tmp_path / "out")])

    assert result.exit_code == 0, result.output
    assert "masking_waits" in result.output
    dop = pd.read_parquet(tmp_path / "out" / "visibility_dop.parquet").set_index("time_s")
    assert dop.loc[293_849.0, "n_seen"] == 11
    assert dop.loc[293_851.0, "n_seen"] == 5


def test_run_of_a_flight_without_messages_knows_itself_where_its_satellites_stood(tmp_path: Path) -> None:
    text = (SAMPLE / "flight.toml").read_text(encoding="utf-8")
    (tmp_path / "flight.toml").write_text(text.replace('navigation = ["nav.rnx"]', ""), encoding="utf-8")
    flight = Flight.load(tmp_path / "flight.toml")
    study = visibility_of(saved_run(tmp_path / "run"), flight, filter_config("tight17"), "isotropic")

    # the run's satellites end after 50 s
    assert study.dop["n_all"].tolist() == [11] * 51 + [0] * 49
    first = study.satellites[study.satellites["time_s"] == 293_800.0]
    np.testing.assert_allclose(first["az_deg"], sorted_by_name(paper_sky(0.0)[1]), atol=1e-9)


def sorted_by_name(values: np.ndarray) -> np.ndarray:
    return values[np.argsort(paper_sky(0.0)[0])]


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["-a", "patch_11"], 2, "patch_l1"),
        (["-a", "nowhere.csv"], 3, "file not found"),
        ([], 2, "no antenna is described"),
        (["-a", "patch_l1", "--format", "xml"], 2, "parquet"),
        (["-a", "patch_l1", "--step", "-1"], 2, "'--step': -1 is not"),
    ],
)
def test_command_answers_wrong_options_with_an_error(options: list[str], code: int, words: str) -> None:
    flight = ["--flight", str(SAMPLE / "flight.toml")]
    result = CliRunner().invoke(APP, [str(SAMPLE / "reference.csv"), *flight, *options])

    assert result.exit_code == code
    assert words in result.output + result.stderr


def test_threshold_of_the_command_is_used(tmp_path: Path) -> None:
    options = ["--flight", str(SAMPLE / "flight.toml"), "-a", "cardioid", "--threshold", "40", "--step", "60"]
    result = CliRunner().invoke(APP, [str(SAMPLE / "reference.csv"), *options])

    assert result.exit_code == 0, result.output
    assert "few_satellites_seen" in result.output
    assert "nothing was written" in result.output
