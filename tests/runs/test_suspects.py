"""Faults that no gate sees: the events name the suspect, the filter that knew of it goes on, and no sigma lies.

The flight is the sample flight from 260 s on, eleven satellites at most, with one fault at 500 s.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import insgnss
from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.constants import C_MPS, NS_PER_S
from insgnss.filter.diagnosis.health import FilterHealth, Remedy
from insgnss.filter.state import Bank
from insgnss.log.flight import Flight, FlightInMemory, FlightLogs
from insgnss.runs.engine import Engine
from insgnss.runs.result import Run
from insgnss.runs.setup import setup_filter
from insgnss.tables import Event, Float64, GnssTable, ImuTable
from insgnss.units import MPS2_PER_MG, deg_per_h_to_radps
from tests.benchmarks.trust.flying import drawn
from tests.benchmarks.trust.rows import Row
from tests.filter.test_engine import assert_same_bits, beginning, no_delay, shortened, stream
from tests.runs.scenes import START_NS, flight, true_start, turns

SAMPLE = Path(__file__).resolve().parents[2] / "data" / "sample_flight" / "flight.toml"
START_S = 293_700.0
BEGIN_S = 260.0  # the filter starts in motion; four minutes show what it has to know of its sensors
FAULT_S = 500.0
END_S = 590.0
L1_M = C_MPS / 1_575.42e6
POSITION = ("n_m", "e_m", "d_m")
VELOCITY = ("vn_mps", "ve_mps", "vd_mps")
ATTITUDE = ("roll_deg", "pitch_deg", "yaw_deg")


@cache
def sample() -> tuple[Flight, FlightLogs]:
    """Return the sample flight and the part of its logs that the tests need."""
    flight = Flight.load(SAMPLE)
    logs = flight.read()
    begin_ns, end_ns = (int(START_NS + at_s * NS_PER_S) for at_s in (BEGIN_S, END_S))
    keep = (logs.imu.t_ns > begin_ns) & (logs.imu.t_ns <= end_ns)
    rows = np.flatnonzero((logs.gnss.t_ns > begin_ns) & (logs.gnss.t_ns <= end_ns))
    imu = ImuTable(logs.imu.t_ns[keep], logs.imu.w_ib_b[keep], logs.imu.f_b[keep])
    return flight, replace(logs, imu=imu, gnss=logs.gnss.take(rows))


def seconds(t_ns: np.ndarray) -> Float64:
    """Return times since the start of the flight [s]."""
    return np.asarray((t_ns - START_NS) / NS_PER_S)


def with_logs(*, imu: ImuTable | None = None, gnss: GnssTable | None = None) -> FlightInMemory:
    """Return the sample flight with a log replaced."""
    flight, logs = sample()
    logs = replace(logs, imu=imu or logs.imu, gnss=gnss or logs.gnss)
    return FlightInMemory(flight.path, flight.config, flight.imu_grade, flight.oscillator, logs)


def with_bias(sensor: str, axis: int, size: float) -> FlightInMemory:
    """Return the flight with a bias of one axis of a sensor that jumps."""
    _, logs = sample()
    values = getattr(logs.imu, sensor).copy()
    values[seconds(logs.imu.t_ns) > FAULT_S, axis] += size
    return with_logs(imu=replace(logs.imu, **{sensor: values}))


def with_rows(
    change: Callable[[GnssTable, np.ndarray], None], sv: tuple[str, ...] = (), to_s: float = FAULT_S + 60.0
) -> FlightInMemory:
    """Return the flight with some of its GNSS rows changed in place, of some satellites or of all."""
    _, logs = sample()
    gnss = logs.gnss
    gnss = replace(gnss, pseudorange_m=gnss.pseudorange_m.copy(), doppler_hz=gnss.doppler_hz.copy())
    t = seconds(gnss.t_ns)
    rows = (t > FAULT_S) & (t <= to_s)
    if sv:
        rows &= np.isin(np.array(gnss.sv_names)[gnss.sv], sv)
    change(gnss, np.flatnonzero(rows))
    return with_logs(gnss=gnss)


def with_ramp(sv: tuple[str, ...], rate_mps: float) -> FlightInMemory:
    """Return the flight with satellites whose code and Doppler run away together."""

    def change(gnss: GnssTable, rows: np.ndarray) -> None:
        gnss.pseudorange_m[rows] += rate_mps * (seconds(gnss.t_ns[rows]) - FAULT_S)
        gnss.doppler_hz[rows] -= rate_mps / L1_M

    return with_rows(change, sv, END_S)


def told(run: Run, kind: str) -> list[str]:
    """Return the details of the events of a kind, in the order of time."""
    return list(run.events.loc[run.events["kind"] == kind, "detail"])


def when(run: Run, kind: str) -> Float64:
    """Return when events of a kind were told, seconds since the fault."""
    return (run.events.loc[run.events["kind"] == kind, "time_s"] - START_S - FAULT_S).to_numpy()


def sigmas(run: Run, from_s: float, *groups: tuple[str, ...], to_s: float = END_S) -> float:
    """Return the largest error over its sigma between two times."""
    assert run.errors is not None
    table = run.errors[run.errors["time_s"].between(START_S + from_s + 1e-6, START_S + to_s)]
    names = [name for group in groups for name in group]
    return float(max((table[f"d_{name}"].abs() / table[f"sd_{name}"]).max() for name in names))


def position_m(run: Run, from_s: float) -> float:
    """Return the largest error of the position from a time on."""
    assert run.errors is not None
    table = run.errors[run.errors["time_s"] > START_S + from_s]
    return float(np.linalg.norm(table[[f"d_{name}" for name in POSITION]], axis=1).max())


def test_flight_without_fault_has_no_suspect() -> None:
    run = insgnss.replay(with_logs())
    assert set(run.events["kind"]) == {"start", "heading_single", "heading_known"}


# ------------------------------------------------------------------------------------------------ inertial sensors


@pytest.mark.parametrize(("axis", "name"), list(enumerate("xyz")))
def test_accelerometer_whose_bias_jumps_by_5_mg_is_named_and_learnt_anew(axis: int, name: str) -> None:
    run = insgnss.replay(with_bias("f_b", axis, 5.0 * MPS2_PER_MG))
    assert f"accelerometer {name}:" in told(run, "sensor_suspect")[-1]
    assert when(run, "sensor_suspect")[0] < 30.0
    assert sigmas(run, FAULT_S + 30.0, POSITION, VELOCITY, ATTITUDE) < 5.0


@pytest.mark.parametrize(("axis", "name", "found_s"), [(0, "x", 40.0), (1, "y", 40.0), (2, "z", 60.0)])
def test_gyro_whose_bias_jumps_by_36_deg_per_h_is_named_and_learnt_anew(
    axis: int, name: str, found_s: float
) -> None:
    """A tilt shows with the square of time, a heading in the next turn: position and velocity are right throughout."""
    run = insgnss.replay(with_bias("w_ib_b", axis, np.radians(36.0 / 3600.0)))
    assert f"gyro {name}:" in told(run, "sensor_suspect")[-1]
    assert when(run, "sensor_suspect")[0] < found_s
    assert sigmas(run, FAULT_S + 30.0, POSITION, VELOCITY) < 5.0
    assert sigmas(run, FAULT_S + found_s, ATTITUDE) < 5.0


@pytest.mark.parametrize(
    ("sensor", "axis", "size", "name"),
    [
        ("w_ib_b", 0, np.radians(0.15), "gyro x"),
        ("w_ib_b", 2, np.radians(0.1), "gyro z"),
        ("w_ib_b", 1, np.radians(2.0), "gyro y"),
        ("f_b", 0, -80.0 * MPS2_PER_MG, "accelerometer x"),
        ("f_b", 2, 120.0 * MPS2_PER_MG, "accelerometer z"),
    ],
)
def test_sensor_that_fails_by_more_than_its_grade_foresees_is_named_and_no_satellite_blamed(
    sensor: str, axis: int, size: float, name: str
) -> None:
    """By a hundred to two thousand sigmas of its bias: until it is found no sigma can be right, then all are."""
    run = insgnss.replay(with_bias(sensor, axis, size))
    assert name in told(run, "sensor_suspect")[-1]
    assert when(run, "sensor_suspect")[0] < 20.0
    assert not {"reset", "restart", "clock_jump"} & set(run.events["kind"])
    assert sigmas(run, FAULT_S + 25.0, POSITION, VELOCITY, ATTITUDE) < 5.0


# ------------------------------------------------------------------------------------------------ kinds, satellites


def frozen(gnss: GnssTable, rows: np.ndarray) -> None:
    """Let every satellite's Doppler stay as it is."""
    for sv in np.unique(gnss.sv[rows]):
        mine = rows[gnss.sv[rows] == sv]
        gnss.doppler_hz[mine] = gnss.doppler_hz[mine[0]]


