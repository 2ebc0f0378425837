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
# # 01 Replay your log
#
# **Question.** How do I get a reliable position from my own CSV logs, with their own columns, units and axes?
#
# Four steps: say in a flight file what the log does not say itself, let the log be checked, replay it, and look at what
# the filter thinks of every satellite before believing the result.

# %%
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import insgnss
from insgnss.gpstime import GPS_EPOCH
from insgnss.report import figures

plt.rcParams.update(figures.STYLE | {"figure.dpi": 120, "figure.constrained_layout.use": True})
SAMPLE = Path("../data/sample_flight").resolve()
scratch = tempfile.TemporaryDirectory()
folder = Path(scratch.name)

# %% [markdown]
# ## A log as loggers write them
#
# To have an answer to compare with, we take the sample flight and write its inertial samples as a logger of its own
# mind would: a unit in the header, deg/s and g, milliseconds of Unix time in UTC, axes right-forward-up, semicolons.

# %%
imu = pd.read_csv(SAMPLE / "imu.csv.gz")
DEG_PER_S, G = np.degrees(1.0), 1.0 / 9.80665
week_start = GPS_EPOCH + pd.Timedelta(weeks=2385)
utc_ms = imu["time_s"] * 1000.0 + (week_start - pd.Timestamp(1970, 1, 1)) / pd.Timedelta("1ms") - 18_000.0
log = pd.DataFrame(
    {
        "Stamp [ms]": utc_ms.round().astype(int),
        "GyrX (dps)": imu["gyro_y"] * DEG_PER_S,  # X to the right
        "GyrY (dps)": imu["gyro_x"] * DEG_PER_S,  # Y ahead
        "GyrZ (dps)": -imu["gyro_z"] * DEG_PER_S,  # Z up
        "AccX (g)": imu["accel_y"] * G,
        "AccY (g)": imu["accel_x"] * G,
        "AccZ (g)": -imu["accel_z"] * G,
    }
)
log.to_csv(folder / "logger.csv", sep=";", index=False, float_format="%.7f")
print((folder / "logger.csv").read_text()[:330])

# %% [markdown]
# ## The flight file
#
# It declares columns, units, axes and time; nothing is guessed. `axes` names the sensor axis that points forward, right
# and down: here `+y`, `+x`, `-z`. The grade says how good the sensor is (a name in `models/imus/` or numbers), the
# lever arm goes from the IMU to the antenna. At first we forget that the accelerometers are in g.

# %%
DECLARED = f"""
name = "my flight"
gps_week = 2385

[imu]
files = ["logger.csv"]
gyro_unit = "deg/s"
accel_unit = "m/s^2"
axes = ["+y", "+x", "-z"]

[imu.columns]
time = "Stamp [ms]"
gyro = ["GyrX (dps)", "GyrY (dps)", "GyrZ (dps)"]
accel = ["AccX (g)", "AccY (g)", "AccZ (g)"]

[imu.time]
unit = "ms"
origin = "unix_epoch"
scale = "utc"

[imu.grade]
gyro_bias_deg_per_h = 1.0
gyro_bias_instability_deg_per_h = 0.3
gyro_correlation_time_s = 1000.0
gyro_arw_deg_per_sqrt_h = 0.1
gyro_scale_factor_ppm = 100.0
accel_bias_mg = 1.0
accel_bias_instability_mg = 0.2
accel_correlation_time_s = 1000.0
accel_vrw_mps_per_sqrt_h = 0.06
accel_scale_factor_ppm = 100.0

[gnss]
files = ["{(SAMPLE / "gnss.csv").as_posix()}"]
navigation = ["{(SAMPLE / "nav.rnx").as_posix()}"]
lever_arm_m = [0.8, 0.0, -1.1]
oscillator = {{ h0_s = 2e-19, h_minus2_per_s = 2e-20 }}

[reference]
file = "{(SAMPLE / "reference.csv").as_posix()}"
"""
(folder / "flight.toml").write_text(DECLARED)
wrong = insgnss.check_flight(insgnss.Flight.load(folder / "flight.toml"))
print("\n".join(finding.line() for finding in wrong.of("error")))

# %% [markdown]
# Gravity gives it away, and the advice names the unit that fits. With it the log passes: rates, time overlap, tilt at
# rest, the sign of the Doppler, satellites with an ephemeris. (A gyro's unit shows only where the sensor turns; rates
# beyond the sensor's range are noticed if the grade has `gyro_range_deg_per_s`.)

# %%
(folder / "flight.toml").write_text(DECLARED.replace('accel_unit = "m/s^2"', 'accel_unit = "g"'))
flight = insgnss.Flight.load(folder / "flight.toml")
report = insgnss.check_flight(flight)
print("\n".join(report.lines()[2:]))

