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
# # 16 Installation in flight
#
# **Question.** The IMU's time tags are 20 ms late and the antenna is 0.3 m from where the flight file says: what does
# that do to the solution, and can the filter find both numbers in flight and correct the flight file?
#
# The filter predicts the antenna's position and velocity from the IMU's at the time of the GNSS epoch. With $l$ for
# the lever arm and $\tau$ for the seconds to add to the IMU's tags,
#
# $$r_a=r_e+C_{eb}(l+\delta l)-v_e\,\tau,\qquad v_a=v_e+C_{eb}\,\omega\times(l+\delta l)-a_e\,\tau .$$
#
# In a turn of 40 degrees of bank the acceleration $a_e$ is 8 m/s^2, and $a_e\tau$ is 0.16 m/s, several sigmas of a
# range rate. $\tau$ is a state with a sigma of 0.02 s unless `process.imu_time_sigma_s` declares another, $\delta l$
# is one where `process.lever_arm_sigma_m` declares it uncertain.

# %%
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.stats import chi2

import insgnss
from insgnss.report.figures import STYLE
from insgnss.runs.simulate import simulate

plt.rcParams.update(STYLE | {"figure.dpi": 120, "figure.constrained_layout.use": True})
SEEDS = (1, 2, 3)
LATE_S = 0.02
ARM_M, WRONG_ARM_M = np.array([0.8, 0.0, -1.1]), np.array([0.6, 0.2, -1.0])
START_S = 300_000.0

# %% [markdown]
# ## Three flights of one aircraft
#
# Two and a half minutes in the air, with turns of 35 to 45 degrees of bank and speeds of 50 to 70 m/s. The receiver
# logs carrier phases. The wrong flight file differs from the right one in two keys: it adds 20 ms to every tag of the
# IMU, and its lever arm is off by (-0.2, 0.2, 0.1) m.

# %%
SCENARIO = f"""
name = "installation"
source = "turns of a light aircraft"
gps_week = 2385
start_s = {START_S}
place = {{ lat_deg = 47.0, lon_deg = 8.0, h_m = 1500.0, heading_deg = 35.0 }}
speed_mps = 60.0
manoeuvre = [
  {{ kind = "straight", duration_s = 10.0 }},
  {{ kind = "turn", by_deg = 90.0, bank_deg = 35.0 }},
  {{ kind = "turn", by_deg = -120.0, bank_deg = 40.0 }},
  {{ kind = "accelerate", to_mps = 70.0, duration_s = 10.0 }},
  {{ kind = "turn", by_deg = 150.0, bank_deg = 45.0 }},
  {{ kind = "accelerate", to_mps = 50.0, duration_s = 10.0 }},
  {{ kind = "s_turn", by_deg = 40.0, bank_deg = 35.0 }},
  {{ kind = "turn", by_deg = -120.0, bank_deg = 40.0 }},
  {{ kind = "straight", duration_s = 10.0 }},
]
[imu]
grade = "tactical"
rate_hz = 50.0
[gnss]
lever_arm_m = {ARM_M.tolist()}
carrier_noise_m = {{ floor = 0.002 }}
"""
AS_DECLARED = {"health.recovery": False, "process.imu_time_sigma_s": 0.0}
STATES = {"process.lever_arm_sigma_m": 0.3, "process.imu_time_sigma_s": 0.02}
keeper = tempfile.TemporaryDirectory()
folder = Path(keeper.name)
(folder / "scenario.toml").write_text(SCENARIO, encoding="utf-8")


def installed(text: str, offset_s: float, arm_m: np.ndarray) -> str:
    """Return a flight file with another time offset of the IMU and another lever arm."""
    time = f"[imu.time]\noffset_s = {offset_s}\n\n[imu.grade]"
    arm = ", ".join(f"{metres:.4f}" for metres in arm_m)
    lines = text.replace("[imu.grade]", time).splitlines()
    return "\n".join(f"lever_arm_m = [{arm}]" if line.startswith("lever_arm_m") else line for line in lines)


runs: dict[tuple[str, int], insgnss.Run] = {}
for seed in SEEDS:
    flight = folder / f"flight_{seed}"
    simulate(folder / "scenario.toml", seed).save(flight)
    right = (flight / "flight.toml").read_text(encoding="utf-8")
    (flight / "wrong.toml").write_text(installed(right, LATE_S, WRONG_ARM_M), encoding="utf-8")
    runs["right file", seed] = insgnss.replay(flight / "flight.toml")
    runs["wrong file", seed] = insgnss.replay(flight / "wrong.toml", settings=AS_DECLARED)
    runs["wrong file, search", seed] = insgnss.replay(flight / "wrong.toml")
    runs["wrong file, states", seed] = insgnss.replay(flight / "wrong.toml", settings=STATES)

