"""Inertial logs in every declared form give the same body rates and specific forces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insgnss.errors import ConfigError, InputError
from insgnss.log.imu.csv_log import read_imu
from insgnss.tables import ImuTable
from tests.log.writing import (
    G_MPS2,
    IMU_HEADER,
    WEEK,
    Float64,
    imu_config,
    lines_of,
    rest,
    write_imu,
    write_lines,
)

WEEK_NS = WEEK * 604_800 * 10**9


def read(path: Path, rows: Float64, **settings: object) -> tuple[ImuTable, list[str]]:
    table, events = read_imu(imu_config(write_imu(path / "imu.csv", rows), **settings), WEEK)
    return table, [event.kind for event in events]


def test_plain_log_is_read_as_it_stands(tmp_path: Path, rng: np.random.Generator) -> None:
    rows = rest(rng)
    table, events = read(tmp_path, rows)
    assert np.array_equal(table.t_ns, WEEK_NS + np.rint(rows[:, 0] * 1e9).astype(np.int64))
    assert np.allclose(table.w_ib_b, rows[:, 1:4], rtol=0, atol=1e-9)
    assert np.allclose(table.f_b, rows[:, 4:7], rtol=0, atol=1e-9)
    assert events == []


@pytest.mark.parametrize(("gyro", "per_rad"), [("rad/s", 1.0), ("deg/s", 180.0 / np.pi)])
@pytest.mark.parametrize(
    ("accel", "per_mps2"), [("m/s^2", 1.0), ("g", 1.0 / G_MPS2), ("mg", 1000.0 / G_MPS2), ("cm/s^2", 100.0)]
)
def test_units_of_rates_are_converted(
    tmp_path: Path, rng: np.random.Generator, gyro: str, per_rad: float, accel: str, per_mps2: float
) -> None:
    rows = rest(rng)
    written = rows * ([1.0] + [per_rad] * 3 + [per_mps2] * 3)
    table, _ = read(tmp_path, written, gyro_unit=gyro, accel_unit=accel)
    assert np.allclose(table.w_ib_b, rows[:, 1:4], rtol=0, atol=1e-8)
    assert np.allclose(table.f_b, rows[:, 4:7], rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("gyro", "accel", "per"), [("rad", "m/s", (1.0, 1.0)), ("deg", "g*s", (180 / np.pi, 1 / G_MPS2))]
)
def test_increments_become_means_over_their_own_steps(
    tmp_path: Path, rng: np.random.Generator, gyro: str, accel: str, per: tuple[float, float]
) -> None:
    rows = rest(rng)
    rows[1:, 0] += np.cumsum(rng.integers(-3, 4, 999)) * 1e-3 / 30  # steps from 9.9 to 10.1 ms
    first = np.median(np.diff(rows[:65, 0]))  # no tag tells the first step: that of the block it stands in
    step = np.diff(rows[:, 0], prepend=rows[0, 0] - first)[:, None]
    written = np.hstack([rows[:, :1], rows[:, 1:4] * step * per[0], rows[:, 4:7] * step * per[1]])
    table, _ = read(tmp_path, written, gyro_unit=gyro, accel_unit=accel, values="increments")
    assert np.allclose(table.w_ib_b, rows[:, 1:4], rtol=0, atol=1e-6)
    assert np.allclose(table.f_b, rows[:, 4:7], rtol=0, atol=2e-5)


def test_increment_after_a_gap_covers_one_nominal_step(tmp_path: Path, rng: np.random.Generator) -> None:
    rows = rest(rng)
    rows[500:, 0] += 1.0
    rows[:, 1:] *= 0.01
    table, events = read(tmp_path, rows, gyro_unit="rad", accel_unit="m/s", values="increments")
    assert table.f_b[500, 2] == pytest.approx(-G_MPS2, abs=0.1)
    assert sorted(events) == ["imu_gap", "imu_increment_after_gap"]


@pytest.mark.parametrize("pattern", [[1, 1, 2], [1] * 500 + [2] * 250])
def test_increments_over_uneven_steps_keep_the_size_of_gravity(
    tmp_path: Path, rng: np.random.Generator, pattern: list[int]
) -> None:
    rows = rest(rng)
    count = np.resize(pattern, 600 if len(pattern) == 3 else 750)
    ends = np.cumsum(count) - 1
    sums = np.add.reduceat(rows[: ends[-1] + 1, 1:], np.concatenate(([0], ends[:-1] + 1)), axis=0) * 0.01
    written = np.hstack([rows[ends, :1], sums])
    table, events = read(tmp_path, written, gyro_unit="rad", accel_unit="m/s", values="increments")
    assert np.allclose(table.f_b[:, 2], -G_MPS2, rtol=0, atol=0.1)
    assert set(events) <= {"imu_increment_over_long_step"}


def test_instant_values_become_means_of_the_intervals_ends(tmp_path: Path, rng: np.random.Generator) -> None:
    rows = rest(rng)
    table, _ = read(tmp_path, rows, sampling="instant")
    assert np.allclose(table.f_b[1:], 0.5 * (rows[1:, 4:7] + rows[:-1, 4:7]), rtol=0, atol=1e-9)
    assert np.allclose(table.w_ib_b[0], rows[0, 1:4], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("axes", "C_bs"),
    [
        (["+x", "+y", "+z"], [[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        (["+x", "-y", "-z"], [[1, 0, 0], [0, -1, 0], [0, 0, -1]]),
        (["-y", "-x", "-z"], [[0, -1, 0], [-1, 0, 0], [0, 0, -1]]),
        (["z", "x", "y"], [[0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    ],
)
def test_axes_are_the_sensor_axes_that_point_forward_right_down(
    tmp_path: Path, rng: np.random.Generator, axes: list[str], C_bs: list[list[int]]
) -> None:
    rows = rest(rng)
    table, _ = read(tmp_path, rows, axes=axes)
    assert np.allclose(table.f_b, rows[:, 4:7] @ np.array(C_bs).T, rtol=0, atol=1e-9)
    matrix, _ = read(tmp_path, rows, mounting_matrix=C_bs)
    assert np.array_equal(matrix.f_b, table.f_b)


def test_full_mounting_matrix_turns_the_sensor_axes(tmp_path: Path, rng: np.random.Generator) -> None:
    rows = rest(rng)
    c, s = np.cos(0.3), np.sin(0.3)
    C_bs = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ np.array(
        [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    )
    table, _ = read(tmp_path, rows, mounting_matrix=C_bs.tolist())
    assert np.allclose(table.f_b, rows[:, 4:7] @ C_bs.T, rtol=0, atol=1e-9)
    assert np.allclose(table.w_ib_b, rows[:, 1:4] @ C_bs.T, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"axes": ["+y", "+x", "+z"]}, "left-handed"),
        ({"mounting_matrix": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}, "left-handed"),
        ({"mounting_matrix": [[1, 0, 0], [0, 1, 0.01], [0, 0, 1]]}, "orthonormal"),
        ({"mounting_matrix": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}, "orthonormal"),
    ],
)
def test_impossible_axes_are_an_error(tmp_path: Path, settings: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read_imu(imu_config(tmp_path / "imu.csv", **settings), WEEK)


def test_several_files_are_joined_in_the_order_of_their_times(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    rows = rest(rng)
    late, early = write_imu(tmp_path / "a.csv", rows[600:]), write_imu(tmp_path / "b.csv", rows[:600])
    whole, _ = read(tmp_path, rows)
    joined, events = read_imu(imu_config(late, early), WEEK)
    assert np.array_equal(joined.t_ns, whole.t_ns) and np.array_equal(joined.f_b, whole.f_b)
    assert not events


def test_stray_tag_at_the_head_of_a_file_leaves_the_order_of_the_files(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    rows = rest(rng, start_s=604_795.0)
    rows[:, 0] %= 604_800.0
    spoilt = rows[:600].copy()
    spoilt[0, 0] = 604_000.0
    rest_of_it = rows[600:].copy()
    rest_of_it[:2, 0] += 1e5
    early, late = write_imu(tmp_path / "a.csv", spoilt), write_imu(tmp_path / "b.csv", rest_of_it)
    joined, events = read_imu(imu_config(early, late), WEEK)
    whole, _ = read(tmp_path, rows)
    kept = np.delete(np.arange(1000), [0, 600, 601])
    assert np.array_equal(joined.t_ns, whole.t_ns[kept]) and np.array_equal(joined.f_b, whole.f_b[kept])
    assert [event.kind for event in events] == [
        "week_crossover",
        "imu_time_spike",
        "imu_time_spike",
        "week_crossover",
    ]


def test_overlapping_files_refuse_the_repeated_samples(tmp_path: Path, rng: np.random.Generator) -> None:
    rows = rest(rng)
    a, b = write_imu(tmp_path / "a.csv", rows[:600]), write_imu(tmp_path / "b.csv", rows[590:])
    joined, events = read_imu(imu_config(a, b), WEEK)
    assert len(joined.t_ns) == 1000
    assert [event.kind for event in events] == ["imu_time_backwards"]


def test_bad_cells_are_refused_and_the_table_stays_finite(tmp_path: Path, rng: np.random.Generator) -> None:
    lines = lines_of(rest(rng))
    for index, cell in ((10, "nan"), (20, "inf"), (30, ""), (40, "text")):
        cells = lines[index].split(",")
        cells[4] = cell
        lines[index] = ",".join(cells)
    path = write_lines(tmp_path / "imu.csv", [IMU_HEADER, *lines])
    table, events = read_imu(imu_config(path), WEEK)
    assert len(table.t_ns) == 996
    assert np.isfinite(table.f_b).all() and np.isfinite(table.w_ib_b).all()
    assert [event.kind for event in events] == ["bad_row"] * 4


def test_log_of_one_sample_is_an_error(tmp_path: Path, rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="at least two"):
        read(tmp_path, rest(rng, n=1))


def test_week_crossover_keeps_time_going_on(tmp_path: Path, rng: np.random.Generator) -> None:
    rows = rest(rng, start_s=604_795.0)
    rows[:, 0] %= 604_800.0
    table, events = read(tmp_path, rows)
    assert np.array_equal(np.diff(table.t_ns), np.full(999, 10_000_000))
    assert events == ["week_crossover"]


@pytest.mark.parametrize("gap_s", [0.1, 1.0, 10.0])
def test_gap_is_told_and_nothing_is_filled_in(tmp_path: Path, rng: np.random.Generator, gap_s: float) -> None:
    rows = rest(rng)
    rows[400:, 0] += gap_s
    table, events = read(tmp_path, rows)
    assert len(table.t_ns) == 1000
    assert events == ["imu_gap"]


def two_files(folder: Path, gyro: Float64, accel: Float64) -> dict[str, object]:
    """Write each sensor's log as a phone does, time and x, y, z, and return what declares them."""
    for name, rows in (("Gyroscope.csv", gyro), ("Accelerometer.csv", accel)):
        write_lines(folder / name, ["time,x,y,z", *lines_of(rows)])
    axes = ["x", "y", "z"]
    return {
        "files": [folder / "Gyroscope.csv"],
        "accel_files": [folder / "Accelerometer.csv"],
        "columns": {"time": "time", "gyro": axes, "accel": axes},
    }


