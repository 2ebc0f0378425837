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
# # 05 Masking in a banked turn
#
# **Question.** What position error do satellites hidden by a bank cause in a tightly coupled filter, and what does
# the filter gain if it finds from its attitude that they are hidden?
#
# The scenario is that of A. I. Sokolov and Yu. S. Yurchenko, *Use of spatial information in integrated
# inertial-satellite navigation systems of aircraft* (Izvestiya SPbGETU "LETI", 2015): eleven satellites, of which a
# left bank hides five for 20 s. Their paper follows how well the filter goes on predicting the ranges of the hidden
# ones; what false measurements of those would do, it only announces. Both are computed here.

# %%
import matplotlib.pyplot as plt
import numpy as np

from insgnss.geodesy.rotations import euler_to_matrix
from insgnss.report.figures import STYLE
from insgnss.studies import hidden_satellite_variance, masking_study

plt.rcParams.update(STYLE | {"figure.dpi": 120, "figure.constrained_layout.use": True})

# %% [markdown]
# ## Which satellites the bank hides
#
# A line of sight in local-level axes, $u_n$, is $u_b = C_{nb}^T u_n$ in the body's. The antenna on the roof receives
# nothing from below 5 deg above the plane of the wings. With a roll of -43.5 deg and a heading of 355.5 deg the right
# wing is up and stands before the eastern sky.

# %%
banked = hidden_satellite_variance("sokolov_2015", outage="bank", until_s=101.0)
sky = banked.table[banked.table["time_s"] == 90.0].set_index("sv")
C_nb = np.zeros((3, 3))
euler_to_matrix(*np.radians([-43.5, 0.0, 355.5]), C_nb)


def line_of_sight(az_deg: np.ndarray, el_deg: np.ndarray) -> np.ndarray:
    """Return u_n (..., 3)."""
    az, el = np.radians(az_deg), np.radians(el_deg)
    return np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), -np.sin(el)], axis=-1)


u_b = line_of_sight(sky["az_deg"].to_numpy(), sky["el_deg"].to_numpy()) @ C_nb  # (C_nb^T u_n)^T
body_el_deg = -np.degrees(np.arcsin(u_b[:, 2]))
below = sorted(sky.index[body_el_deg < 5.0])
shown = sky[["az_deg", "el_deg"]].assign(above_wings_deg=body_el_deg)
print(shown.round(1))

azimuth, elevation = np.meshgrid(np.arange(0.0, 361.0, 2.0), np.arange(0.0, 91.0, 1.0))
above_wings = -np.degrees(np.arcsin((line_of_sight(azimuth, elevation) @ C_nb)[..., 2]))
figure, axes = plt.subplots(figsize=(3.6, 3.6), subplot_kw={"projection": "polar"})
axes.set_theta_zero_location("N")
axes.set_theta_direction(-1)
axes.contourf(np.radians(azimuth), 90.0 - elevation, above_wings, levels=[-90.0, 5.0], colors=["0.85"])
for sv, row in sky.iterrows():
    colour = "C3" if sv in below else "C2"
    axes.plot(np.radians(row["az_deg"]), 90.0 - row["el_deg"], "o", color=colour, ms=5)
    axes.annotate(
        sv, (np.radians(row["az_deg"]), 90.0 - row["el_deg"]), textcoords="offset points", xytext=(4, 3)
    )
axes.set_yticks([0, 30, 60, 90], ["90°", "60°", "30°", "0°"])
axes.set_title("sky over the place, azimuth and elevation; grey: hidden by the bank")
plt.show()

# %% [markdown]
# ## How well their ranges stay predicted
#
# For a satellite with the row $h$, the filter predicts the pseudorange with the variance
#
# $$ D = h\,P^-\,h^T , $$
#
# $P^-$ being the covariance just before the update. Without measurements of five satellites $D$ grows, by
# the inertial errors and the clock, but the six others hold the most of it.

# %%
variance = hidden_satellite_variance("sokolov_2015", imu="tactical", oscillator="tcxo", until_s=130.0)
summary = variance.summary().set_index("sv")
print(summary.round(3))
variance.figure()

