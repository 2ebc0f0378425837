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
# # 08 The interference margin of the aided loop
#
# **Question.** How much more interference does a phase loop stand when an inertial system aids it, and where along a
# flight would each loop lose lock?
#
# All densities are one-sided. A loop that is aided has to follow only what the aiding leaves: the drift of the
# oscillator and of the inertial system, $S=S_\mathrm{osc}+S_\mathrm{INS}$ in rad²/s³. At the loop's optimum its phase
# error has the variance $(S S_n^3)^{1/4}/\sqrt2$, and lock goes where that reaches the square of a share $C_A$ of the
# aperture $A_d$ (Shatilov 2009):
#
# $$S_{n,\mathrm{thr}}=(A_dC_A)^{8/3}\left(\frac4S\right)^{1/3},\qquad
#   \frac JS=\Delta F_c\,S_{n,\mathrm{thr}}\ \ (\text{no data}),\qquad
#   \frac JS=\Delta F_c T_s\left(\sqrt{1+\frac{2S_{n,\mathrm{thr}}}{T_s}}-1\right)\ \ (\text{data}).$$

# %%
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import insgnss
from insgnss.config.interference import InterferenceConfig
from insgnss.config.library import imu_grade, oscillator
from insgnss.gnss.signals import L1_HZ
from insgnss.interference import (
    PhaseLoop,
    bandwidth_at_margin_hz,
    density_of_grade,
    density_of_walk,
    discriminator,
    greatest_drift,
    margin_db,
    margin_in_motion_db,
    oscillator_density,
)
from insgnss.interference.figures import diagram_figure, margin_figure, trade_off_figure
from insgnss.interference.steady_acceleration import density_at_threshold
from insgnss.report.figures import STYLE
from insgnss.runs.margin import flown_figure, flown_margin

plt.rcParams.update(STYLE | {"figure.dpi": 120, "figure.constrained_layout.use": True})
CARRIER_HZ, BAND_HZ, ACCUMULATION_S = 1.6e9, 1.022e6, 0.01

# %% [markdown]
# ## The margin over the drift
#
# With the engineering threshold of 0.076 for both. The paper's oscillator, 19 Hz within a second at the most, has
# $S=2(2\pi\cdot19/3)^2/1=3167$.

# %%
loops = {
    "type 1, no data": PhaseLoop(discriminator("Q", 0.076), BAND_HZ, ACCUMULATION_S),
    "type 2, data": PhaseLoop(discriminator("IQ", 0.076), BAND_HZ, ACCUMULATION_S),
}
paper_drift = float(oscillator_density(19.0, 1.0))
S = np.array([0.1, 1.0, 7.1144, 100.0, paper_drift, 1e5])
columns = {}
for name, loop in loops.items():
    columns[f"{name}: J/S, dB"] = margin_db(S, loop)
    columns[f"{name}: B, Hz"] = bandwidth_at_margin_hz(S, loop)
margins = pd.DataFrame(columns, index=pd.Index(S.round(2), name="S, rad²/s³"))
gap_db = float(margins.iloc[4, 0] - margins.iloc[4, 2])
print(margins.round(3).to_string())
margin_figure(loops, marks={"paper's oscillator": paper_drift})

# %% [markdown]
# ## The trade between oscillator and inertial system
#
# With $c_\mathrm{osc}=\Delta f_\mathrm{max}^2/T_\mathrm{osc}$ and
# $c_\mathrm{INS}=\Delta V_\mathrm{max}^2/T_\mathrm{INS}$ a wanted margin allows all pairs below a straight line,
#
# $$2\left(\frac{2\pi}3\right)^2c_\mathrm{osc}+2\left(\frac{2\pi f_0}{3c}\right)^2c_\mathrm{INS}\le S_\mathrm{max}.$$
#
# First the margin with one of the two alone (the paper's figure 4: on each axis the *other* sensor is without drift),
# then the lines for loops without and with data (figures 5 and 6).

# %%
diagram_figure(loops, CARRIER_HZ)

# %%
trade_off_figure(loops["type 1, no data"], CARRIER_HZ)

# %%
trade_off_figure(loops["type 2, data"], CARRIER_HZ)

