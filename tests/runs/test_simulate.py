"""From a scenario to a folder and back: the same seed the same files, other skies, a logged reference, the command."""

from __future__ import annotations

import filecmp
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import insgnss
from insgnss.cli.main import app
from insgnss.constants import NS_PER_S
from insgnss.errors import InputError
from insgnss.log.rinex.navigation import read_navigation
from insgnss.log.yuma import read_yuma
from insgnss.runs.simulate import simulate
from insgnss.simulation.chosen_messages import nearest_messages, referred_to, rows_of
from insgnss.simulation.constellation import satellite_states
from insgnss.tables import EphemerisTable, NavigationData

HEAD = """\
gps_week = 2385
start_s = 293700.0
duration_s = 20.0
"""
MOVING = """\
speed_mps = 40.0
place = { lat_deg = 50.0, lon_deg = 8.0, h_m = 500.0 }
[[manoeuvre]]
kind = "straight"
duration_s = 20.0
"""


def scenario(folder: Path, text: str) -> Path:
    path = folder / "scenario.toml"
    path.write_text(HEAD + text)
    return path


def test_same_seed_gives_the_same_files_and_another_seed_others(tmp_path: Path) -> None:
    for folder, seed in (("one", 5), ("two", 5), ("three", 6)):
        names = [path.name for path in simulate("aerobatics", seed, duration_s=20.0).save(tmp_path / folder)]
    _, differing, missing = filecmp.cmpfiles(tmp_path / "one", tmp_path / "two", names, shallow=False)
    assert not differing and not missing
    for name in ("imu.csv", "gnss.csv"):
        assert not filecmp.cmp(tmp_path / "one" / name, tmp_path / "three" / name, shallow=False)


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (
            "carrier_noise_m = { floor = 0.001, elevation = 0.0005, cn0_at_45_dbhz = 0.002 }",
            (0.002, 0.001, 0.0005, 0.0, 60.0),
        ),
        # B / (C/N0) = 15 / 31623 rad^2 and 1 + 1 / (2 T C/N0) = 1.0008, times the wavelength over 2 pi
        (
            "carrier_noise_m = { floor = 0.001 }\n[gnss.loops]",
            (0.19029 / (2.0 * np.pi) * np.sqrt(15.0 / 10.0**4.5 * 1.00079), 0.0, 0.0, 0.0, 60.0),
        ),
        # 0.1 m at every elevation, 0.02 of it on the carrier
        (
            "carrier_noise_m = { floor = 0.001 }\n[gnss.multipath]\nfloor_m = 0.1\nhorizon_m = 0.0\n"
            "carrier_ratio = 0.02\ncorrelation_time_s = 20.0",
            (1e-5, 0.001, 0.0, 0.002, 20.0),
        ),
    ],
)
def test_flight_file_declares_the_phase_noise_of_several_antennas(
    lines: str, told: tuple[float, ...], tmp_path: Path
) -> None:
    antenna = '[attitude]\n[[attitude.antenna]]\nname = "ahead"\nlever_arm_m = [1.0, 0.0, 0.0]\n'
    path = scenario(tmp_path, f"{MOVING}[gnss]\n{lines}\n{antenna}")
    simulate(path).save(tmp_path / "out")
    attitude = insgnss.Flight.load(tmp_path / "out" / "flight.toml").config.attitude

    assert attitude is not None
    found = (attitude.phase_sigma_m, attitude.phase_floor_m, attitude.phase_elevation_m)
    assert (*found, attitude.multipath_sigma_m, attitude.multipath_time_s) == pytest.approx(told, rel=2e-4)


def test_log_on_disk_is_the_log_in_memory(tmp_path: Path) -> None:
    made = simulate("ship_in_waves", duration_s=30.0)  # increments, carriers, an ocean below
    made.save(tmp_path)
    logs = insgnss.Flight.load(tmp_path / "flight.toml").read()
    assert np.array_equal(logs.imu.t_ns, made.log.imu.t_ns)
    # decimals of the file: 1e-11 rad and 1e-9 m/s over 10 ms
    assert logs.imu.w_ib_b == pytest.approx(made.log.imu.w_ib_b, abs=1e-9)
    assert logs.imu.f_b == pytest.approx(made.log.imu.f_b, abs=1e-7)
    assert np.array_equal(logs.gnss.t_ns, made.log.gnss.t_ns)
    assert logs.gnss.pseudorange_m == pytest.approx(made.log.gnss.pseudorange_m, abs=5.1e-4)
    assert logs.gnss.carrier_cycles == pytest.approx(made.log.gnss.carrier_cycles, abs=5.1e-4)
    assert logs.reference is not None and len(logs.reference.t_ns) == 301


def test_message_that_is_missing_is_not_in_the_file_but_its_satellite_is_in_the_log(tmp_path: Path) -> None:
    made = simulate("faulty_receiver", duration_s=10.0)
    made.save(tmp_path)
    sent, _ = read_navigation([tmp_path / "nav.rnx"])
    assert "G03" in made.log.navigation.ephemerides.sv_names
    assert "G03" not in sent.ephemerides.sv_names
    log = pd.read_csv(tmp_path / "gnss.csv")
    visible = {made.log.gnss.sv_names[k] for k in made.log.gnss.sv}
    assert set(log["sv"]) == visible


