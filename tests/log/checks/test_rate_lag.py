"""Range rates that lag behind the ranges: the lag that the ranges show, and the findings of a flight's check."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insgnss.constants import NS_PER_S
from insgnss.log.checks.rate_lag import KnownLag, RateLag, best_lag, known_lag, rate_lag
from insgnss.log.checks.report import CheckReport, Finding
from insgnss.log.checks.time_offset import RatesInTime, Timing
from insgnss.log.checks.track import GnssTrack
from insgnss.runs.check import examine
from insgnss.runs.simulate import simulate
from insgnss.tables import Float64, GnssTable
from tests.log.checks.spoilt import Log, imu_later, log_of

CHANNELS = 7
RATE_MPS = 0.03


def motion(t_s: Float64) -> tuple[Float64, Float64]:
    """Return a way [m] and its velocity [m/s] of a vehicle that turns and brakes."""
    phase = t_s[:, None] * np.array([0.5, 0.4, 0.2])
    size = np.array([6.0, 5.0, 4.0])
    return size * np.sin(phase), size * np.array([0.5, 0.4, 0.2]) * np.cos(phase)


def logged(
    lag_s: float,
    seed: int,
    *,
    code_m: float = 0.5,
    rate_hz: float = 2.0,
    still: bool = False,
    seconds: float = 200.0,
) -> tuple[GnssTable, Float64]:
    """Return a table of satellites that change their rates slowly, and range rates that are so late."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(0.0, seconds, 1.0 / rate_hz)
    u = rng.normal(size=(3, CHANNELS))
    u /= np.linalg.norm(u, axis=0)
    swing = rng.uniform(-0.09, 0.09, CHANNELS)

    def of(t: Float64) -> tuple[Float64, Float64]:
        way, velocity = motion(t)
        moved = 0.0 if still else 1.0
        clock = 50.0 * t[:, None] + 3.0 * np.sin(0.3 * t)[:, None]
        ranges = moved * way @ u + 0.5 * swing * t[:, None] ** 2 + clock
        return ranges, moved * velocity @ u + swing * t[:, None] + 50.0 + 0.9 * np.cos(0.3 * t)[:, None]

    ranges, rates = of(t_s)[0], of(t_s - lag_s)[1]
    ranges = ranges + rng.normal(0.0, code_m, ranges.shape)
    rates = rates + rng.normal(0.0, RATE_MPS, rates.shape)
    n = ranges.size
    nothing = np.full(n, np.nan)
    sv = np.tile(np.arange(CHANNELS, dtype=np.int16), len(t_s))
    names = tuple(f"G{k + 1:02d}" for k in range(CHANNELS))
    t_ns = np.repeat(np.rint(t_s * NS_PER_S).astype(np.int64), CHANNELS)
    signal = np.zeros(n, np.int16)
    table = GnssTable(
        t_ns, sv, signal, 2.2e7 + ranges.ravel(), nothing, rates.ravel(), nothing, names, ("C1C",)
    )
    return table, rates.ravel()


def found(lag_s: float, seed: int, **how: float) -> RateLag:
    table, rates = logged(lag_s, seed, **how)  # type: ignore[arg-type]
    lag = best_lag(table, rates, None)
    assert lag is not None
    return lag


@pytest.mark.parametrize("lag_s", [0.0, 0.05, 0.2, 0.5])
def test_lag_is_found_by_the_ranges(lag_s: float) -> None:
    lag = found(lag_s, 3, code_m=0.1)
    assert lag.late_s == pytest.approx(lag_s, abs=0.02) and lag.sd_s < 0.01


def test_sigma_of_the_lag_is_honest() -> None:
    lags = [found(0.0, 100 + k) for k in range(40)]
    ratio = np.array([lag.late_s / lag.sd_s for lag in lags])
    assert 0.6 < np.sqrt(np.mean(ratio**2)) < 1.4
    assert np.abs(ratio).max() < 4.0


def test_ranges_with_slips_and_outliers_still_show_the_lag() -> None:
    table, rates = logged(0.2, 5, code_m=0.003)
    phases = table.pseudorange_m.copy()
    rng = np.random.default_rng(6)
    for at in rng.integers(0, len(phases), 20):
        later = (table.sv == table.sv[at]) & (table.t_ns >= table.t_ns[at])
        phases[later] += 0.19 * rng.integers(-50, 50)
    lag = rate_lag(table, phases, rates, 6.0, "carrier phases")
    assert (
        lag is not None and lag.late_s == pytest.approx(0.2, abs=5.0 * lag.sd_s + 0.005) and lag.sd_s < 0.02
    )


def test_rest_shows_no_lag() -> None:
    """Noise of the rates is in their integral, too: a receiver at rest seemed to lag by 0.04 s, 100 sigma."""
    table, rates = logged(0.0, 4, still=True, code_m=0.003, rate_hz=5.0)
    assert best_lag(table, rates, table.pseudorange_m) is None


def finding(lag_s: float, declared_s: float) -> Finding:
    table, rates = logged(lag_s, 7, code_m=0.1)
    (told,) = known_lag(table, rates, None, declared_s).findings
    return told


def test_lag_is_proposed_where_it_is_not_as_declared() -> None:
    assert finding(0.0, 0.0).severity == finding(0.2, 0.2).severity == "ok"
    late = finding(0.2, 0.0)
    assert late.severity == "error" and late.proposals[0].key == "gnss.range_rate_lag_s"
    assert late.proposals[0].value == pytest.approx(0.2, abs=0.02)
    less = finding(0.0, 0.2)
    assert "less than declared" in less.text and less.proposals[0].value == pytest.approx(0.0, abs=0.02)
    early = finding(-0.2, 0.0)
    assert early.severity == "warning" and not early.proposals, "no key makes rates earlier"