# %%
S_max = {db: float(greatest_drift(db, loops["type 2, data"])) for db in (30.0, 35.0, 40.0)}
print(
    "drift that allows 30, 35, 40 dB with data:", {db: float(f"{value:.5g}") for db, value in S_max.items()}
)
of_clock = {name: float(density_of_walk(oscillator(name).h_minus2_per_s, L1_HZ)) for name in ("tcxo", "ocxo")}
of_imu = {
    name: density_of_grade(imu_grade(name), L1_HZ).total
    for name in ("mems_consumer", "tactical", "navigation")
}
choices = pd.DataFrame(
    {
        c: {i: float(margin_db(of_clock[c] + of_imu[i], loops["type 2, data"])) for i in of_imu}
        for c in of_clock
    }
)
print("\nJ/S with data, dB, by IMU (corrected every second) and oscillator at L1")
print(choices.round(1).to_string())

# %% [markdown]
# ## Along a flight
#
# A tactical IMU and a TCXO, as the sample flight has them. Two broadband transmitters stand below its path; each
# radiates 40 mW, over the band of the C/A code and over 20 MHz. `flown_margin` takes place, attitude and the sigma of
# the aiding from the run; a satellite is in lock while its effective C/N0 is above the loop's threshold,
#
# $$\frac1{q}=\frac{N_0}C+\sum_k\left(\frac JS\right)_k\kappa_k .$$
#
# The unaided loop has to follow the vehicle's acceleration along the line of sight as well. It is not left to widen its
# band: a loop of third order carries the acceleration, a Gauss-Markov process of the turn's size that lasts for 5 s, as
# a state, and follows it with the gains of the Riccati equation. Both orders are computed for both loops and the better
# one counts. First what that is worth in a turn of 5 g, with an oscillator of 100 rad²/s³ and 1 ms of accumulation.

# %%
five_g = PhaseLoop(discriminator("IQ", 0.076), BAND_HZ, 0.001)
turn_db = float(margin_in_motion_db(100.0, 5.0 * 9.80665, 1.0 / 0.3, CARRIER_HZ, five_g))
wide = density_at_threshold(
    100.0, 5.0 * 9.80665, 1.0 / 0.3, CARRIER_HZ, five_g.discriminator.threshold_rms_rad
)
wide_db = float(margin_db(wide, five_g))
print(f"turn of 5 g: {wide_db:.2f} dB with second order, {turn_db:.2f} dB with third order")

# %%
EMITTERS = """
name = "two transmitters below the sample flight"
[[emitter]]
name = "narrow"
lat_deg = 60.040
lon_deg = 30.100
h_m = 60.0
eirp_dbw = -14.0
bandwidth_hz = 2.0e6
loss_db = 3.0
[[emitter]]
name = "wide"
lat_deg = 60.085
lon_deg = 30.400
h_m = 40.0
eirp_dbw = -14.0
bandwidth_hz = 20.0e6
loss_db = 3.0
[receiver]
discriminator = "atan(Q/I)"
"""
SAMPLE = Path("../data/sample_flight")
run = insgnss.replay(SAMPLE / "flight.toml", filter="tight17", aiding=10.0)
keeper = tempfile.TemporaryDirectory()
folder = Path(keeper.name)
(folder / "emitters.toml").write_text(EMITTERS)
study = flown_margin(run, folder / "emitters.toml")
summary = study.summary()
print(summary.round(2).to_string())
flown_figure(study)

# %% [markdown]
# Blue: the aided loop alone keeps the satellite; red: neither does. What the aiding gains is the difference of the two
# reserves: it is there where the aircraft turns; without turns both loops face the same clock.

# %%
table = study.satellites[study.satellites["time_s"] > run.heading_known_s()]
roll = np.interp(table["time_s"], run.nav["time_s"], run.nav["roll_deg"])
gain = table["reserve_aided_db"] - table["reserve_unaided_db"]
turning = np.abs(roll) > 20.0
level = np.abs(roll) < 2.0
print(f"gain of the aiding: {gain[turning].mean():.1f} dB in turns ({gain.max():.1f} at the most), ", end="")
print(f"{gain[level].median():.2f} dB (median) in level flight")
lost = {loop: int((~table[f"lock_{loop}"]).sum()) for loop in ("unaided", "aided")}
print(f"satellite-seconds without lock: {lost['unaided']} unaided, {lost['aided']} aided")
third = float((table.loc[turning, "order_unaided"] == 3).mean())
print(f"in turns the third order is the better one without aiding in {third:.0%} of the rows")
print(study.events.head(6).to_string())

