# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#       format_version: '1.3'
#       jupytext_version: 1.19.6
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # 06 Loop aiding and its error budget
#
# **Question.** How far can a tracking loop trust the Doppler that the filter predicts for it, and what limits it?
#
# Candidates are the inertial sensors, the clock, the lever arm, and the time that passes until the number is used.
#
# The prediction for one satellite, with $\mathbf u$ the line of sight from the antenna to the satellite,
#
# $$\dot\rho = \mathbf u\cdot(\mathbf v_\mathrm{sat}-\mathbf v_\mathrm{ant}),\qquad
#   \mathbf v_\mathrm{ant}=\mathbf v_e+C_{eb}(\boldsymbol\omega\times\mathbf l_b),\qquad
#   f_D=-\frac{\dot\rho+c\,\dot\tau_\mathrm{rx}-c\,\dot\tau_\mathrm{sat}}{\lambda}$$
#
# is made at every fifth inertial sample, 20 times a second, and its variance is $\mathbf h P\mathbf h^T$ of the
# filter's covariance plus what the covariance does not hold. The sample flight is simulated, so the truth is known.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import insgnss
from insgnss.config.aiding import AidingConfig
from insgnss.constants import C_MPS, WGS84_OMEGA_RADPS
from insgnss.report.figures import STYLE
from insgnss.simulation.constellation import satellite_states
from insgnss.simulation.sample_flight import LEVER_ARM_B, SEED, START_S, sample_scenario
from insgnss.simulation.simulated_log import Simulator

plt.rcParams.update(STYLE | {"figure.dpi": 120, "figure.constrained_layout.use": True})
SAMPLE = Path("../data/sample_flight")
WAVELENGTH_M = C_MPS / 1575.42e6

flight = insgnss.Flight.load(SAMPLE / "flight.toml")


def replayed(**settings: float) -> insgnss.Run:
    """Replay the flight with the aiding; sigma are computed ten times a second, or as the settings say."""
    config = AidingConfig(**{"rate_hz": 20.0, "sigma_interval_s": 0.1} | settings)
    return insgnss.replay(flight, filter="tight17", aiding=config)


run = replayed()
known_s = run.heading_known_s()
print(
    f"{len(run.aiding)} predictions for {run.aiding['sv'].nunique()} satellites; heading known at {known_s:.0f} s"
)
run.aiding[run.aiding["time_s"] > known_s].groupby("sv", observed=True).first().head(4).transpose()

# %% [markdown]
# ## The truth
#
# The true distance is $\rho(t)=|\mathbf S(t-\rho/c)-\mathbf R(t)|$ in axes that do not turn; its derivatives are taken
# numerically. None of the filter's own equations enters: the trajectory is a spline, the orbits are the simulation's.

# %%
scenario = sample_scenario()
motion, ephemerides = scenario.trajectory, scenario.navigation.ephemerides
NAMES = list(ephemerides.sv_names)