def reversed_sign(gnss: GnssTable, rows: np.ndarray) -> None:
    """Turn the sign of every Doppler round."""
    gnss.doppler_hz[rows] *= -1.0


def held_with_noise(gnss: GnssTable, rows: np.ndarray) -> None:
    """Let every satellite's Doppler stay as it is but for some noise."""
    frozen(gnss, rows)
    gnss.doppler_hz[rows] += 0.02 / L1_M * np.random.default_rng(5).normal(size=len(rows))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (frozen, "repeats the range rates"),
        (reversed_sign, "range rates contradict the pseudoranges"),
        (held_with_noise, "range rates of all satellites contradict the pseudoranges"),
    ],
)
def test_doppler_that_contradicts_all_else_is_refused(
    change: Callable[[GnssTable, np.ndarray], None], words: str
) -> None:
    run = insgnss.replay(with_rows(change))
    assert any(words in detail for detail in told(run, "kind_refused"))
    assert position_m(run, FAULT_S) < 10.0
    if change is not held_with_noise:  # found after some seconds, and undone
        assert sigmas(run, FAULT_S, POSITION, VELOCITY, ATTITUDE) < 5.0


@pytest.mark.parametrize(
    ("sv", "rate_mps"), [(("G13",), 0.3), (("G13",), 1.0), (("G23",), -0.3), (("G04", "G13"), 0.5)]
)
def test_satellites_whose_code_and_doppler_run_away_are_found(sv: tuple[str, ...], rate_mps: float) -> None:
    run = insgnss.replay(with_ramp(sv, rate_mps))
    rows = run.measurements
    t = rows["time_s"] - START_S
    late = rows[(t > FAULT_S + 60.0) & (t <= END_S)]
    for name in sv:
        used = late[(late["sv"] == name) & (late["status"] == "used")]
        assert len(used) <= 0.1 * np.sum(late["sv"] == name), name
    assert "sensor_suspect" not in set(run.events["kind"])
    assert sigmas(run, FAULT_S + 60.0, POSITION, VELOCITY, ATTITUDE) < 5.0