# %% [markdown]
# At the end of the 20 s three sigma of the predicted range are about 4 m. The discriminator of a C/A code sees
# $\pm 0.5$ chip, 147 m: the receiver can put its correlators where the satellite will come back, and need not search.
#
# ## Four ways to treat what the channels say meanwhile
#
# A receiver that knows nothing of the bank goes on: some channels coast, some find a reflection or another satellite's
# code, and report pseudoranges. `masking_study` flies the bank with the filter of the package and its fault tests,
# three times with other errors:
#
# - (a) everything that the receiver reports is offered to the filter,
# - (b) an elevation mask over the horizon,
# - (c) the filter masks what its attitude says is hidden,
# - (d) and supervises the search: no channel searches for a hidden satellite, and each gets its search window when the
#   satellite returns.

# %%
study = masking_study("sokolov_2015", runs=3)
SHOWN = {
    "words": "case",
    "rms_during_m": "rms, m",
    "max_during_m": "largest, m",
    "false_rows": "false rows",
    "believed": "accepted",
    "delay_mean_s": "back after, s",
    "search_s": "search, s",
}
print(study.cases[list(SHOWN)].rename(columns=SHOWN).round(3).to_string(index=False))
study.error_figure()

# %%
study.rows_figure()

# %% [markdown]
# The elevation mask changes nothing, to the bit: above the horizon the satellites still stand. The fault tests refuse
# more than half of the false rows by themselves. What they let through is what looks right: rates of reflections, and a
# channel that coasts and creeps away slower than any gate opens. It costs little, because the filter takes the range of
# a weak signal for uncertain. Masking by attitude stops all of them.
#
# The paper's filter has no fault tests. The first of the flights without any:

# %%
bare = masking_study("sokolov_2015", runs=1, fault_tests=False)
print(bare.cases[list(SHOWN)].rename(columns=SHOWN).round(3).to_string(index=False))

# %% [markdown]
# ## Answer

# %%
# D of G01, G16, G30, G31, G32 at the end of the outage, from a computation that is independent of this package [m^2]
INDEPENDENT_M2 = np.array([1.721, 2.028, 1.673, 1.813, 1.357])
cases, without_tests = study.cases.set_index("case"), bare.cases.set_index("case")
rms_m, accepted = cases["rms_during_m"], cases["believed"]
np.testing.assert_allclose(body_el_deg, sky["body_el_deg"], atol=0.1)
assert below == ["G01", "G16", "G30", "G31", "G32"] == sorted(sky.index[sky["hidden"]])
np.testing.assert_allclose(summary["peak_m2"], INDEPENDENT_M2, rtol=0.02)
assert 3.0 * summary["sd_peak_m"].max() < 5.0  # far inside half a chip
assert rms_m["b"] == rms_m["a"] and accepted["b"] == accepted["a"]
assert rms_m["a"] > 1.5 * rms_m["c"] and accepted["c"] < 0.02 * accepted["a"]
assert cases["false_rows"]["d"] == 0 and cases["search_s"]["d"] < 0.01 < cases["search_s"]["c"]
assert without_tests["rms_during_m"]["a"] > 100.0 > 3.0 * without_tests["rms_during_m"]["c"]
peak_m2, peak_m = summary["peak_m2"], summary["sd_peak_m"]
print(
    f"Answer: the bank hides {len(below)} of {len(sky)} satellites; after 20 s their ranges are still predicted to"
    f" {peak_m.min():.1f} to {peak_m.max():.1f} m (D = {peak_m2.min():.2f} to {peak_m2.max():.2f} m^2). Believing what"
    f" the channels then report costs {rms_m['a']:.1f} m rms and {cases['max_during_m']['a']:.0f} m at worst"
    f" ({without_tests['rms_during_m']['a']:.0f} m rms without fault tests), an elevation mask the same; masking by"
    f" attitude {rms_m['c']:.1f} m; supervision cuts the search from {cases['search_s']['c']:.1f} s to"
    f" {1000.0 * cases['search_s']['d']:.0f} ms a satellite."
)