def turned(r_e: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Turn ECEF vectors of the times ``t`` into the axes of ``t = 0``."""
    angle = WGS84_OMEGA_RADPS * t
    x, y, z = np.moveaxis(r_e, -1, 0)
    return np.stack(
        [np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y, z], axis=-1
    )


def true_range(t: np.ndarray, lever_b: tuple[float, float, float]) -> np.ndarray:
    """Return distances (times, satellites) to a point of the body, with light time."""
    r_e = motion.position_e(t) + motion.rotation_eb(t).apply(lever_b)
    antenna, rho = turned(r_e, t)[:, None], np.full((len(t), len(NAMES)), 2.2e7)
    for _ in range(4):
        sent = t[:, None] - rho / C_MPS
        satellite = turned(satellite_states(ephemerides, scenario.start_ns, sent).r_e, sent)
        rho = np.linalg.norm(satellite - antenna, axis=-1)
    return rho


def true_rate(
    t: np.ndarray, lever_b: tuple[float, float, float] = LEVER_ARM_B, h: float = 2.0**-6
) -> np.ndarray:
    """Return range rates by five points: rounding of 4e-9 m leaves 4e-7 m/s."""
    rho = {k: true_range(t + k * h, lever_b) for k in (-2, -1, 1, 2)}
    return (rho[-2] - 8.0 * rho[-1] + 8.0 * rho[1] - rho[2]) / (12.0 * h)


def table(found: insgnss.Run, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Return times, once the heading is known, and one column of the aiding as (times, satellites)."""
    aiding = found.aiding[found.aiding["time_s"].between(known_s + 30.0, START_S + 1199.0)]
    wide = aiding.pivot(index="time_s", columns="sv", values=column)
    return wide.index.to_numpy(), wide[NAMES].to_numpy(float)


def errors(found: insgnss.Run, every: int = 9) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, error of the predicted range rates and their sigma at every so many outputs."""
    time_s, rate = table(found, "range_rate_mps")
    sigma = table(found, "sd_range_rate_mps")[1]
    at = slice(None, None, every)
    return time_s[at], rate[at] - true_rate(time_s[at] - START_S), sigma[at]


# %%
time_s, error, sigma = errors(run)
scaled = error / sigma
within = np.mean(np.abs(scaled) < 3.0)
print(
    f"range rate: rms {1e3 * np.sqrt(np.mean(error**2)):.1f} mm/s, mean sigma {1e3 * sigma.mean():.1f} mm/s,"
)
print(f"rms of error / sigma {np.sqrt(np.mean(scaled**2)):.2f}, inside three sigma {100 * within:.2f} %")

nav = run.nav
figure, (upper, lower) = plt.subplots(2, 1, figsize=(7, 3.6), sharex=True, height_ratios=(2, 1))
for name, colour in (("G23", "tab:blue"), ("G16", "tab:red")):
    k = NAMES.index(name)
    upper.plot(time_s - START_S, 1e3 * error[:, k], color=colour, lw=0.6, label=f"{name}: error")
    for sign in (-3.0, 3.0):
        upper.plot(time_s - START_S, sign * 1e3 * sigma[:, k], color=colour, lw=0.8, ls="--")
upper.set_ylabel("range rate, mm/s\n(dashed: three sigma)")
upper.legend(loc="upper right")
lower.plot(nav["time_s"] - START_S, nav["roll_deg"], color="tab:gray")
lower.set_ylabel("roll, deg")
lower.set_xlabel("time since the log's start, s")

# %% [markdown]
# ## The clock
#
# A loop tracks the *received* Doppler, and that has the receiver's oscillator in it. With the flight's TCXO the drift
# walks by $\sqrt{q\,T}$, $q=2\pi^2c^2h_{-2}$, between two epochs: the clock that was known to 3 cm/s right after an
# update is known to 20 cm/s just before the next. The same seed gives the same log, so the true drift is known too.

# %%
clock = Simulator(scenario).draw(np.random.default_rng(SEED)).clock
doppler_s, doppler = table(run, "doppler_hz")
sd_doppler = table(run, "sd_doppler_hz")[1]

# at an epoch the aiding is from before its update: the last output of each second
whole = np.append(np.diff(np.ceil(doppler_s - 1e-3)) > 0, False)
t = doppler_s[whole] - START_S
satellite_drift = C_MPS * satellite_states(ephemerides, scenario.start_ns, t[:, None] - 0.075).clock_rate
drift = np.interp(t, clock.true_s, clock.drift_mps)
true_doppler = -(true_rate(t) + drift[:, None] - satellite_drift) / WAVELENGTH_M
scaled_doppler = (doppler[whole] - true_doppler) / sd_doppler[whole]
rms_doppler = float(np.sqrt(np.mean((doppler[whole] - true_doppler) ** 2)))
print(
    f"just before an update: Doppler rms {rms_doppler:.2f} Hz, mean sigma {sd_doppler[whole].mean():.2f} Hz,"
)
print(f"rms of error / sigma {np.sqrt(np.mean(scaled_doppler**2)):.2f}")

# %% [markdown]
# `sigma_interval_s` is one second when left out: between, the sigma grows by the walk of the clock and the noise of the
# accelerometers alone. With this oscillator nothing else grows as fast, and nothing is lost.

# %%
seldom = replayed(sigma_interval_s=1.0)
seldom_s, sd_seldom = table(seldom, "sd_doppler_hz")
k = NAMES.index("G23")
span = (doppler_s >= START_S + 300.0) & (doppler_s < START_S + 304.0)
figure, axes = plt.subplots(figsize=(5.5, 2.4))
axes.plot(doppler_s[span] - START_S, sd_doppler[span, k], label="sigma found every 0.1 s")
axes.plot(
    seldom_s[span] - START_S, sd_seldom[span, k], ls="--", label="every second, grown between (default)"
)
axes.set_xlabel("time since the log's start, s")
axes.set_ylabel("sigma of the Doppler of G23, Hz")
axes.set_ylim(0.0, 1.35)
axes.legend(ncols=2)
of_interval = float(np.median(sd_seldom[np.isin(seldom_s, doppler_s[whole]), k] / sd_doppler[whole, k]))
print(f"just before an update the sigma grown over a second is {of_interval:.2f} times the one just computed")

# %% [markdown]
# ## What the sigma is made of
#
# `run.aiding_budget` splits the variance into the blocks of $P$; what their correlations add stands in `cross_*`. The
# parts of the radial acceleration matter to a loop that is led by it between two predictions.

# %%
budget = run.aiding_budget
budget = budget[(budget["sv"] == "G16") & (budget["time_s"] > known_s + 30.0)]
parts = ("velocity", "attitude", "accelerometer", "gyro", "clock", "satellite", "motion")
colours = dict(zip(parts, plt.rcParams["axes.prop_cycle"].by_key()["color"], strict=False))
figure, panels = plt.subplots(2, 1, figsize=(7, 4.2), sharex=True)
for axes, kind, unit in ((panels[0], "rate", "mps"), (panels[1], "acceleration", "mps2")):
    for part in parts:
        value = budget[f"sd_{kind}_{part}_{unit}"].to_numpy()
        if value.max() > 0.0:
            smooth = np.sqrt(np.convolve(value**2, np.full(10, 0.1), mode="valid"))  # over a second
            axes.semilogy(budget["time_s"].to_numpy()[9:] - START_S, smooth, label=part, color=colours[part])
panels[0].set_ylabel("sigma of the rate, m/s")
panels[1].set_ylabel("sigma of the acceleration, m/s²")
panels[1].set_xlabel("time since the log's start, s")
panels[0].set_title("G16, mean over each second; parts that are zero are left out")
panels[1].legend(ncols=6, loc="upper center", bbox_to_anchor=(0.5, 0.45))
share = {p: float(np.mean(budget[f"sd_rate_{p}_mps"] ** 2)) for p in parts}
print({p: f"{100 * v / sum(share.values()):.1f} %" for p, v in share.items() if v > 0.0})

# %% [markdown]
# ## The lever arm
#
# The antenna is 1.36 m from the IMU; while the aircraft rolls it moves by $\boldsymbol\omega\times\mathbf l$. How
# wrong is the aiding without the lever arm?

# %%
lever_term = true_rate(time_s - START_S) - true_rate(time_s - START_S, (0.0, 0.0, 0.0))
largest = float(np.abs(lever_term).max())
at = np.unravel_index(np.abs(lever_term).argmax(), lever_term.shape)
print(
    f"the lever arm's part: up to {1e3 * largest:.0f} mm/s ({largest / WAVELENGTH_M:.2f} Hz), for {NAMES[at[1]]} at"
)
print(
    f"{time_s[at[0]] - START_S:.0f} s; that is {largest / sigma[at]:.0f} sigma of the prediction that has it in"
)

# %% [markdown]
# ## The latency
#
# A prediction is used some milliseconds after the inertial sample it rests on. The aiding leads the rate on with the
# radial acceleration, $\dot\rho(t+L)=\dot\rho+\ddot\rho L$; what is left is the jerk, $\tfrac12 j L^2$, for which the
# sigma allows 5 m/s³. Without the acceleration the error would be $\ddot\rho L$.

# %%
latencies = (0.0, 0.05, 0.1, 0.2)
found = []
for latency_s in latencies:
    late = replayed(latency_s=latency_s, rate_hz=10.0)
    late_s, late_error, late_sigma = errors(late, every=7)
    acceleration = table(late, "range_acceleration_mps2")[1][::7]
    held = late_error - latency_s * acceleration  # the rate of the sample, used as it is
    rms = [float(np.sqrt(np.mean(x**2))) for x in (late_error, held, late_sigma, late_error / late_sigma)]
    found.append([*rms, float(np.abs(late_error).max()), float(np.abs(held).max())])
by_latency = np.array(found)

figure, axes = plt.subplots(figsize=(7, 2.6))
milliseconds = 1e3 * np.array(latencies)
axes.semilogy(milliseconds, 1e3 * by_latency[:, 5], "s-", ms=4, label="largest error, rate held")
axes.semilogy(
    milliseconds, 1e3 * by_latency[:, 4], "s--", ms=4, label="largest error, led on by the acceleration"
)
axes.semilogy(milliseconds, 1e3 * by_latency[:, 2], "o-", ms=4, color="k", label="sigma (rms)")
axes.semilogy(milliseconds, 1e3 * by_latency[:, 0], "o--", ms=4, label="rms error, led on")
axes.set_xlabel("latency, ms")
axes.set_ylabel("range rate, mm/s")
axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
print("latency, ms:", [round(1e3 * latency_s) for latency_s in latencies])
print(
    "largest error led on, mm/s: ",
    (1e3 * by_latency[:, 4]).round(),
    " held: ",
    (1e3 * by_latency[:, 5]).round(),
)

# %% [markdown]
# ## Answer
#
# Between two updates the aiding cannot predict the oscillator: a quieter one is worth more than better gyros.

# %%
rms_rate = float(np.sqrt(np.mean(error**2)))
consistency = float(np.sqrt(np.mean(scaled**2)))
motion_hz, lever_hz = rms_rate / WAVELENGTH_M, largest / WAVELENGTH_M
led_hz, held_hz = by_latency[2, 4:] / WAVELENGTH_M

assert 0.7 < consistency < 1.1 and within > 0.99
assert rms_rate < 0.025
assert 0.8 < np.sqrt(np.mean(scaled_doppler**2)) < 1.2 and rms_doppler > 5.0 * motion_hz
assert 0.9 < of_interval < 1.1
assert largest > 5.0 * sigma[at]
assert led_hz < 0.25 * held_hz and np.all(by_latency[:, 3] < 1.1)
print(
    f"Answer: the motion is predicted to {1e3 * rms_rate:.0f} mm/s rms, {motion_hz:.2f} Hz at L1, and the sigma says"
    f" so (error over sigma {consistency:.2f} rms, {100 * within:.1f} % inside three sigma); the TCXO limits the"
    f" Doppler to {rms_doppler:.2f} Hz just before an update; without the lever arm a roll would mislead the loop by"
    f" {lever_hz:.1f} Hz; 100 ms of latency cost at most {led_hz:.1f} Hz when led on by the radial acceleration,"
    f" {held_hz:.1f} Hz when not."
)