def test_sensors_with_files_of_their_own_are_paired_at_the_gyros_times(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    rows = rest(rng)
    accel_t = rows[5:-5:2, 0] + 0.003
    force = np.column_stack([np.sin(accel_t - 1000.0), np.cos(accel_t - 1000.0), accel_t - 1010.0])
    accel = np.column_stack([accel_t, force])
    config = imu_config(**two_files(tmp_path, rows[:, :4], accel))
    table, events = read_imu(config, WEEK)
    inside = (rows[:, 0] >= accel_t[0]) & (rows[:, 0] <= accel_t[-1])
    assert np.array_equal(table.t_ns, WEEK_NS + np.rint(rows[inside, 0] * 1e9).astype(np.int64))
    assert np.allclose(table.w_ib_b, rows[inside, 1:4], rtol=0, atol=1e-9)
    expected = np.column_stack([np.interp(rows[inside, 0], accel_t, force[:, k]) for k in range(3)])
    assert np.allclose(table.f_b, expected, rtol=0, atol=2e-8)  # nine decimals of both
    (unpaired,) = [event.detail for event in events if event.kind == "imu_unpaired"]
    assert f"{int((~inside).sum())} angular rate(s) without a specific force" in unpaired


def test_sensors_that_share_no_time_are_an_error_with_both_spans(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    rows = rest(rng)
    later = rows[:, [0, 4, 5, 6]] + [500.0, 0.0, 0.0, 0.0]
    with pytest.raises(
        InputError, match=r"1000.000 to 1009.990 s\) and accelerometers \(1500.000 to 1509.990"
    ):
        read_imu(imu_config(**two_files(tmp_path, rows[:, :4], later)), WEEK)


def test_one_sensor_s_file_in_the_place_of_both_names_the_key_for_two(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    rows = rest(rng)
    two_files(tmp_path, rows[:, :4], rows[:, [0, 4, 5, 6]])
    columns = {"time": "time", "gyro": ["x", "y", "z"], "accel": ["ax", "ay", "az"]}
    with pytest.raises(InputError, match="accel_files"):
        read_imu(imu_config(tmp_path / "Gyroscope.csv", columns=columns), WEEK)
    misspelt = write_lines(tmp_path / "imu.csv", [IMU_HEADER.replace("accel_y", "acel_y"), *lines_of(rows)])
    with pytest.raises(InputError, match="nearest: 'acel_y'") as caught:
        read_imu(imu_config(misspelt), WEEK)
    assert "accel_files" not in str(caught.value)
    columns["accel"] = columns["gyro"]
    with pytest.raises(ValueError, match=r"'x' is named for two things(.|\n)*accel_files"):
        imu_config(tmp_path / "Gyroscope.csv", columns=columns)


def test_increments_of_two_files_are_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    rows = rest(rng)
    settings = two_files(tmp_path, rows[:, :4], rows[:, [0, 4, 5, 6]])
    with pytest.raises(ValueError, match="accel_files goes with values = 'rates'"):
        imu_config(**settings, values="increments", gyro_unit="rad", accel_unit="m/s")
