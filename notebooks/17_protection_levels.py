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
# # 17 Protection levels
#
# **Question.** The range of one satellite steps or runs away: do the protection levels bound the position error, both
# where the filter refuses the satellite and where it uses it, and what does an alert say?
#
# A sub-filter runs without each satellite $k$. Its solution, of sigma $s_k$, does not depend on a fault of that
# satellite. With $d_k$ for its distance from the full solution, $p_k$ for the probability of the fault and $r$ for an
# equal part of the risk, the level of an axis is
#
# $$L=\max\left(K(r)\,s_0,\ \max_k\left(|d_k|+K(r/p_k)\,s_k\right)\right),$$
#
# where a standard normal variable is beyond $\pm K(r)$ with probability $r$.

# %%
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.stats import norm

import insgnss
from insgnss.report.figures import STYLE
from insgnss.runs.simulate import simulate

plt.rcParams.update(STYLE | {"figure.dpi": 120, "figure.constrained_layout.use": True})
SEEDS = (1, 2)
FAULTY, FROM_S, START_S = "G18", 60.0, 300_000.0
LIMIT_M = 40.0  # the horizontal alert limit of an LPV-200 approach

# %% [markdown]
# ## A flight and three faults
#
# An aircraft turns for two and a half minutes under ten GPS satellites, with a tactical IMU. After a minute the range
# of G18 steps by 60 m, or grows by 0.3 m/s, or by 0.1 m/s. Its Doppler stays right. No range error lasts in this
# simulation, and its flight file says so (`[gnss.slow_errors]`).

# %%
SCENARIO = f"""
name = "protection levels"
source = "turns of a light aircraft"
gps_week = 2385
start_s = {START_S}
place = {{ lat_deg = 47.0, lon_deg = 8.0, h_m = 1500.0, heading_deg = 35.0 }}
speed_mps = 60.0
manoeuvre = [
  {{ kind = "straight", duration_s = 20.0 }},
  {{ kind = "turn", by_deg = 90.0, bank_deg = 30.0 }},
  {{ kind = "straight", duration_s = 20.0 }},
  {{ kind = "turn", by_deg = -120.0, bank_deg = 35.0 }},
  {{ kind = "straight", duration_s = 30.0 }},
  {{ kind = "turn", by_deg = 90.0, bank_deg = 30.0 }},
  {{ kind = "straight", duration_s = 20.0 }},
]
[imu]
grade = "tactical"
rate_hz = 50.0
[gnss]
lever_arm_m = [0.8, 0.0, -1.1]
"""
FAULTS = {
    "no fault": "",
    "step 60 m": f'[[fault]]\nkind = "range_step"\nsv = "{FAULTY}"\nsize_m = 60.0\nfrom_s = {FROM_S}\n',
    "ramp 0.3 m/s": f'[[fault]]\nkind = "range_ramp"\nsv = "{FAULTY}"\nrate_mps = 0.3\nfrom_s = {FROM_S}\n',
    "ramp 0.1 m/s": f'[[fault]]\nkind = "range_ramp"\nsv = "{FAULTY}"\nrate_mps = 0.1\nfrom_s = {FROM_S}\n',
}
UNTESTED = {  # a filter that uses each range, however large its innovation
    "gates.pseudorange_sigma": 1000.0,
    "gates.range_rate_sigma": 1000.0,
    "gates.clock_jump_min_m": 1e6,
    "faults.residual_sigma": 0.0,
    "faults.drift_sigma": 0.0,
    "adaptation.rate_memory_s": 0.0,
    "adaptation.on": False,
    "health.suspicion_sigma": 0.0,
    "health.recovery": False,
}
CASES = [(fault, "tested") for fault in FAULTS] + [("step 60 m", "untested"), ("ramp 0.3 m/s", "untested")]
keeper = tempfile.TemporaryDirectory()
flights = {}
for fault, lines in FAULTS.items():
    file = Path(keeper.name) / f"{fault.replace(' ', '_').replace('/', '_')}.toml"
    file.write_text(SCENARIO + lines, encoding="utf-8")
    for seed in SEEDS:
        simulate(file, seed).save(file.with_suffix("") / str(seed))
        flights[fault, seed] = file.with_suffix("") / str(seed) / "flight.toml"

runs = {}
for fault, tests in CASES:
    settings = UNTESTED if tests == "untested" else {}
    for seed in SEEDS:
        runs[fault, tests, seed] = insgnss.replay(flights[fault, seed], settings=settings, integrity=True)

# %% [markdown]
# ## Error, level, alert
#
# "Tested" is the filter as it is. "Untested" is the same filter without gates and fault tests: it shows what the levels
# do when a fault gets through. Errors are the largest from the fault on, over both flights.


