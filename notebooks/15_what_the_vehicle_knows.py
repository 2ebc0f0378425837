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
# # 15 What the vehicle knows
#
# **Question.** A car has no satellites for a minute: how much smaller does the position error become when the filter
# knows that it is in a car, and when it reads the car's odometer and a barometer?
#
# Each adds a measurement that needs no satellite. With the velocity $C_{be}v_e$ in body axes, the height $h$ and the
# rate of turn $\omega$, the filter predicts
#
# | source | measurement |
# |---|---|
# | `[vehicle] kind = "car"`, moving | $0=y\cdot C_{mb}C_{be}v_e$ and $0=z\cdot C_{mb}C_{be}v_e$ at the rear axle |
# | `[vehicle] kind = "car"`, at rest | $0=v_e$ and $0=\omega$ |
# | `[[sensor]] kind = "odometer"` | $s=(1+k)\,x\cdot C_{be}v_e$ |
# | `[[sensor]] kind = "barometer"` | $b=h+o$ |
#
# The mounting $C_{mb}$ of the IMU in the car, the odometer's scale factor $k$ and the barometer's offset $o$ are
# states.

# %%
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
SEEDS = range(1, 4)
GONE_S, END_S = 110.0, 170.0  # the satellites are gone from the one to the other, the end of the drive

# %% [markdown]
# ## A drive that ends underground
#
# The car stands for 20 s, drives with four corners and two stops, and loses all satellites after 110 s. The last minute
# has two of the corners, a stop of 15 s and a start. The IMU is of industrial grade. The simulator draws the sensors'
# scale factor, offset, drift and noise; the flight file declares their sigmas.

# %%


def move(kind: str, duration_s: float, **more: float) -> str:
    """Return a manoeuvre of the scenario file."""
    keys = {"duration_s": duration_s, **more}
    return "\n".join(["[[manoeuvre]]", f'kind = "{kind}"', *(f"{key} = {keys[key]}" for key in keys)])


def block(side: float) -> list[str]:
    """Return 71 s between two stops, with corners to one side."""
    return [
        move("accelerate", 8.0, to_mps=13.0),
        move("straight", 12.0),
        move("accelerate", 4.0, to_mps=6.0),
        move("steer", 5.0, by_deg=90.0 * side),
        move("accelerate", 5.0, to_mps=11.0),
        move("straight", 9.0),
        move("accelerate", 4.0, to_mps=6.0),
        move("steer", 4.0, by_deg=60.0 * side),
        move("accelerate", 5.0, to_mps=0.0),
        move("straight", 15.0),
    ]


DRIVE = "\n".join([move("straight", 20.0), *block(1.0), *block(-1.0), move("accelerate", 8.0, to_mps=13.0)])
SCENARIO = f"""
name = "garage"
source = "corners of 5 s at 6 m/s, stops of 15 s"
gps_week = 2385
start_s = 300000.0
place = {{ lat_deg = 47.0, lon_deg = 8.0, h_m = 300.0, heading_deg = 35.0 }}
{DRIVE}
[imu]
grade = "industrial"
rate_hz = 50.0
[gnss]
lever_arm_m = [0.5, 0.1, -0.8]
[[sensor]]
kind = "odometer"
rate_hz = 2.0
lever_arm_m = [0.0, 0.7, 0.3]
[[sensor]]
kind = "barometer"
rate_hz = 1.0
[[fault]]
kind = "outage"
from_s = {GONE_S}
"""

# %% [markdown]
# ## Four flight files for the same logs
#
# The simulator writes a flight file with both sensors. The others leave them out or add the vehicle's kind. The IMU is
# at the middle of the rear axle; `axle_m` says so.

# %%
CAR = '\n[vehicle]\nkind = "car"\nnon_holonomic = { axle_m = [0.0, 0.0, 0.0] }\n'
keeper = tempfile.TemporaryDirectory()


def drive(text: str, seed: int, name: str) -> dict[str, Path]:
    """Return the flight files of a simulated drive by what the filter knows."""
    folder = Path(keeper.name) / name
    folder.with_suffix(".toml").write_text(text, encoding="utf-8")
    simulate(folder.with_suffix(".toml"), seed).save(folder)
    sensors = (folder / "flight.toml").read_text(encoding="utf-8")
    head, _, rest = sensors.partition("[[sensor]]")
    alone = head + rest[rest.index("[reference]") :]
    texts = {"IMU alone": alone, "car": alone + CAR, "sensors": sensors, "car and sensors": sensors + CAR}
    files = {label: folder / f"flight_{i}.toml" for i, label in enumerate(texts)}
    for label, file in files.items():
        file.write_text(texts[label], encoding="utf-8")
    return files


