"""The margin along a path: link budget by hand, reduces to the closed forms, and what must matter does."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from insgnss.antenna.gain_pattern import GainTable, pattern_of
from insgnss.antenna.installation import Installation
from insgnss.config.interference import InterferenceConfig
from insgnss.config.strict import load_toml
from insgnss.constants import C_MPS
from insgnss.errors import ConfigError, InputError, ModelError
from insgnss.geodesy.rotations import euler_to_matrix
from insgnss.gnss.signals import L1_HZ
from insgnss.interference.discriminators import discriminator, inverse_cn0
from insgnss.interference.drift import density_of_walk
from insgnss.interference.margin import PhaseLoop, margin_db, threshold_cn0_dbhz
from insgnss.interference.spectra import broadband_separation, modulation_of, signal_named
from insgnss.interference.steady_acceleration import density_at_threshold
from insgnss.interference.third_order import third_order_threshold_noise
from insgnss.runs.datum import FLIGHT, GPS_WEEK
from insgnss.runs.margin import FlownMargin, flown_margin, picture
from insgnss.runs.margin.figures import flown_figure
from tests.runs.margin.scene import EMITTER, SETTINGS, TURN_MPS2, N, flown, interference


def of(study: FlownMargin, sv: str) -> pd.DataFrame:
    """Return a satellite's rows in order of time."""
    rows = study.satellites
    return rows[rows["sv"] == sv].reset_index(drop=True)


def antenna(down_dbic: float) -> Installation:
    """Return one antenna: 0 dBic above its horizon, another gain below."""
    gain = np.array([[down_dbic] * 4, [down_dbic] * 4, [0.0] * 4, [0.0] * 4])
    angles = np.array([-90.0, -1.0, 0.0, 90.0]), np.array([0.0, 90.0, 180.0, 270.0])
    table = GainTable("half", L1_HZ, "RHCP", "test", *angles, gain)
    clear = np.full((1, 180, 360), 127, np.int8)
    return Installation(pattern_of([table]), np.eye(3)[None], np.zeros((1, 3)), clear, np.zeros(1, np.bool_))


def test_received_power_is_friis_law_at_the_distance() -> None:
    study = flown_margin(flown(), interference())
    first = study.emitters.iloc[0]
    # 0.05 deg of latitude, 0.1 deg of longitude, 950 m: a sphere's degrees, good to 0.3 %
    north, east = 0.05 * 111_400.0, 0.1 * 111_400.0 * math.cos(math.radians(60.0))
    distance = math.sqrt(north**2 + east**2 + 950.0**2)
    loss = 20.0 * math.log10(4.0 * math.pi * distance * L1_HZ / C_MPS)

    assert first["distance_m"] == pytest.approx(distance, rel=3e-3)
    assert first["received_dbw"] == pytest.approx(-loss, abs=0.03)
    assert first["az_deg"] == pytest.approx(math.degrees(math.atan2(east, north)), abs=0.2)
    assert first["el_deg"] < 0.0 and first["in_sight"]
    assert study.satellites["js_db"].iloc[0] == pytest.approx(-loss + 158.5, abs=0.03)


def test_effective_cn0_is_noise_and_separated_interference_added() -> None:
    row = of(flown_margin(flown(), interference()), "G05").iloc[7]
    kappa = broadband_separation(modulation_of(signal_named("G:C1C")), 20e6, 0.0, 20e6)
    by_hand = -10.0 * math.log10(10.0**-4.5 + 10.0 ** (row["js_db"] / 10.0) * kappa)

    assert row["cn0_effective_dbhz"] == pytest.approx(by_hand, abs=1e-9)


def test_limit_without_acceleration_is_the_closed_form_with_thermal_noise() -> None:
    study = flown_margin(flown(), interference(receiver={"discriminator": "IQ"}))
    row = of(study, "G05").iloc[5]  # long before the turn
    kappa = broadband_separation(modulation_of(signal_named("G:C1C")), 20e6, 0.0, 20e6)
    loop = PhaseLoop(discriminator("IQ"), 1.0 / kappa, 0.020)
    S = float(density_of_walk(4e-25, L1_HZ))

    assert row["drift_unaided_rad2ps3"] == pytest.approx(S, rel=1e-6)
    assert row["js_limit_unaided_db"] == pytest.approx(float(margin_db(S, loop, 45.0)), abs=1e-6)


