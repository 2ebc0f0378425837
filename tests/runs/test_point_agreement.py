"""The point solution against two independent programs on real logs, with the same models, weights and rows."""

from __future__ import annotations

import datetime as dt
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import sidereon

from insgnss.config.filter import FilterConfig, NoiseConfig
from insgnss.config.library import filter_config
from insgnss.constants import C_MPS
from insgnss.gnss.point.rows import PointLog, PointRows
from insgnss.gnss.troposphere import standard_atmosphere
from insgnss.gpstime import ns_to_datetime
from insgnss.log.flight import Flight, FlightLogs
from insgnss.runs.point import read_logs, solve_rows
from insgnss.runs.setup import setup_filter
from insgnss.tables import Float64
from tests.conftest import REPOSITORY

pytestmark = pytest.mark.real_data
INSTINCT = "instinct_static_20230629"
REACH_FLIGHT = """\
gps_week = 2268
[imu]
files = ["not opened.csv"]
grade = "tactical_low"
[gnss]
format = "rinex"
files = ["{folder}/reach_m2_static_10min.23O.gz"]
navigation = ["{folder}/nav_reach_m2.rnx"]
"""


class Fact(NamedTuple):
    """One epoch of RTKLIB's solution: time tag of the log, position and velocity ECEF, satellites."""

    t_ns: int
    r_e: tuple[float, float, float]
    v_e: tuple[float, float, float]
    n: int


# rnx2rtkp of RTKLIB EX 2.5.1 (rtklibexplorer, commit 968da9a), reach_m2_static_10min.23O with nav_reach_m2.rnx, GPS L1:
# pos1-posmode single, pos1-frequency l1, pos1-elmask 10, pos1-sateph brdc, pos1-navsys 1, stats-errphase 0,
# stats-errphaseel 0, pos1-ionoopt and pos1-tropopt as named; out-solformat xyz, out-outvel on
WITHOUT_ATMOSPHERE = (  # ionoopt off, tropopt off
    Fact(1372072362094000000, (4157199.7125, 671198.4325, 4774777.5820), (0.10083, 0.03850, 0.05272), 9),
    Fact(1372072372094000000, (4157200.3438, 671198.6285, 4774777.7218), (0.01364, -0.00490, 0.00574), 9),
    Fact(1372072387094000000, (4157200.3646, 671202.6586, 4774773.2719), (0.05781, 0.02510, 0.05139), 9),
    Fact(1372072402094000000, (4157201.4424, 671199.3211, 4774777.8088), (0.06740, 0.00053, 0.03466), 9),
    Fact(1372072422994000000, (4157201.6994, 671196.6690, 4774781.1140), (0.03366, -0.00010, 0.02989), 9),
)
WITH_ATMOSPHERE = (  # ionoopt brdc, tropopt saas, and the default stats-errphase 0.003, stats-errphaseel 0.003
    Fact(1372072362094000000, (4157191.2377, 671197.5312, 4774761.8687), (0.10022, 0.03706, 0.05267), 9),
    Fact(1372072372094000000, (4157191.7919, 671197.6679, 4774761.8644), (0.01303, -0.00636, 0.00570), 9),
    Fact(1372072387094000000, (4157191.0831, 671200.3100, 4774755.4130), (0.05718, 0.02345, 0.05143), 9),
    Fact(1372072402094000000, (4157192.7467, 671198.1768, 4774761.5202), (0.06680, -0.00096, 0.03466), 9),
    Fact(1372072422994000000, (4157193.4910, 671196.4974, 4774766.0218), (0.03308, -0.00146, 0.02985), 9),
)


def settings(
    ionosphere: str, troposphere: str, constellations: tuple[str, ...], mask_deg: float
) -> FilterConfig:
    """Return a filter whose own noise is next to nothing: the sigmas of the log count, weak signals as the others."""
    config = filter_config("tight17")
    weak = {"weak_signal_m_per_db": 0.0, "weak_signal_mps_per_db": 0.0}
    use = config.measurements.model_copy(
        update={
            "constellations": constellations,
            "signals": {"G": ("C1C",), "E": ("C1C", "C1X")},
            "every_band": False,
            "ionosphere": ionosphere,
            "troposphere": troposphere,
            "elevation_mask_deg": mask_deg,
        }
    )
    no_slow_errors = config.slow_errors.model_copy(update={"no_ionosphere_zenith_m": 0.0})
    return config.model_copy(
        update={
            "measurements": use,
            "slow_errors": no_slow_errors,
            "adaptation": config.adaptation.model_copy(update=weak),
            "pseudorange_noise_m": NoiseConfig(floor=1e-3, elevation=0.0, cn0_at_45_dbhz=0.0),
            "range_rate_noise_mps": NoiseConfig(floor=0.2, elevation=0.0, cn0_at_45_dbhz=0.0),
        }
    )


