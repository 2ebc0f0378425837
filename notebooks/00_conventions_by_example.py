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
# # 00 Conventions by example
#
# **Question.** Which way do the axes point, what do the signs mean, and in which units and times are the numbers?
#
# Most wrong navigation results are a sign, a frame or a unit. Each convention of the package is shown here by a
# computation of a line or two whose result can be checked by hand, and is asserted. The other notebooks rely on them.
# The sample flight in `data/sample_flight` (simulated, 20 minutes) serves as the example of a log.

# %%
import shutil
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import insgnss
from insgnss.constants import C_MPS, WGS84_A_M, WGS84_OMEGA_RADPS
from insgnss.geodesy.ellipsoid import geodetic_to_ecef, radii
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.geodesy.rotations import euler_to_matrix, matrix_to_quaternion
from insgnss.gpstime import leap_seconds, ns_to_datetime, week_seconds_to_ns
from insgnss.report.figures import STYLE

plt.rcParams.update(STYLE | {"figure.dpi": 120, "figure.constrained_layout.use": True})
SAMPLE = Path("../data/sample_flight")
FORWARD, RIGHT, BELOW = np.eye(3)  # body axes b
NORTH, EAST, DOWN = np.eye(3)  # local-level axes n

# %% [markdown]
# ## Frames, and the target first
#
# The frames are i (inertial), e (Earth-centred, Earth-fixed, WGS-84), n (local level: north, east, down), b (body:
# forward, right, down) and a (antenna). A rotation matrix names its **target first**, so that equal letters meet:
#
# $$ C_{nb}\, f_b = f_n , \qquad C_{eb} = C_{en}\, C_{nb} .$$
#
# Roll, pitch and yaw are turned in the order yaw about down, pitch about right, roll about forward. Heading east with
# the wings level, the body's forward axis points east and its right axis south. Functions of the numerical core write
# into the array that they are given last.


# %%
def attitude(roll_deg: float, pitch_deg: float, yaw_deg: float) -> np.ndarray:
    """Return C_nb."""
    C_nb = np.zeros((3, 3))
    euler_to_matrix(*np.radians([roll_deg, pitch_deg, yaw_deg]), C_nb)
    return C_nb


np.testing.assert_allclose(attitude(0, 0, 90) @ FORWARD, EAST, atol=1e-15)  # yaw is clockwise from north
np.testing.assert_allclose(attitude(0, 0, 90) @ RIGHT, -NORTH, atol=1e-15)
np.testing.assert_allclose(attitude(0, 90, 0) @ FORWARD, -DOWN, atol=1e-15)  # positive pitch: nose up
np.testing.assert_allclose(attitude(90, 0, 0) @ RIGHT, DOWN, atol=1e-15)  # positive roll: right wing down

# %% [markdown]
# Quaternions have their scalar first. ECEF's x axis leaves the Earth where the equator meets Greenwich; there north is
# $+z_e$, east is $+y_e$ and down is $-x_e$: the rows of $C_{ne}$.

# %%
q_nb, r_e, C_ne = np.zeros(4), np.zeros(3), np.zeros((3, 3))
matrix_to_quaternion(attitude(0, 0, 90), q_nb)
geodetic_to_ecef(0.0, 0.0, 0.0, r_e)
ecef_to_ned_matrix(0.0, 0.0, C_ne)
np.testing.assert_allclose(q_nb, [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)], atol=1e-15)
np.testing.assert_allclose(r_e, [WGS84_A_M, 0.0, 0.0])
np.testing.assert_array_equal(C_ne, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]])

# %% [markdown]
# ## What the sensors show at rest
#
# An accelerometer measures specific force, not acceleration. At rest it shows what holds it up, $f_b = -C_{bn}\, g_n$:
# with the z axis down that is **minus** 9.8 m/s². The gyro shows $\omega_{ib}$, the Earth's turn of 15.04 deg/h. The
# first 60 s of the sample flight, at rest at 60 degrees north and heading 10 degrees, say the same.