def test_three_satellites_that_run_away_leave_the_heading_as_it_is() -> None:
    run = insgnss.replay(with_ramp(("G02", "G04", "G13"), 1.0))
    assert not {"reset", "restart"} & set(run.events["kind"])
    assert sigmas(run, FAULT_S, ("yaw_deg",)) < 10.0


def test_four_pseudoranges_of_eleven_that_jump_stay_out() -> None:
    def change(gnss: GnssTable, rows: np.ndarray) -> None:
        gnss.pseudorange_m[rows] += 50.0

    run = insgnss.replay(with_rows(change, ("G01", "G02", "G04", "G10")))
    assert not {"reset", "restart"} & set(run.events["kind"])
    assert sigmas(run, FAULT_S, POSITION, VELOCITY, ATTITUDE) < 5.0


@pytest.mark.parametrize("times", [3.0, 20.0])
def test_noise_that_rises_at_a_stroke_is_noise(times: float) -> None:
    """Its first second is told by nobody; from then on the levels have risen."""
    rng = np.random.default_rng(7)

    def change(gnss: GnssTable, rows: np.ndarray) -> None:
        gnss.pseudorange_m[rows] += times * 2.0 * rng.normal(size=len(rows))
        gnss.doppler_hz[rows] += times * 0.07 / L1_M * rng.normal(size=len(rows))

    run = insgnss.replay(with_rows(change))
    assert not {"reset", "restart", "sensor_suspect", "satellite_suspect"} & set(run.events["kind"])
    assert sigmas(run, FAULT_S, POSITION, VELOCITY, ATTITUDE) < 5.0


# ------------------------------------------------------------------------------------------------ time tags, the end