# %%
def with_levels(run: insgnss.Run) -> pd.DataFrame:
    """Return errors and levels, horizontal and vertical, from 10 s after the start on."""
    table = run.errors.merge(run.nav[["time_s", "hpl_m", "vpl_m"]], on="time_s")
    table = table.assign(
        since_s=table["time_s"] - START_S,
        horizontal_m=np.hypot(table["d_n_m"], table["d_e_m"]),
        vertical_m=table["d_d_m"].abs(),
    )
    return table[table["since_s"] > 10.0]


tables = {case: with_levels(run) for case, run in runs.items()}
summary = {}
for fault, tests in CASES:
    late = pd.concat([tables[fault, tests, seed] for seed in SEEDS])
    late = late[late["since_s"] > FROM_S]
    used = pd.concat([runs[fault, tests, seed].measurements for seed in SEEDS])
    used = used[
        (used["sv"] == FAULTY) & (used["kind"] == "pseudorange") & (used["time_s"] > START_S + FROM_S)
    ]
    summary[fault, tests] = {
        "G18 used": (used["status"] == "used").mean(),
        "error, m": late["horizontal_m"].max(),
        "median HPL, m": late["hpl_m"].median(),
        "error/HPL": (late["horizontal_m"] / late["hpl_m"]).max(),
        "error/VPL": (late["vertical_m"] / late["vpl_m"]).max(),
        "alerts": sum((runs[fault, tests, seed].integrity["alert_rows"] > 0).sum() for seed in SEEDS),
    }
summary = pd.DataFrame(summary).T
print(summary.round(2).to_string())

# %%
figure, panels = plt.subplots(1, 3, figsize=(7.6, 2.7), sharey=True, sharex=True)
for panel, case in zip(panels, [("ramp 0.1 m/s", "tested"), *CASES[-2:]], strict=True):
    table = tables[(*case, SEEDS[0])]
    panel.semilogy(table["since_s"], table["hpl_m"], color="tab:blue", label="HPL")
    panel.semilogy(table["since_s"], table["horizontal_m"], color="tab:red", label="horizontal error")
    panel.axvline(FROM_S, color="k", lw=0.6, ls=":")
    panel.set(title=", ".join(case), xlabel="time, s", ylim=(0.02, 60.0))
panels[0].set_ylabel("m")
panels[0].legend()

# %% [markdown]
# ## The Stanford diagram
#
# One dot for each row. Above the diagonal the level bounds the error. Below it a row is misleading, and hazardously
# so where the error is also beyond the alert limit. With a level above the limit the solution is not available.

# %%
figure, axes = plt.subplots(figsize=(4.8, 3.7))
for k, (fault, tests) in enumerate(CASES):
    table = pd.concat([tables[fault, tests, seed] for seed in SEEDS])
    axes.loglog(
        table["horizontal_m"].clip(lower=0.02),
        table["hpl_m"],
        "." if tests == "tested" else "x",
        ms=3,
        color=f"C{k}",
        label=f"{fault}, {tests}",
    )
ends = np.array([0.015, 150.0])
axes.plot(ends, ends, "k", lw=0.8)
axes.axhline(LIMIT_M, color="k", lw=0.6, ls="--")
below = np.geomspace(0.5, 150.0, 50)
axes.fill_between(below, 0.5, below, color="tab:red", alpha=0.08, lw=0.0)
axes.text(6.0, 0.8, "misleading", color="tab:red")
axes.text(0.02, 1.15 * LIMIT_M, "not available: above the alert limit")
axes.set(xlabel="horizontal error, m", ylabel="HPL, m", xlim=ends, ylim=(0.5, 150.0))
axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))

# %% [markdown]
# ## What an alert says
#
# An alert says that the solution without a satellite is farther away than chance allows. That satellite need not be
# the faulty one: without G01, which stands beside G18 in the sky, the fault of G18 weighs more, and that solution
# differs as well. The largest distance in units of its limit points to the fault as long as the filter uses it. Where
# the tests have removed G18 from the full solution but not from the one without G01, the alert names G01 alone: the
# second flight with 0.3 m/s.

# %%
named = {}
for case, run in runs.items():
    faults = run.integrity.assign(over_limit=(run.integrity["separation_m"] / run.integrity["limit_m"]).abs())
    alerts = faults[faults["alert_rows"] > 0].sort_values("over_limit", ascending=False)
    named[case] = alerts["fault"].tolist()
    worst = [f"{fault} {ratio:.1f}" for fault, ratio in alerts[["fault", "over_limit"]].to_numpy()]
    print(f"{', '.join(map(str, case)):24} {', '.join(worst) or 'no alert'}")

