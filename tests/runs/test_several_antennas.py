"""Attitude from several antennas inside the filter: what they make known, and what they must not be misled by."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import insgnss
from insgnss.cli.main import app
from insgnss.errors import ConfigError, GeometryError, InputError, MissingFileError, TimeError
from insgnss.runs.result import Run
from insgnss.simulation.simulated_log import SimulatedLog
from insgnss.status import NAMES
from tests.attitude.several_flights import (
    SLALOM,
    TRIANGLE,
    events,
    fly,
    normalised,
    scenario_text,
    with_cycles,
    with_further,
    write_flight,
)
from tests.statistics_bounds import mean_chi_square_bounds

SCALENE = (("ahead", (1.4, 0.1, -1.3)), ("right", (0.9, 1.3, -1.3)))
KIND = "attitude_difference"


def differences(run: Run) -> dict[str, int]:
    """Return how many differences had each status."""
    own = run.measurements[run.measurements["kind"] == KIND]
    counts = own["status"].value_counts()
    return {name: int(n) for name, n in counts.items() if n}


@pytest.fixture(scope="module")
def at_rest(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return half a minute at rest with a triangle of 1 m."""
    return fly(tmp_path_factory.mktemp("rest"), scenario_text())


def test_heading_at_rest_becomes_known_within_its_predicted_sigma(at_rest: Run) -> None:
    assert at_rest.errors is not None
    before, after = at_rest.nav.iloc[0], at_rest.nav.iloc[-1]
    error = at_rest.errors["d_yaw_deg"].iloc[-1]

    # one epoch of 22 differences of 2 mm over 0.75 m rms of lever: 0.1 deg; 27 of them, and the gyros' walk
    assert before["sd_yaw_deg"] > 90.0
    assert after["sd_yaw_deg"] == pytest.approx(0.025, rel=0.25)
    assert abs(error) < 3.3 * after["sd_yaw_deg"]
    assert len(events(at_rest, "attitude_found")) == len(events(at_rest, "heading_known")) == 1


def test_heading_at_rest_stays_open_without_the_block(tmp_path: Path) -> None:
    path = write_flight(tmp_path, scenario_text())
    text = path.read_text(encoding="utf-8")
    bare = text[: text.index("[attitude]")] + text[text.index("[reference]") :]
    path.write_text(bare, encoding="utf-8")

    run = insgnss.replay(path)

    assert run.nav["sd_yaw_deg"].iloc[-1] > 20.0
    assert "antenna" not in run.measurements.columns


def test_attitude_and_innovations_are_consistent_over_runs(tmp_path: Path) -> None:
    # right after the heading was found, some seconds later, and at the end; common clock and clocks of their own
    squares, nis = [], []
    for seed in range(16):
        clocks = "separate" if seed % 2 else "common"
        run = fly(tmp_path, scenario_text(clocks=clocks, clock_bias_m=60_000.0), seed=seed)
        squares.append(normalised(run)[[4, 8, -1]] ** 2)
        nis.append(run.nis_summary().loc[KIND, "mean_nis"])

    for at in range(3):
        low, high = mean_chi_square_bounds(3, 16)
        assert low < np.mean([np.sum(square[at]) for square in squares]) < high
    # 16 runs of some 500 innovations; those of one phase share half their noise
    low, high = mean_chi_square_bounds(1, 16 * 500, effective_share=0.5)
    assert low < np.mean(nis) < high


def test_innovations_agree_with_the_phase_noise_that_simulate_writes(tmp_path: Path) -> None:
    """Noise of all three kinds: with C/N0, whatever C/N0, and towards the horizon; nothing declared by hand."""
    noise = "{ floor = 0.001, elevation = 0.0005, cn0_at_45_dbhz = 0.001 }"
    text = scenario_text().replace("{ floor = 0.0, cn0_at_45_dbhz = 0.0014 }", noise)
    nis = [fly(tmp_path, text, seed=seed).nis_summary().loc[KIND, "mean_nis"] for seed in range(301, 307)]

    # 6 runs of some 570 innovations; those of one phase share half their noise
    low, high = mean_chi_square_bounds(1, 6 * 570, effective_share=0.5)
    assert low < np.mean(nis) < high


@pytest.mark.parametrize("clocks", ["common", "separate"])
def test_moving_vehicle_has_its_attitude_within_its_sigma(tmp_path: Path, clocks: str) -> None:
    text = scenario_text(clocks=clocks, manoeuvres=SLALOM, speed_mps=60.0, clock_bias_m=60_000.0)

    run = fly(tmp_path, text)

    used = differences(run)["used"]
    rms = np.sqrt(np.mean(normalised(run, from_s=150_012.0) ** 2))
    assert used > 0.9 * sum(differences(run).values())
    # some 60 epochs, alike over some ten: the mean of 18 independent values, within 3.3 of its sigmas
    assert rms == pytest.approx(1.0, abs=0.5)
    assert run.nis_summary().loc[KIND, "mean_nis"] == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize("clocks", ["common", "separate"])