def solved(
    flight: Flight, logs: FlightLogs, config: FilterConfig, sigma_m: Float64 | None
) -> tuple[PointRows, PointLog, Float64]:
    """Return rows, solution and the positions at reception (m, 3): both programs leave them there."""
    logs = replace(logs, gnss=replace(logs.gnss, sigma_pseudorange_m=sigma_m))
    setup = setup_filter(flight, logs, config)
    rows, _, out = solve_rows(setup, setup.rows(logs.gnss, setup.navigation))
    return rows, out, out.r_e - out.v_e * out.clock_m[:, :1] / C_MPS


# ---------------------------------------------------------------------------------------------------------- RTKLIB


@pytest.fixture(scope="module")
def reach(data_root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Flight, FlightLogs]:
    path = tmp_path_factory.mktemp("reach") / "flight.toml"
    path.write_text(REACH_FLIGHT.format(folder=(data_root / INSTINCT).as_posix()), encoding="utf-8")
    flight = Flight.load(path)
    return flight, read_logs(flight)


def rtklib_sigma(logs: FlightLogs) -> Float64:
    """Return RTKLIB's sigma of each row without atmosphere: URA, 0.3 m of code bias, 5 m ionosphere, 3 m troposphere.

    It takes the upper end of a URA's interval: 2.4 m for an index of 0 (2.0 m in the file), 3.4 m for 1 (2.8 m).
    """
    assert logs.navigation is not None
    table = logs.navigation.ephemerides
    ura = {
        name: 2.4 if metres < 2.4 else 3.4
        for name, metres in zip(table.sv_names, table.accuracy_m, strict=True)
        if name[0] == "G"
    }
    variance = np.array([ura.get(name, 2.4) ** 2 + 0.3**2 + 5.0**2 + 3.0**2 for name in logs.gnss.sv_names])
    return np.asarray(np.sqrt(variance)[logs.gnss.sv])


def test_position_with_the_same_weights_is_that_of_rtklib_to_a_millimetre(
    reach: tuple[Flight, FlightLogs],
) -> None:
    """Orbit, clock, group delay, light time and Earth's turn; the largest difference of all 610 epochs is 0.8 mm."""
    flight, logs = reach
    rows, out, r_e = solved(flight, logs, settings("none", "none", ("G",), 10.0), rtklib_sigma(logs))
    for fact in WITHOUT_ATMOSPHERE:
        e = int(np.flatnonzero(rows.epoch_ns == fact.t_ns)[0])
        assert out.n_used[e, 0] == fact.n
        np.testing.assert_allclose(r_e[e], fact.r_e, rtol=0, atol=2e-3)
        # it leaves out the Doppler factor 1 + u.v_s / c: 800 m/s times 2.6e-6
        np.testing.assert_allclose(out.v_e[e], fact.v_e, rtol=0, atol=3e-3)


def test_position_with_atmosphere_and_own_weights_is_near_that_of_rtklib(
    reach: tuple[Flight, FlightLogs],
) -> None:
    """Klobuchar's delays are the same to a millimetre in the position; the others differ by what they are.

    Troposphere: 1 / sin(elevation) there, a mapping function and another humidity here: 8 cm north, 16 cm in height.
    Weights: there half of the ionosphere's delay and the URA count, here elevation and C/N0: the code noise of single
    satellites, metres on this antenna, enters with other factors. Weak signals count as the others do, as there.
    """
    flight, logs = reach
    config = settings("klobuchar", "saastamoinen", ("G",), 10.0)
    config = config.model_copy(update={"pseudorange_noise_m": filter_config("tight17").pseudorange_noise_m})
    rows, out, r_e = solved(flight, logs, config, None)
    apart = []
    for fact in WITH_ATMOSPHERE:
        e = int(np.flatnonzero(rows.epoch_ns == fact.t_ns)[0])
        apart.append(np.linalg.norm(r_e[e] - fact.r_e))
        assert 0.01 < apart[-1] < 4.0 * np.sqrt(np.trace(out.P[e, :3, :3]))
    assert np.median(apart) < 3.0