runs: dict[tuple[str, int], insgnss.Run] = {}
for seed in SEEDS:
    for label, file in drive(SCENARIO, seed, f"drive_{seed}").items():
        runs[label, seed] = insgnss.replay(file, output=1.0)
LABELS = list(dict.fromkeys(label for label, _ in runs))
print(runs["car and sensors", SEEDS[0]].nis_summary().round(2).to_string())


# %% [markdown]
# ## The end of the minute
#
# Errors in the last row, over three drives. "Horizontal" is the root of the sum of the squares north and east; its
# error over sigma is the rms of both ratios.


# %%
def last_rows(label: str) -> pd.DataFrame:
    """Return the errors and sigmas at the end of each drive."""
    return pd.DataFrame([runs[label, seed].errors.iloc[-1] for seed in SEEDS], index=list(SEEDS))


def over_sigma(rows: pd.DataFrame, axes: str) -> pd.Series:
    """Return the rms over some axes of error over sigma, for each drive."""
    ratios = [(rows[f"d_{axis}_m"] / rows[f"sd_{axis}_m"]) ** 2 for axis in axes]
    return np.sqrt(sum(ratios) / len(axes))


def rms(values: pd.Series) -> float:
    return float(np.sqrt((values**2).mean()))


ends = {}
for label in LABELS:
    rows = last_rows(label)
    ends[label] = {
        "horizontal, m": rms(np.hypot(rows["d_n_m"], rows["d_e_m"])),
        "sigma, m": rms(np.hypot(rows["sd_n_m"], rows["sd_e_m"])),
        "over sigma": rms(over_sigma(rows, "ne")),
        "height, m": rms(rows["d_d_m"]),
        "sigma of height, m": rms(rows["sd_d_m"]),
        "height over sigma": rms(over_sigma(rows, "d")),
    }
ends = pd.DataFrame(ends).T
print(ends.round(2).to_string())

# %% [markdown]
# ## Over time
#
# Left: horizontal error (lines) and one sigma (dashed), rms over the drives. The car's stop lasts from 147 to 162 s.
# Right: error over sigma at the end of each drive, horizontal (dots) and of the height (crosses).

# %%
COLOURS = dict(zip(LABELS, ("tab:red", "tab:blue", "tab:orange", "tab:green"), strict=True))
figure, (left, right) = plt.subplots(1, 2, figsize=(7.4, 3.0), width_ratios=(3, 2))
for k, label in enumerate(LABELS):
    tables = [runs[label, seed].errors for seed in SEEDS]
    since_s = tables[0]["time_s"] - 300_000.0
    error = np.sqrt(np.mean([t["d_n_m"] ** 2 + t["d_e_m"] ** 2 for t in tables], axis=0))
    sigma = np.sqrt(np.mean([t["sd_n_m"] ** 2 + t["sd_e_m"] ** 2 for t in tables], axis=0))
    shown = since_s > GONE_S - 20.0
    left.semilogy(since_s[shown], error[shown], color=COLOURS[label], label=label)
    left.semilogy(since_s[shown], sigma[shown], color=COLOURS[label], ls="--", lw=0.8)
    rows = last_rows(label)
    right.plot(np.full(len(SEEDS), k - 0.1), over_sigma(rows, "ne"), "o", ms=3, color=COLOURS[label])
    right.plot(np.full(len(SEEDS), k + 0.1), over_sigma(rows, "d"), "x", ms=4, color=COLOURS[label])
left.axvspan(GONE_S, END_S, color="0.93", zorder=0)
left.set(xlabel="time, s", ylabel="horizontal error, m (dashed: sigma)")
left.legend()
right.axhline(1.0, color="k", lw=0.6)
right.set(ylabel="error over sigma at the end", ylim=(0.0, 3.0))
right.set_xticks(range(len(LABELS)), [label.replace(" and ", "\nand ") for label in LABELS])