# %%
imu = pd.read_csv(SAMPLE / "imu.csv.gz", nrows=6000)
f_b = imu[["accel_x", "accel_y", "accel_z"]].mean().to_numpy()
w_ib_b = imu[["gyro_x", "gyro_y", "gyro_z"]].mean().to_numpy()
lat = np.radians(59.97)
C_nb, g_e = attitude(0, 0, 10), np.zeros(3)
geodetic_to_ecef(lat, 0.0, 20.0, r_e)
ecef_to_ned_matrix(lat, 0.0, C_ne)
normal_gravity_ecef(r_e, g_e)
at_rest_f_b = -C_nb.T @ C_ne @ g_e
at_rest_w_b = C_nb.T @ (WGS84_OMEGA_RADPS * np.array([np.cos(lat), 0.0, -np.sin(lat)]))
DEG_PER_H = np.degrees(1.0) * 3600.0
print(pd.DataFrame({"f_b, m/s^2": f_b, "-C_bn g_n, m/s^2": at_rest_f_b}, index=["x", "y", "z"]).round(4))
rates = {"w_ib_b, deg/h": w_ib_b * DEG_PER_H, "C_bn w_ie_n, deg/h": at_rest_w_b * DEG_PER_H}
print(pd.DataFrame(rates, index=["x", "y", "z"]).round(2))
# three sigma: biases of 1 mg and 1 deg/h, and what the noise leaves of a minute's mean, 0.8 deg/h
np.testing.assert_allclose(f_b, at_rest_f_b, atol=0.03)
np.testing.assert_allclose(w_ib_b, at_rest_w_b, atol=4.0 / DEG_PER_H)

# %% [markdown]
# ## Units and time
#
# Inside the package are SI units and radians. Where users meet numbers, every name ends in its unit. Time is GPS time:
# users see `time_s`, seconds of the GPS week that the flight file states; inside it is integer nanoseconds, because a
# float of seconds since 1980 would resolve no better than 0.2 µs, which is 70 m of range. GPS time has no leap
# seconds and has been 18 s ahead of UTC since 2017: a log labelled in UTC says so in its flight file.

# %%
flight = insgnss.Flight.load(SAMPLE / "flight.toml")
run = insgnss.replay(flight, filter="tight17")
t_ns = int(week_seconds_to_ns(flight.config.gps_week, run.nav["time_s"].iloc[0]))
when = ns_to_datetime(t_ns)
UNITS = ("_s", "_deg", "_m", "_mps", "_mps2", "_radps")
print(f"first output: {run.nav['time_s'].iloc[0]:.3f} s of week {flight.config.gps_week} = {when} GPS time")
assert [name for name in run.nav if not name.endswith(UNITS)] == ["n_used", "n_hypotheses"]
assert when.isoformat().startswith("2025-09-24T09:35") and leap_seconds(when) == 18
assert np.spacing(t_ns * 1e-9) * C_MPS > 35.0  # metres of range in the last digit of such a float

# %% [markdown]
# ## Range rate, Doppler and the receiver's clock
#
# A pseudorange is the distance plus the receiver's clock minus the satellite's (all in metres), plus delays. A range
# rate is positive when the distance grows. Doppler has the sign of RINEX, positive when the distance **shrinks**:
#
# $$ \dot\rho = -\lambda\, D , \qquad \lambda = c / f_{L1} = 0.1903\ \mathrm{m}. $$
#
# So a pseudorange changes between two epochs by what Doppler says, the drift of the receiver's clock in both alike.

# %%
gnss = pd.read_csv(SAMPLE / "gnss.csv")
one = gnss[gnss["sv"] == "G01"].reset_index(drop=True)
rate_of_code = one["pseudorange_m"].diff() / one["time_s"].diff()
range_rate = -C_MPS / 1575.42e6 * one["doppler_hz"]
mid_interval = 0.5 * (range_rate + range_rate.shift())
figure, axes = plt.subplots(figsize=(5.5, 2.4))
axes.plot(one["time_s"], rate_of_code, ".", ms=2, label="pseudorange, difference per second")
axes.plot(
    one["time_s"], range_rate.where(one["time_s"].diff() < 1.5), lw=1.0, label=r"$-\lambda \cdot$ Doppler"
)
axes.set(xlabel="GPS seconds of the week, s", ylabel="range rate of G01, m/s")
axes.legend()
plt.show()
sigma_mps = (rate_of_code - mid_interval).std()
assert abs((rate_of_code - mid_interval).median()) < 4.0 * sigma_mps / np.sqrt(len(one))
assert abs(rate_of_code + mid_interval).median() > 100.0  # with the other sign nothing fits