def test_inertial_tags_that_are_declared_exact_and_50_ms_late_are_told() -> None:
    _, logs = sample()
    late = with_logs(imu=ImuTable(logs.imu.t_ns + 50_000_000, logs.imu.w_ib_b, logs.imu.f_b))
    short = replace(late, logs=shortened(late.logs, 300.0))
    run = insgnss.replay(short, settings={"process.imu_time_sigma_s": 0.0})
    assert "inertial time tags" in told(run, "time_tag_suspect")[0]
    detail = told(run, "time_tag_suspect")[0]
    late_s, along_m = map(
        float, re.findall(r"about ([\d.]+) s late, or the GNSS.*error of ([\d.]+) m", detail)[0]
    )
    assert 0.02 < late_s < 0.15
    at_s = run.events.loc[run.events["kind"] == "time_tag_suspect", "time_s"].iloc[0]
    v = run.nav.loc[(run.nav["time_s"] - at_s).abs().idxmin(), ["vn_mps", "ve_mps", "vd_mps"]]
    assert along_m == pytest.approx(late_s * float(np.linalg.norm(v.to_numpy(float))), rel=0.2)
    assert "sensor_suspect" not in set(run.events["kind"])


@cache
def late_epochs() -> Run:
    """Return a run with GNSS tags that are 50 ms late for twenty seconds, ten seconds before its end."""
    _, logs = sample()
    t = seconds(logs.gnss.t_ns)
    late = 50_000_000 * ((t > FAULT_S) & (t <= FAULT_S + 20.0))
    flight = with_logs(gnss=replace(logs.gnss, t_ns=logs.gnss.t_ns + late))
    return insgnss.replay(beginning(flight, FAULT_S + 30.0 - BEGIN_S))


def test_gnss_tags_that_are_50_ms_late_are_told_at_once() -> None:
    assert "GNSS time tags" in told(late_epochs(), "time_tag_jump")[0]
    assert when(late_epochs(), "time_tag_jump")[0] == pytest.approx(0.5, abs=3.0)


def test_gnss_tags_that_are_50_ms_late_have_honest_sigmas() -> None:
    assert sigmas(late_epochs(), FAULT_S, POSITION) < 5.0


def ended() -> GnssTable:
    """Return the GNSS log up to the fault."""
    _, logs = sample()
    return logs.gnss.take(np.flatnonzero(seconds(logs.gnss.t_ns) <= FAULT_S))


def test_end_of_gnss_is_told_in_replay() -> None:
    run = insgnss.replay(with_logs(gnss=ended()))
    assert when(run, "no_measurements") == pytest.approx([0.0], abs=1.0)


def test_end_of_gnss_is_told_by_the_engine_after_ten_seconds() -> None:
    flight = with_logs(gnss=ended())
    logs = flight.logs
    setup = setup_filter(flight, logs, filter_config("tight17"))
    engine = Engine(setup)
    first = np.searchsorted(seconds(logs.imu.t_ns), FAULT_S - 100.0)
    last = np.searchsorted(seconds(logs.imu.t_ns), FAULT_S + 12.0)
    rows = seconds(logs.gnss.t_ns) > FAULT_S - 100.0
    engine.gnss(logs.gnss.take(np.flatnonzero(rows)))
    told_s = np.inf
    for k in range(int(first), int(last)):
        engine.imu(int(logs.imu.t_ns[k]), logs.imu.w_ib_b[k], logs.imu.f_b[k])
        if any(event.kind == "no_measurements" for event in engine.events[-1:]):
            told_s = min(told_s, float(seconds(logs.imu.t_ns[k : k + 1])[0]) - FAULT_S)
    assert 10.0 < told_s < 11.5
    assert [event.kind for event in engine.events].count("no_measurements") == 1


class Watched(Engine):
    """An engine that notes whether it was ever unclear what has failed."""

    unclear = False

    def gnss(self, epoch: GnssTable, antenna: str | None = None) -> None:
        super().gnss(epoch, antenna)
        self.unclear = self.unclear or self._navigator.health.past.unclear_ns != 0


def test_engine_gives_the_bits_of_replay_while_it_is_not_clear_what_has_failed() -> None:
    flight = with_bias("w_ib_b", 1, deg_per_h_to_radps(36.0))
    logs = flight.logs
    keep = np.abs(seconds(logs.imu.t_ns) - FAULT_S + 45.0) < 105.0
    imu = ImuTable(logs.imu.t_ns[keep], logs.imu.w_ib_b[keep], logs.imu.f_b[keep])
    rows = np.abs(seconds(logs.gnss.t_ns) - FAULT_S + 45.0) < 105.0
    logs = replace(logs, imu=imu, gnss=logs.gnss.take(np.flatnonzero(rows)))
    flown = FlightInMemory(flight.path, flight.config, flight.imu_grade, flight.oscillator, logs)
    engine = Watched(setup_filter(flown, logs, filter_config("tight17")))
    stream(engine, logs, no_delay())
    assert_same_bits(engine.take_results(all_of_them=True), logs, flown)
    assert engine.unclear
    assert "sensor_suspect" in {event.kind for event in engine.events}


