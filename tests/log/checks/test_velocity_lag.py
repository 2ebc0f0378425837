"""Velocities late against the position fixes beside them: simulated lags, what does not show them, and a real log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import insgnss
from insgnss.log.checks.fixes_track import VelocityLag, velocity_lag
from insgnss.log.checks.report import Finding
from insgnss.runs.check import examine
from insgnss.tables import Float64

RADIUS_M = 6_378_137.0


def motion(t_s: Float64) -> tuple[Float64, Float64]:
    """Return a way [m] and its velocity [m/s], north and east, of a vehicle that turns and brakes."""
    way = np.column_stack([-6.0 * np.cos(0.5 * t_s) + np.sin(1.3 * t_s) / 1.3, 5.0 * np.sin(0.4 * t_s)])
    return way, np.column_stack([3.0 * np.sin(0.5 * t_s) + np.cos(1.3 * t_s), 2.0 * np.cos(0.4 * t_s)])


def logged(
    lag_s: float,
    rng: np.random.Generator,
    *,
    rate_hz: float = 4.0,
    noise_m: float = 0.02,
    noise_mps: float = 0.05,
    still: bool = False,
    seconds: float = 120.0,
) -> tuple[Float64, Float64, Float64, Float64]:
    """Return times and places of fixes, times and values of velocities that are so late."""
    t_s = np.arange(0.0, seconds, 1.0 / rate_hz)
    way, velocity = motion(t_s)[0], motion(t_s - lag_s)[1]
    if still:
        way, velocity = np.zeros_like(way), np.zeros_like(velocity)
    way = way + rng.normal(0.0, noise_m, way.shape)
    velocity = velocity + rng.normal(0.0, noise_mps, velocity.shape)
    # in the Gulf of Guinea north is along z, east along y
    r_e = np.column_stack([np.full(len(t_s), RADIUS_M), way[:, 1], way[:, 0]])
    return t_s, r_e, t_s, velocity


def found(lag_s: float, seed: int, **how: float) -> VelocityLag:
    lag = velocity_lag(*logged(lag_s, np.random.default_rng(seed), **how))  # type: ignore[arg-type]
    assert lag is not None
    return lag


@pytest.mark.parametrize("lag_s", [-0.1, 0.05, 0.125, 0.3])
def test_lag_is_found(lag_s: float) -> None:
    lag = found(lag_s, 5)
    assert lag.offset_s == pytest.approx(-lag_s, abs=0.01) and lag.is_sure


@pytest.mark.parametrize(("rate_hz", "noise_m"), [(4.0, 0.05), (1.0, 0.3)])
def test_sigma_of_the_lag_is_honest(rate_hz: float, noise_m: float) -> None:
    lags = [found(0.0, 100 + k, rate_hz=rate_hz, noise_m=noise_m) for k in range(60)]
    ratio = np.array([lag.offset_s / lag.sigma_s for lag in lags])
    assert 0.4 < np.sqrt(np.mean(ratio**2)) < 1.3  # the ways of one second count once, though they overlap
    assert not any(lag.is_sure for lag in lags)


def test_rest_and_noise_show_no_lag() -> None:
    still = velocity_lag(*logged(0.2, np.random.default_rng(3), still=True))
    assert still is None or not still.is_sure
    rough = velocity_lag(*logged(0.2, np.random.default_rng(4), rate_hz=1.0, noise_m=5.0))
    assert rough is None or (not rough.is_sure and rough.sigma_s > 0.05)
    few = logged(0.2, np.random.default_rng(5), seconds=4.0)
    assert velocity_lag(*few) is None


def test_ways_over_a_pause_do_not_count() -> None:
    t_s, r_e, v_s, v_n = logged(0.125, np.random.default_rng(6))
    kept = (v_s <= 40.0) | (v_s >= 60.0)
    lag = velocity_lag(t_s, r_e, v_s[kept], v_n[kept])
    assert lag is not None and lag.offset_s == pytest.approx(-0.125, abs=0.01)


@pytest.mark.real_data
@pytest.mark.parametrize("vertical", ["vd", "none"])
def test_real_receivers_velocities_are_half_an_epoch_late(
    data_root: Path, tmp_path: Path, vertical: str
) -> None:
    """A receiver with four fixes a second: raw range rates agree with the IMU's tags, its velocities do not."""
    folder = data_root / "walk_boulder_20250828"
    fixes = f'files = ["{folder / "reference.csv"}"]'
    path = tmp_path / "flight.toml"

    def findings(of_velocities: str) -> list[Finding]:
        path.write_text(
            f'gps_week = 2381\n[imu]\nfiles = ["{folder / "imu.csv"}"]\ngrade = "mems_consumer"\n[imu.columns]\n'
            'gyro = ["wx_radps", "wy_radps", "wz_radps"]\naccel = ["fx_mps2", "fy_mps2", "fz_mps2"]\n'
            f'[[sensor]]\nkind = "position"\n{fixes}\nsigma_m = [0.1, 0.1, 0.2]\n'
            f'[[sensor]]\nkind = "velocity"\n{fixes}\nsigma_mps = [0.1, 0.1, 0.1]\n'
            f'columns = {{ velocity = ["vn", "ve", "{vertical}"] }}\n{of_velocities}'
        )
        return examine(insgnss.Flight.load(path)).findings

    told = findings("")
    (late,) = [each for each in told if "late relative to the position fixes" in each.text]
    assert late.severity == "warning" and late.advice.startswith("add -0.13")
    # the IMU's tags are right: a lag of the velocities must not be proposed as theirs
    assert not [each for each in told if each.severity == "error" or each.proposals]
    mended = findings("time.offset_s = -0.134\n")
    assert [each.severity for each in mended if "tags fit the position fixes" in each.text] == ["ok"]
    assert not [each for each in mended if "late relative" in each.text or each.proposals]
