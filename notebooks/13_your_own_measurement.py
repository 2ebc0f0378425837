# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # 13 Your own measurement
#
# **Question.** What are a height from a map, a compass and the range to one beacon worth to a car that has no GNSS for
# a minute?
#
# None of the three is built in. `replay(flight, measurements=[...])` takes objects with a name, times and a method
# `rows(state, layout)`, which returns for each row
#
# $$\left(z-h(\hat x),\quad \partial h/\partial x\ \text{by the names of the states},\quad r\right) .$$
#
# The partials are those of the prediction with their plain sign: how much it grows when the position grows, or when
# $C_{eb}$ becomes $(I+[\psi\times])\,C_{eb}$.

# %%
import math
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import insgnss
from insgnss.config.library import find
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.report.figures import STYLE
from insgnss.runs.simulate import simulate

plt.rcParams.update(STYLE | {"figure.dpi": 120, "figure.constrained_layout.use": True})
GONE_S = (65.0, 125.0)  # seconds from the start without any satellite
SEEDS = (1, 2, 3)

# %% [markdown]
# ## A car in a city, through a tunnel
#
# The scenario is `city_car` of the library with a telephone's inertial sensor: it waits, drives, turns at corners and
# stops. For a minute all satellites are gone, and within it the car goes round a corner.

# %%
keeper = tempfile.TemporaryDirectory()
folder = Path(keeper.name)
text = find("scenarios", "city_car").read_text(encoding="utf-8")
fault = f'[[fault]]\nkind = "outage"\nfrom_s = {GONE_S[0]}\nto_s = {GONE_S[1]}\n'
(folder / "tunnel.toml").write_text(f"{text}\n{fault}", encoding="utf-8")
flights, truths = {}, {}
for seed in SEEDS:
    simulate(folder / "tunnel.toml", seed).save(folder / str(seed))
    flights[seed] = insgnss.Flight.load(folder / str(seed) / "flight.toml")
    truths[seed] = pd.read_csv(folder / str(seed) / "reference.csv")
START_S = float(truths[SEEDS[0]]["time_s"].iloc[0])
print(truths[SEEDS[0]].columns.tolist())

# %% [markdown]
# ## Three measurements, some lines each
#
# `state` is what the filter knows at the time, before the measurement: position, velocity, attitude, biases, and what
# follows from them.


# %%
class MapHeight:
    name, unit, sigma = "map_height", "m", 0.5

    def __init__(self, times_ns, values):
        self.times_ns, self.values = times_ns, dict(zip(times_ns.tolist(), values, strict=True))

    def rows(self, state, layout):
        return self.values[state.t_ns] - state.h_m, {"position": state.up_e}, self.sigma**2


class Compass(MapHeight):
    name, unit, sigma = "compass", "rad", math.radians(4.0)

    def rows(self, state, layout):
        difference = math.remainder(self.values[state.t_ns] - state.yaw_rad, 2.0 * math.pi)
        return difference, {"attitude": state.rpy_by_attitude[2]}, self.sigma**2


class Beacon(MapHeight):
    name, unit, sigma = "beacon", "m", 1.0
    place_e = np.zeros(3)

    def rows(self, state, layout):
        away = state.r_e - self.place_e
        distance = np.linalg.norm(away)
        return self.values[state.t_ns] - distance, {"position": away / distance}, self.sigma**2


# %% [markdown]
# What they would have measured once a second, the truth with noise. The beacon stands 300 m north and 200 m east of
# the middle of the tunnel.


# %%
def in_ecef(table: pd.DataFrame) -> np.ndarray:
    """Return the positions of a table with latitude, longitude and height."""
    places = np.zeros((len(table), 3))
    for place, row in zip(places, table[["lat_deg", "lon_deg", "h_m"]].to_numpy(), strict=True):
        geodetic_to_ecef(math.radians(row[0]), math.radians(row[1]), row[2], place)
    return places