@pytest.mark.parametrize(
    ("rest_s", "sd_s", "used_s", "lag_s"),
    [
        (0.0, np.inf, 0.0, 0.2),  # the ranges say nothing
        (0.1, 0.08, 0.0, 0.2),  # they fit both
        (0.0, 0.01, 0.0, None),  # they show no lag
        (0.2, 0.01, 0.0, 0.2),  # they show the lag
        (0.0, np.inf, 1.9, None),  # a lag of 2.1 s has no key
    ],
)
def test_offset_may_be_a_lag_unless_the_ranges_rule_it_out(
    rest_s: float, sd_s: float, used_s: float, lag_s: float | None
) -> None:
    told = RatesInTime(used_s, rest_s, sd_s).lag_s(Timing(0.2, 0.01, 0.0, 100.0))
    assert told == (None if lag_s is None else pytest.approx(lag_s))
    ahead = RatesInTime(0.0, rest_s, np.inf).lag_s(Timing(-0.2, 0.01, 0.0, 100.0))
    assert ahead is None, "rates do not run ahead of the motion"


@pytest.mark.parametrize(
    ("offset_s", "lag_s"),
    # an offset of 0.051 s would be proposed by itself, one of 0.036 s would not
    [(-0.236, 0.0), (-0.251, None), (-0.18, 0.02)],
)
def test_lag_that_is_declared_but_absent_is_not_blamed_on_the_tags(
    offset_s: float, lag_s: float | None
) -> None:
    """A city's tags, by their sigma 0.036 s or 3.4 sigma off, were to be set 0.236 s back: surely, as it was said."""
    found = RatesInTime(0.2, -0.327, 0.075).lag_s(Timing(offset_s, 0.0099, 0.0, 100.0))
    assert found == (None if lag_s is None else pytest.approx(lag_s))


def test_rates_that_do_not_lag_are_no_other_reading_of_early_tags() -> None:
    """``gnss.range_rate_lag_s = 0`` is what the flight file says already."""
    assert RatesInTime(0.0, 0.0, np.inf).lag_s(Timing(-0.04, 0.01, 0.0, 100.0)) is None


def test_velocities_of_late_rates_are_not_made_up_over_a_gap() -> None:
    t_s = np.concatenate((np.arange(0.0, 10.0, 0.5), np.arange(60.0, 70.0, 0.5)))
    ones = np.ones(len(t_s))
    track = GnssTrack(t_s, ones[:, None] * 4e6, motion(t_s - 0.2)[1], 0.1 * ones, ones, ones, 0, 40, 40, 40)

    moved = KnownLag(0.2, 0.0, None).at_epochs(track)

    assert moved.t_s.tolist() == [t for t in t_s.tolist() if t not in (9.5, 69.5)]
    np.testing.assert_allclose(moved.v_e, motion(moved.t_s)[1], atol=0.05)
    assert len(moved.r_e) == len(moved.sd_v_mps) == len(moved.clock_m) == len(moved.drift_mps) == 38


def simulated(folder: Path, scenario: str, seed: int) -> Log:
    simulate(scenario, seed=seed, duration_s=300.0 if scenario != "city_car" else None).save(folder)
    return log_of(folder / "flight.toml")


def with_late_doppler(log: Log, lag_s: float, declared_s: float) -> Log:
    gnss = log.gnss.copy()
    for _, own in gnss.groupby(["sv", "signal"]):
        t, doppler = own["time_s"].astype(float), own["doppler_hz"].astype(float)
        gnss.loc[own.index, "doppler_hz"] = [f"{v:.6f}" for v in np.interp(t - lag_s, t, doppler)]
    return replace(log, gnss=gnss, gnss_keys=f"range_rate_lag_s = {declared_s}\n")


def checked(log: Log, folder: Path) -> CheckReport:
    folder.mkdir()
    return examine(log.write(folder))


def keys(report: CheckReport) -> dict[str, object]:
    return {proposal.key: proposal.value for proposal in report.proposals}


def test_late_range_rates_are_not_blamed_on_the_inertial_tags(tmp_path: Path) -> None:
    """Until now `imu.time.offset_s = 0.2` was proposed, declared or not, and the lever arm was to be measured again."""
    log = simulated(tmp_path, "turning_flight", 11)
    late = keys(checked(with_late_doppler(log, 0.2, 0.0), tmp_path / "late"))
    assert set(late) == {"gnss.range_rate_lag_s"}
    assert late["gnss.range_rate_lag_s"] == pytest.approx(0.2, abs=0.04)
    declared = checked(with_late_doppler(log, 0.2, 0.2), tmp_path / "declared")
    assert not keys(declared) and declared.severity == "ok", declared.lines()
    tags = keys(checked(imu_later(log, -0.2), tmp_path / "tags"))
    assert set(tags) == {"imu.time.offset_s"}
    assert tags["imu.time.offset_s"] == pytest.approx(0.2, abs=0.03)


def test_where_reflections_hide_the_lag_both_readings_are_named(tmp_path: Path) -> None:
    """Pseudoranges of a street, off by metres for 15 s, do not tell the two apart."""
    log = simulated(tmp_path, "city_car", 2)
    for name, spoilt in (("late", with_late_doppler(log, 0.2, 0.0)), ("tags", imu_later(log, -0.15))):
        report = checked(spoilt, tmp_path / name)
        (told,) = [each for each in report.findings if "range rates lag by" in each.text]
        assert told.severity == "warning" and not keys(report)
        assert "imu.time.offset_s" in told.advice and "gnss.range_rate_lag_s" in told.advice
        assert "carrier phases" in told.advice, "what would decide"