def test_reserve_ends_where_the_interference_reaches_the_limit() -> None:
    table = flown_margin(flown(), interference({**EMITTER, "eirp_dbw": 10.0})).satellites
    for loop in ("unaided", "aided"):
        lost = ~table[f"lock_{loop}"]
        assert (lost == (table[f"reserve_{loop}_db"] <= 0.0)).all()
        assert (lost == (table["js_db"] >= table[f"js_limit_{loop}_db"])).all()
        assert 0 < lost.sum() < len(table)


def test_turn_takes_lock_from_the_unaided_loop_alone_and_along_the_line_of_sight_alone() -> None:
    study = flown_margin(flown(), interference(dynamics={"window_s": 1.0}))
    east, zenith = of(study, "G05"), of(study, "E11")
    turning = slice(65, 85)

    # cos 30 deg of 5 m/s^2 towards G05, nothing towards the zenith
    assert (east["threshold_unaided_dbhz"][turning] > east["threshold_unaided_dbhz"][10] + 5.0).all()
    assert np.allclose(zenith["threshold_unaided_dbhz"], zenith["threshold_unaided_dbhz"][10], atol=1e-6)
    assert np.allclose(east["threshold_aided_dbhz"], east["threshold_aided_dbhz"][10], atol=1e-6)
    assert TURN_MPS2 == 5.0


def test_loop_without_aiding_is_the_better_of_second_and_third_order() -> None:
    study = flown_margin(flown(), interference(dynamics={"window_s": 1.0, "oscillator_density": 77.0}))
    east = of(study, "G05")
    straight, turning = east.iloc[5], east.iloc[75]
    sigma = math.cos(math.radians(30.0)) * TURN_MPS2
    loop = PhaseLoop(discriminator("atan(Q/I)"), 1.0, 0.020)
    rms = loop.discriminator.threshold_rms_rad
    by_second = threshold_cn0_dbhz(density_at_threshold(77.0, sigma, 5.0, L1_HZ, rms), loop)
    noise = third_order_threshold_noise(77.0, rms, sigma, 5.0, L1_HZ)
    by_third = -10.0 * math.log10(float(inverse_cn0(loop.discriminator, noise, 0.020)))

    assert (straight["order_unaided"], turning["order_unaided"]) == (2, 3)
    assert turning["threshold_unaided_dbhz"] == pytest.approx(by_third, abs=1e-3)
    assert by_third < float(by_second) - 1.0
    # the drift of the table is that of the same threshold, by (18)
    drift = east[["drift_unaided_rad2ps3", "drift_aided_rad2ps3"]].to_numpy()
    limits = east[["threshold_unaided_dbhz", "threshold_aided_dbhz"]].to_numpy()
    assert threshold_cn0_dbhz(drift, loop) == pytest.approx(limits, abs=1e-6)


def test_aiding_table_tells_the_residual_acceleration() -> None:
    run, told = flown(), []
    for sigma in (0.001, 1.0):
        aiding = run.satellites[["time_s", "sv"]].assign(sd_range_acceleration_mps2=sigma)
        aiding["time_s"] += 0.02
        run.aiding = aiding  # type: ignore[attr-defined]
        study = flown_margin(run, interference())
        assert "aiding_absent" not in set(study.events["kind"])
        told.append(of(study, "G05")["drift_aided_rad2ps3"].iloc[0])
    assert told[1] > 100.0 * told[0]


def test_run_without_aiding_is_bounded_by_tilt_and_bias_and_says_so() -> None:
    study = flown_margin(flown(), interference())
    assert {"aiding_absent", "antenna_unknown"} <= set(study.events["kind"])
    run = flown()
    run.nav["sd_roll_deg"] = 2.0
    worse = flown_margin(run, interference())
    assert (worse.satellites["drift_aided_rad2ps3"] > 10.0 * study.satellites["drift_aided_rad2ps3"]).all()


def test_tilt_turns_gravity_into_residual_acceleration() -> None:
    run = flown()
    run.nav["sd_roll_deg"] = math.degrees(2e-3)
    for axis in "xyz":
        run.nav[f"sd_accel_bias_{axis}_mps2"] = 0.003
    by_tilt = flown_margin(run, interference()).satellites["drift_aided_rad2ps3"]
    sigma = math.hypot(2e-3 * 9.80665, 0.003)
    run.aiding = run.satellites[["time_s", "sv"]].assign(sd_range_acceleration_mps2=sigma)  # type: ignore[attr-defined]
    by_aiding = flown_margin(run, interference()).satellites["drift_aided_rad2ps3"]

    assert by_tilt.to_numpy() == pytest.approx(by_aiding.to_numpy(), rel=1e-9)