def measured(seed: int) -> dict[str, MapHeight]:
    """Return the three measurements of a drive."""
    rng = np.random.default_rng([13, seed])
    truth = truths[seed]
    since_s = truth["time_s"] - START_S
    whole = (since_s - since_s.round()).abs() < 1e-3
    truth = truth[whole & since_s.between(*GONE_S)]
    times_ns, noise = flights[seed].gps_ns(truth["time_s"]), rng.standard_normal((3, len(truth)))
    middle = truth.iloc[len(truth) // 2].copy()
    middle["lat_deg"] += 300.0 / 111e3
    middle["lon_deg"] += 200.0 / (111e3 * math.cos(math.radians(middle["lat_deg"])))
    Beacon.place_e = in_ecef(middle.to_frame().T.astype(float))[0]
    distance = np.linalg.norm(in_ecef(truth) - Beacon.place_e, axis=1)
    yaw = np.radians(truth["yaw_deg"].to_numpy())
    values = (truth["h_m"].to_numpy(), yaw, distance)
    kinds = (MapHeight, Compass, Beacon)
    return {
        kind.name: kind(times_ns, value + kind.sigma * n)
        for kind, value, n in zip(kinds, values, noise, strict=True)
    }


USED = {
    "inertial alone": (),
    "height": ("map_height",),
    "height, compass": ("map_height", "compass"),
    "height, beacon": ("map_height", "beacon"),
    "all three": ("map_height", "compass", "beacon"),
}
runs = {}
for seed in SEEDS:
    kinds = measured(seed)
    for label, names in USED.items():
        own = [kinds[name] for name in names]
        runs[label, seed] = insgnss.replay(flights[seed], output=2.0, measurements=own)
print(runs["all three", SEEDS[0]].status_counts().to_string())
print(runs["all three", SEEDS[0]].nis_summary().to_string())

# %% [markdown]
# ## What the vehicle itself knows
#
# No sensor at all: the flight file says that this is a car. Its axle moves neither sideways nor up, and where the
# inertial samples are those of a vehicle at rest, velocity and rate are zero. The filter makes such rows each second.

# %%
CAR = '\n[vehicle]\nkind = "car"\nnon_holonomic = { axle_m = [0.0, 0.0, 0.0] }\n'
for seed in SEEDS:
    drive = folder / str(seed)
    text = (drive / "flight.toml").read_text(encoding="utf-8")
    (drive / "car.toml").write_text(text + CAR, encoding="utf-8")
    runs["a car", seed] = insgnss.replay(drive / "car.toml", output=2.0)
print(runs["a car", SEEDS[0]].nis_summary().to_string())
keeper.cleanup()


# %% [markdown]
# ## What they are worth
#
# Errors against the truth over three drives: lines their rms, dashed the rms of the filter's own sigma.


# %%
def by_time(label: str) -> pd.DataFrame:
    """Return rms errors and sigmas over the drives by the time since the start."""
    tables = []
    for seed in SEEDS:
        errors = runs[label, seed].errors
        since_s = (errors["time_s"] - START_S).round(1)
        squared = pd.DataFrame(
            {
                "horizontal": errors["d_n_m"] ** 2 + errors["d_e_m"] ** 2,
                "sd_horizontal": errors["sd_n_m"] ** 2 + errors["sd_e_m"] ** 2,
                "height": errors["d_d_m"] ** 2,
                "sd_height": errors["sd_d_m"] ** 2,
            }
        )
        tables.append(squared.groupby(since_s).first())
    return np.sqrt(pd.concat(tables).groupby(level=0).mean())


rms = {label: by_time(label) for label in (*USED, "a car")}
figure, axes = plt.subplots(1, 2, figsize=(7.6, 3.0), sharex=True)
for label, table in rms.items():
    table = table.loc[GONE_S[0] - 5.0 : GONE_S[1] + 8.0]
    for axis, name in zip(axes, ("horizontal", "height"), strict=True):
        (line,) = axis.semilogy(table.index, table[name].clip(lower=0.02), label=label)
        axis.semilogy(table.index, table[f"sd_{name}"], ls="--", lw=0.8, color=line.get_color())
for axis, name in zip(axes, ("horizontal", "height"), strict=True):
    axis.axvspan(*GONE_S, color="0.93", zorder=0)
    axis.set(xlabel="time, s", ylabel=f"{name} error, m (dashed: sigma)")
axes[0].legend(fontsize=7)

at_end = pd.DataFrame({label: table.loc[GONE_S[1] - 1.0] for label, table in rms.items()}).T
print(at_end.round(2).to_string())

# %% [markdown]
# The map holds the height and nothing else. The compass keeps the heading; tilt and accelerometer bias still drift.
# One range stops the drift along its line, not across it: with the height a line of position is left, along which the
# sigma grows. That it is a car is worth more than any of them horizontally: velocity errors along the road are across
# it after the next corner, and the stop ends them. Its rows count less than their innovations would allow (NIS far
# below 1): a real car slips in corners, this one does not. The rows stand in the ledger, in NIS and on the report's
# page like any other.

# %%
alone, height, beacon, everything, car = (
    at_end.loc[label] for label in ("inertial alone", "height", "height, beacon", "all three", "a car")
)
nis = pd.concat([runs["all three", seed].measurements for seed in SEEDS])
nis = nis[nis["kind"].isin(["map_height", "compass", "beacon"])]
mean_nis = nis.groupby(nis["kind"].astype(str))["nis"].mean()
print(mean_nis.round(2).to_dict())
assert (nis["status"] == "used").mean() > 0.98
assert height["height"] < 0.6 < 5.0 < alone["sd_height"]
assert everything["horizontal"] < 0.6 * alone["horizontal"]
assert everything["sd_horizontal"] < 0.4 * alone["sd_horizontal"]
assert car["horizontal"] < 0.3 * alone["horizontal"]
assert mean_nis.between(0.7, 1.35).all()
print(
    f"Answer: after {GONE_S[1] - GONE_S[0] - 1.0:.0f} s the car is off by {alone['horizontal']:.0f} m horizontally and"
    f" {alone['height']:.0f} m in height with its telephone's inertial sensor alone, by {height['height']:.2f} m in"
    f" height with the map, by {beacon['horizontal']:.0f} m horizontally with map and beacon, and by"
    f" {everything['horizontal']:.0f} m with all three, by {car['horizontal']:.0f} m without any of them but as a car;"
    f" mean NIS {mean_nis.min():.2f} to {mean_nis.max():.2f}."
)
