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
# # 03 The error model and what turns observe
#
# **Question.** Which errors of heading, tilt, gyros and accelerometers does GNSS leave open in straight flight, and how
# much do turns add?
#
# First the error model answers by counting what can be seen at all; then two simulated flights of ten minutes, one
# straight and one with turns, show it in standard deviations and in true errors.

# %%
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.linalg import expm

import insgnss
from insgnss.geodesy.rotations import euler_to_matrix
from insgnss.report.figures import STYLE
from insgnss.runs.simulate import simulate

plt.rcParams.update(STYLE | {"figure.dpi": 120, "figure.constrained_layout.use": True})
G_MPS2 = 9.81

# %% [markdown]
# ## What the model lets us see
#
# The part of the error state that matters within minutes is velocity, attitude and the six biases (error = estimate
# minus truth, $\hat C = (I + [\psi\times])\, C$; the biases are errors of the filter's estimates):
#
# $$ \dot{\delta v} = \psi \times f_n - C_{nb}\,\delta b_a , \qquad \dot\psi = -\,C_{nb}\,\delta b_g , \qquad
#    \dot{\delta b} = 0 . $$
#
# GNSS shows $\delta v$. In straight flight $f_n = (0, 0, -g)$ and $C_{nb}$ is constant, so
# $\ddot{\delta v}_n$ and $\ddot{\delta v}_e$ see only sums:
#
# - a tilt $\psi_e$ and an accelerometer bias $-\delta b_a/g$ do the same to the velocity: only their sum is seen,
# - $\psi_d$, the heading, stands in no line at all, and so does the bias of the gyro that points down.
#
# A turn has a horizontal acceleration $a = g \tan\varphi$, which $\psi_d$ turns into a wrong direction, and it carries
# the biases round while the tilts stay. We stack $H\,\Phi(t_k)$ over a flight, each state in units of its first sigma,
# and count the singular values that are not zero: the directions of the error state that GNSS can see.

# %%
FIRST_SIGMA = np.repeat([0.1, np.radians(1.0), 0.03, np.radians(10.0) / 3600.0], 3)  # dv, psi, b_a, b_g


def cross(a: np.ndarray) -> np.ndarray:
    """Return [a x]."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def seen(
    bank_deg: float, speed_mps: float = 70.0, straight_s: float = 60.0, turn_s: float = 60.0
) -> np.ndarray:
    """Return the singular values of a flight that goes straight, then turns with this bank (0: straight on)."""
    step_s, C_nb, Phi, rows, yaw = 0.5, np.zeros((3, 3)), np.eye(12), [], 0.0
    for k in range(int((straight_s + turn_s) / step_s)):
        bank = np.radians(bank_deg) if k * step_s >= straight_s else 0.0
        yaw += G_MPS2 * np.tan(bank) / speed_mps * step_s
        euler_to_matrix(bank, 0.0, yaw, C_nb)
        across = G_MPS2 * np.tan(bank) * np.array([-np.sin(yaw), np.cos(yaw), 0.0])
        f_n = across - np.array([0.0, 0.0, G_MPS2])
        F = np.zeros((12, 12))
        F[0:3, 3:6] = -cross(f_n)  # psi x f = -f x psi
        F[0:3, 6:9] = -C_nb
        F[3:6, 9:12] = -C_nb
        Phi = expm(F * step_s) @ Phi
        rows.append(Phi[0:3])
    return np.linalg.svd(np.concatenate(rows) * FIRST_SIGMA, compute_uv=False)


visible = {bank_deg: seen(bank_deg) for bank_deg in (0.0, 30.0)}
rank = {bank_deg: int(np.sum(values > 1e-9 * values[0])) for bank_deg, values in visible.items()}
for bank_deg, values in visible.items():
    print(
        f"bank {bank_deg:2.0f} deg: {rank[bank_deg]:2d} of 12 directions seen; smallest {values[-5:].round(6)}"
    )

# %% [markdown]
# Four directions are hidden in straight flight: heading, gyro bias about down, and one combination of tilt and
# accelerometer bias for each horizontal axis.
#
# ## Two flights
#
# A sensor with a gyro bias of 10 deg/h and an accelerometer bias of 3 mg at 70 m/s, GPS at 1 Hz. Both filters begin
# with the same start: heading known to 3 deg (and 2 deg wrong), tilt to 0.5 deg. The second flight has an S-turn after
# four minutes and another after seven.

# %%
HEAD = """
gps_week = 2385
start_s = 293700.0
place = { lat_deg = 59.97, lon_deg = 30.32, h_m = 1000.0, heading_deg = 40.0 }
speed_mps = 70.0