def test_emitter_is_seen_in_body_axes_by_roll_pitch_and_yaw() -> None:
    run = flown()
    run.nav[["roll_deg", "pitch_deg", "yaw_deg"]] = [20.0, -35.0, 130.0]
    row = flown_margin(run, interference()).emitters.iloc[0]
    C_nb = np.empty((3, 3))
    euler_to_matrix(*np.radians([20.0, -35.0, 130.0]), C_nb)
    az, el = np.radians([row["az_deg"], row["el_deg"]])
    x, y, z = C_nb.T @ [math.cos(el) * math.cos(az), math.cos(el) * math.sin(az), -math.sin(el)]

    assert row["body_az_deg"] == pytest.approx(math.degrees(math.atan2(y, x)) % 360.0, abs=1e-9)
    assert row["body_el_deg"] == pytest.approx(-math.degrees(math.asin(z)), abs=1e-9)


def test_airframe_between_emitter_and_antenna_takes_its_loss() -> None:
    free = antenna(0.0)
    hidden = free._replace(clearance_deg=np.full((1, 180, 360), -5, np.int8), is_obstructed=np.array([True]))
    receiver = {"airframe_loss_db": 17.0}
    gains = [
        flown_margin(flown(), interference(receiver=receiver), antennas=one).emitters["gain_dbic"]
        for one in (free, hidden)
    ]
    assert (gains[0] - gains[1]).to_numpy() == pytest.approx(17.0)


def test_glonass_channels_stand_beside_a_narrow_emitter() -> None:
    run = flown(settings={**SETTINGS, "flight": {"gnss": {"glonass_channels": {"R05": -7, "R11": 0}}}})
    run.satellites["sv"] = run.satellites["sv"].astype("str").replace({"G05": "R05", "E11": "R11"})
    narrow = {**EMITTER, "frequency_hz": 1602e6, "bandwidth_hz": 0.5e6}
    study = flown_margin(run, interference(narrow))
    # channel -7 is 3.9 MHz away, in the eighth lobe of its spectrum
    effective = [of(study, sv)["cn0_effective_dbhz"].iloc[0] for sv in ("R05", "R11")]
    assert effective[0] > effective[1] + 15.0


def test_inertial_noise_limits_the_aided_loop() -> None:
    perfect = {"h0_s": 0.0, "h_minus2_per_s": 1e-40}
    grade = {**flown().settings["imu_grade"]}
    noisy, quiet = (
        flown(settings={"oscillator": perfect, "imu_grade": {**grade, "accel_vrw_mps_per_sqrt_h": vrw}})
        for vrw in (6.0, 0.0)
    )
    found = [
        of(flown_margin(run, interference()), "G05")["drift_aided_rad2ps3"].iloc[0] for run in (noisy, quiet)
    ]
    # 2 (2 pi f / c)^2 (0.1 m/s/sqrt s)^2 of white acceleration
    assert found[0] - found[1] == pytest.approx(2.0 * (2.0 * math.pi * L1_HZ / C_MPS) ** 2 * 0.01, rel=0.15)


def test_antenna_turned_away_hears_the_emitter_less_and_bank_brings_it_back() -> None:
    east = {**EMITTER, "lat_deg": 60.06, "lon_deg": 30.2}
    study = flown_margin(flown(), interference(east), antennas=antenna(-15.0))
    gain = study.emitters["gain_dbic"].to_numpy()
    # below the wings in level flight; the bank to the right turns the antenna's axis towards it
    assert gain[:55] == pytest.approx(-15.0, abs=0.5)
    assert gain[65:80] == pytest.approx(0.0, abs=0.5)
    assert "antenna_unknown" not in set(study.events["kind"])


def test_gain_of_the_satellite_counts_for_signal_and_noise_alike() -> None:
    low, none = (of(flown_margin(flown(g), interference()), "G05").iloc[0] for g in (-6.0, math.nan))
    assert none["cn0_dbhz"] - low["cn0_dbhz"] == pytest.approx(6.0)
    assert low["js_db"] - none["js_db"] == pytest.approx(6.0)


def test_emitter_beyond_the_horizon_adds_nothing_and_is_told() -> None:
    # 1000 m and 10 m see each other up to 143 km
    study = flown_margin(flown(), interference({**EMITTER, "lat_deg": 61.4, "h_m": 10.0}))
    assert np.isneginf(study.satellites["js_db"]).all()
    assert "emitter_beyond_horizon" in set(study.events["kind"])
    assert study.satellites["lock_unaided"].any()
    near = flown_margin(flown(), interference({**EMITTER, "lat_deg": 61.1, "h_m": 10.0}))
    assert np.isfinite(near.satellites["js_db"]).all()


