"""Navigation files written and read back: every number to the last digit that the file has for it."""

from __future__ import annotations

import dataclasses
import datetime as dt
from pathlib import Path

import numpy as np
import pytest

from insgnss.log.rinex.nav_writer import write_rinex_navigation
from insgnss.log.rinex.navigation import read_navigation
from insgnss.tables import EphemerisTable, NavigationData, StateVectorTable

CREATED = dt.datetime(2025, 8, 28)
WEEK_NS = 604_800 * 10**9
START_NS = 2381 * WEEK_NS
ROWS = [
    *[("C03", "D2", 14), ("C20", "D1", 14), ("E11", "FNAV", 0), ("E11", "INAV", 0), ("G05", "LNAV", 0)],
    *[("I02", "LNAV", 0), ("J03", "LNAV", 0)],
]
EXACT = ("sv_names", "message", "toe_ns", "toc_ns", "toe_sow_s", "group_delay_s")


def digits(values: np.ndarray, places: int = 12) -> np.ndarray:
    return np.vectorize(lambda value: float(f"{value:.{places}E}"), otypes=[float])(values)


def messages() -> EphemerisTable:
    rng = np.random.default_rng(3)
    n = len(ROWS)
    names = [f.name for f in dataclasses.fields(EphemerisTable) if f.name not in EXACT]
    columns = {name: rng.uniform(-1.0, 1.0, n) * 10.0 ** rng.integers(-9, 3, n) for name in names}
    columns |= {"e": rng.uniform(0.0, 0.02, n), "sqrt_a": rng.uniform(5100.0, 6500.0, n)}
    columns |= {"i0": rng.uniform(0.9, 1.0, n), "health": np.zeros(n), "issue": np.arange(1.0, n + 1.0)}
    columns |= {"accuracy_m": np.array([2.0, 2.8, 3.12, np.nan, 2.0, 4.0, 2.8])}
    columns |= {"fit_interval_s": np.array([np.nan] * 4 + [14400.0, np.nan, np.nan])}
    toe_s = np.array([0.0, 604_800.0 - 300.0, 600.0, 1200.0, 7200.0, 302_400.0, 3600.0])
    shift = np.array([row[2] for row in ROWS])
    delays = rng.uniform(-1e-8, 1e-8, (n, 2))
    delays[[4, 5, 6], 1] = 0.0
    return EphemerisTable(
        sv_names=tuple(row[0] for row in ROWS),
        message=tuple(row[1] for row in ROWS),
        toe_ns=START_NS + ((toe_s + shift) * 1e9).astype(np.int64),
        toc_ns=START_NS + ((toe_s + shift) * 1e9).astype(np.int64),
        toe_sow_s=toe_s,
        group_delay_s=delays,
        **columns,
    )


def states() -> StateVectorTable:
    rng = np.random.default_rng(4)
    return StateVectorTable(
        sv_names=("R07", "R20"),
        t_ns=START_NS + np.array([900 + 18, 86_400 - 900 + 18]) * 10**9,
        r_e=rng.uniform(-2.5e7, 2.5e7, (2, 3)),
        v_e=rng.uniform(-3e3, 3e3, (2, 3)),
        a_e=rng.uniform(-3e-6, 3e-6, (2, 3)),
        clock_s=np.array([-1.3e-4, 2.0**-20]),
        clock_rate=np.array([1e-12, -(2.0**-40)]),
        group_delay_s=np.array([2.0**-28, -5.5e-9]),
        health=np.array([0.0, 0.0]),
        channel=np.array([-7, 6], np.int16),
    )


def test_every_field_of_every_system_comes_back_to_the_last_digit(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    ionosphere = {"beidou": rng.uniform(-1e5, 1e5, 8), "qzss": rng.uniform(-1.0, 1.0, 8)}
    ionosphere |= {"navic": rng.uniform(-1e-8, 1e-8, 8), "galileo": np.array([40.25, 0.125, -0.001])}
    sent = NavigationData(messages(), rng.uniform(-1e5, 1e5, 8), 18, states(), ionosphere)
    assert write_rinex_navigation(tmp_path / "nav.rnx", sent, CREATED) == 9
    found, events = read_navigation([tmp_path / "nav.rnx"])
    assert events == []
    for f in dataclasses.fields(EphemerisTable):
        expected, back = getattr(sent.ephemerides, f.name), getattr(found.ephemerides, f.name)
        if f.name in ("sv_names", "message"):
            assert back == expected
        elif f.name in ("toe_ns", "toc_ns"):
            assert back.tolist() == expected.tolist()
        elif f.name == "accuracy_m":
            assert np.array_equal(np.delete(back, 3), digits(np.delete(expected, 3)))
            assert np.isnan(back[3]) or back[3] < 0.0  # Galileo: no accuracy predicted
        elif f.name == "group_delay_s":
            # the reader gives NavIC's delay for L5 instead of the one broadcast
            others = [k for k, name in enumerate(found.ephemerides.sv_names) if name[0] != "I"]
            assert np.array_equal(back[others], digits(expected)[others])
        elif f.name == "fit_interval_s":
            assert back[4] == 14400.0
        else:
            assert np.array_equal(back, digits(expected), equal_nan=True), f.name
    assert found.state_vectors is not None
    for f in dataclasses.fields(StateVectorTable):
        expected, back = getattr(sent.state_vectors, f.name), getattr(found.state_vectors, f.name)
        if f.name in ("sv_names", "t_ns", "channel"):
            assert list(back) == list(expected)
        else:
            # kilometres in the file: one rounding more on each way
            tolerance = 2e-16 if f.name in ("r_e", "v_e", "a_e") else 0.0
            scale = 1000.0 if tolerance else 1.0
            assert np.allclose(back, digits(expected / scale) * scale, rtol=tolerance, atol=0.0), f.name
    assert found.klobuchar is not None and sent.klobuchar is not None
    assert np.array_equal(found.klobuchar, digits(sent.klobuchar, 4)) and found.leap_seconds == 18
    assert found.ionosphere.keys() == ionosphere.keys()
    assert all(np.array_equal(found.ionosphere[name], digits(ionosphere[name], 4)) for name in ionosphere)


def test_unhealthy_glonass_and_unknown_channel_stay_so(tmp_path: Path) -> None:
    sent = dataclasses.replace(states(), health=np.array([1.0, 2.0]), channel=np.array([-128, 3], np.int16))
    write_rinex_navigation(tmp_path / "nav.rnx", NavigationData(messages(), None, 18, sent), CREATED)
    found = read_navigation([tmp_path / "nav.rnx"])[0].state_vectors
    assert found is not None and (found.health != 0).all() and found.channel.tolist() == [-128, 3]


@pytest.mark.real_data
@pytest.mark.parametrize(
    "name",
    [
        "instinct_static_20230629/nav_reach_m2.rnx",
        "walk_boulder_20250828/nav_decoded_from_ubx.rnx",
        "xian_psins_20211108/nav_from_mat.rnx",
    ],
)
def test_real_navigation_written_again_is_the_same(data_root: Path, tmp_path: Path, name: str) -> None:
    first, _ = read_navigation([data_root / name])
    write_rinex_navigation(tmp_path / "nav.rnx", first, CREATED)
    second, _ = read_navigation([tmp_path / "nav.rnx"])
    for f in dataclasses.fields(EphemerisTable):
        a, b = getattr(first.ephemerides, f.name), getattr(second.ephemerides, f.name)
        if f.name in ("sv_names", "message"):
            assert a == b
        elif f.name != "fit_interval_s":
            assert np.array_equal(a, b, equal_nan=True), f.name