[imu.grade]
gyro_bias_deg_per_h = 10.0
gyro_bias_instability_deg_per_h = 0.3
gyro_correlation_time_s = 1000.0
gyro_arw_deg_per_sqrt_h = 0.1
accel_bias_mg = 3.0
accel_bias_instability_mg = 0.1
accel_correlation_time_s = 1000.0
accel_vrw_mps_per_sqrt_h = 0.06

"""
STRAIGHT = '[[manoeuvre]]\nkind = "straight"\nduration_s = {}\n'
S_TURN = '[[manoeuvre]]\nkind = "s_turn"\nby_deg = 60.0\nbank_deg = 30.0\n'
FLIGHTS = {
    "straight": HEAD + STRAIGHT.format(600.0),
    "with turns": HEAD
    + STRAIGHT.format(240.0)
    + S_TURN
    + STRAIGHT.format(110.0)
    + S_TURN
    + STRAIGHT.format(150.0),
}
START = """
[start]
time_s = 293701.0
lat_deg = {lat_deg}
lon_deg = {lon_deg}
h_m = {h_m}
v_ned_mps = [{vn}, {ve}, {vd}]
rpy_deg = [{roll_deg}, {pitch_deg}, {yaw_deg}]
sd_position_m = 5.0
sd_velocity_mps = 0.3
sd_roll_pitch_deg = 0.5
sd_yaw_deg = 3.0
"""


def fly(scenario: str, seed: int) -> insgnss.Run:
    """Simulate, give the filter a start that is 2 deg wrong in heading, and replay."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scenario.toml").write_text(scenario)
        simulate(folder / "scenario.toml", seed, duration_s=600.0).save(folder)
        truth = pd.read_csv(folder / "reference.csv").set_index("time_s").loc[293701.0]
        start = START.format(**(truth + pd.Series({"yaw_deg": 2.0}).reindex(truth.index, fill_value=0.0)))
        declared = (folder / "flight.toml").read_text().replace('start = "automatic"\n', "")
        (folder / "flight.toml").write_text(declared + start)
        return insgnss.replay(folder / "flight.toml")


runs = {name: fly(scenario, seed=3) for name, scenario in FLIGHTS.items()}


# %% [markdown]
# ## Sigma over time
#
# Solid lines are the filter's sigma, dots the true errors where the reference has them; turns are grey.

# %%
MG, DEG_PER_H = 9.80665e-3, np.radians(1.0) / 3600.0
COLOURS = dict(zip(FLIGHTS, ("C3", "C0"), strict=True))
turning = runs["with turns"].nav["roll_deg"].abs() > 10.0
figure, panels = plt.subplots(2, 2, figsize=(7.2, 4.4), sharex=True)
yaw, tilt, accel, gyro = panels.ravel()
for name, run in runs.items():
    nav, errors, colour = run.nav, run.errors, COLOURS[name]
    t_s = nav["time_s"] - 293700.0
    yaw.semilogy(t_s, nav["sd_yaw_deg"], color=colour, label=name)
    yaw.semilogy(errors["time_s"] - 293700.0, errors["d_yaw_deg"].abs(), ".", ms=1, color=colour)
    tilt.semilogy(t_s, nav["sd_pitch_deg"], color=colour)
    tilt.semilogy(errors["time_s"] - 293700.0, errors["d_pitch_deg"].abs(), ".", ms=1, color=colour)
    for axis, style in (("x", "-"), ("y", "--"), ("z", ":")):
        label = axis if name == "straight" else None
        accel.semilogy(t_s, nav[f"sd_accel_bias_{axis}_mps2"] / MG, style, color=colour, label=label)
        gyro.semilogy(t_s, nav[f"sd_gyro_bias_{axis}_radps"] / DEG_PER_H, style, color=colour, label=label)
