"""A drive on level ground with runs apart from turns: mirrored readings are told, and what cannot be seen is said.

Straight runs fit a reversed forward axis with the attitude turned round, and turns fit it with another one: only the
one direction in which the vehicle moves, held all through the log, tells them apart. Nothing turns about the level
axes: the signs of gyro x and y do not show.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from typer.testing import CliRunner

from insgnss.cli.main import app
from insgnss.constants import NS_PER_S
from insgnss.log.checks.axis_search import Match, search, with_noses
from insgnss.log.checks.declaration import AxesDeclaration
from insgnss.log.checks.longitudinal_axis import CORRELATION_S, STEADY, mean_direction
from insgnss.log.checks.report import CheckReport, Finding
from insgnss.log.checks.stretches import GnssStretch
from insgnss.log.checks.vehicle_axes import axes_findings, candidates
from insgnss.runs.check import examine
from insgnss.runs.simulate import simulate
from insgnss.tables import ImuTable

Float64 = npt.NDArray[np.float64]
DOWN_E = np.array([-0.6, 0.0, -0.8])
RATE_HZ = 50.0
ORIGIN_NS = 1000 * NS_PER_S
LENGTH_S = 40.0
SIGMA_MPS = 0.03
BACKWARDS = np.diag([-1.0, -1.0, 1.0])
EXCHANGED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


class LevelDrive:
    """40 s with a run up, 40 s with two turns, 40 s with a run down: the vehicle moves ``off_nose`` of its nose.

    ``slower``: factor on its speed of 5 to 20 m/s. ``thrown``: two epochs show it at 1.2 m/s backwards.
    """

    def __init__(
        self, off_nose: float | str = 0.0, banked: bool = False, slower: float = 1.0, thrown: bool = False
    ) -> None:
        self.thrown = thrown
        self.t_s = np.arange(-3.0, 3.0 * LENGTH_S + 3.0, 1.0 / RATE_HZ)
        t = self.t_s
        speed = slower * (5.0 + np.interp(t, [10.0, 20.0, 100.0, 110.0], [0.0, 15.0, 15.0, 0.0]))
        course = np.interp(t, [45.0, 55.0, 65.0, 75.0], [0.0, 2.0, 2.0, 0.4])
        wander = 1.5 * np.sin(0.11 * t) + 1.2 * np.sin(0.23 * t) if off_nose == "wanders" else float(off_nose)
        yaw = course - wander
        self.v_n = np.stack([speed * np.cos(course), speed * np.sin(course), 0.0 * t], axis=1)
        cos, sin, zero = np.cos(yaw), np.sin(yaw), 0.0 * t
        C_nb = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, zero + 1.0], axis=1).reshape(-1, 3, 3)
        if banked:
            roll, pitch = 0.25 * np.sin(0.7 * t), 0.15 * np.sin(0.5 * t + 1.0)
            C_nb = C_nb @ _about_y(pitch) @ _about_x(roll)
        f_n = np.gradient(self.v_n, t, axis=0) - np.array([0.0, 0.0, 9.81])
        self.f_b = np.einsum("kji,kj->ki", C_nb, f_n)
        turn = np.einsum("kji,kjl->kil", C_nb[:-1], C_nb[1:]) * RATE_HZ
        skew = 0.5 * (turn - np.swapaxes(turn, 1, 2))
        w_b = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        self.w_b = np.concatenate((w_b[:1], w_b))
        north = np.array([-0.8, 0.0, 0.6])
        self.C_en = np.stack([north, np.cross(DOWN_E, north), DOWN_E], axis=1)

    def match(self, accel: Float64, gyro: Float64) -> Match:
        """Return the search's result with columns f_s = M f_b and w_s = G w_b, declared to be body axes."""
        rng = np.random.default_rng(5)
        t_ns = np.rint(self.t_s * NS_PER_S).astype(np.int64) + ORIGIN_NS
        noise = rng.normal(0.0, 1e-3, (2, len(t_ns), 3))
        imu = ImuTable(t_ns, (self.w_b + noise[0]) @ gyro.T, (self.f_b + 10.0 * noise[1]) @ accel.T)
        stretches = [self._stretch(first, rng) for first in (0.0, LENGTH_S, 2.0 * LENGTH_S)]
        found = search(imu, ORIGIN_NS, stretches, np.eye(3), (1.0,))
        assert found is not None
        return found

    def _stretch(self, first_s: float, rng: np.random.Generator) -> GnssStretch:
        at = np.flatnonzero((self.t_s >= first_s) & (self.t_s < first_s + LENGTH_S))[:: int(RATE_HZ)]
        v_n = self.v_n[at]
        if self.thrown and first_s == 0.0:
            v_n[2:4] *= -1.2 / np.linalg.norm(v_n[2:4], axis=1, keepdims=True)
        v_e = v_n @ self.C_en.T + rng.normal(0.0, SIGMA_MPS, (len(at), 3))
        return GnssStretch(
            self.t_s[at], v_e, v_e - 9.81 * self.t_s[at][:, None] * DOWN_E, -DOWN_E, SIGMA_MPS, 30.0
        )


