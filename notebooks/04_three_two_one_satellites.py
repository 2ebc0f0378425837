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
# # 04 Tight coupling with three, two, one satellites
#
# **Question.** How much do three, two or one satellites help a tightly coupled filter, compared with none?
#
# A receiver's own fix needs four satellites. A loosely coupled filter takes fixes, so with three it navigates by
# inertia alone. A tightly coupled filter takes each satellite for what it says: one range and one range rate along one
# line of sight.

# %%
import shutil
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import insgnss
from insgnss.report.figures import STYLE
from insgnss.runs.simulate import simulate
from insgnss.studies import Periodic, Removal, outage_study

plt.rcParams.update(STYLE | {"figure.dpi": 120, "figure.constrained_layout.use": True})
SAMPLE = Path("../data/sample_flight")
KEPT = {0: (), 1: ("G04",), 2: ("G04", "G31"), 3: ("G04", "G31", "G20"), 4: ("G04", "G31", "G20", "G23")}
ALL = ("G01", "G02", "G04", "G10", "G13", "G16", "G20", "G23", "G30", "G31", "G32")

# %% [markdown]
# ## What a satellite can tell
#
# The row of satellite $k$'s range rate is $\dot\rho_k = u_k \cdot (v_k - v) + \dot b$, with the drift $\dot b$ of the
# receiver's clock in every row. An ordinary oscillator wanders faster than the inertial velocity, so the first
# satellite only says how the clock runs; each further one adds the velocity along one direction,
# $(u_j - u_k)\cdot\delta v$. So $m$ satellites should see $m - 1$ directions: two are worth one, four all three.
#
# ## A fix from three satellites
#
# First a receiver alone: `insgnss.point` solves every epoch by itself. We leave three satellites in a copy
# of the log of the sample flight.

# %%
with tempfile.TemporaryDirectory() as name:
    copy = Path(shutil.copytree(SAMPLE, Path(name) / "copy"))
    gnss = pd.read_csv(copy / "gnss.csv")
    fixes = {}
    for count in (4, 3):
        gnss[gnss["sv"].isin(KEPT[count])].to_csv(copy / "gnss.csv", index=False)
        epochs = insgnss.point(copy / "flight.toml").point
        fixes[count] = int(epochs["lat_deg"].notna().sum())
        print(f"{count} satellites: a position at {fixes[count]} of {len(epochs)} epochs")

# %% [markdown]
# ## Sixty seconds with fewer
#
# `outage_study` takes satellites away in twelve windows of 60 s, straight and turning, and compares with the reference;
# before each window the filter has had all eleven. The sensor is the sample flight's (1 deg/h, 1 mg), the clock a TCXO.
# In the windows the filter's sigma is held against what the errors really were: rms over the twelve windows.

# %%
studies = {
    count: outage_study(
        SAMPLE / "flight.toml",
        Periodic(length_s=60.0, every_s=90.0),
        Removal(satellites=tuple(sv for sv in ALL if sv not in kept)),
        after_s=0.0,
    )
    for count, kept in KEPT.items()
}
MEASURES = ["horizontal_m", "vertical_m", "velocity_mps", "attitude_deg"]
at_end = {count: study.at(59.0, "reference").set_index("measure") for count, study in studies.items()}
table = pd.DataFrame(
    {
        (measure, value): {count: rows.loc[measure, value] for count, rows in at_end.items()}
        for measure in MEASURES
        for value in ("rms", "sd")
    }
).rename_axis("satellites")
print(
    "after 59 s with so many satellites: rms of the error and the filter's sigma\n",
    table.round(3).to_string(),
)

# %%
figure, panels = plt.subplots(1, 2, figsize=(7.2, 2.9), sharex=True)
for axes, measure, label in zip(
    panels, ("horizontal_m", "velocity_mps"), ("horizontal error, m", "velocity error, m/s"), strict=True
):
    for count, study in studies.items():
        rows = study.percentiles
        rows = rows[
            (rows["against"] == "reference") & (rows["measure"] == measure) & (rows["since_s"] < 60.0)
        ]
        colour = plt.get_cmap("viridis")(0.22 * count)
        axes.plot(rows["since_s"], rows["rms"], color=colour, label=f"{count}")
        axes.plot(rows["since_s"], rows["sd"], "--", color=colour)
    axes.set(xlabel="time with so many satellites, s", ylabel=label)
panels[0].legend(title="satellites (dashed: sigma)", ncols=2)
plt.show()