# %% [markdown]
# A better clock: the same flight with the drift of an OCXO (`dynamics.oscillator_density`).

# %%
settings = {
    **study.settings.model_dump(exclude_unset=True),
    "dynamics": {"oscillator_density": of_clock["ocxo"]},
}
quiet = flown_margin(run, InterferenceConfig.model_validate(settings)).satellites
quiet = quiet[quiet["time_s"] > run.heading_known_s()]
quiet_gain = quiet["reserve_aided_db"] - quiet["reserve_unaided_db"]
quiet_lost = {loop: int((~quiet[f"lock_{loop}"]).sum()) for loop in ("unaided", "aided")}
better = float((quiet["reserve_aided_db"].to_numpy() - table["reserve_aided_db"].to_numpy()).mean())
print(
    f"with an OCXO the aiding is worth {quiet_gain[turning].mean():.1f} dB in turns; satellite-seconds without lock:"
)
print(
    f"{quiet_lost['unaided']} unaided, {quiet_lost['aided']} aided; the aided loop alone gains {better:.1f} dB"
)

# %% [markdown]
# The command line gives the same tables and picture for a saved run: `insgnss margin out/ --emitters emitters.toml`.

# %%
run.save(folder / "out")
command = [
    "margin",
    str(folder / "out"),
    "--emitters",
    str(folder / "emitters.toml"),
    "--output",
    str(folder),
]
told = subprocess.run(
    [sys.executable, "-m", "insgnss.cli", *command], capture_output=True, text=True, check=True
)
print(told.stdout.splitlines()[-1].replace(str(folder), "...").split(";")[0])
same = pd.read_parquet(folder / "margin_satellites.parquet")
keeper.cleanup()

# %% [markdown]
# ## Answer
#
# Aiding pays where the vehicle turns and where the clock lets it: with a TCXO a better IMU is worth nothing, the
# oscillator is the limit; with an OCXO the IMU's grade tells. Against a loop of second order the gain would look twice
# as large: a loop that has to do without aiding is of third order. The same share of the aperture is taken for loss of
# lock with both orders, which favours the third by half a decibel in simulation.

# %%
assert np.allclose(margins.iloc[:, 0], [56.8745, 53.5412, 50.7007, 46.8745, 41.8724, 36.8745], atol=1e-3)
assert np.allclose(margins.iloc[:, 2], [44.8669, 42.7008, 40.7007, 37.7389, 33.4030, 28.6926], atol=1e-3)
assert np.isclose(gap_db, 8.47, atol=0.005)
assert np.allclose(list(S_max.values()), [3.9074e4, 926.19, 13.653], rtol=1e-4)
assert np.ptp(choices["tcxo"]) < 0.2 and np.ptp(choices["ocxo"]) > 3.0
assert np.isclose(wide_db, 27.43, atol=0.005) and np.isclose(turn_db, 30.31, atol=0.005)
assert 1.2 < gain[turning].mean() < gain.max() < 4.5 and abs(gain[level].median()) < 0.1
assert lost["aided"] < 0.8 * lost["unaided"] and quiet_gain[turning].mean() > gain[turning].mean() + 2.0
assert same["lock_aided"].sum() == study.satellites["lock_aided"].sum()
print(
    f"Answer: with a TCXO the aided loop stands {gain[turning].mean():.1f} dB more in turns ({gain.max():.1f} at the"
    f" most) and none in level flight, with an OCXO {quiet_gain[turning].mean():.1f} dB; past two transmitters of 40 mW"
    f" the unaided loops are {lost['unaided']} satellite-seconds without lock, the aided ones {lost['aided']}; a margin"
    f" of 40 dB with data allows a drift of {S_max[40.0]:.2f} rad^2/s^3, and the paper's oscillator allows"
    f" {margins.iloc[4, 2]:.2f} dB with data and {margins.iloc[4, 0]:.2f} dB without."
)