def _about_x(angle: Float64) -> Float64:
    c, s, o = np.cos(angle), np.sin(angle), 0.0 * angle
    return np.stack([o + 1.0, o, o, o, c, -s, o, s, c], axis=1).reshape(-1, 3, 3)


def _about_y(angle: Float64) -> Float64:
    c, s, o = np.cos(angle), np.sin(angle), 0.0 * angle
    return np.stack([c, o, s, o, o + 1.0, o, -s, o, c], axis=1).reshape(-1, 3, 3)


def finding(drive: LevelDrive, accel: Float64, gyro: Float64) -> Finding:
    match = drive.match(accel, gyro)
    unit = np.eye(3)
    declared = AxesDeclaration(
        ImuTable(np.zeros(0, np.int64), unit, unit), unit, unit, False, (1.0,), ("rad/s",)
    )
    told = axes_findings(declared, candidates(match.readings, unit, unit), match)
    assert len(told) == 1
    return told[0]


@pytest.fixture(scope="module")
def flat() -> LevelDrive:
    return LevelDrive()


def test_right_axes_of_a_flat_drive_fit_but_for_what_it_does_not_show(flat: LevelDrive) -> None:
    told = finding(flat, np.eye(3), np.eye(3))
    assert told.severity == "ok" and told.proposals == ()
    assert "fit the motion; it does not show the sign or order of gyro x, gyro y" in told.text


@pytest.mark.parametrize(
    "mounting", [BACKWARDS, np.diag([1.0, -1.0, -1.0]), EXCHANGED @ np.diag([1.0, 1.0, -1.0])],
    ids=["backwards", "z up", "ENU"],
)  # fmt: skip
def test_mounting_of_a_flat_drive_is_likely_and_never_a_mirrored_one(
    flat: LevelDrive, mounting: Float64
) -> None:
    told = finding(flat, mounting, mounting)
    assert [p.key for p in told.proposals] == ["imu.axes"]
    values = {p.key: p.value for p in told.proposals}
    expected = tuple(
        ("+" if row.sum() > 0.0 else "-") + "xyz"[int(np.argmax(np.abs(row)))] for row in mounting.T
    )
    assert values["imu.axes"] == expected
    assert told.sure.startswith("likely") and "gyro x, gyro y" in told.advice
    assert CheckReport("drive", (told,)).sure_proposals == ()


@pytest.mark.parametrize(
    ("spoilt", "truth"),
    [
        (np.diag([-1.0, 1.0, 1.0]), "-x, +y, +z with gyros +x, +y, +z"),
        (np.diag([1.0, -1.0, 1.0]), "+x, -y, +z with gyros +x, +y, +z"),
        (EXCHANGED, "+y, +x, +z with gyros +x, +y, +z"),
    ],
    ids=["accel x reversed", "accel y reversed", "accel x and y exchanged"],
)
def test_accelerometers_that_are_wrong_by_themselves_never_fit(
    flat: LevelDrive, spoilt: Float64, truth: str
) -> None:
    told = finding(flat, spoilt, np.eye(3))
    assert told.severity == "error" and told.proposals == ()
    assert truth in told.text


