"""Wrong units are an error; no legitimate motion, from free fall to a spinning rocket, is taken for one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insgnss.config.flight import ImuConfig
from insgnss.errors import UnitsError
from insgnss.log.imu.units import check_units
from insgnss.tables import Event, ImuTable
from tests.log.writing import G_MPS2, GRADE, Float64, imu_config

LOG = Path("imu.csv")
RATE_HZ = 100.0
DEG = np.pi / 180.0
DOWN = np.array([0.0, 0.0, G_MPS2])
Motion = Callable[[np.random.Generator], tuple[Float64, Float64]]


def seconds(duration_s: float) -> Float64:
    return np.arange(0.0, duration_s, 1.0 / RATE_HZ)


def attitudes(w: Float64, start: Rotation | None = None) -> Rotation:
    """Return C_nb after each step of the given body rates."""
    current = Rotation.identity() if start is None else start
    steps = Rotation.from_rotvec(w / RATE_HZ)
    matrices = []
    for step in steps:
        matrices.append(current.as_matrix())
        current = current * step
    return Rotation.from_matrix(np.array(matrices))


def force(C_nb: Rotation, a_n: Float64) -> Float64:
    return np.asarray(C_nb.inv().apply(a_n - DOWN), dtype=np.float64)


def noisy(rng: np.random.Generator, w: Float64, f: Float64) -> tuple[Float64, Float64]:
    return w + rng.normal(0.0, 2e-3, w.shape), f + rng.normal(0.0, 0.02, f.shape)


def at_rest(rng: np.random.Generator) -> tuple[Float64, Float64]:
    n = len(seconds(60.0))
    return noisy(rng, np.tile([0.5 * DEG, 0.3 * DEG, -0.2 * DEG], (n, 1)), np.tile(-DOWN, (n, 1)))


def free_fall(rng: np.random.Generator) -> tuple[Float64, Float64]:
    n = len(seconds(120.0))
    w = np.tile([0.0, -1.1e-3, 0.0], (n, 1))
    return w + rng.normal(0.0, 1e-5, w.shape), np.tile([0.009, 0.02, -0.006], (n, 1))


def rocket(rng: np.random.Generator) -> tuple[Float64, Float64]:
    parts = [(60.0, G_MPS2), (20.0, 100.0 * G_MPS2), (20.0, -8.0), (20.0, -1.0), (60.0, -0.1)]
    axial = np.concatenate([np.full(len(seconds(duration)), value) for duration, value in parts])
    spinning = np.concatenate(
        [np.full(len(seconds(d)), 0.0 if d == 60.0 and v > 1 else 94.0) for d, v in parts]
    )
    zero = np.zeros_like(axial)
    return noisy(rng, np.column_stack([spinning, zero, zero]), np.column_stack([axial, zero, zero]))


def spin_about_level_axis(rng: np.random.Generator) -> tuple[Float64, Float64]:
    w = np.tile([8.0 * np.pi, 0.0, 0.0], (len(seconds(60.0)), 1))  # whole turns in each window
    tilt = Rotation.from_euler("y", 6.0 * DEG)  # the axial part of g is 1.02 m/s^2
    return noisy(rng, w, force(attitudes(w, tilt), np.zeros_like(w)))


def rate_table_with_lever_arm(rng: np.random.Generator) -> tuple[Float64, Float64]:
    w = np.tile([0.0, 0.0, 3.0], (len(seconds(60.0)), 1))
    return noisy(rng, w, np.tile([-0.25 * 9.0, 0.0, -G_MPS2], (len(w), 1)))


def circling_aircraft(rng: np.random.Generator) -> tuple[Float64, Float64]:
    n = len(seconds(120.0))
    bank, speed = 13.0 * DEG, 6.0
    turn = G_MPS2 * np.tan(bank) / speed
    w = np.tile([0.0, turn * np.sin(bank), turn * np.cos(bank)], (n, 1))
    return noisy(rng, w, np.tile([0.0, 0.0, -G_MPS2 / np.cos(bank)], (n, 1)))


def coordinated_rolls(rng: np.random.Generator) -> tuple[Float64, Float64]:
    t = seconds(120.0)
    w = np.column_stack([0.7 * np.sin(0.5 * t), 0.01 * np.sin(0.5 * t), 0.02 * np.ones_like(t)])
    f = np.column_stack([0.1 * np.sin(0.5 * t), 0.1 * np.cos(0.5 * t), -G_MPS2 * np.ones_like(t)])
    return noisy(rng, w, f)


def aerobatics(rng: np.random.Generator) -> tuple[Float64, Float64]:
    t = seconds(120.0)
    w = np.column_stack([np.zeros_like(t), 0.3 * np.ones_like(t), np.zeros_like(t)])
    C_nb = attitudes(w)
    return noisy(
        rng, w, force(C_nb, np.cross(C_nb.apply(w), C_nb.apply(np.tile([60.0, 0.0, 0.0], (len(t), 1)))))
    )


def stiff_car(rng: np.random.Generator) -> tuple[Float64, Float64]:
    t = seconds(200.0)
    a = 3.0 * np.sin(0.8 * t)
    pitch = 1.0 * DEG * a / G_MPS2
    w = np.column_stack([np.zeros_like(t), np.gradient(pitch, t), 0.3 * np.sin(0.1 * t)])
    f = np.column_stack([a + G_MPS2 * np.sin(pitch), np.zeros_like(t), -G_MPS2 * np.cos(pitch)])
    return noisy(rng, w, f)


def stiff_car_straight_on(rng: np.random.Generator) -> tuple[Float64, Float64]:
    w, f = stiff_car(rng)
    w[:, 2] = 0.0  # what is left: f tilts 58 times as far as the body
    return w, f


def handheld(rng: np.random.Generator) -> tuple[Float64, Float64]:
    t = seconds(120.0)
    w = np.column_stack([0.25 * np.sin(0.21 * t), 0.25 * np.cos(0.17 * t), 0.2 * np.sin(0.4 * t)])
    return noisy(rng, w, force(attitudes(w), 0.3 * rng.standard_normal((1, 3)) * np.sin(3.0 * t)[:, None]))


def growing_thrust(rng: np.random.Generator) -> tuple[Float64, Float64]:
    t = seconds(200.0)
    zero = np.zeros_like(t)
    return np.column_stack([zero, zero, zero]), np.column_stack([np.linspace(0.6, 1.4, len(t)), zero, zero])


MOTIONS: list[Motion] = [
    growing_thrust,
    at_rest,
    free_fall,
    rocket,
    spin_about_level_axis,
    rate_table_with_lever_arm,
    circling_aircraft,
    coordinated_rolls,
    aerobatics,
    stiff_car,
    stiff_car_straight_on,
    handheld,
]


def check(w: Float64, f: Float64, config: ImuConfig, range_deg_per_s: float | None = None) -> list[Event]:
    t_ns = np.arange(len(w), dtype=np.int64) * round(1e9 / RATE_HZ)
    grade = GRADE.model_copy(update={"gyro_range_deg_per_s": range_deg_per_s})
    return check_units(ImuTable(t_ns, w, f), config, grade, 1e9 / RATE_HZ, "imu.csv")


@pytest.mark.parametrize("gyro_unit", ["rad/s", "deg/s"])
@pytest.mark.parametrize("accel_unit", ["m/s^2", "g"])
@pytest.mark.parametrize("motion", MOTIONS)
def test_legitimate_motion_is_no_units_error(
    motion: Motion, gyro_unit: str, accel_unit: str, rng: np.random.Generator
) -> None:
    w, f = motion(rng)
    events = check(w, f, imu_config(LOG, gyro_unit=gyro_unit, accel_unit=accel_unit))
    assert {event.kind for event in events} <= {"units_suspicion"}


@pytest.mark.parametrize("motion", [at_rest, stiff_car, handheld])
def test_everyday_motion_gives_no_suspicion_either(motion: Motion, rng: np.random.Generator) -> None:
    assert check(*motion(rng), imu_config(LOG)) == []


@pytest.mark.parametrize("motion", [at_rest, stiff_car, handheld, coordinated_rolls])
@pytest.mark.parametrize(
    ("factor", "declared", "fits"),
    [
        (1.0 / G_MPS2, {}, "accel_unit = 'g' fits"),
        (G_MPS2, {"accel_unit": "g"}, "accel_unit = 'm/s^2' fits"),
        (1e-3 * G_MPS2, {"accel_unit": "mg"}, "accel_unit = 'm/s^2' fits"),
        (1.0 / RATE_HZ, {}, "values = 'increments' with accel_unit = 'm/s' fits"),
        (
            RATE_HZ,
            {"values": "increments", "gyro_unit": "rad", "accel_unit": "m/s"},
            "values = 'rates' with accel_unit = 'm/s^2' fits",
        ),
    ],
)
def test_wrong_accelerometer_unit_is_an_error_that_names_the_right_one(
    motion: Motion, factor: float, declared: dict[str, str], fits: str, rng: np.random.Generator
) -> None:
    w, f = motion(rng)
    with pytest.raises(UnitsError) as caught:
        check(w, f * factor, imu_config(LOG, **declared))
    assert fits in caught.value.advice
    assert caught.value.key == "imu.accel_unit"


@pytest.mark.parametrize(("per_mps2", "unit"), [(1000.0 / G_MPS2, "mg"), (100.0, "cm/s^2")])
def test_units_that_differ_by_two_per_cent_are_told_apart_by_a_steady_sensor_alone(
    per_mps2: float, unit: str, rng: np.random.Generator
) -> None:
    """In a stiff car the mean specific force is 2.3 % above g, so values in cm/s^2 may also be mg."""
    both = "accel_unit = 'mg' or accel_unit = 'cm/s^2' would fit"
    for motion, told in ((at_rest, f"accel_unit = '{unit}' fits"), (stiff_car, both)):
        w, f = motion(rng)
        with pytest.raises(UnitsError) as caught:
            check(w, f * per_mps2, imu_config(LOG))
        alone = motion is at_rest or unit == "mg"
        assert caught.value.advice == (f"accel_unit = '{unit}' fits" if alone else told)
        assert len(caught.value.fits) == alone


def test_gyros_in_degrees_declared_as_radians_are_seen_at_rest(rng: np.random.Generator) -> None:
    w, f = at_rest(rng)
    with pytest.raises(UnitsError, match="gyro_unit = 'deg/s' fits"):
        check(w / DEG, f, imu_config(LOG))


@pytest.mark.parametrize(
    ("factor", "declared", "fits"),
    [(1.0 / DEG, "rad/s", "deg/s"), (DEG, "deg/s", "rad/s")],
    ids=["deg", "rad"],
)
def test_wrong_gyro_unit_is_seen_when_the_sensor_tilts(
    factor: float, declared: str, fits: str, rng: np.random.Generator
) -> None:
    w, f = handheld(rng)
    with pytest.raises(UnitsError, match=f"gyro_unit = '{fits}' fits"):
        check(w * factor, f, imu_config(LOG, gyro_unit=declared))


def test_rates_beyond_twice_the_range_are_a_units_error(rng: np.random.Generator) -> None:
    w, f = coordinated_rolls(rng)
    check(w, f, imu_config(LOG), range_deg_per_s=450.0)
    with pytest.raises(UnitsError, match="range"):
        check(w / DEG, f, imu_config(LOG), range_deg_per_s=450.0)


def test_strange_magnitude_at_rest_that_no_unit_explains_is_only_told(rng: np.random.Generator) -> None:
    w, f = at_rest(rng)
    events = check(w, 0.7 * f, imu_config(LOG))
    assert [event.kind for event in events] == ["units_suspicion"]


def test_restless_log_in_the_wrong_unit_is_only_told(rng: np.random.Generator) -> None:
    w, f = at_rest(rng)
    f = f + 8.0 * np.repeat(rng.standard_normal((60, 3)), 100, axis=0)
    events = check(w, f / np.median(np.linalg.norm(f, axis=1)), imu_config(LOG))
    assert [event.kind for event in events] == ["units_suspicion"]
