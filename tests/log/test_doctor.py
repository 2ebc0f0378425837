"""The check of a flight: each defect is named, and a sound flight is called sound."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insgnss.log.checks import corrected_flight
from insgnss.log.checks.each_log import read_and_check
from insgnss.log.checks.report import CheckReport
from insgnss.log.flight import Flight
from tests.log.test_flight import FLIGHT, FLIGHTS
from tests.log.test_rinex_navigation import HEADER as NAV_HEADER
from tests.log.test_rinex_navigation import message
from tests.log.writing import Float64, gnss_lines, rest, write_gnss, write_imu

SATELLITES = ("G05", "G07", "G13", "G30")
C_PER_MS = 299_792.458


class Case:
    """A flight in a folder whose files a test may spoil."""

    def __init__(self, folder: Path, rng: np.random.Generator) -> None:
        self.folder = folder
        self.imu = rest(rng, n=2000)
        self.gnss = gnss_lines()
        self.flight = FLIGHT
        messages = [message(sv, toc="2023 06 25 00 00 00", toe=0.0) for sv in SATELLITES]
        self.navigation = NAV_HEADER + "".join(messages)

    def check(self) -> CheckReport:
        write_imu(self.folder / "imu.csv", self.imu)
        write_gnss(self.folder / "gnss.csv", self.gnss)
        (self.folder / "nav.rnx").write_text(self.navigation)
        (self.folder / "flight.toml").write_text(self.flight)
        return read_and_check(Flight.load(self.folder / "flight.toml"))[0]

    def change(self, column: int, factor: float) -> None:
        """Multiply one column of the GNSS rows."""
        rows = [line.split(",") for line in self.gnss]
        for cells in rows:
            cells[column] = f"{float(cells[column]) * factor:.4f}"
        self.gnss = [",".join(cells) for cells in rows]


@pytest.fixture
def case(tmp_path: Path, rng: np.random.Generator) -> Case:
    return Case(tmp_path, rng)


def texts(report: CheckReport, severity: str) -> str:
    return "\n".join(f.line() for f in report.findings if f.severity == severity)


def test_sound_flight_is_called_sound(case: Case) -> None:
    report = case.check()
    assert report.severity == "ok", "\n".join(report.lines())
    everything = "\n".join(report.lines())
    for words in (
        "2000 samples",
        "100 Hz",
        "|f| = 9.80",
        "roll 0.0",
        "20 epochs",
        "G C1C (4)",
        "ratio 1.000",
    ):
        assert words in everything
    assert "overlap for 19.0 s" in everything and "lever arm (0, 0, 0)" in everything
    assert report.lines()[-1].startswith("flight: 0 error(s), 0 warning(s)")


def test_reversed_range_rate_sign_is_an_error(case: Case) -> None:
    case.change(4, -1.0)
    report = case.check()
    assert report.severity == "error"
    assert "range-rate sign reversed" in texts(report, "error")


def test_doppler_in_metres_per_second_is_an_error(case: Case) -> None:
    case.change(4, -0.190293672798365)
    assert "doppler_hz looks like metres per second" in texts(case.check(), "error")


@pytest.mark.parametrize(
    ("factor", "words"), [(1.0, "with the sign of Doppler"), (-1.0, "the sign of a range rate")]
)
def test_range_rate_in_hertz_is_an_error(case: Case, factor: float, words: str) -> None:
    case.change(4, factor)
    case.flight += 'columns.doppler = "none"\ncolumns.range_rate = "doppler_hz"\n'
    report = texts(case.check(), "error")
    assert "looks like Doppler in Hz" in report and words in report


@pytest.mark.parametrize("as_range_rate", [False, True])
@pytest.mark.parametrize("factor", [1.0, -1.0, 0.190293672798365, -0.190293672798365])
def test_proposals_mend_every_sign_and_unit_of_the_rates(
    case: Case, factor: float, as_range_rate: bool
) -> None:
    case.change(4, factor)
    if as_range_rate:
        case.flight += 'columns.doppler = "none"\ncolumns.range_rate = "doppler_hz"\n'
    proposals = case.check().proposals
    sound = factor == (-0.190293672798365 if as_range_rate else 1.0)
    assert (proposals == ()) == sound
    mended = read_and_check(corrected_flight(Flight.load(case.folder / "flight.toml"), proposals))[0]
    assert mended.severity == "ok" and "ratio 1.000" in "\n".join(mended.lines())


def test_rates_of_another_scale_are_an_error(case: Case) -> None:
    case.change(4, 2.0)
    assert "disagree" in texts(case.check(), "error")


@pytest.mark.parametrize("drift_mps", [0.0, 400.0])
def test_clock_jumps_are_counted_and_do_not_disturb_the_sign(case: Case, drift_mps: float) -> None:
    rows = [line.split(",") for line in case.gnss]
    for cells in rows:
        t = float(cells[0]) - 1000.0
        jump = C_PER_MS * ((t >= 7) + (t >= 14))
        cells[3] = f"{float(cells[3]) + drift_mps * t - jump:.3f}"
        cells[4] = f"{float(cells[4]) - drift_mps / 0.190293672798365:.4f}"
    case.gnss = [",".join(cells) for cells in rows]
    report = "\n".join(case.check().lines())
    assert "clock jumps 2 time(s), typically by 1 ms, first at 1007.000 s" in report
    assert "ratio 1.000" in report


def test_satellite_twice_in_an_epoch_is_told(case: Case) -> None:
    case.gnss.insert(1, case.gnss[0])
    assert case.check().severity == "warning"
    assert "1 row(s) repeat a satellite and signal within an epoch, first G05 C1C" in texts(
        case.check(), "warning"
    )


def test_epochs_with_few_or_no_satellites_are_counted(case: Case) -> None:
    for k in (20, 21, 22, 23, 27):
        cells = case.gnss[k].split(",")
        cells[3] = ""
        case.gnss[k] = ",".join(cells)
    assert "2 of 20 epochs with fewer than 4 satellites, 1 with none" in texts(case.check(), "warning")


def test_gap_of_the_gnss_is_told(case: Case) -> None:
    case.gnss = case.gnss[:20] + case.gnss[40:]
    assert "1 gap(s), the longest 6 s from 1004.000 s on" in texts(case.check(), "warning")


def test_satellites_without_a_current_ephemeris_are_named(case: Case) -> None:
    case.navigation = case.navigation.replace(message("G30", toc="2023 06 25 00 00 00", toe=0.0), "")
    report = texts(case.check(), "warning")
    assert "no current ephemeris for G30" in report and "20 of 20 epochs with fewer than 4" in report


def test_stale_ephemerides_are_named(case: Case) -> None:
    case.navigation = case.navigation.replace("2023 06 25 00 00 00", "2023 06 25 03 00 00")
    case.navigation = case.navigation.replace(f"    {0.0:19.12E} ", f"    {10_800.0:19.12E} ")
    assert "no current ephemeris for G05, G07, G13, G30" in texts(case.check(), "warning")


def test_unhealthy_satellites_and_missing_ionosphere_are_told(case: Case) -> None:
    sick = message("G07", toc="2023 06 25 00 00 00", toe=0.0, health=63.0)
    case.navigation = case.navigation.replace(message("G07", toc="2023 06 25 00 00 00", toe=0.0), sick)
    case.navigation = case.navigation.replace("IONOSPHERIC CORR", "COMMENT         ")
    report = "\n".join(case.check().lines())
    assert "unhealthy by their own message: G07" in report and "no ionosphere coefficients" in report


@pytest.mark.parametrize(
    ("f_b", "words"),
    [
        ((0.0, 0.0, 9.8), "points along +z: upside down"),
        ((9.8, 0.0, 0.0), "the +x axis points up"),
        ((0.0, -9.8, 0.0), "the -y axis points up"),
        ((4.9, 0.0, -8.487), "tilted at rest"),
    ],
)
def test_axes_that_gravity_contradicts_are_suspected(
    case: Case, f_b: tuple[float, float, float], words: str
) -> None:
    case.imu[:, 4:7] += np.array(f_b) - (0.0, 0.0, -9.80665)
    assert words in texts(case.check(), "warning")


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(5.0, 0.0), (0.0, -7.0), (3.0, 8.0)])
def test_resting_tilt_is_roll_and_pitch(case: Case, roll_deg: float, pitch_deg: float) -> None:
    roll, pitch = np.deg2rad([roll_deg, pitch_deg])
    f_b = 9.80665 * np.array([np.sin(pitch), -np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch)])
    case.imu[:, 4:7] += f_b - (0.0, 0.0, -9.80665)
    line = next(line for line in case.check().lines() if "f at rest" in line)
    shown = [float(part.split()[1]) for part in line.split(": ")[-1].replace(" deg", "").split(", ")]
    assert shown == pytest.approx([roll_deg, pitch_deg], abs=0.1)


def test_gravity_off_by_two_percent_is_told(case: Case) -> None:
    case.imu[:, 4:7] *= 1.02
    assert "+2.00 % of g" in texts(case.check(), "warning")


def spoil_units(imu: Float64) -> None:
    imu[:, 4:7] /= 9.80665


def test_wrong_units_are_an_error_and_the_rest_is_still_checked(case: Case) -> None:
    spoil_units(case.imu)
    report = case.check()
    assert "accel_unit = 'g' fits" in texts(report, "error")
    assert any(finding.topic == "gnss" for finding in report.findings)


def test_missing_log_is_an_error_and_the_rest_is_still_checked(case: Case) -> None:
    case.flight = case.flight.replace('"imu.csv"', '"no.csv"')
    report = case.check()
    assert "file not found" in texts(report, "error")
    assert any("20 epochs" in finding.text for finding in report.findings)


def test_imu_gaps_and_stuck_axes_are_told(case: Case) -> None:
    case.imu[1000:, 0] += 1.0
    case.imu[200:400, 2] = 0.25
    report = texts(case.check(), "warning")
    assert "imu_gap" in report and "imu_stuck_axis" in report


def test_frozen_sensor_is_a_warning_and_a_dead_one_an_error(case: Case) -> None:
    case.imu[200:400, 1:7] = case.imu[200, 1:7]
    assert "imu_frozen_sensor" in texts(case.check(), "warning")
    most = int(0.4 * len(case.imu))
    case.imu[most:, 4:7] = case.imu[most, 4:7]
    assert "imu_dead_sensor" in texts(case.check(), "error")


def test_logs_without_overlap_are_an_error(case: Case) -> None:
    case.imu[:, 0] += 500.0
    assert "do not overlap" in texts(case.check(), "error")


def test_imu_that_ends_first_is_told(case: Case) -> None:
    case.imu = case.imu[:1000]
    assert "10 after it ends" in texts(case.check(), "warning")


@pytest.mark.parametrize(
    ("lever", "words"),
    [("", "is not given"), ("lever_arm_m = [-100.0, 0.0, -120.0]", "declare it in metres")],
)
def test_ambiguous_lever_arm_is_told(case: Case, lever: str, words: str) -> None:
    case.flight = case.flight.replace("lever_arm_m = [0.0, 0.0, 0.0]", lever)
    assert words in texts(case.check(), "warning")


@pytest.mark.parametrize(("limit", "warned"), [("", True), ("quality_max = 1\n", False)])
def test_reference_of_several_qualities_asks_for_a_limit(case: Case, limit: str, warned: bool) -> None:
    rows = [f"{1000 + k},48,9,300,{1 if k % 3 else 2}\n" for k in range(9)]
    (case.folder / "reference.csv").write_text("time_s,lat_deg,lon_deg,h_m,quality\n" + "".join(rows))
    case.flight += f'\n[reference]\nfile = "reference.csv"\n{limit}'
    told = [line for line in case.check().lines() if "several qualities" in line]
    assert bool(told) is warned
    assert not warned or ("1 in 6, 2 in 3" in told[0] and "reference.quality_max = 1" in told[0])


def test_reference_elsewhere_in_time_is_told(case: Case) -> None:
    (case.folder / "reference.csv").write_text("time_s,lat_deg,lon_deg,h_m\n9000,48,9,300\n")
    case.flight += '\n[reference]\nfile = "reference.csv"\n'
    assert "does not overlap the inertial log" in texts(case.check(), "warning")


@pytest.mark.real_data
@pytest.mark.parametrize("name", ["xian", "walk", "instinct"])
def test_real_flights_have_no_error(name: str, data_root: Path) -> None:
    flight = Flight.load(FLIGHTS / f"{name}.toml")
    if not flight.config.imu.files[0].is_file():
        pytest.skip(
            f"the flight file looks for its logs in shared/data beside the checkout, not in {data_root}"
        )
    report = read_and_check(flight)[0]
    assert not report.of("error"), "\n".join(report.lines())
    assert any("ratio 1.00" in finding.text for finding in report.findings)
