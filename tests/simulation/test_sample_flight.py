"""The sample flight: repeatable, small, what its note says, and the one that lies in data/."""

from __future__ import annotations

import filecmp
import gzip
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pymap3d import geodetic2ecef
from scipy.spatial.transform import Rotation

from insgnss.config.flight import FlightConfig
from insgnss.constants import C_MPS
from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.simulation.atmosphere import broadcast_atmosphere
from insgnss.simulation.observations import AntennaMotion, signal_paths
from insgnss.simulation.sample_flight import (
    FILES,
    GPS_WEEK,
    LEVER_ARM_B,
    PSEUDORANGE_NOISE,
    RANGE_RATE_NOISE,
    START_S,
    TACTICAL,
    TCXO,
    sample_scenario,
    write_sample_flight,
)
from tests.conftest import REPOSITORY
from tests.statistics_bounds import assert_mean_chi_square

COMMITTED = REPOSITORY / "data" / "sample_flight"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    write_sample_flight(folder)
    return folder


def plain(path: Path) -> str:
    data = path.read_bytes()
    return (gzip.decompress(data) if path.suffix == ".gz" else data).decode("ascii")


@pytest.mark.parametrize("name", FILES)
def test_the_committed_files_are_the_scripts(name: str, made: Path) -> None:
    # another machine's mathematical library may round the last digit of a number differently
    number = re.compile(r"-?\d+\.?\d*(?:E[+-]\d+)?")
    committed, fresh = plain(COMMITTED / name), plain(made / name)
    assert number.sub("#", committed) == number.sub("#", fresh)
    if name.endswith((".csv", ".csv.gz")):
        texts = [re.sub(r"[A-Z]\d\d,C1C", "0,0", text) for text in (committed, fresh)]
        a, b = (np.loadtxt(text.splitlines()[1:], delimiter=",") for text in texts)
        assert np.max(np.abs(a - b)) <= 1.001e-3
    if name == "nav.rnx":
        a, b = (np.array([float(n) for n in number.findall(text)]) for text in (committed, fresh))
        assert a == pytest.approx(b, rel=1e-10)


def test_the_same_seed_gives_the_same_bytes_in_another_process(tmp_path: Path) -> None:
    call = "from pathlib import Path; from insgnss.simulation.sample_flight import write_sample_flight as w; "
    code = f"{call} w(Path({str(tmp_path / 'one')!r}), seed=7, duration_s=30.0)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=REPOSITORY)
    write_sample_flight(tmp_path / "two", seed=7, duration_s=30.0)
    write_sample_flight(tmp_path / "three", seed=8, duration_s=30.0)
    _, differing, missing = filecmp.cmpfiles(tmp_path / "one", tmp_path / "two", FILES, shallow=False)
    assert not differing and not missing
    assert not filecmp.cmp(tmp_path / "one" / "gnss.csv", tmp_path / "three" / "gnss.csv", shallow=False)


def test_the_folder_stays_below_five_megabytes() -> None:
    files = list(COMMITTED.iterdir())
    assert {file.name for file in files} == {*FILES, "picture.png"}  # drawn by tests/benchmarks/picture.py
    assert sum(file.stat().st_size for file in files) < 5e6


def test_the_flight_file_is_valid_and_names_what_was_simulated() -> None:
    config = FlightConfig.model_validate(tomllib.loads((COMMITTED / "flight.toml").read_text()))
    assert config.gps_week == GPS_WEEK
    assert config.gnss.lever_arm_m == LEVER_ARM_B
    assert config.imu.grade == TACTICAL.model_copy(update={"source": ""})
    assert config.gnss.oscillator == TCXO.model_copy(update={"source": ""})
    assert config.reference is not None
    for file in (*config.imu.files, *config.gnss.files, *config.gnss.navigation, config.reference.file):
        assert (COMMITTED / file).is_file()