def test_switched_emitters_add_up_while_they_are_on() -> None:
    late = {**EMITTER, "from_s": 1050.0, "until_s": 1060.0}
    one = of(flown_margin(flown(), interference()), "G05")["js_db"].to_numpy()
    two = of(flown_margin(flown(), interference(EMITTER, late)), "G05")["js_db"].to_numpy()
    on = (np.arange(N) >= 50) & (np.arange(N) < 60)
    assert two - one == pytest.approx(np.where(on, 10.0 * math.log10(2.0), 0.0), abs=1e-9)


def test_wave_between_galileo_and_gps_lobes_hits_only_who_listens_there() -> None:
    # on the carrier: the middle of C/A, a zero of the BOC of E1
    cw = {k: v for k, v in EMITTER.items() if k != "bandwidth_hz"} | {"kind": "cw", "frequency_hz": L1_HZ}
    study = flown_margin(flown(), interference(cw))
    assert of(study, "G05")["cn0_effective_dbhz"].iloc[0] < 25.0
    assert of(study, "E11")["cn0_effective_dbhz"].iloc[0] == pytest.approx(45.0, abs=1e-6)


def test_spells_without_lock_are_events_and_the_summary_counts_them() -> None:
    study = flown_margin(flown(), interference({**EMITTER, "eirp_dbw": 40.0}))
    lost = study.events[study.events["kind"] == "lock_lost_aided"]
    assert sorted(detail[:3] for detail in lost["detail"]) == ["E11", "G05"]
    assert (study.summary()["lock_aided_share"] == 0.0).all()
    assert (study.in_lock()["n_satellites"] == 2).all()


def test_study_is_saved_and_drawn(tmp_path: Path) -> None:
    study = flown_margin(flown(), interference(), step_s=10.0)
    folder = study.save(tmp_path / "out", "csv")
    again = pd.read_csv(folder / "margin_satellites.csv")
    assert len(again) == len(study.satellites) == 2 * 13
    path = picture(study, tmp_path / "out" / "lock.png")
    assert path.read_bytes()[:4] == b"\x89PNG"


def test_no_legend_of_the_picture_covers_its_caption() -> None:
    study = flown_margin(flown(), interference())
    study.satellites.attrs |= {GPS_WEEK: 2385, FLIGHT: "a flight with a name of many words, in the mountains"}
    figure = flown_figure(study)
    figure.draw_without_rendering()
    (caption,) = [text.get_window_extent() for text in figure.texts if text.get_text().endswith(" UTC")]
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes)]

    assert not any(caption.overlaps(legend.get_window_extent()) for legend in legends if legend)


def test_file_of_emitters_is_strict(tmp_path: Path) -> None:
    path = tmp_path / "emitters.toml"
    path.write_text("[[emitter]]\nlat_deg = 60.0\nlon_deg = 30.0\nh_m = 1.0\neirp_dbm = 3.0\n")
    with pytest.raises(ConfigError) as caught:
        load_toml(path, InterferenceConfig)
    assert caught.value.line == 5 and "eirp_dbw" in caught.value.advice
    path.write_text("[[emitter]]\nlat_deg = 60.0\nlon_deg = 30.0\nh_m = 1.0\neirp_dbw = 3.0\n")
    with pytest.raises(ConfigError, match="bandwidth_hz"):
        flown_margin(flown(), path)


def test_what_cannot_be_studied_is_refused_with_advice() -> None:
    run = flown()
    run.nav = run.nav.drop(columns="yaw_deg")
    with pytest.raises(InputError, match="yaw_deg"):
        flown_margin(run, interference())
    run = flown()
    run.satellites["time_s"] += 1e5
    with pytest.raises(InputError, match="no time"):
        flown_margin(run, interference())
    with pytest.raises(ConfigError, match="oscillator"):
        flown_margin(flown(settings={}), interference())
    with pytest.raises(ModelError, match="G05"):
        flown_margin(flown(), interference(receiver={"signals": {"G": "C9Z", "E": "C1C"}}))
    with pytest.raises(ModelError) as caught:
        flown_margin(flown(), interference(receiver={"discriminator": "atn"}))
    assert "atan" in caught.value.advice
    with pytest.raises(ConfigError, match="front_end_hz"):
        flown_margin(flown(), interference(receiver={"front_end_hz": 0.2e6}))