def states(table: EphemerisTable, start_ns: int, t_s: float) -> np.ndarray:
    return satellite_states(table, start_ns, np.full((1, len(table.sv_names)), t_s)).r_e[0]


def test_sky_of_a_rinex_file_is_that_of_its_messages(tmp_path: Path) -> None:
    first = simulate("turning_flight", duration_s=20.0)
    first.save(tmp_path / "made")
    sky = '[sky]\nkind = "rinex"\nfiles = ["made/nav.rnx"]\n'
    again = simulate(scenario(tmp_path, MOVING + sky))
    a, b = first.log.navigation.ephemerides, again.log.navigation.ephemerides
    assert a.sv_names == b.sv_names
    start = again.scenario.start_ns
    assert states(a, start, 100.0) == pytest.approx(states(b, start, 100.0), abs=1e-6)
    run = again.save(tmp_path / "again")
    assert insgnss.Flight.load(run[4]).read().navigation is not None


def test_message_at_another_reference_time_is_the_same_orbit_and_clock() -> None:
    made = simulate("at_rest", duration_s=10.0)
    navigation, start = made.log.navigation, made.scenario.start_ns
    plain = {f: np.zeros_like(navigation.ephemerides.cuc) for f in ("cuc", "cus", "crc", "crs", "cic", "cis")}
    eph = EphemerisTable(**{**vars(navigation.ephemerides), **plain})
    moved = referred_to(NavigationData(eph, None, None), int(eph.toe_ns[0]) + 3 * 86_400 * NS_PER_S)
    # 13 digits of angles and of the mean motion's product with three days: a centimetre
    assert states(moved.ephemerides, start, 0.0) == pytest.approx(states(eph, start, 0.0), abs=0.02)
    assert not np.array_equal(moved.ephemerides.omega0, eph.omega0)


def test_nearest_message_is_chosen_among_the_healthy_ones() -> None:
    made = simulate("at_rest", duration_s=10.0)
    navigation, start = made.log.navigation, made.scenario.start_ns
    eph = rows_of(navigation.ephemerides, [0, 0, 0, 1])
    offsets = np.array([0, 3600, -1800, 600]) * NS_PER_S
    health = np.array([1.0, 0.0, 0.0, 0.0])
    eph = EphemerisTable(**{**vars(eph), "toe_ns": start + offsets, "health": health})
    chosen = nearest_messages(NavigationData(eph, None, None), start, 300.0).ephemerides
    assert chosen.toe_ns.tolist() == [start - 1800 * NS_PER_S, start + 600 * NS_PER_S]


def write_yuma(path: Path, eph: EphemerisTable, week: int) -> None:
    """Write an almanac as the Coast Guard does, with its digits."""
    lines = []
    for k, name in enumerate(eph.sv_names):
        lines += [
            f"******** Week {week % 1024:4d} almanac for PRN-{name[1:]} ********",
            f"ID:                         {name[1:]}",
            f"Health:                     {int(eph.health[k]):03d}",
            f"Eccentricity:               {eph.e[k]:.10E}",
            f"Time of Applicability(s):  {eph.toe_sow_s[k]:.4f}",
            f"Orbital Inclination(rad):   {eph.i0[k]:.10f}",
            f"Rate of Right Ascen(r/s):  {eph.omega_dot[k]:.10E}",
            f"SQRT(A)  (m 1/2):           {eph.sqrt_a[k]:.6f}",
            f"Right Ascen at Week(rad):  {eph.omega0[k]:.10E}",
            f"Argument of Perigee(rad):   {eph.omega[k]:.9f}",
            f"Mean Anom(rad):            {eph.m0[k]:.10E}",
            f"Af0(s):                     {eph.af0[k]:.10E}",
            f"Af1(s/s):                  {eph.af1[k]:.10E}",
            f"week:                        {week % 1024}",
            "",
        ]
    path.write_text("\n".join(lines))