def test_the_logs_cover_twenty_minutes() -> None:
    imu = pd.read_csv(COMMITTED / "imu.csv.gz")
    gnss = pd.read_csv(COMMITTED / "gnss.csv")
    reference = pd.read_csv(COMMITTED / "reference.csv")
    assert len(imu) == 120_000 and imu["time_s"].iloc[-1] == START_S + 1200.0
    assert np.diff(imu["time_s"]) == pytest.approx(0.01)
    assert gnss["time_s"].nunique() == 1200 and gnss["sv"].nunique() == 11
    assert len(reference) == 12_001
    satellites = gnss.groupby("time_s").size()
    assert satellites.max() == 11 and 5 <= satellites.min() < 9


def test_observations_fit_the_written_truth_with_the_stated_noise() -> None:
    """The reference file, the lever arm and the satellites explain the GNSS file; what is left is the noise."""
    reference = pd.read_csv(COMMITTED / "reference.csv").set_index("time_s")
    gnss = pd.read_csv(COMMITTED / "gnss.csv")
    scenario = sample_scenario()
    truth = reference.loc[np.unique(gnss["time_s"])]
    place = np.column_stack([np.deg2rad(truth[["lat_deg", "lon_deg"]].to_numpy()), truth["h_m"]])
    r_e = _ecef(place)
    C_en = np.swapaxes(ned_axes(place), 1, 2)
    angles = truth[["yaw_deg", "pitch_deg", "roll_deg"]].to_numpy()
    C_eb = C_en @ Rotation.from_euler("ZYX", angles, degrees=True).as_matrix()
    antenna_e = r_e + C_eb @ np.array(LEVER_ARM_B)
    antenna = AntennaMotion(antenna_e, np.zeros_like(r_e), C_eb)
    tag_s = truth.index.to_numpy() - START_S
    eph = scenario.navigation.ephemerides
    row = np.searchsorted(tag_s, gnss["time_s"] - START_S)
    column = np.searchsorted(eph.sv_names, gnss["sv"].to_numpy(dtype=str))
    clock = np.zeros_like(tag_s)
    # the receiver clock of each epoch is unknown: the weighted mean is its estimate, and dates the second pass
    for _ in range(2):
        t_s = tag_s - clock / C_MPS
        paths = signal_paths(antenna, eph, scenario.start_ns, t_s)
        delay = broadcast_atmosphere(scenario.navigation.klobuchar)(
            paths.geodetic, paths.azimuth, paths.elevation, START_S + t_s
        )
        predicted = paths.range_m - C_MPS * (paths.satellite.clock_s - eph.group_delay_s[:, 0]) + delay
        residual = gnss["pseudorange_m"].to_numpy() - predicted[row, column]
        sigma = PSEUDORANGE_NOISE.sigma(paths.elevation[row, column], gnss["cn0_dbhz"].to_numpy())
        weight = 1.0 / sigma**2
        clock = np.bincount(row, weight * residual) / np.bincount(row, weight)
    chi2 = float(np.sum(weight * (residual - clock[row]) ** 2))
    freedom = len(residual) - len(clock)
    assert_mean_chi_square(np.full(freedom, chi2 / freedom), 1)
    assert clock[0] == pytest.approx(0.3e-3 * C_MPS, abs=5.0)
    # 50 m/s, and a random walk of the frequency that is 3.8 m/s (one sigma) in the mean of twenty minutes
    assert (clock[-1] - clock[0]) / 1199.0 == pytest.approx(50.0, abs=15.0)


def _ecef(place: np.ndarray) -> np.ndarray:
    return np.column_stack(geodetic2ecef(place[:, 0], place[:, 1], place[:, 2], deg=False))


def test_the_place_of_the_reference_is_read_back() -> None:
    place = np.array([[np.deg2rad(59.97), np.deg2rad(30.32), 20.0]])
    assert geodetic(_ecef(place)) == pytest.approx(place, abs=1e-9)


def test_range_rate_noise_is_named_in_the_note() -> None:
    note = (COMMITTED / "README.md").read_text()
    for terms in (PSEUDORANGE_NOISE, RANGE_RATE_NOISE):
        assert f"{terms.floor}, {terms.elevation}, {terms.cn0} m" in note