def test_banked_drive_shows_every_column_and_makes_the_proposal_sure() -> None:
    drive = LevelDrive(banked=True)
    assert finding(drive, np.eye(3), np.eye(3)).text.startswith("the axes fit the motion: ")
    told = finding(drive, BACKWARDS, BACKWARDS)
    assert told.sure.startswith("sure") and told.advice == ""
    assert told.proposals[0].value == ("-x", "-y", "+z")


def test_two_epochs_do_not_show_which_axis_is_forward() -> None:
    """A rover at walking pace: its usual motion decides, not the jump of its reference at the start."""
    drive = LevelDrive(banked=True, slower=0.045, thrown=True)
    assert drive.match(np.eye(3), np.eye(3)).readings[0].along_s[0] > 0.9
    assert finding(drive, np.eye(3), np.eye(3)).text.startswith("the axes fit the motion: ")
    assert finding(drive, BACKWARDS, BACKWARDS).proposals[0].value == ("-x", "-y", "+z")
    alone = mean_direction(np.array([2.0, 0.0, 0.0]), 2.0, 1.0 / CORRELATION_S)
    assert np.linalg.norm(alone) < STEADY


def test_motion_in_no_steady_direction_does_not_speak_for_any_axes() -> None:
    """A hovering vehicle flies where it likes: what it costs to hold a direction must not rule any reading out."""
    match = LevelDrive("wanders", banked=True).match(np.eye(3), np.eye(3))
    assert not any(nose.steady for nose in match.ranked[0].noses)
    assert {one.cost for one in match.readings} == {one.cost for one in with_noses(match.ranked)}
    assert [one.cost for one in match.readings] == pytest.approx([one.cost for one in match.ranked])


SCENARIO = """\
name = "drive"
gps_week = 2398
start_s = 312345.0
place = { lat_deg = -33.9, lon_deg = 151.2, h_m = 50.0, heading_deg = 140.0 }
manoeuvre = [
    { kind = "straight", duration_s = 20.0 },
    { kind = "accelerate", to_mps = 20.0, duration_s = 10.0 },
    { kind = "straight", duration_s = 20.0 },
    { kind = "steer", by_deg = 120.0, duration_s = 12.0 },
    { kind = "straight", duration_s = 30.0 },
    { kind = "steer", by_deg = -90.0, duration_s = 10.0 },
    { kind = "straight", duration_s = 30.0 },
    { kind = "accelerate", to_mps = 0.0, duration_s = 10.0 },
    { kind = "straight", duration_s = 20.0 },
]
[imu]
grade = "tactical"
[gnss]
lever_arm_m = [0.5, -0.3, -1.1]
"""


def test_check_does_not_write_axes_that_are_only_likely(tmp_path: Path) -> None:
    """The sensor is turned by 180 deg about down; a file with mirrored axes would ruin the flight."""
    (tmp_path / "scenario.toml").write_text(SCENARIO)
    simulate(tmp_path / "scenario.toml", seed=7).save(tmp_path)
    names, *rows = (tmp_path / "imu.csv").read_text().splitlines()
    values = np.array([row.split(",") for row in rows], float)
    values[:, 1:] *= [-1.0, -1.0, 1.0, -1.0, -1.0, 1.0]
    np.savetxt(tmp_path / "imu.csv", values, "%.9f", ",", header=names, comments="")
    corrected = tmp_path / "corrected.toml"
    told = CliRunner().invoke(
        app, ["check", str(tmp_path / "flight.toml"), "--write", str(corrected)], env={"COLUMNS": "300"}
    )
    assert told.exit_code == 3 and 'imu.axes = ["-x", "-y", "+z"]' in told.output, told.output
    assert "(likely" in told.output and "only certain ones are written" in told.output
    assert not corrected.exists()


def test_scale_errors_of_a_telephone_do_not_reverse_a_gyro(tmp_path: Path) -> None:
    """Corners that the gyro z reads 1 % too large were explained better by a wrong sign of x: reported as an error."""
    simulate("city_car", seed=5).save(tmp_path)
    told = [each for each in examine(tmp_path / "flight.toml").findings if each.topic == "motion"]
    assert "the axes fit the motion; it does not show the sign or order of gyro x, gyro y" in told[0].text
    assert not [each for each in told if each.proposals]
