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
# # 02 Pure inertial and Schuler
#
# **Question.** How do the errors of an inertial navigation system grow by themselves, and where do the 84.4 minutes
# come from?
#
# We stand still for hours, give the mechanization of the package perfect sensors but a wrong start (a tilt, a velocity)
# or a gyro with a bias, and hold what comes out against a linear model of nine states that is solved by a matrix
# exponential.

# %%
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.geodesy.ellipsoid import geodetic_to_ecef, radii
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.geodesy.rotations import matrix_to_quaternion
from insgnss.inertial.mechanization import mechanize
from insgnss.report.figures import STYLE

plt.rcParams.update(STYLE | {"figure.dpi": 120, "figure.constrained_layout.use": True})
LAT, LON, H_M = np.radians(45.0), np.radians(10.0), 0.0
STEP_S = 0.2  # rates and specific force are constant here, for which the mechanization is exact
HOURS = 6.0

# %% [markdown]
# ## Standing still
#
# The body axes are those of the local level (north, east, down). Perfect sensors show $f_b = -g$ and
# $\omega_{ib} = \omega_{ie}$, the Earth's turn.

# %%
r0_e, g0_e, C_ne = np.zeros(3), np.zeros(3), np.zeros((3, 3))
geodetic_to_ecef(LAT, LON, H_M, r0_e)
normal_gravity_ecef(r0_e, g0_e)
ecef_to_ned_matrix(LAT, LON, C_ne)
w_ie_n = C_ne @ np.array([0.0, 0.0, WGS84_OMEGA_RADPS])
f_n = -C_ne @ g0_e
G_MPS2 = float(np.linalg.norm(g0_e))
MERIDIAN_M, PRIME_VERTICAL_M = radii(LAT)  # radii of curvature north and east
R_M = float(np.sqrt(MERIDIAN_M * PRIME_VERTICAL_M))


# %%
def stand(
    hours: float, dv_n: np.ndarray, psi_n: np.ndarray, gyro_bias: np.ndarray, *, hold_height: bool = True
) -> pd.DataFrame:
    """Mechanize at rest with these errors; return position, velocity and attitude errors in axes of the place.

    With ``hold_height`` the vertical channel is held by force, as a barometer would.
    """
    C_eb = np.ascontiguousarray(C_ne.T @ Rotation.from_rotvec(psi_n).as_matrix())
    q_eb, r_e, v_e, scratch = np.zeros(4), r0_e.copy(), C_ne.T @ dv_n, np.zeros(3)
    matrix_to_quaternion(C_eb, q_eb)
    w, f = w_ie_n + gyro_bias, f_n.copy()
    up_e = -C_ne[2]
    kept = []
    count = round(hours * 3600.0 / STEP_S)
    for k in range(1, count + 1):
        mechanize(q_eb, C_eb, r_e, v_e, w, f, STEP_S, scratch)
        if hold_height:
            r_e -= up_e * (up_e @ (r_e - r0_e))
            v_e -= up_e * (up_e @ v_e)
        if k % round(60.0 / STEP_S) == 0:
            psi = Rotation.from_matrix(C_ne @ C_eb).as_rotvec()
            kept.append([k * STEP_S, *(C_ne @ (r_e - r0_e)), *(C_ne @ v_e), *psi])
    names = ["t_s", "dr_n", "dr_e", "dr_d", "dv_n", "dv_e", "dv_d", "psi_n", "psi_e", "psi_d"]
    return pd.DataFrame(kept, columns=names)


# %% [markdown]
# ## The linear model
#
# With error = estimate minus truth and $\hat C = (I + [\psi\times])\, C$, in axes that are fixed to the place,
#
# $$ \dot{\delta r} = \delta v, \qquad
#    \dot{\delta v} = \psi \times f + \frac{\partial g}{\partial r}\,\delta r - 2\,\omega_{ie} \times \delta v, \qquad
#    \dot\psi = -\omega_{ie} \times \psi + b_g , $$
#
# where $b_g$ is what the gyro shows too much. Gravity turns with the place,
# $\partial g/\partial r = g\,\mathrm{diag}(-1/M, -1/N, 2/R)$ with the radii of curvature $M$ and $N$ of the
# ellipsoid and $R = \sqrt{MN}$: the mechanization compensates gravity where it believes to be, and what is left pulls
# a wrong horizontal position back. That is a pendulum as long as the Earth's radius,
#
# $$ T = 2\pi \sqrt{R/g} \approx 84.4\ \mathrm{min} , $$
#
# whose plane the Earth's turn carries round (Foucault, clockwise in the north, at $\omega_{ie}\sin\varphi$); seen from
# the Earth its frequency is $\sqrt{g/R + \omega_{ie}^2\sin^2\varphi}$, a thousandth higher.