# %% [markdown]
# ## Lever arm
#
# The lever arm $l_b$ goes from the IMU to the antenna, in body axes. `run.nav` is the place of the IMU; the antenna is
# at $r_n + C_{nb}\, l_b$. With 0.8 m forward and 1.1 m up, heading east, the antenna is 0.8 m east and 1.1 m above.

# %%
l_b = np.array(flight.config.gnss.lever_arm_m)
np.testing.assert_array_equal(l_b, [0.8, 0.0, -1.1])
np.testing.assert_allclose(attitude(0, 0, 90) @ l_b, [0.0, 0.8, -1.1], atol=1e-15)

# %% [markdown]
# ## Errors and innovations
#
# An **error is estimate minus truth**, everywhere: $\hat r = r + \delta r$,
# $\hat C_{eb} = (I + [\psi\times])\, C_{eb}$, estimated bias minus true bias.
# `run.errors` is `run.nav` minus the reference.

# %%
truth = pd.read_csv(SAMPLE / "reference.csv")
nav = run.nav.set_index("time_s").loc[run.errors["time_s"]]
meridian_m = radii(lat)[0] + 20.0
at = run.errors["time_s"].to_numpy()
north_m = (
    np.radians(nav["lat_deg"] - np.interp(at, truth["time_s"], truth["lat_deg"])).to_numpy() * meridian_m
)
down_m = np.interp(at, truth["time_s"], truth["h_m"]) - nav["h_m"].to_numpy()
at_rest = at < at[0] + 50.0  # later the reference would have to be interpolated along a curve
np.testing.assert_allclose(run.errors["d_n_m"][at_rest], north_m[at_rest], atol=1e-4)
np.testing.assert_allclose(run.errors["d_d_m"][at_rest], down_m[at_rest], atol=1e-4)

# %% [markdown]
# An **innovation is measured minus predicted**, so a pseudorange that is 5 m too long has an innovation that is 5 m
# larger. We spoil one row of a copy of the log and look at the ledger, which has one row for each measurement.

# %%
ROW = 6000
with tempfile.TemporaryDirectory() as folder:
    copy = Path(shutil.copytree(SAMPLE, Path(folder) / "copy"))
    spoilt = gnss.copy()
    spoilt.loc[ROW, "pseudorange_m"] += 5.0
    spoilt.to_csv(copy / "gnss.csv", index=False)
    spoilt_run = insgnss.replay(copy / "flight.toml")


def innovation(of: insgnss.Run) -> float:
    """Return that of the spoilt row: the ledger has the order of the log."""
    return float(of.measurements.query("kind == 'pseudorange'")["innovation"].iloc[ROW])


longer_m = innovation(spoilt_run) - innovation(run)
print(
    f"innovation of {gnss['sv'][ROW]}: {innovation(run):.3f} m, and {innovation(spoilt_run):.3f} m with 5 m more"
)

# %% [markdown]
# ## Answer

# %%
# the time of transmission follows from the pseudorange: in 5 m / c the satellite moves 0.06 mm
assert abs(longer_m - 5.0) < 1e-4
assert abs(f_b[2] + 9.82) < 0.03
print(
    f"Answer: axes are forward-right-down and north-east-down, C_nb f_b = f_n; an IMU at rest shows"
    f" f_z = {f_b[2]:.2f} m/s^2; range rate = -{C_MPS / 1575.42e6:.4f} m x Doppler; a pseudorange that is 5 m too"
    f" long has an innovation {longer_m:.3f} m larger; errors are estimate minus truth; time is GPS time, 18 s ahead"
    " of UTC."
)