def test_antennas_tilted_against_each_other_see_the_wave_turned_and_stay_consistent(
    tmp_path: Path, clocks: str
) -> None:
    tilted = "mounting_rpy_deg = [25.0, 10.0, 40.0]"
    text = scenario_text(clocks=clocks, clock_bias_m=60_000.0, further=tilted)
    path = write_flight(tmp_path, text)

    run = insgnss.replay(path)

    # 40 deg about the vertical are 0.11 cycles, 2 cm: ten sigmas of a difference
    assert run.nis_summary().loc[KIND, "mean_nis"] == pytest.approx(1.0, abs=0.25)
    assert np.abs(normalised(run)[-1]).max() < 3.3
    path.write_text(path.read_text(encoding="utf-8").replace(tilted, ""), encoding="utf-8")
    if clocks == "common":  # else a clock takes up the most of it
        assert "used" not in differences(insgnss.replay(path))


def test_ledger_has_every_phase_of_the_further_antennas(at_rest: Run) -> None:
    own = at_rest.measurements[at_rest.measurements["kind"] == KIND]

    assert len(own) == 31 * 2 * 11  # epochs, antennas, satellites
    assert set(own["antenna"].unique()) == {"ahead", "right"}
    assert (at_rest.measurements.loc[at_rest.measurements["kind"] != KIND, "antenna"] == "").all()
    assert own.loc[own["status"] == "used", "nis"].notna().all()
    assert at_rest.measurements["time_s"].is_monotonic_increasing
    assert set(differences(at_rest)) <= set(NAMES.values())


def test_saved_run_holds_the_antennas(at_rest: Run, tmp_path: Path) -> None:
    for form in ("parquet", "csv"):
        loaded = Run.load(at_rest.save(tmp_path / form, format=form))

        assert loaded.measurements["antenna"].astype(str).tolist() == at_rest.measurements["antenna"].tolist()


def test_a_wrong_cycle_is_told_and_refused(tmp_path: Path) -> None:
    run = fly(tmp_path, scenario_text(), change=with_cycles(0, "G01", 15.0, 1.0))

    told = events(run, "attitude_cycles_wrong")
    assert len(told) == 1
    assert "G01 C1C, antenna ahead" in told[0]
    assert "+1 cycle" in told[0]
    assert differences(run)["cycles_wrong"] == 1
    assert np.abs(normalised(run)[-1]).max() < 3.3
    wrong = run.measurements[run.measurements["status"] == "cycles_wrong"]
    assert wrong["innovation"].iloc[0] == pytest.approx(0.1903, abs=0.02)  # a wavelength


def test_a_flagged_slip_is_resolved_anew_without_harm(at_rest: Run, tmp_path: Path) -> None:
    run = fly(tmp_path, scenario_text(), change=with_cycles(1, "G01", 15.0, 7.0, flagged=True))

    assert len(events(run, "attitude_slip")) == 1
    assert differences(run) == differences(at_rest)
    # but for the file's three decimals of a cycle, the same attitude
    assert run.nav["yaw_deg"].iloc[-1] == pytest.approx(at_rest.nav["yaw_deg"].iloc[-1], abs=1e-4)


def test_half_a_cycle_is_refused_and_never_taken_for_whole_ones(tmp_path: Path) -> None:
    run = fly(tmp_path, scenario_text(), change=with_cycles(0, "G01", 15.0, 0.5))

    own = run.measurements[(run.measurements["kind"] == KIND) & (run.measurements["sv"] == "G01")]
    late = own[(own["antenna"] == "ahead") & (own["time_s"] >= 150_015.0)]
    assert set(late["status"]) == {"gated", "cycles_open"}
    assert np.abs(normalised(run)[-1]).max() < 3.3


def test_swapped_cables_are_named_and_nothing_is_used(tmp_path: Path) -> None:
    run = fly(tmp_path, scenario_text(SCALENE), change=lambda log: replace(log, further=log.further[::-1]))

    told = events(run, "attitude_antennas_swapped")
    assert len(told) == 1
    assert "the log of 'ahead' fits the position of 'right'" in told[0]
    assert "used" not in differences(run)
    assert run.nav["sd_yaw_deg"].iloc[-1] > 20.0