# %%
def cross(a: np.ndarray) -> np.ndarray:
    """Return [a x]."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def linear(hours: float, dv_n: np.ndarray, psi_n: np.ndarray, gyro_bias: np.ndarray) -> pd.DataFrame:
    """Return the same errors by the linear model, the height held."""
    F = np.zeros((10, 10))  # the tenth state is one: it carries the gyro bias
    F[0:3, 3:6] = np.eye(3)
    F[3:6, 0:3] = G_MPS2 * np.diag([-1.0 / MERIDIAN_M, -1.0 / PRIME_VERTICAL_M, 2.0 / R_M])
    F[3:6, 3:6] = -2.0 * cross(w_ie_n)
    F[3:6, 6:9] = -cross(f_n)  # psi x f = -f x psi
    F[6:9, 6:9] = -cross(w_ie_n)
    F[6:9, 9] = gyro_bias
    F[[2, 5], :] = 0.0  # the height is held
    x = np.concatenate([np.zeros(3), dv_n, psi_n, [1.0]])
    Phi = expm(F * 60.0)
    states = []
    for _ in range(round(hours * 60.0)):
        x = Phi @ x
        states.append(x[:9])
    table = pd.DataFrame(
        states, columns=["dr_n", "dr_e", "dr_d", "dv_n", "dv_e", "dv_d", "psi_n", "psi_e", "psi_d"]
    )
    table.insert(0, "t_s", 60.0 * np.arange(1, len(table) + 1))
    return table


# %% [markdown]
# ## Three errors, each on its own
#
# A tilt of 0.1 mrad (a tenth of a milli-g of accelerometer bias levels that badly), a velocity of 1 m/s north, and a
# gyro bias of 0.01 deg/h about east: an IMU of navigation grade.

# %%
MRAD, DEG_PER_H = 1e-3, np.radians(1.0) / 3600.0
ZERO = np.zeros(3)
CASES = {
    "tilt of 0.1 mrad": (ZERO, np.array([0.0, 0.1 * MRAD, 0.0]), ZERO),
    "velocity of 1 m/s": (np.array([1.0, 0.0, 0.0]), ZERO, ZERO),
    "gyro bias of 0.01 deg/h": (ZERO, ZERO, np.array([0.0, 0.01 * DEG_PER_H, 0.0])),
}
flown = {name: stand(HOURS, *case) for name, case in CASES.items()}
model = {name: linear(HOURS, *case) for name, case in CASES.items()}

figure, panels = plt.subplots(2, 3, figsize=(7.2, 3.8), sharex=True)
for column, name in zip(panels.T, CASES, strict=True):
    for axes, (quantity, unit) in zip(column, (("dr", "m"), ("dv", "m/s")), strict=True):
        for direction, colour in (("n", "C0"), ("e", "C1")):
            label = {"n": "north", "e": "east"}[direction]
            t_h = flown[name]["t_s"] / 3600.0
            axes.plot(t_h, flown[name][f"{quantity}_{direction}"], color=colour, label=label)
            axes.plot(t_h, model[name][f"{quantity}_{direction}"], "k:", lw=1.0)
        axes.set_ylabel(f"{'position' if quantity == 'dr' else 'velocity'} error, {unit}")
    column[0].set_title(name)
    column[1].set_xlabel("time, h")
lines, names = panels[0, 0].get_legend_handles_labels()
figure.legend(lines, names, title="dotted: linear model", loc="outside lower center", ncols=2)
plt.show()

# %% [markdown]
# Tilt and velocity swing and stay bounded; the bias of a gyro drifts, $R\,b_g\,t$ on average, with the pendulum upon
# it. After a few hours part of each has gone over into the other horizontal axis.
#
# ## The period
#
# It is read off the speed that a wrong velocity causes: a Foucault pendulum swings along a line that turns, so its
# speed $|\delta v_h|$ comes to its largest value twice in each period.

# %%
speed = np.hypot(flown["velocity of 1 m/s"]["dv_n"], flown["velocity of 1 m/s"]["dv_e"]).to_numpy()
t_s = flown["velocity of 1 m/s"]["t_s"].to_numpy()


def extremes(values: np.ndarray) -> np.ndarray:
    """Return the times of the largest values, each from the parabola through three samples."""
    k = np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:])) + 1
    below, at, above = values[k - 1], values[k], values[k + 1]
    return t_s[k] + 60.0 * 0.5 * (below - above) / (below - 2.0 * at + above)


largest_s = extremes(speed)
period_min = 2.0 * float(np.polyfit(np.arange(len(largest_s)), largest_s, 1)[0]) / 60.0
schuler_min = 2.0 * np.pi * np.sqrt(R_M / G_MPS2) / 60.0
seen_min = 2.0 * np.pi / np.sqrt(G_MPS2 / R_M + (WGS84_OMEGA_RADPS * np.sin(LAT)) ** 2) / 60.0
turned_deg = {}
for source, table in (("mechanization", flown), ("linear model", model)):
    at = np.searchsorted(t_s, largest_s[-1])
    v = table["velocity of 1 m/s"].iloc[at]
    turned_deg[source] = float(np.degrees(np.arctan2(v["dv_e"], v["dv_n"])))
foucault_deg = np.degrees(WGS84_OMEGA_RADPS * np.sin(LAT) * largest_s[-1])
print(f"largest speeds at {np.round(largest_s / 60.0, 1)} min")
print(
    f"period {period_min:.2f} min; 2 pi sqrt(R/g) = {schuler_min:.2f}, on the turning Earth {seen_min:.2f} min"
)
print(f"direction of the swing after {largest_s[-1] / 3600.0:.1f} h, clockwise from north:")
print({source: round(angle, 2) for source, angle in turned_deg.items()}, f"Foucault {foucault_deg:.2f} deg")

# %% [markdown]
# ## The vertical channel
#
# Upwards the same gravity has the other sign, $2g/R$: too high means too little gravity subtracted, and higher still.
# The error grows by $e$ in $\sqrt{R/2g}$, 9.5 minutes. A start 1 mm/s wrong shows it; that is why the height was held
# above, and why no system navigates for hours without a barometer or GNSS.

# %%
free = stand(1.5, np.array([0.0, 0.0, -1e-3]), ZERO, ZERO, hold_height=False)
late = free["t_s"] > 2400.0
e_fold_min = 1.0 / np.polyfit(free["t_s"][late], np.log(np.abs(free["dr_d"][late])), 1)[0] / 60.0
figure, axes = plt.subplots(figsize=(3.5, 2.2))
axes.semilogy(free["t_s"] / 60.0, np.abs(free["dr_d"]))
axes.set(xlabel="time, min", ylabel="height error, m", title="a start 1 mm/s wrong, nothing holds the height")
plt.show()
print(f"grows by e in {e_fold_min:.2f} min; sqrt(R / 2 g) = {np.sqrt(R_M / (2.0 * G_MPS2)) / 60.0:.2f} min")

# %% [markdown]
# ## Answer

# %%
horizontal = ["dr_n", "dr_e"]
apart, largest = {}, {}
for name in CASES:
    largest[name] = model[name][horizontal].abs().to_numpy().max()
    apart[name] = (flown[name] - model[name])[horizontal].abs().to_numpy().max() / largest[name]
    print(f"{name}: largest {largest[name]:.0f} m, mechanization and linear model within {apart[name]:.2%}")
drift_m_per_h = 0.01 * DEG_PER_H * R_M * 3600.0
one_period = flown["gyro bias of 0.01 deg/h"].iloc[round(schuler_min) - 1]
drifted_m_per_h = float(np.hypot(one_period["dr_n"], one_period["dr_e"])) / (one_period["t_s"] / 3600.0)

assert abs(period_min - 84.4) < 0.1 and abs(period_min / seen_min - 1.0) < 5e-4
assert abs(turned_deg["mechanization"] - foucault_deg) < 1.0
assert max(apart.values()) < 0.002
assert abs(drifted_m_per_h / drift_m_per_h - 1.0) < 0.03
assert abs(e_fold_min / (np.sqrt(R_M / (2.0 * G_MPS2)) / 60.0) - 1.0) < 0.01
print(
    f"Answer: horizontal errors are a pendulum of the Earth's radius: they swing with {period_min:.1f} min"
    f" (theory {seen_min:.1f}), turned by the Earth {foucault_deg:.0f} deg in 5.6 h. A tilt of 0.1 mrad"
    f" stays within {largest['tilt of 0.1 mrad'] / 1000.0:.1f} km, 1 m/s within"
    f" {largest['velocity of 1 m/s'] / 1000.0:.1f} km, a gyro bias of 0.01 deg/h drifts {drifted_m_per_h:.0f} m/h;"
    f" the height error grows by e in {e_fold_min:.1f} min. The linear model agrees within {max(apart.values()):.2%}."
)