# %% [markdown]
# ## What the levels cost where errors persist
#
# A real log has errors of orbits, clocks and air that last. With the sizes of `[slow_errors]` for a real sky the flight
# has levels several times as large. Imperfect: the levels hold as far as these sizes and the other sigmas do; two
# faults at once, and with one constellation a fault of all of it, are not monitored.

# %%
# a filter whose sizes are changed uses its own: the others stay at their defaults
sizes = {"slow_errors.satellite_m": {"G": 0.6}}
real = with_levels(insgnss.replay(flights["no fault", 1], integrity=True, settings=sizes))
small_m, real_m = (float(table["hpl_m"].median()) for table in (tables["no fault", "tested", 1], real))
print(f"median HPL: {small_m:.1f} m without errors that persist, {real_m:.1f} m with the default sizes")

# %% [markdown]
# ## Live
#
# The streaming engine has the levels as well. It makes the filter without a satellite as a copy of the full filter,
# before the satellite is used for the first time. Here it flies the ramp that the filter does not test. A receiver
# would hand over one epoch after the other in the same way.

# %%
live_case = ("ramp 0.3 m/s", "untested", SEEDS[0])
file = flights[live_case[0], live_case[2]]
logs = insgnss.Flight.load(file).read()
signals = [("G", name) for name in logs.gnss.signal_names]  # what the receiver will send
engine = insgnss.Engine(insgnss.engine_settings(file, settings=UNTESTED, signals=signals), integrity=True)
arriving = iter(np.unique(logs.gnss.t_ns))
epoch_ns = next(arriving, None)
for t_ns, gyro, accel in zip(logs.imu.t_ns, logs.imu.w_ib_b, logs.imu.f_b, strict=True):
    engine.imu(t_ns, gyro, accel)
    while epoch_ns is not None and epoch_ns <= t_ns:
        engine.gnss(logs.gnss.take(np.flatnonzero(logs.gnss.t_ns == epoch_ns)))
        epoch_ns = next(arriving, None)
results = [result for result in engine.take_results(all_of_them=True) if result.protection is not None]
live = pd.Series([result.protection.hpl_m for result in results])
replayed = runs[live_case].nav["hpl_m"]
alerts = [event for event in engine.events if event.kind == "integrity_alert"]
after_s = (alerts[0].t_ns - logs.imu.t_ns[0]) / 1e9 - FROM_S
print(f"{len(live)} live levels, largest difference from the replay {(live - replayed).abs().max():.1e} m")
print(f"{after_s:.0f} s after the ramp began: {alerts[0].detail}")
keeper.cleanup()

# %% [markdown]
# ## Answer
#
# Given the fault, an axis exceeds its level with a probability of at most $r/p_k$ in a row. North and east have a
# quarter of the risk of 1e-7 each, shared by eleven hypotheses.

# %%
each = 0.25 * 1e-7 / 11.0
K, K_fault = norm.isf(0.5 * each), norm.isf(0.5 * each / 1e-5)
print(f"K(r) = {K:.1f}, K(r/p) = {K_fault:.1f}, r/p = {each / 1e-5:.1e} for each row")
rows = pd.concat(tables.values())
misleading = int(((rows["horizontal_m"] > rows["hpl_m"]) | (rows["vertical_m"] > rows["vpl_m"])).sum())
untested = summary.loc[(slice(None), "untested"), :]
assert misleading == 0
assert summary.loc[("no fault", "tested"), "alerts"] == 0
assert summary.loc[("step 60 m", "tested"), "G18 used"] == 0.0
assert (untested["G18 used"] == 1.0).all() and untested["error, m"].min() > 5.0
assert all(named[fault, tests, seed][0] == FAULTY for fault, tests in CASES[-2:] for seed in SEEDS)
assert small_m < real_m < LIMIT_M
assert len(live) == len(replayed) and (live == replayed).all() and FAULTY in alerts[0].detail.split(":")[0]
tested = summary.loc[(slice(None), "tested"), :]
print(
    f"Answer: none of {len(rows)} rows exceeds its level; a filter without tests is off by up to"
    f" {untested['error, m'].max():.0f} m, {untested['error/HPL'].max():.2f} of the HPL; the tests hold the error to"
    f" {tested['error, m'].max():.1f} m; the largest alert names the faulty satellite where the filter uses it;"
    " the streaming engine has the levels of the replay, bit for bit;"
    f" the median HPL is {small_m:.1f} m, with errors that persist {real_m:.1f} m."
)