# %% [markdown]
# ## Without the states
#
# Error over sigma in the second half of each flight, rms over the flights. Without the states, and without a search for
# faults, the filter attributes what the satellites show to the attitude: roll is wrong by nine sigmas. Position and
# velocity are then compared at the IMU's tags, so their errors include the motion of 20 ms. By default the tags are a
# state and faults are searched for: in all flights the search finds within 40 s that the lever arm is wrong, and the
# filter goes on with its error as states, too. The sigmas hold then. The forward component stays uncertain until the
# speed changes.

# %%
QUANTITIES = ("roll_deg", "pitch_deg", "yaw_deg", "vn_mps", "ve_mps", "n_m", "e_m", "d_m")


def over_sigma(label: str, seeds: tuple[int, ...]) -> pd.Series:
    """Return the rms of error over sigma of each quantity, over the second halves of the flights."""
    halves = [runs[label, seed].errors for seed in seeds]
    table = pd.concat([errors.iloc[len(errors) // 2 :] for errors in halves])
    return pd.Series({q: np.sqrt(((table[f"d_{q}"] / table[f"sd_{q}"]) ** 2).mean()) for q in QUANTITIES})


ratios = pd.DataFrame(
    {label: over_sigma(label, SEEDS) for label in dict.fromkeys(label for label, _ in runs)}
)
print(ratios.round(2).T.to_string())
suspects = pd.concat([runs["wrong file, search", seed].events.assign(flight=seed) for seed in SEEDS])
suspects = suspects[suspects["kind"].isin(["lever_arm_suspect", "sensor_suspect"])]
for (seed, kind), told in suspects.groupby(["flight", "kind"]):
    first = told.iloc[0]
    print(f"flight {seed}: {len(told)} {kind}, at {first['time_s'] - START_S:.0f} s: {first['detail']}")
misplaced = suspects.loc[suspects["kind"] == "lever_arm_suspect", "flight"].unique()

# %%
figure, panels = plt.subplots(1, 2, figsize=(7.2, 2.6), sharey=True)
for panel, label in zip(panels, ("wrong file", "wrong file, states"), strict=True):
    errors = runs[label, 1].errors.iloc[12:]
    since_s = errors["time_s"] - START_S
    sigma = 3.0 * errors["sd_roll_deg"]
    panel.fill_between(since_s, -sigma, sigma, color="tab:blue", alpha=0.25, lw=0.0)
    panel.plot(since_s, errors["d_roll_deg"], color="tab:red")
    panel.set(title=label, xlabel="time, s", ylim=(-0.6, 0.6))
panels[0].set_ylabel("roll error, deg (band: 3 sigma)")

# %% [markdown]
# ## What the states find
#
# `nav` has what must be added to the number in the flight file, with its sigma. When a sigma has fallen to a fifth of
# what it was at the start, the event `installation_known` says so.

# %%
NUMBERS = {"imu_time_offset_s": -LATE_S} | {
    f"lever_arm_{axis}_m": metres for axis, metres in zip("xyz", ARM_M - WRONG_ARM_M, strict=True)
}
found = pd.DataFrame(
    {
        (name, seed): {
            "true": true,
            "found": (last := runs["wrong file, states", seed].nav.iloc[-1])[name],
            "sigma": last[f"sd_{name}"],
        }
        for name, true in NUMBERS.items()
        for seed in SEEDS
    }
).T
found["error over sigma"] = (found["found"] - found["true"]) / found["sigma"]
print(found.round(4).to_string())
known = runs["wrong file, states", 1].events
known = known[known["kind"] == "installation_known"]
for time_s, detail in zip(known["time_s"], known["detail"], strict=True):
    print(f"{time_s - START_S:4.0f} s  installation_known  {detail}")

# %%
figure, panels = plt.subplots(1, 4, figsize=(7.6, 2.4), sharex=True)
nav = runs["wrong file, states", 1].nav
since_s = nav["time_s"] - START_S
for panel, (name, true) in zip(panels, NUMBERS.items(), strict=True):
    scale, unit = (1e3, "ms") if name.endswith("_s") else (1.0, "m")
    value, sigma = scale * nav[name], scale * nav[f"sd_{name}"]
    panel.fill_between(since_s, value - sigma, value + sigma, color="tab:blue", alpha=0.25, lw=0.0)
    panel.plot(since_s, value, color="tab:blue")
    panel.axhline(scale * true, color="k", lw=0.8, ls="--")
    panel.set(title=name.rsplit("_", 1)[0].replace("_", " ") + f", {unit}", xlabel="time, s")
    panel.set_ylim(-45.0, 25.0) if name.endswith("_s") else panel.set_ylim(true - 0.4, true + 0.4)

# %% [markdown]
# Bands are one sigma, dashed lines the truth. The first turn shows the right and down components of the lever arm, and
# by its acceleration the time to some milliseconds. At constant speed an error of the time and one of the forward
# component have the same effect on the position, $v\tau=\delta l_x$. They separate as the speed changes, and what
# remains of both is still mostly one error. Without carrier phases the same turns show less:

# %%
last = runs["wrong file, states", 1].nav.iloc[-1]
speed_mps = float(np.hypot(last["vn_mps"], last["ve_mps"]))
forward_m, by_time_m = last["sd_lever_arm_x_m"], speed_mps * last["sd_imu_time_offset_s"]
print(f"{speed_mps:.0f} m/s times the sigma of the time: {by_time_m:.3f} m; sigma forward: {forward_m:.3f} m")
coarse = {**STATES, "measurements.carrier": False}
coarse_run = insgnss.replay(folder / "flight_1" / "wrong.toml", settings=coarse)
sigmas = {name: float(coarse_run.nav[f"sd_{name}"].iloc[-1]) for name in NUMBERS}
print("without carrier phases the sigmas are", {name: round(value, 4) for name, value in sigmas.items()})

# %% [markdown]
# ## The corrected file
#
# `insgnss check FLIGHT --run DIR` compares the run with the flight file and proposes the corrected keys; `--write`
# writes them. A correction is proposed where it exceeds three sigmas. The corrected file of the first flight then
# serves for the other two flights of the aircraft, without the states. (Without a run, `check` compares the two logs
# with each other. It suspects an offset too, with a sigma of 8 ms.)

# %%
runs["wrong file, states", 1].save(folder / "run")
command = ["check", str(folder / "flight_1" / "wrong.toml"), "--run", str(folder / "run")]
corrected = folder / "flight_1" / "corrected.toml"
told = subprocess.run(
    [sys.executable, "-m", "insgnss.cli", *command, "--write", str(corrected)],
    capture_output=True,
    text=True,
    check=True,
).stdout
print("\n".join(line for line in told.splitlines() if line.startswith("WARNING")))
lines = corrected.read_text(encoding="utf-8").splitlines()
changed = [line for line in lines if "# corrected" in line]
print("\n".join(changed))
for seed in SEEDS[1:]:
    same = folder / f"flight_{seed}" / "corrected.toml"
    same.write_text("\n".join(lines), encoding="utf-8")
    runs["corrected file", seed] = insgnss.replay(same)
after = over_sigma("corrected file", SEEDS[1:])
print(after.round(2).to_string())
keeper.cleanup()

# %% [markdown]
# ## Answer
#
# Errors within a flight are correlated in time, so each flight counts as one sample. The rms over three flights of an
# error over its sigma is then below a chi-square bound, which the wrong file exceeds.

# %%
bound, bound_two = (float(np.sqrt(chi2.ppf(0.999, n) / n)) for n in (len(SEEDS), len(SEEDS) - 1))
print(f"99.9 % of the rms of error over sigma: {bound:.2f} (three flights), {bound_two:.2f} (two)")
of_number = np.sqrt((found["error over sigma"] ** 2).groupby(level=0).mean())
assert ratios.loc["roll_deg", "wrong file"] > 2.0 * bound
assert (ratios["wrong file, search"] < bound).all()
assert (ratios["wrong file, states"] < bound).all() and (ratios["right file"] < bound).all()
assert (of_number < bound).all()
assert len(misplaced) == len(SEEDS) and len(known) == len(NUMBERS)
assert len(changed) == 2
assert (after < bound_two).all()
of_time, forward = found.loc[("imu_time_offset_s", 1)], found.loc[("lever_arm_x_m", 1)]
across = found.loc[["lever_arm_y_m", "lever_arm_z_m"], "sigma"].max()
wrong, states = (ratios.loc["roll_deg", label] for label in ("wrong file", "wrong file, states"))
print(
    f"Answer: the error of roll is {wrong:.1f} of its sigma with the wrong file and {states:.1f} with the states, which"
    f" find the time to {1e3 * of_time['sigma']:.1f} ms and the lever arm to {1e3 * forward['sigma']:.0f} mm forward"
    f" and {1e3 * across:.0f} mm right and down (sigma); errors over sigma {of_number.min():.1f} to"
    f" {of_number.max():.1f}; with the corrected file roll is at {after['roll_deg']:.1f} sigma in two other flights."
)