# -------------------------------------------------------------------------------------------------------- sidereon


def oracle(
    logs: FlightLogs,
    navigation: sidereon.BroadcastEphemeris,
    rows: PointRows,
    out: PointLog,
    epoch: int,
    corrections: tuple[bool, bool],
) -> sidereon.SppSolution:
    """Return sidereon's solution of the pseudoranges that ours used in an epoch."""
    at = np.arange(rows.first[epoch], rows.first[epoch + 1])
    at = at[out.status[at, 0] == 0]
    names = [logs.gnss.sv_names[k] for k in logs.gnss.sv[at]]
    seen = [sidereon.SppObservation(n, float(v)) for n, v in zip(names, rows.value[at, 0], strict=True)]
    when = ns_to_datetime(int(rows.epoch_ns[epoch]))
    midnight = when.replace(hour=0, minute=0, second=0, microsecond=0)
    pressure, temperature, vapour = standard_atmosphere(377.0)  # at the antenna
    saturation = 6.108 * np.exp((17.15 * temperature - 4684.0) / (temperature - 38.45))
    assert logs.navigation is not None and logs.navigation.klobuchar is not None
    alpha_beta = logs.navigation.klobuchar.tolist()
    return sidereon.solve_broadcast(
        navigation,
        sidereon.SppConfig(
            seen,
            (when - dt.datetime(2000, 1, 1, 12, tzinfo=when.tzinfo)).total_seconds(),
            (when - midnight).total_seconds(),
            float(when.timetuple().tm_yday),
            [*out.r_e[epoch].tolist(), 0.0],
            sidereon.SppCorrections(*corrections),
            sidereon.SppKlobucharCoeffs(alpha_beta[:4], alpha_beta[4:]),
            met=sidereon.SppSurfaceMet(pressure, temperature, vapour / saturation),
            troposphere_model=sidereon.TroposphereModel.SAASTAMOINEN_NIELL,
        ),
    )


@pytest.mark.parametrize("constellations", [("G",), ("G", "E")])
@pytest.mark.parametrize(
    ("ionosphere", "troposphere", "limit_m"),
    [
        ("none", "none", 5e-4),
        ("klobuchar", "none", 5e-4),
        # its zenith delays differ by the form of the wet part: 2 cm at the zenith, three times that in the height
        ("klobuchar", "saastamoinen", 0.08),
    ],
)
def test_position_is_that_of_sidereon_with_the_same_weights(
    data_root: Path, constellations: tuple[str, ...], ionosphere: str, troposphere: str, limit_m: float
) -> None:
    flight = Flight.load(REPOSITORY / "tests" / "flights" / "instinct.toml")
    if not flight.config.gnss.files[0].is_file():
        pytest.skip("the flight files look beside the checkout")
    logs = read_logs(flight)
    navigation = sidereon.load_rinex_nav(str(data_root / INSTINCT / "nav_reach_m2.rnx"))
    config = settings(ionosphere, troposphere, constellations, 10.0)
    equal = np.full(len(logs.gnss.t_ns), 5.0)
    rows, out, _ = solved(flight, logs, config, equal)
    epochs = range(0, len(rows.epoch_ns), 15)
    theirs, sigma = {}, equal.copy()
    for e in epochs:
        theirs[e] = oracle(logs, navigation, rows, out, e, (ionosphere != "none", troposphere != "none"))
        variance = dict(zip(theirs[e].used_sats, theirs[e].pseudorange_variances_m2, strict=True))
        for i in range(rows.first[e], rows.first[e + 1]):
            sigma[i] = np.sqrt(variance.get(logs.gnss.sv_names[logs.gnss.sv[i]], 25.0))
    rows, out, r_e = solved(flight, logs, config, sigma)
    apart = [float(np.linalg.norm(r_e[e] - theirs[e].position)) for e in epochs]
    assert max(apart) < limit_m
    assert [int(out.n_used[e, 0]) for e in epochs] == [len(theirs[e].used_sats) for e in epochs]
