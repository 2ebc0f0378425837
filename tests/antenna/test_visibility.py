"""The stage: the study's geometry, hysteresis, uncertainty, several antennas, unusual attitudes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from insgnss.antenna.equipment import limits_of, mounting
from insgnss.antenna.installation import N_AZIMUTHS, N_ELEVATIONS, clearance_at
from insgnss.antenna.obstruction import directions
from insgnss.antenna.visibility import (
    DEWEIGHT,
    HIDDEN,
    HIDE,
    IS_UNCERTAIN,
    KEEP,
    UNCERTAIN_HIDDEN,
    UNCERTAIN_VISIBLE,
    VISIBLE,
    VisibilityLimits,
    attitude_covariance,
    compare,
    look_at,
)
from insgnss.config.filter import Visibility
from insgnss.config.flight import MountedAntenna
from insgnss.errors import ConfigError
from insgnss.status import MASKED_GAIN, MASKED_OBSTRUCTION, USED
from tests.antenna.vehicle import HIDDEN_FIVE, NO_LIMIT, Decisions, attitudes, paper_sky, vehicle

SHARP = VisibilityLimits(-5.3, 0.0, 0.0, NO_LIMIT)


# --- the study's geometry -------------------------------------------------------------------------------------------


def test_left_bank_of_the_study_loses_exactly_its_five_satellites() -> None:
    names, azimuth, elevation = paper_sky(90.0)
    found = Decisions(attitudes([-43.5, 0.0, 355.5]), azimuth, elevation, vehicle("cardioid"), SHARP)

    assert {n for n, seen in zip(names, found.visible[0], strict=True) if not seen} == HIDDEN_FIVE
    assert (found.reason[0][~found.visible[0]] == MASKED_GAIN).all()


def test_body_elevations_in_that_bank_are_those_of_the_study() -> None:
    names, azimuth, elevation = paper_sky(90.0)
    u_b = directions(azimuth, elevation) @ attitudes([-43.5, 0.0, 355.5]).C_nb[0]
    body = dict(zip(names, np.degrees(np.arcsin(-u_b[:, 2])), strict=True))

    # the study prints one decimal
    expected = {"G01": -19.7, "G16": -27.3, "G30": -21.2, "G31": -11.4, "G32": -8.4, "G20": 18.4}
    assert {name: body[name] for name in expected} == pytest.approx(expected, abs=0.051)
    assert min(value for name, value in body.items() if name not in HIDDEN_FIVE) == body["G20"]


@pytest.mark.parametrize(
    ("rpy", "lost"),
    [
        ((43.5, 0.0, 175.5), HIDDEN_FIVE),  # the same lean with the tail ahead
        ((-30.0, 0.0, 0.0), HIDDEN_FIVE),
        ((-45.0, 0.0, 0.0), HIDDEN_FIVE),
        ((-60.0, 0.0, 0.0), HIDDEN_FIVE | {"G20"}),
        ((-15.0, 0.0, 0.0), {"G16"}),
        ((0.0, 0.0, 355.5), set()),
    ],
)
def test_other_attitudes_of_the_study_lose_what_it_says(rpy: tuple[float, ...], lost: set[str]) -> None:
    names, azimuth, elevation = paper_sky(90.0)
    found = Decisions(attitudes(rpy), azimuth, elevation, vehicle("cardioid"), SHARP)

    assert {n for n, seen in zip(names, found.visible[0], strict=True) if not seen} == lost


def test_threshold_on_predicted_cn0_is_one_on_gain() -> None:
    by_gain = limits_of(Visibility(threshold_gain_dbic=-15.0))
    by_cn0 = limits_of(Visibility(threshold="cn0", threshold_cn0_dbhz=30.0, nominal_cn0_dbhz=45.0))

    assert by_gain == by_cn0


# --- reduces to ----------------------------------------------------------------------------------------------------


def test_isotropic_antenna_masks_nothing_in_any_attitude() -> None:
    rng = np.random.default_rng(4)
    rpy = np.column_stack([rng.uniform(-180.0, 180.0, (200, 2)), rng.uniform(0.0, 360.0, 200)])
    limits = limits_of(Visibility())
    found = Decisions(attitudes(rpy, sd_deg=1.0), *paper_sky(0.0)[1:], vehicle("isotropic"), limits)

    assert (found.decision == VISIBLE).all()
    assert (found.gain == 0.0).all()
    assert (found.reason == USED).all()


def test_vehicle_without_an_antenna_masks_nothing() -> None:
    found = Decisions(attitudes([170.0, 0.0, 0.0]), *paper_sky(0.0)[1:], vehicle(), SHARP)

    assert found.visible.all()
    assert (found.antenna == -1).all()
    assert np.isnan(found.gain[..., 0]).all()


def test_threshold_above_every_gain_masks_everything() -> None:
    limits = VisibilityLimits(50.0, 1.0, 3.0, NO_LIMIT)
    found = Decisions(attitudes([0.0, 0.0, 0.0]), *paper_sky(0.0)[1:], vehicle("patch_l1"), limits)

    assert (found.decision == HIDDEN).all()


def test_satellite_whose_place_is_not_known_is_undecided() -> None:
    found = Decisions(attitudes([0.0, 0.0, 0.0]), np.nan, np.nan, vehicle("patch_l1"), SHARP)

    assert found.decision.tolist() == [[-1]]
    assert found.visible.all()


# --- hysteresis and uncertainty ------------------------------------------------------------------------------------


def roll_through(rolls: list[float], limits: VisibilityLimits, sd_deg: float = 0.0) -> Decisions:
    """Return decisions on a satellite to the right at 5 deg while the vehicle rolls: its body elevation is 5 + roll."""
    rpy = np.column_stack([rolls, np.zeros((len(rolls), 2))])
    return Decisions(attitudes(rpy, sd_deg), 90.0, 5.0, vehicle("cardioid"), limits)


def test_hidden_satellite_needs_the_hysteresis_to_return() -> None:
    limits = VisibilityLimits(-5.2948, 1.0, 0.0, NO_LIMIT)
    rolls = [1.0, -1.0, 1.0, 6.0, 8.0, 1.0, -1.0]
    # the gain is 1 dB above the threshold from about 7 deg of roll on
    expected = [True, False, False, False, True, True, False]

    assert roll_through(rolls, limits).visible[:, 0].tolist() == expected
    assert roll_through(rolls, limits._replace(hysteresis_db=0.0)).visible[:, 0].tolist() == [
        *(True, False, True, True, True, True, False)
    ]


def test_satellite_near_the_threshold_keeps_its_decision() -> None:
    # sigma of the gain 1 deg times the slope: within 3 sigma is within 3 deg
    limits = VisibilityLimits(-5.2948, 0.0, 3.0, NO_LIMIT)
    rolls = [4.0, 2.0, -2.0, -4.0, -2.0, 2.0, 4.0]
    found = roll_through(rolls, limits, sd_deg=1.0)

    assert found.decision[:, 0].tolist() == [
        *(VISIBLE, UNCERTAIN_VISIBLE, UNCERTAIN_VISIBLE, HIDDEN),
        *(UNCERTAIN_HIDDEN, UNCERTAIN_HIDDEN, VISIBLE),
    ]
    assert found.reason[:, 0].tolist() == [0, 0, 0, *[MASKED_GAIN] * 3, 0]


def test_satellite_near_the_threshold_is_hidden_where_that_is_asked_for() -> None:
    limits = VisibilityLimits(-5.2948, 0.0, 3.0, NO_LIMIT, HIDE)
    rolls = [4.0, 2.0, -2.0, -4.0, -2.0, 2.0, 4.0]
    found = roll_through(rolls, limits, sd_deg=1.0)

    assert found.decision[:, 0].tolist() == [
        *(VISIBLE, UNCERTAIN_HIDDEN, UNCERTAIN_HIDDEN, HIDDEN),
        *(UNCERTAIN_HIDDEN, UNCERTAIN_HIDDEN, VISIBLE),
    ]
    assert found.reason[:, 0].tolist() == [0, *[MASKED_GAIN] * 5, 0]


def test_doubt_is_the_probability_that_the_satellite_is_hidden() -> None:
    # 5 deg of body elevation are the threshold; sigma of the gain is that of the elevation times the slope
    rolls = [4.0, 2.0, 0.5, -1.0, -2.0, -4.0]
    keep, deweight = (VisibilityLimits(-5.2948, 0.0, 3.0, NO_LIMIT, what) for what in (KEEP, DEWEIGHT))
    found = roll_through(rolls, deweight, sd_deg=1.0)
    expected = [0.0, *stats.norm.sf([2.0, 0.5, -1.0, -2.0]), 0.0]

    # the slope bends by a twentieth over two degrees
    assert found.gain[:, 0, 2].tolist() == pytest.approx(expected, abs=0.02)
    assert found.decision.tolist() == roll_through(rolls, keep, sd_deg=1.0).decision.tolist()
    assert roll_through([4.0, 2.0], SHARP, sd_deg=1.0).gain[:, 0, 2].tolist() == [0.0, 0.0]


def test_satellite_never_seen_and_uncertain_counts_as_visible() -> None:
    found = roll_through([-2.0], VisibilityLimits(-5.2948, 0.0, 3.0, NO_LIMIT), sd_deg=1.0)

    assert found.decision.tolist() == [[UNCERTAIN_VISIBLE]]


def test_sigma_of_the_gain_is_the_slope_times_the_attitudes() -> None:
    found = roll_through([0.5], SHARP, sd_deg=2.0)
    elevation, sigma = np.radians(5.5), np.radians(2.0)
    slope = 20.0 * np.log10(np.e) * np.cos(elevation) / (1.0 + np.sin(elevation))

    # in the middle of a cell; the file's four decimals: 0.1 %
    assert found.gain[0, 0, 1] == pytest.approx(slope * sigma, rel=1e-3)


def test_sigma_of_the_gain_covers_the_spread_over_drawn_attitude_errors() -> None:
    n, sd_deg = 4000, 0.5
    rng = np.random.default_rng(11)
    turns = Rotation.from_rotvec(np.radians(rng.normal(0.0, sd_deg, (n, 3))))
    history = attitudes(np.tile([-30.0, 4.0, 20.0], (n, 1)), sd_deg=0.0)
    history.C_nb[:] = history.C_nb @ turns.as_matrix()
    history.P_b[:] = np.eye(3) * np.radians(sd_deg) ** 2
    found = Decisions(history, 105.0, 24.0, vehicle("patch_l1"), SHARP)

    # the sample's sigma is good to 1 / sqrt(2 n) = 1.1 %; the slope varies from cell to cell by a tenth
    assert found.gain[:, 0, 0].std() == pytest.approx(found.gain[:, 0, 1].mean(), rel=0.1)


def changes(found: Decisions) -> int:
    return int(np.abs(np.diff(found.visible[:, 0].astype(int))).sum())


def test_noise_of_the_attitude_makes_the_decision_flicker_only_without_margin() -> None:
    rolls = np.random.default_rng(8).normal(0.0, 1.0, 600).tolist()
    sharp, calm = VisibilityLimits(-5.2948, 0.0, 0.0, NO_LIMIT), VisibilityLimits(-5.2948, 0.0, 4.0, NO_LIMIT)

    assert changes(roll_through(rolls, sharp, sd_deg=1.0)) > 200
    assert changes(roll_through(rolls, calm, sd_deg=1.0)) == 0


def test_masking_waits_until_the_heading_is_known() -> None:
    limits = limits_of(Visibility(heading_sigma_limit_deg=5.0))
    history = attitudes(np.tile([-60.0, 0.0, 0.0], (3, 1)))
    down_b = history.C_nb[0][2]
    for k, sd_deg in enumerate((20.0, 5.1, 4.9)):
        # level is known, the rotation about the vertical is not
        history.P_b[k] = np.outer(down_b, down_b) * np.radians(sd_deg) ** 2
    found = Decisions(history, 90.0, 5.0, vehicle("cardioid"), limits)

    assert found.decision[:, 0].tolist() == [UNCERTAIN_VISIBLE, UNCERTAIN_VISIBLE, HIDDEN]
    assert found.decision[0, 0] & IS_UNCERTAIN


def test_covariance_of_the_attitude_is_turned_into_the_body() -> None:
    rng = np.random.default_rng(6)
    half = rng.standard_normal((17, 17))
    P, C_eb, P_b = half @ half.T, Rotation.random(random_state=2).as_matrix(), np.zeros((3, 3))

    attitude_covariance(P, 6, C_eb, P_b)

    np.testing.assert_allclose(P_b, C_eb.T @ P[6:9, 6:9] @ C_eb, rtol=1e-12, atol=1e-12)


# --- antennas on a vehicle -----------------------------------------------------------------------------------------


def test_mounting_by_angles_and_by_matrix_agree() -> None:
    turned = MountedAntenna(pattern="isotropic", mounting_rpy_deg=(10.0, -20.0, 130.0))
    C_ba = mounting(turned)
    same = MountedAntenna(pattern="isotropic", mounting_matrix=tuple(map(tuple, C_ba.tolist())))

    np.testing.assert_allclose(C_ba, Rotation.from_euler("ZYX", (130, -20, 10), degrees=True).as_matrix())
    np.testing.assert_array_equal(mounting(same), C_ba)


@pytest.mark.parametrize(
    "rows",
    [
        ((1, 0, 0), (0, 1, 0), (0, 0, -1)),
        ((1, 0, 0), (0, 2, 0), (0, 0, 1)),
        ((1, 0, 0), (1, 0, 0), (0, 0, 1)),
    ],
)
def test_mounting_that_is_no_rotation_is_refused(rows: tuple[tuple[float, float, float], ...]) -> None:
    with pytest.raises(ValueError, match="not a rotation"):
        MountedAntenna(pattern="isotropic", mounting_matrix=rows)


def test_mounting_given_twice_is_refused() -> None:
    square = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    with pytest.raises(ValueError, match="not both"):
        MountedAntenna(pattern="isotropic", mounting_matrix=square, mounting_rpy_deg=(1.0, 0.0, 0.0))


def test_antenna_leaning_forward_gains_ahead_and_loses_behind() -> None:
    # pitched down by 40 deg its boresight points forward of the zenith
    leaning = MountedAntenna(pattern="cardioid", mounting_rpy_deg=(0.0, -40.0, 0.0))
    found = Decisions(attitudes([0.0, 0.0, 0.0]), np.array([0.0, 180.0]), 10.0, vehicle(leaning), SHARP)

    expected = 20.0 * np.log10(0.5 * (1.0 + np.sin(np.radians([50.0, -30.0]))))
    np.testing.assert_allclose(found.gain[0, :, 0], expected, atol=1e-3)


def test_second_antenna_below_takes_over_when_the_vehicle_is_inverted() -> None:
    below = MountedAntenna(name="belly", pattern="patch_l1", mounting_rpy_deg=(180.0, 0.0, 0.0))
    inverted = attitudes(np.tile([180.0, 0.0, 30.0], (3000, 1)))  # five minutes
    azimuth, elevation = paper_sky(600.0)[1:]
    limits = VisibilityLimits(-5.0, 1.0, 3.0, NO_LIMIT)
    alone = Decisions(inverted, azimuth, elevation, vehicle("patch_l1"), limits)
    both = Decisions(inverted, azimuth, elevation, vehicle("patch_l1", below), limits)

    assert not alone.visible.any()
    assert both.visible.all()
    assert (both.antenna == 1).all()


def test_rotation_of_1000_deg_per_s_is_only_geometry() -> None:
    n = 2000
    rolls = 1000.0 * 0.001 * np.arange(n)
    history = attitudes(np.column_stack([rolls, np.zeros((n, 2))]), step_s=0.001)
    found = Decisions(
        history, 90.0, 5.0, vehicle("hemispherical"), VisibilityLimits(-5.0, 0.0, 0.0, NO_LIMIT)
    )

    body_elevation = np.degrees(np.arcsin(np.sin(np.radians(5.0 + rolls))))
    clear = np.abs(body_elevation) > 0.2  # the edge falls within 0.1 deg
    np.testing.assert_array_equal(found.visible[clear, 0], body_elevation[clear] > 0.0)


# --- obstructions --------------------------------------------------------------------------------------------------

TAIL = """\
frame = "body_forward_right_down"
source = "test"
[[sector]]
azimuth_deg = [170.0, 190.0]
elevation_deg = [-90.0, 30.0]
"""


def with_tail(tmp_path: Path, pattern: str = "isotropic") -> MountedAntenna:
    (tmp_path / "tail.toml").write_text(TAIL, encoding="utf-8")
    return MountedAntenna(pattern=pattern, obstruction=Path("tail.toml"))


def test_tail_hides_what_is_behind_it_and_says_so(tmp_path: Path) -> None:
    azimuth = np.array([0.0, 180.0, 165.0, 195.0])
    antennas = vehicle(with_tail(tmp_path), folder=tmp_path)
    found = Decisions(attitudes([0.0, 0.0, 0.0]), azimuth, 10.0, antennas, SHARP)

    assert found.visible[0].tolist() == [True, False, True, True]
    assert found.reason[0].tolist() == [USED, MASKED_OBSTRUCTION, USED, USED]


def test_satellite_near_the_edge_of_the_tail_keeps_its_decision(tmp_path: Path) -> None:
    antennas = vehicle(with_tail(tmp_path), folder=tmp_path)
    # towards the edge of the tail, behind it, and back: yaw to the left moves the satellite to the right of the body
    yaws = [-20.0, -12.0, -8.0, 0.0, -8.0, -12.0, -20.0]
    rpy = np.column_stack([np.zeros((7, 2)), yaws])
    limits = VisibilityLimits(-5.0, 0.0, 3.0, NO_LIMIT)
    found = Decisions(attitudes(rpy, sd_deg=1.0), 180.0, 5.0, antennas, limits)

    assert found.visible[:, 0].tolist() == [True, True, True, False, False, False, True]
    assert (found.decision[[1, 2, 4, 5], 0] & IS_UNCERTAIN).all()


def test_another_antenna_sees_past_the_tail(tmp_path: Path) -> None:
    antennas = vehicle(with_tail(tmp_path), "isotropic", folder=tmp_path)
    found = Decisions(attitudes([0.0, 0.0, 0.0]), 180.0, 10.0, antennas, SHARP)

    assert found.decision.tolist() == [[VISIBLE]]
    assert found.antenna.tolist() == [[1]]


def test_obstruction_file_that_is_wrong_is_refused_when_the_vehicle_is_equipped(tmp_path: Path) -> None:
    antenna = with_tail(tmp_path)
    (tmp_path / "tail.toml").write_text(TAIL.replace("azimuth", "azimut"), encoding="utf-8")

    with pytest.raises(ConfigError, match="azimuth_deg"):
        vehicle(antenna, folder=tmp_path)


# --- what is no number ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("excess", "margin", "expected"), [(np.nan, 1.0, -1), (1.0, np.nan, -1), (0.0, np.inf, 0)]
)
def test_gain_that_is_no_number_falls_short(excess: float, margin: float, expected: int) -> None:
    assert compare(excess, margin) == expected


def test_direction_that_is_no_number_is_hidden_by_every_antenna() -> None:
    antennas = vehicle("cardioid", "patch_l1")
    look = look_at(np.full(3, np.nan), np.eye(3) * 1e-6, False, antennas, SHARP, VISIBLE)

    assert look.decision == HIDDEN
    assert look.reason == MASKED_GAIN


@pytest.mark.parametrize("axis", range(3))
def test_raster_of_what_is_hidden_hides_a_direction_that_is_no_number(axis: int) -> None:
    direction = [0.6, 0.0, -0.8]
    direction[axis] = np.nan
    clearance = np.full((1, N_ELEVATIONS, N_AZIMUTHS), 100, np.int8)

    assert clearance_at(clearance, 0, *direction) == -np.pi