def swapped_from(log: SimulatedLog, from_s: float) -> SimulatedLog:
    """Return the log with the two further antennas exchanged from a time of the log on."""
    first, second = log.further
    late = first.t_ns - first.t_ns[0] >= from_s * 1e9
    assert first.carrier_cycles is not None
    assert second.carrier_cycles is not None
    mixed = [
        replace(one, carrier_cycles=np.where(late, other.carrier_cycles, one.carrier_cycles))
        for one, other in ((first, second), (second, first))
    ]
    return replace(log, further=tuple(mixed))


def test_cables_swapped_on_the_way_lose_the_cycles_but_not_the_attitude(tmp_path: Path) -> None:
    # the ambiguities are exchanged with the phases: at one blow every difference is wrong by whole cycles and a part
    run = fly(tmp_path, scenario_text(SCALENE), change=lambda log: swapped_from(log, 15.0))

    own = run.measurements[run.measurements["kind"] == KIND]
    assert len(events(run, "attitude_lost")) == 1
    assert len(events(run, "attitude_antennas_swapped")) == 1
    assert "used" not in set(own.loc[own["time_s"] >= 150_015.0, "status"])
    assert np.abs(normalised(run)[-1]).max() < 3.3


def test_two_antennas_tell_the_heading_and_say_what_they_leave(tmp_path: Path) -> None:
    run = fly(tmp_path, scenario_text(TRIANGLE[:1]))

    assert "(roll)" in events(run, "attitude_collinear")[0]
    assert run.nav["sd_yaw_deg"].iloc[-1] < 0.05
    assert run.nav["sd_roll_deg"].iloc[-1] > 0.2  # levelled by an accelerometer of some milli-g
    assert np.abs(normalised(run)[-1]).max() < 3.3


def test_check_says_which_angle_is_lost(tmp_path: Path) -> None:
    path = write_flight(tmp_path, scenario_text((("ahead", (1.4, 0.1, -1.3)), ("nose", (2.4, 0.1, -1.3)))))

    result = CliRunner().invoke(app, ["check", str(path)])

    assert "the antennas are on one line: the rotation about body axes (1, 0, 0) (roll)" in result.output
    assert "antenna ahead: phases of 11 to 11 satellites" in result.output
    assert result.exit_code == 0


def keep(log: SimulatedLog, satellites: tuple[str, ...]) -> SimulatedLog:
    """Return the log with the further antennas' rows of some satellites alone."""
    for number, table in enumerate(log.further):
        numbers = [table.sv_names.index(sv) for sv in satellites]
        log = with_further(log, number, table.take(np.flatnonzero(np.isin(table.sv, numbers))))
    return log


def test_one_satellite_in_common_is_not_used_for_an_attitude(tmp_path: Path) -> None:
    run = fly(tmp_path, scenario_text(), change=lambda log: keep(log, ("G01",)))

    assert "fewer than two satellites" in events(run, "attitude_waits")[0]
    assert "used" not in differences(run)
    # and a block of which nothing is used changes no bit of the filter
    path = tmp_path / "logs" / "flight.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text[: text.index("[attitude]")] + text[text.index("[reference]") :], encoding="utf-8")
    bare = insgnss.replay(path)
    assert run.nav.equals(bare.nav)
    own = run.measurements[run.measurements["kind"] != KIND]
    assert np.array_equal(own["innovation"], bare.measurements["innovation"], equal_nan=True)


def test_a_satellite_hidden_for_one_antenna_is_used_between_the_others(tmp_path: Path) -> None:
    (tmp_path / "wall.toml").write_text(
        'frame = "body_forward_right_down"\nsource = "a wall to the right"\n[[sector]]\n'
        "azimuth_deg = [30.0, 150.0]\nelevation_deg = [-90.0, 90.0]\n",
        encoding="utf-8",
    )
    path = write_flight(tmp_path, scenario_text())
    text = path.read_text(encoding="utf-8")
    hidden = 'name = "ahead"\nobstruction = "../wall.toml"'
    path.write_text(text.replace('name = "ahead"', hidden), encoding="utf-8")

    run = insgnss.replay(path)

    own = run.measurements[(run.measurements["kind"] == KIND) & (run.measurements["time_s"] > 150_010.0)]
    masked = own[own["status"] == "masked_obstruction"]
    assert set(masked["antenna"]) == {"ahead"}
    assert 1 <= masked["sv"].nunique() <= 6
    others = own[(own["antenna"] == "right") & own["sv"].isin(masked["sv"].unique())]
    assert set(others["status"]) == {"used"}
    assert np.abs(normalised(run)[-1]).max() < 3.3


