"""The picture of the README: the sample flight under a patch antenna, with the search supervisor.

``python -m tests.benchmarks.picture [FILE]`` replays the flight and draws it anew; by default into
``data/sample_flight/picture.png``.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pymap3d
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

import insgnss
from insgnss.config.flight import MountedAntenna
from insgnss.runs.result import Run

SAMPLE = Path(__file__).resolve().parents[2] / "data" / "sample_flight"
BLUE, RED, GREEN, AMBER, GREY = "#0072b2", "#d55e00", "#009e73", "#e69f00", "#8c8c8c"
STATES = {"track": GREEN, "hold": AMBER, "search": RED, "control_detection": RED, "lost": GREY}
STYLE = {"font.size": 8.5, "axes.spines.top": False, "axes.spines.right": False, "axes.titlelocation": "left"}


def flown() -> Run:
    """Return the sample flight's run, with an antenna on the roof and the supervisor."""
    flight = insgnss.Flight.load(SAMPLE / "flight.toml")
    gnss = flight.config.gnss.model_copy(update={"antenna": (MountedAntenna(pattern="patch_l1"),)})
    whole = replace(flight, config=flight.config.model_copy(update={"gnss": gnss}))
    return insgnss.replay(whole, supervise=True)


def picture(run: Run) -> Figure:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 5.2), layout="constrained")
        left, right = figure.subfigures(1, 2, width_ratios=(1.0, 1.25))
        upper, lower = left.subplots(2, 1, height_ratios=(1.25, 1.0))
        horizontal, yaw, sky = right.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.0, 1.5))
        track(upper, run)
        innovations(lower, run)
        error(horizontal, run, "n_m", "north, m", 1.6, "Position and heading: error and three sigma")
        error(yaw, run, "yaw_deg", "heading, deg", 0.28, "")
        states(sky, run)
    return figure


def track(axes: Any, run: Run) -> None:
    nav = run.nav
    place = [nav[name].to_numpy() for name in ("lat_deg", "lon_deg", "h_m")]
    east, north, _ = pymap3d.geodetic2enu(*place, *(values[0] for values in place))
    points = 1e-3 * np.column_stack([east, north])
    sigma = np.hypot(nav["sd_n_m"], nav["sd_e_m"])
    pieces = [list(pair) for pair in pairwise(points)]
    lines = LineCollection(
        pieces, array=sigma, cmap="viridis", linewidths=2.4, capstyle="projecting", clim=(0.4, 0.7)
    )
    axes.add_collection(lines)
    axes.autoscale()
    axes.set_aspect("equal")
    axes.set(title="Track, by its horizontal sigma", xlabel="east, km", ylabel="north, km")
    axes.figure.colorbar(lines, ax=axes, label="m", shrink=0.8)


def innovations(axes: Any, run: Run) -> None:
    used = run.measurements[run.measurements["status"] == "used"]
    edges = np.linspace(-4.0, 4.0, 49)
    for kind, colour in (("pseudorange", BLUE), ("range_rate", RED)):
        rows = used[used["kind"] == kind]
        nis = rows["nis"].mean()
        label = f"{kind.replace('_', ' ')}, mean NIS {nis:.2f}"
        ratio = rows["innovation"] / rows["sd_innovation"]
        axes.hist(ratio, edges, density=True, histtype="step", color=colour, linewidth=1.5, label=label)
    x = np.linspace(-4.0, 4.0, 200)
    axes.plot(x, np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi), color=GREY, linestyle="--", label="normal")
    axes.set_ylim(0.0, 0.62)
    axes.set(title=f"{len(used)} innovations by their sigma", xlabel="innovation / sigma", yticks=[])
    axes.legend(frameon=False, loc="upper left", fontsize=7.5)


def error(axes: Any, run: Run, name: str, words: str, limit: float, title: str) -> None:
    errors = run.errors
    assert errors is not None
    time_s, sigma = errors["time_s"] - run.nav["time_s"].iloc[0], 3.0 * errors[f"sd_{name}"]
    axes.fill_between(time_s, -sigma, sigma, color=BLUE, alpha=0.18, linewidth=0.0)
    axes.plot(time_s, errors[f"d_{name}"], color=BLUE, linewidth=1.0)
    axes.set(ylim=(-limit, limit), ylabel=words, title=title)
    known_s = run.heading_known_s()
    if title == "" and known_s is not None:
        at = known_s - run.nav["time_s"].iloc[0]
        axes.axvline(at, color=GREY, linestyle=":")
        axes.annotate("heading known", (at, 0.7 * limit), (at + 12.0, 0.7 * limit), fontsize=7.5)


def states(axes: Any, run: Run) -> None:
    table = run.supervision
    assert table is not None
    names = sorted(table["sv"].astype("str").unique(), reverse=True)
    start_s = run.nav["time_s"].iloc[0]
    for state, colour in STATES.items():
        rows = table[table["state"] == state]
        row = rows["sv"].astype("str").map(names.index)
        label = None if state == "control_detection" else state
        axes.plot(rows["time_s"] - start_s, row, "|", color=colour, markersize=6.5, markeredgewidth=0.9)
        axes.plot([], [], "s", color=colour, label=label)
    axes.set_yticks(range(len(names)), names, fontsize=7.0)
    axes.set(xlabel="time, s", title="What each channel should do while the airframe turns")
    axes.legend(frameon=False, ncols=4, loc="lower left", bbox_to_anchor=(0.0, -0.48), fontsize=7.5)
    axes.set_xlim(0.0, 1200.0)


if __name__ == "__main__":
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else SAMPLE / "picture.png"
    run = flown()
    picture(run).savefig(path, dpi=130)
    times = run.search_times
    assert times is not None
    print(
        f"in search {times['search_s'].sum() + times['control_s'].sum():.2f} s,"
        f" without the supervisor {times['unsupervised_s'].sum():.0f} s"
    )
    print(f"wrote {path} ({path.stat().st_size / 1e3:.0f} kB)")