for axes, what in zip(
    panels.ravel(), ("yaw, deg", "pitch, deg", "accelerometer bias, mg", "gyro bias, deg/h"), strict=True
):
    axes.set_ylabel(f"sigma of {what}")
    axes.fill_between(t_s, 0, 1, where=turning, color="0.9", transform=axes.get_xaxis_transform(), lw=0)
yaw.set_ylim(0.01, 30.0)
tilt.set_ylim(0.001, 1.0)
yaw.legend(title="dots: true error")
accel.set_ylim(0.02, 10.0)
accel.legend(ncols=3, loc="upper right")
for axes in panels[1]:
    axes.set_xlabel("time since the start, s")
plt.show()

# %% [markdown]
# In straight flight the heading keeps the sigma it began with (slowly the unseen bias of the down gyro adds to it), and
# the sigma of a tilt times $g$ is that of the accelerometer bias: they are known only as a sum. The two gyros that lie
# level are seen at once, through the tilt they would cause, and so is the vertical accelerometer. An S-turn betters the
# other four within a minute. After it the heading drifts again, but with a bias that is now known better.
#
# A turn also brings out scale factors, misalignments and what specific force does to the gyros. This simulated sensor
# has scale factors alone; the filter has a state for each error that the grade names. And with a bias of 80 deg/h
# (industrial grade) the heading's error grew to 25 deg in straight flight, where linear error dynamics no longer hold:
# sigma was 8 deg.
#
# ## Answer

# %%
before = {name: run.nav.set_index("time_s").loc[293935.0] for name, run in runs.items()}
after = {name: run.nav.set_index("time_s").loc[294240.0] for name, run in runs.items()}
COLUMNS = {
    "yaw, deg": ("sd_yaw_deg", 1.0),
    "pitch, deg": ("sd_pitch_deg", 1.0),
    "accelerometer bias forward, mg": ("sd_accel_bias_x_mps2", MG),
    "accelerometer bias down, mg": ("sd_accel_bias_z_mps2", MG),
    "gyro bias forward, deg/h": ("sd_gyro_bias_x_radps", DEG_PER_H),
    "gyro bias down, deg/h": ("sd_gyro_bias_z_radps", DEG_PER_H),
}
found = pd.DataFrame(
    {
        label: {name: values[column] / unit for name, values in after.items()}
        for label, (column, unit) in COLUMNS.items()
    }
).T
found["ratio"] = found["straight"] / found["with turns"]
print("sigma after nine minutes\n", found.round(2))

level = before["straight"]
assert rank == {0.0: 8, 30.0: 12}
# in straight flight the tilt is the accelerometer's bias
assert abs(np.radians(level["sd_pitch_deg"]) * G_MPS2 / level["sd_accel_bias_x_mps2"] - 1.0) < 0.05
assert found["straight"]["yaw, deg"] > 0.9 * 3.0 and found["straight"]["gyro bias down, deg/h"] > 0.9 * 10.0
assert found["ratio"]["yaw, deg"] > 50.0
assert found["ratio"][["pitch, deg", "accelerometer bias forward, mg", "gyro bias down, deg/h"]].min() > 8.0
assert found["ratio"][["accelerometer bias down, mg", "gyro bias forward, deg/h"]].between(0.8, 2.0).all()
for name, run in runs.items():
    errors = run.errors[["d_roll_deg", "d_pitch_deg", "d_yaw_deg"]].to_numpy()
    sigmas = run.errors[["sd_roll_deg", "sd_pitch_deg", "sd_yaw_deg"]].to_numpy()
    assert np.mean(np.abs(errors) < 3.0 * sigmas) > 0.98, name
straight, turned = found["straight"], found["with turns"]
print(
    f"Answer: straight flight leaves {12 - rank[0.0]} of 12 directions open: heading, down gyro, and tilt against"
    " accelerometer twice. After nine minutes sigma of the heading is"
    f" {straight['yaw, deg']:.1f} deg and of the down gyro {straight['gyro bias down, deg/h']:.0f} deg/h; with two"
    f" S-turns {turned['yaw, deg']:.2f} deg and {turned['gyro bias down, deg/h']:.1f} deg/h, tilt"
    f" {found['ratio']['pitch, deg']:.0f} times and level accelerometers"
    f" {found['ratio']['accelerometer bias forward, mg']:.0f} times better; level gyros and the down accelerometer"
    " are seen without turns."
)