def test_missing_or_foreign_logs_are_typed_errors(tmp_path: Path) -> None:
    path = write_flight(tmp_path, scenario_text())
    text, other = path.read_text(encoding="utf-8"), path.parent / "gnss_ahead.csv"
    log = other.read_text(encoding="ascii")

    other.write_text(log.replace("\n150", "\n170"), encoding="ascii")
    with pytest.raises(TimeError, match="antenna 'ahead'"):
        insgnss.replay(path)
    other.write_text(log.replace(".000,G", ".500,G"), encoding="ascii")
    with pytest.raises(InputError, match="no epoch of antenna 'ahead'"):
        insgnss.replay(path)
    lines = [",".join(line.split(",")[:6]) for line in log.splitlines()]
    other.write_text("\n".join(lines) + "\n", encoding="ascii")
    with pytest.raises(InputError, match="no carrier phase"):
        insgnss.replay(path)
    other.unlink()
    with pytest.raises(MissingFileError):
        insgnss.replay(path)
    path.write_text(text.replace("lever_arm_m = [1.4, 0.1, -1.3]", ""), encoding="utf-8")
    other.write_text(log, encoding="ascii")
    with pytest.raises(ConfigError, match="place of antenna 'ahead'"):
        insgnss.replay(path)
    path.write_text(text.replace("[1.4, 0.1, -1.3]", "[0.4, 0.1, -1.3]"), encoding="utf-8")
    with pytest.raises(GeometryError, match="same place"):
        insgnss.replay(path)


def test_places_of_a_vehicle_file_give_the_same_bits(tmp_path: Path, at_rest: Run) -> None:
    keys = 'vehicle = "mine.toml"\nmain_antenna = "main"\n'
    path = write_flight(tmp_path, scenario_text(), keys=keys)
    (path.parent / "mine.toml").write_text(
        "".join(
            f'[[antenna]]\nname = "{name}"\nlever_arm_m = {list(lever)}\n'
            for name, lever in (("main", (0.4, 0.1, -1.3)), *TRIANGLE)
        ),
        encoding="utf-8",
    )

    run = insgnss.replay(path)

    assert run.nav.equals(at_rest.nav)


def test_mounting_of_a_vehicle_file_is_taken_where_the_flight_says_nothing(tmp_path: Path) -> None:
    tilted = "mounting_rpy_deg = [0.0, 0.0, 40.0]"
    path = write_flight(
        tmp_path, scenario_text(further=tilted), keys='vehicle = "mine.toml"\nmain_antenna = "main"\n'
    )
    path.write_text(path.read_text(encoding="utf-8").replace(tilted, ""), encoding="utf-8")
    tables = [
        f'[[antenna]]\nname = "{name}"\nlever_arm_m = {list(lever)}\n{tilted}\n' for name, lever in TRIANGLE
    ]
    main = '[[antenna]]\nname = "main"\nlever_arm_m = [0.4, 0.1, -1.3]\n'
    (path.parent / "mine.toml").write_text(main + "".join(tables), encoding="utf-8")

    run = insgnss.replay(path)

    # taken as level, 40 deg of wind-up would keep every set of whole cycles from fitting
    assert differences(run)["used"] > 500
    assert np.abs(normalised(run)[-1]).max() < 3.3


@pytest.mark.parametrize("clocks", ["common", "separate"])
def test_slips_on_two_carriers_flagged_or_not_leave_the_filter_consistent(
    tmp_path: Path, clocks: str
) -> None:
    # a slip on each carrier every two minutes, one in ten unnoticed by the receiver
    told = '[gnss]\nsignals = ["C1C", "C5Q"]\nslips_per_hour = 30.0\n'
    text = scenario_text(clocks=clocks, clock_bias_m=250_000.0, manoeuvres=SLALOM, speed_mps=60.0)

    run = fly(tmp_path, text.replace("[gnss]\n", told), seed=5)

    counts = differences(run)
    assert counts["cycles_wrong"] == len(events(run, "attitude_cycles_wrong")) >= 1
    assert len(events(run, "attitude_slip")) > 10
    assert counts["used"] > 0.85 * sum(counts.values())
    assert run.nis_summary().loc[KIND, "mean_nis"] == pytest.approx(1.0, abs=0.1)
    assert np.sqrt(np.mean(normalised(run, from_s=150_012.0) ** 2)) == pytest.approx(1.0, abs=0.5)


def test_check_reports_a_missing_log_of_an_antenna_and_goes_on(tmp_path: Path) -> None:
    path = write_flight(tmp_path, scenario_text())
    (path.parent / "gnss_ahead.csv").unlink()

    result = CliRunner().invoke(app, ["check", str(path)])

    assert result.exit_code == 3
    assert any(
        line.startswith("ERROR   attitude") and "gnss_ahead.csv" in line
        for line in result.output.splitlines()
    )
    assert "antenna right: phases of 11" in result.output