# ------------------------------------------------------------------------------------------------ the switch


def without_recovery() -> FilterConfig:
    """Return the filter that is never set right."""
    config = filter_config("tight17")
    return config.model_copy(update={"health": config.health.model_copy(update={"recovery": False})})


def test_recovery_can_be_switched_off() -> None:
    run = insgnss.replay(with_bias("f_b", 2, 5.0 * MPS2_PER_MG), without_recovery())
    assert not {"reset", "restart", "sensor_suspect", "satellite_suspect"} & set(run.events["kind"])


# ------------------------------------------------------------------------------------------------ recovery


def test_fix_that_reflections_agree_on_is_not_taken() -> None:
    """Six of the pseudoranges are for 20 s those of a place 100 m away, the range rates are right: no vehicle jumps."""
    sky = insgnss.replay(with_logs()).satellites
    assert sky is not None
    towards = {
        (round(t, 1), sv): 100.0 * np.cos(np.radians(az)) * np.cos(np.radians(el))
        for t, sv, az, el in zip(sky["time_s"], sky["sv"], sky["az_deg"], sky["el_deg"], strict=True)
    }
    _, logs = sample()
    times = seconds(logs.gnss.t_ns)

    def change(gnss: GnssTable, rows: np.ndarray) -> None:
        names = np.array(gnss.sv_names)[gnss.sv[rows]]
        for row, sv in zip(rows, names, strict=True):
            gnss.pseudorange_m[row] -= towards.get((round(START_S + times[row], 1), str(sv)), 0.0)

    six = ("G01", "G04", "G13", "G20", "G23", "G32")
    run = insgnss.replay(with_rows(change, six, FAULT_S + 20.0))
    assert not {"reset", "restart", "clock_jump"} & set(run.events["kind"])
    assert position_m(run, FAULT_S) < 10.0


@pytest.mark.parametrize(("seed", "fault_mg"), [(63, 100.0), (62, 300.0)])
def test_accelerometer_that_fails_at_once_is_named_in_place_of_a_reset(seed: int, fault_mg: float) -> None:
    """Along the way of a jet, between two epochs: after half a second no row fits any more, and a fix is at hand."""
    _, _, flown = drawn(Row("jet", "jet", "fast_jet", (), "navigation"), seed)
    imu, at_s = flown.logs.imu, 150.81
    imu = replace(imu, f_b=imu.f_b.copy())
    imu.f_b[(imu.t_ns - imu.t_ns[0]) / NS_PER_S > at_s, 0] += fault_mg * MPS2_PER_MG
    seen = shortened(replace(flown.logs, imu=imu), at_s + 40.0)
    run = insgnss.replay(replace(flown, logs=replace(seen, reference=flown.logs.reference)))
    assert run.errors is not None
    since = run.errors["time_s"] - run.errors["time_s"].iloc[0] - at_s
    named = run.events[run.events["kind"] == "sensor_suspect"]
    assert "accelerometer x" in named["detail"].iloc[0] and len(named) == 1
    assert "reset" not in set(run.events["kind"])
    late = run.errors[since > 15.0]
    for name in ATTITUDE:
        assert (late[f"d_{name}"].abs() < 5.0 * late[f"sd_{name}"]).all()


def test_what_a_look_finds_when_a_fix_is_believed_is_told_beside_the_reset(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looks = []

    def look(health: FilterHealth, bank: Bank, imu: object, t_ns: int, parameters: object) -> Remedy:
        looks.append(t_ns)
        return Remedy(bank, [Event(t_ns, "looked", "")])

    monkeypatch.setattr(FilterHealth, "_second_look", look)
    start = true_start(turns(), 2.0)
    off = {"lat_deg": start.lat_deg + 0.001, "sd_position_m": 1.0, "sd_velocity_mps": 0.1}
    wrong = start.model_copy(update=off)
    events = insgnss.replay(flight(turns(), start=wrong)).events
    assert list(events["kind"]).count("reset") == 1
    assert list(events["kind"]).count("looked") == len(looks) > 1