def test_almanac_puts_the_satellites_where_they_are_and_replays(tmp_path: Path) -> None:
    first = simulate("turning_flight", duration_s=20.0)
    eph = first.log.navigation.ephemerides
    write_yuma(tmp_path / "week.alm", eph, 2385)
    read = read_yuma(tmp_path / "week.alm", 2385)
    assert read.ephemerides.sv_names == eph.sv_names
    assert np.array_equal(read.ephemerides.toe_ns, eph.toe_ns)
    again = simulate(scenario(tmp_path, MOVING + '[sky]\nkind = "yuma"\nfile = "week.alm"\n'))
    start = again.scenario.start_ns
    apart = states(again.log.navigation.ephemerides, start, 0.0) - states(eph, start, 0.0)
    # what an almanac leaves out: harmonics of some 100 m, delta n
    assert 10.0 < np.linalg.norm(apart, axis=1).max() < 3000.0
    again.save(tmp_path / "out")
    assert len(insgnss.Flight.load(tmp_path / "out" / "flight.toml").read().gnss.t_ns) > 100


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [("SQRT(A)", "SQRT(B)", "sqrt"), (".", "x", "not a valid almanac value"), ("ID:", "NAME:", "not a YUMA")],
)
def test_damaged_almanac_is_told(old: str, new: str, told: str, tmp_path: Path) -> None:
    eph = simulate("at_rest", duration_s=2.0).log.navigation.ephemerides
    write_yuma(tmp_path / "week.alm", rows_of(eph, [0]), 2385)
    text = (tmp_path / "week.alm").read_text()
    (tmp_path / "week.alm").write_text(text.replace(old, new))
    with pytest.raises(InputError) as caught:
        read_yuma(tmp_path / "week.alm", 2385)
    assert told.lower() in str(caught.value).lower()


@pytest.mark.parametrize("with_attitude", [True, False])
def test_logged_reference_is_followed(with_attitude: bool, tmp_path: Path) -> None:
    first = simulate("turning_flight", duration_s=200.0)
    first.save(tmp_path / "made")
    log = pd.read_csv(tmp_path / "made" / "reference.csv")
    if not with_attitude:
        log = log.drop(columns=["roll_deg", "pitch_deg", "yaw_deg"])
    log.to_csv(tmp_path / "track.csv", index=False)
    text = HEAD.replace("293700.0", "293830.0").replace("duration_s = 20.0", "duration_s = 60.0")
    (tmp_path / "scenario.toml").write_text(
        text + '[follow]\nfile = "track.csv"\nfrom_s = 293810.0\nto_s = 293899.0\n'
    )
    again = simulate(tmp_path / "scenario.toml")
    t = np.arange(0.0, 60.0, 0.7)
    a = first.scenario.trajectory.motion(t + 130.0)
    b = again.scenario.trajectory.motion(t)
    assert b.r_e == pytest.approx(a.r_e, abs=0.02)
    assert b.v_e == pytest.approx(a.v_e, abs=0.05)
    turned = np.einsum("nji,njk->nik", a.C_eb, b.C_eb)
    angle = np.degrees(np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0)))
    # without an attitude the bank is that of a coordinated turn: what the climb's bend and noise of digits leave
    assert angle.max() < (0.1 if with_attitude else 1.5)


def test_reference_with_a_gap_is_told_with_its_moment(tmp_path: Path) -> None:
    simulate("turning_flight", duration_s=60.0).save(tmp_path / "made")
    log = pd.read_csv(tmp_path / "made" / "reference.csv")
    log.drop(index=range(300, 350)).to_csv(tmp_path / "track.csv", index=False)
    with pytest.raises(insgnss.InsGnssError, match=r"gap of 5\.1 s at 29\.9 s") as caught:
        simulate(scenario(tmp_path, '[follow]\nfile = "track.csv"\n'))
    assert "smoothing_s" in str(caught.value)


def test_antenna_files_of_the_scenario_go_with_the_flight(tmp_path: Path) -> None:
    (tmp_path / "fin.toml").write_text(
        'frame = "body_forward_right_down"\nsource = "test"\n'
        "[[sector]]\nazimuth_deg = [90, 270]\nelevation_deg = [-90, 89]\n"
    )
    antenna = (
        '[[gnss.antenna]]\npattern = "isotropic"\nlever_arm_m = [0.1, 0.2, -0.3]\nobstruction = "fin.toml"\n'
    )
    plain = simulate(scenario(tmp_path, MOVING))
    made = simulate(scenario(tmp_path, MOVING + antenna))
    assert 0 < len(made.log.gnss.t_ns) < 0.8 * len(plain.log.gnss.t_ns)
    made.save(tmp_path / "out")
    assert (tmp_path / "out" / "fin.toml").is_file()
    config = insgnss.Flight.load(tmp_path / "out" / "flight.toml").config
    assert config.gnss.antenna[0].lever_arm_m == (0.1, 0.2, -0.3)


def test_command_writes_the_folder_and_tells_of_it(tmp_path: Path) -> None:
    call = ["simulate", "city_car", "-o", str(tmp_path), "--seed", "4", "--duration", "10"]
    result = CliRunner().invoke(app, call)
    assert result.exit_code == 0, result.output
    assert "city car: 10 s, 1000 inertial samples" in result.output
    assert (tmp_path / "flight.toml").is_file()
    clean = CliRunner().invoke(app, [*call, "--clean"])
    assert clean.exit_code == 0
    unknown = CliRunner().invoke(app, ["simulate", "city_cat", "-o", str(tmp_path)])
    assert unknown.exit_code == 2


def test_duration_beyond_the_scenario_is_told(tmp_path: Path) -> None:
    call = ["simulate", str(scenario(tmp_path, MOVING)), "--duration", "600", "-o", str(tmp_path / "made")]
    result = CliRunner().invoke(app, call)
    assert "the scenario ends before the 600 s of --duration" in result.output, result.output