# %% [markdown]
# ## Replay
#
# One call. `run.nav` is the solution with its standard deviations, `run.measurements` the ledger: one row for each
# measurement of the log, with its innovation $\nu$ (measured minus predicted), the predicted $\sigma_\nu$ and
# $\mathrm{NIS} = \nu^2 / \sigma_\nu^2$, and whether it was used or why not.

# %%
run = insgnss.replay(flight, filter="tight17")
print(run.status_counts(), "\n")
print(run.events[["time_s", "kind"]].dropna().to_string(index=False))
figures.track(run)

# %% [markdown]
# ## What the filter thinks of each satellite
#
# Innovations that agree with their sigma have a mean NIS of 1 and lie below the 95 % bound (3.84) in 95 % of the cases;
# far above it the noise is larger than assumed, far below it smaller. A satellite whose innovations have a mean, in the
# picture a row of points that sits off the zero line, has a bias of its own (multipath, a wrong ephemeris).

# %%
used = run.measurements[run.measurements["status"] == "used"]
by_satellite = (
    used.groupby(["kind", "sv"], observed=True)
    .agg(
        rows=("nis", "size"),
        mean=("innovation", "mean"),
        rms=("innovation", lambda y: np.sqrt(np.mean(y**2))),
        sigma=("sd_innovation", "mean"),
        mean_nis=("nis", "mean"),
    )
    .round(3)
)
print(by_satellite.to_string(), "\n")
print(run.nis_summary().round(3))

# %%
satellites = sorted(used["sv"].unique())
figure, panels = plt.subplots(2, 1, figsize=(7.2, 3.6), sharex=True)
for axes, (kind, unit) in zip(panels, (("pseudorange", "m"), ("range_rate", "m/s")), strict=True):
    rows = used[used["kind"] == kind]
    place = rows["sv"].map({sv: k for k, sv in enumerate(satellites)}).astype(float)
    spread = np.linspace(-0.35, 0.35, len(rows))  # in the order of time
    axes.scatter(place + spread, rows["innovation"], s=1, c=rows["time_s"], cmap="viridis", rasterized=True)
    axes.axhline(0.0, color="k", lw=0.6)
    axes.set_ylabel(f"innovation, {unit}")
    axes.set_title(kind.replace("_", " "))
panels[-1].set_xticks(range(len(satellites)), satellites)
panels[-1].set_xlabel("satellite; within each, time from left to right")
plt.show()

# %% [markdown]
# ## The errors
#
# Here a reference exists, so the errors can be seen beside the three sigma that the filter gave. They count from the
# moment at which the heading became known: at rest nothing shows it.

# %%
known_s = run.heading_known_s()
errors = run.error_summary(from_s=known_s)
print(f"heading known at {known_s:.0f} s, {known_s - run.nav['time_s'].iloc[0]:.0f} s after the start\n")
print(errors[["rms", "p95", "max", "mean_sigma", "rms_over_sigma"]].round(3))
figures.errors(run, "position")

# %%
figures.errors(run, "attitude")

# %% [markdown]
# ## Answer
#
# The right declaration must give what the flight gives from its own files, up to the digits that the logger kept; and
# every row of the log must be accounted for.

# %%
own = insgnss.replay(SAMPLE / "flight.toml")
apart_m = (
    np.abs(run.errors[["d_n_m", "d_e_m", "d_d_m"]] - own.errors[["d_n_m", "d_e_m", "d_d_m"]]).to_numpy().max()
)
nis = run.nis_summary()
worst_mean = by_satellite.loc["pseudorange", "mean"].abs().max()
north, east, down = errors.loc[["n_m", "e_m", "d_m"], "rms"]
assert wrong.severity == "error" and "accel_unit = 'g' fits" in wrong.of("error")[0].advice
assert report.severity == "ok"
assert int(run.status_counts().to_numpy().sum()) == 2 * len(pd.read_csv(SAMPLE / "gnss.csv"))
assert nis["mean_nis"].between(0.85, 1.15).all() and nis["share_95"].between(0.93, 0.97).all()
assert worst_mean < 0.6  # metres; the pseudoranges' noise is 2 m
assert errors["rms_over_sigma"].max() < 2.0
assert np.hypot(north, east) < 0.6 and down < 0.8
assert apart_m < 0.005  # the logger's seventh decimal and its milliseconds
scratch.cleanup()
print(
    f"Answer: declare, check, replay, and look at the ledger. The check named the wrong unit before the replay; then"
    f" the errors are {north:.2f}, {east:.2f}, {down:.2f} m rms (N, E, D), the mean NIS"
    f" {nis.loc['pseudorange', 'mean_nis']:.2f} and {nis.loc['range_rate', 'mean_nis']:.2f}, no satellite's mean"
    f" residual is beyond {worst_mean:.2f} m, and the odd log's position differs from the original's by at most"
    f" {apart_m * 1000.0:.3f} mm."
)
