"""Simulated flights of a vehicle with several antennas, as folders of files, and what goes wrong with their logs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

import insgnss
from insgnss.runs.result import Run
from insgnss.runs.simulate import Simulation, simulate
from insgnss.simulation.simulated_log import SimulatedLog
from insgnss.tables import GnssTable

TRIANGLE = (("ahead", (1.4, 0.1, -1.3)), ("right", (0.9, 0.966025, -1.3)))
PLACE = "place = { lat_deg = 59.97, lon_deg = 30.37, h_m = 40.0, heading_deg = 127.0 }"
AT_REST = '[[manoeuvre]]\nkind = "straight"\nduration_s = {duration}\n'
SLALOM = """[[manoeuvre]]
kind = "straight"
duration_s = 10.0
[[manoeuvre]]
kind = "turn"
by_deg = 120.0
bank_deg = 30.0
[[manoeuvre]]
kind = "turn"
by_deg = -90.0
bank_deg = 25.0
[[manoeuvre]]
kind = "straight"
duration_s = 10.0
"""

Change = Callable[[SimulatedLog], SimulatedLog]


def scenario_text(
    antennas: tuple[tuple[str, tuple[float, float, float]], ...] = TRIANGLE,
    *,
    clocks: str = "common",
    manoeuvres: str = AT_REST.format(duration=30.0),
    speed_mps: float = 0.0,
    rate_hz: float = 1.0,
    further: str = "",
    clock_bias_m: float = 0.0,
) -> str:
    """Return a scenario file; ``further`` are lines of every further antenna."""
    tables = "".join(
        f'[[attitude.antenna]]\nname = "{name}"\nlever_arm_m = {list(lever)}\n'
        f"clock_bias_m = {clock_bias_m * number}\n{further}\n"
        for number, (name, lever) in enumerate(antennas, 1)
    )
    return f"""\
name = "several antennas"
gps_week = 2385
start_s = 150000.0
speed_mps = {speed_mps}
{PLACE}
{manoeuvres}
[imu]
grade = "industrial"
[gnss]
rate_hz = {rate_hz}
lever_arm_m = [0.4, 0.1, -1.3]
carrier_noise_m = {{ floor = 0.0, cn0_at_45_dbhz = 0.0014 }}
[attitude]
clocks = "{clocks}"
{tables}"""


def write_flight(
    folder: Path, scenario: str, *, seed: int = 1, change: Change | None = None, keys: str = ""
) -> Path:
    """Write a drawn flight and return its flight file; its phase noise is the simulation's, without reflections."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scenario.toml").write_text(scenario, encoding="utf-8")
    drawn: Simulation = simulate(folder / "scenario.toml", seed)
    drawn = drawn if change is None else replace(drawn, log=change(drawn.log))
    drawn.save(folder / "logs")
    path = folder / "logs" / "flight.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("[attitude]\n", f"[attitude]\n{keys}"), encoding="utf-8")
    return path


def fly(folder: Path, scenario: str, *, seed: int = 1, change: Change | None = None, keys: str = "") -> Run:
    """Return the replay of a drawn flight."""
    return insgnss.replay(write_flight(folder, scenario, seed=seed, change=change, keys=keys))


def normalised(run: Run, from_s: float = 0.0) -> np.ndarray:
    """Return error over sigma of roll, pitch and yaw, (rows, 3), from a time on."""
    assert run.errors is not None
    table = run.errors[run.errors["time_s"] >= from_s]
    angles = ("roll_deg", "pitch_deg", "yaw_deg")
    return np.column_stack([table[f"d_{name}"] / table[f"sd_{name}"] for name in angles])


def with_cycles(antenna: int, sv: str, from_s: float, cycles: float, *, flagged: bool = False) -> Change:
    """Return a change that adds whole cycles to a further antenna's phase of a satellite from a time of the log on."""

    def change(log: SimulatedLog) -> SimulatedLog:
        table = log.further[antenna]
        own = (table.sv == table.sv_names.index(sv)) & (table.t_ns - table.t_ns[0] >= from_s * 1e9)
        assert table.carrier_cycles is not None
        assert table.lli is not None
        lli = table.lli.copy()
        if flagged:
            lli[np.flatnonzero(own)[0]] = 1
        slipped = replace(table, carrier_cycles=table.carrier_cycles + cycles * own, lli=lli)
        return with_further(log, antenna, slipped)

    return change


def with_further(log: SimulatedLog, antenna: int, table: GnssTable) -> SimulatedLog:
    """Return a log with another table of one further antenna."""
    tables = list(log.further)
    tables[antenna] = table
    return replace(log, further=tuple(tables))


def events(run: Run, kind: str) -> list[str]:
    """Return the details of all events of a kind."""
    return run.events.loc[run.events["kind"] == kind, "detail"].tolist()