# %% [markdown]
# With the IMU alone the error grows with about the square of time. The odometer measures the velocity along the road,
# the car's constraint the velocity across it. What one of them leaves open it measures after a corner: both sigmas step
# down at the corner at 140 s, and with the velocity's error the filter corrects the position error that came from it.
# With both, no component of the velocity is open. Constraint and barometer each hold the height.
#
# Imperfect: the car's rows have sigmas for tyres that slip and for an engine that shakes a standing car. The simulated
# car does neither, so the NIS of these rows is far below 1, and the errors of the car are smaller than its sigma says.

# %% [markdown]
# ## When the sensors are wrong
#
# For 10 s a wheel turns 30 % too fast, and for 30 s a window changes the pressure by 1 hPa, which is 8.4 m. The gate
# refuses the odometer until it agrees again. Pressures that are off one after the other, when the window opens and when
# it closes, are a step of the barometer's offset, which is estimated anew. The events say so.

# %%
WRONG = """
[[fault]]
kind = "slip"
from_s = 125.0
to_s = 135.0
share = 0.3
[[fault]]
kind = "draught"
from_s = 120.0
to_s = 150.0
size_hpa = 1.0
"""
wrong = insgnss.replay(drive(SCENARIO + WRONG, SEEDS[0], "wrong")["car and sensors"], output=1.0)
sound = runs["car and sensors", SEEDS[0]]
told = wrong.events[wrong.events["kind"].isin(["sensor_refused", "sensor_agrees", "sensor_stepped"])]
for since_s, kind, detail in zip(told["time_s"] - 300_000.0, told["kind"], told["detail"], strict=True):
    print(f"{since_s:5.0f} s  {kind:15} {detail}")
ledger = wrong.measurements
ledger = ledger[ledger["kind"].isin(["odometer", "barometer"]) & (ledger["time_s"] > 300_000.0 + GONE_S)]
print(ledger.groupby(["kind", "status"], observed=True).size().to_string())
moved = (
    wrong.errors[["d_n_m", "d_e_m", "d_d_m"]].iloc[-1] - sound.errors[["d_n_m", "d_e_m", "d_d_m"]].iloc[-1]
)
moved_m = float(np.linalg.norm(moved))
print(f"both faults move the position at the end by {moved_m:.2f} m")
keeper.cleanup()

# %% [markdown]
# ## Answer
#
# What is claimed of the sizes is claimed of the sigmas, which do not depend on the seed, and the errors must agree with
# the sigmas: three squared ratios are a chi-square variable of three degrees of freedom. North and east together count
# as one, as if they were the same error, which leaves the bounds wide.

# %%
low, high = np.sqrt(chi2.ppf((5e-4, 1.0 - 5e-4), len(SEEDS)) / len(SEEDS))
print(f"rms of error over sigma of {len(SEEDS)} drives in 99.9 % of the cases: {low:.2f} to {high:.2f}")
sigma = ends["sigma, m"]
assert ends[["over sigma", "height over sigma"]].stack().between(low, high).all()
assert sigma["car"] < 0.1 * sigma["IMU alone"]
assert sigma["sensors"] < 0.2 * sigma["IMU alone"]
assert sigma["car and sensors"] < 0.8 * sigma["car"]
assert ends["sigma of height, m"].iloc[1:].max() < 0.5 * ends["sigma of height, m"].iloc[0]
assert told["kind"].value_counts().to_dict() == {"sensor_stepped": 2, "sensor_refused": 1, "sensor_agrees": 1}
assert moved_m < rms(sound.errors[["sd_n_m", "sd_e_m", "sd_d_m"]].iloc[-1])  # less than one sigma
assert not any({"reset", "restart", "rows_contradict"} & set(run.events["kind"]) for run in runs.values())
metres = ends["horizontal, m"]
print(
    f"Answer: after a minute without satellites the horizontal error is {metres['IMU alone']:.0f} m with the IMU alone,"
    f" {metres['sensors']:.1f} m with odometer and barometer, {metres['car']:.1f} m as a car and"
    f" {metres['car and sensors']:.1f} m with all of it (sigma {sigma['IMU alone']:.0f}, {sigma['sensors']:.1f},"
    f" {sigma['car']:.1f}, {sigma['car and sensors']:.1f} m); error over sigma {ends['over sigma'].min():.2f} to"
    f" {ends['over sigma'].max():.2f}; a wheel that slips and a draught move the solution by {moved_m:.2f} m."
)