# %% [markdown]
# One satellite changes nothing: it pays for the clock. Two take away one direction, three nearly all of the horizontal
# error, four what was left of the velocity. Sigma says so itself, and tells the truth: the errors are as large as it
# claims. In the loosely coupled reading the rows 1, 2 and 3 would all be row 0.
#
# ## A clock that need not be paid for
#
# If the reason is the clock, one satellite must be worth a direction with a receiver that carries an atomic clock. We
# simulate one flight (an S-turn, then straight on) with a TCXO and with a chip-scale atomic clock, each of which the
# filter knows, and take the same satellites away.

# %%
SCENARIO = """
gps_week = 2385
start_s = 293700.0
place = {{ lat_deg = 59.97, lon_deg = 30.32, h_m = 1000.0, heading_deg = 40.0 }}
speed_mps = 70.0
clock = {{ oscillator = "{oscillator}" }}
imu = {{ grade = "tactical" }}

[[manoeuvre]]
kind = "s_turn"
by_deg = 60.0
bank_deg = 30.0
[[manoeuvre]]
kind = "straight"
duration_s = 200.0

[sky]
kind = "table"
satellite = [
    {{ sv = "G01", azimuth_deg = [76.0, 75.0], elevation_deg = [23.0, 24.0] }},
    {{ sv = "G04", azimuth_deg = [282.0, 280.0], elevation_deg = [42.0, 42.0] }},
    {{ sv = "G10", azimuth_deg = [294.0, 294.0], elevation_deg = [19.0, 21.0] }},
    {{ sv = "G13", azimuth_deg = [240.0, 241.0], elevation_deg = [50.0, 52.0] }},
    {{ sv = "G20", azimuth_deg = [144.0, 144.0], elevation_deg = [50.0, 48.0] }},
    {{ sv = "G23", azimuth_deg = [172.0, 160.0], elevation_deg = [82.0, 81.0] }},
    {{ sv = "G31", azimuth_deg = [46.0, 45.0], elevation_deg = [24.0, 22.0] }},
]
"""


def sigma_after_a_minute(oscillator: str) -> dict[int, float]:
    """Return sigma of the horizontal position [m] by number of satellites."""
    found = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scenario.toml").write_text(SCENARIO.format(oscillator=oscillator))
        simulation = simulate(folder / "scenario.toml", seed=1)
        simulation.save(folder)
        names = simulation.log.gnss.sv_names
        for count in (0, 1, 2, 3):
            taken = Removal(satellites=tuple(sv for sv in names if sv not in KEPT[count]))
            study = outage_study(folder / "flight.toml", [(293840.0, 293900.0)], taken, after_s=0.0)
            found[count] = float(study.at(59.0, "reference").set_index("measure").loc["horizontal_m", "sd"])
    return found


by_clock = {oscillator: sigma_after_a_minute(oscillator) for oscillator in ("tcxo", "csac")}
figure, axes = plt.subplots(figsize=(3.5, 2.4))
for shift, (oscillator, found) in zip((-0.2, 0.2), by_clock.items(), strict=True):
    axes.bar(np.array(list(found)) + shift, list(found.values()), 0.36, label=oscillator.upper())
axes.set(xlabel="satellites", ylabel="sigma, horizontal, after 59 s, m", xticks=range(4))
axes.legend()
plt.show()
print(pd.DataFrame(by_clock).rename_axis("satellites").round(2))

# %% [markdown]
# With the better clock one satellite does what two did before, and two nearly what three did.
#
# ## Answer

# %%
horizontal = table[("horizontal_m", "sd")]
errors = table[("horizontal_m", "rms")]
assert fixes[3] == 0 and fixes[4] > 0.8 * 1200
assert abs(horizontal[1] / horizontal[0] - 1.0) < 0.03
assert horizontal[2] < 0.75 * horizontal[0] and horizontal[3] < 0.2 * horizontal[0]
assert table[("velocity_mps", "sd")][4] < 0.2 * table[("velocity_mps", "sd")][0]
# twelve windows, two horizontal components that mostly share one slow error: rms is sigma within a factor of 0.6 to 1.4
assert (errors / horizontal).between(0.6, 1.4).all()
tcxo, csac = by_clock["tcxo"], by_clock["csac"]
assert tcxo[1] > 0.97 * tcxo[0] and csac[1] < 0.85 * csac[0]
assert csac[1] < 1.15 * tcxo[2] and csac[2] < 0.5 * tcxo[2]
sigmas, found = (", ".join(f"{value:.1f}" for value in column) for column in (horizontal, errors))
print(
    f"Answer: after a minute with 0, 1, 2, 3, 4 satellites the horizontal sigma is {sigmas} m (errors {found} m rms);"
    f" of three satellites a loosely coupled filter gets {fixes[3]} fixes and drifts as with none. The first satellite"
    f" pays for the clock: with an atomic one it takes sigma from {csac[0]:.1f} to {csac[1]:.1f} m by itself."
)
