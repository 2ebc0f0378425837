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
# # 11 A campaign on Dask
#
# **Question.** Over a hundred simulated flights, do errors and innovations agree with the covariance for every IMU
# grade, and does the answer depend on how many workers computed it?
#
# One flight tells little: its errors are one draw. A campaign is a grid of cases times seeds. A case function takes a
# case and a seed and nothing else, so that a run is the same wherever and whenever it is computed. The normalised
# errors and innovations,
#
# $$\mathrm{NEES}=\mathbf e^TP^{-1}\mathbf e,\qquad \mathrm{NIS}=\nu^2/s,$$
#
# have the means 3 (for a block of three states) and 1 where the filter's model is right.

# %%
import hashlib
import tempfile
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy import stats

from insgnss.report.figures import STYLE
from insgnss.studies import data_set, failures, load_campaign, run_campaign, summary
from insgnss.studies.campaign.cases import matched
from insgnss.studies.campaign.scaling import Costs, scaling_table

plt.rcParams.update(STYLE | {"figure.dpi": 120, "figure.constrained_layout.use": True})
SEEDS = 20
keeper = tempfile.TemporaryDirectory()
folder = Path(keeper.name)

# %% [markdown]
# ## One run
#
# A simulated flight with errors drawn from the filter's own model, the filter over it, a row for each epoch looked at.

# %%
one = pd.DataFrame(matched({"imu": "tactical", "duration_s": 40}, 0))
print(one[["time_s", "nees_position", "nis_range", "position_error_m", "position_sd_m"]].round(2).to_string())

# %% [markdown]
# ## The campaign
#
# `imu_grades` of the library, with more seeds and shorter flights: three grades of IMU, the measurement noise as the
# filter assumes it or 1.4 times as large. Some seeds of one case are a task; a task writes one file.

# %%
short = {"seeds": SEEDS, "seeds_per_task": 10, "fixed": {"duration_s": 40}}
campaign = load_campaign("imu_grades").model_copy(update=short)
print(f"case {campaign.case!r}, fixed {campaign.fixed}, grid {campaign.grid}")
print(f"{campaign.n_cases} cases x {len(campaign.seed_list)} seeds = {campaign.n_runs} runs")

done = run_campaign(campaign, folder, workers=2)  # a cluster of two processes on this machine
print(f"{done.n_runs} runs in {done.n_tasks} tasks, {len(failures(folder))} of them failed")

# %% [markdown]
# In a script the call stands under `if __name__ == "__main__":`, because the workers are processes that import it. On
# the command line it is `insgnss campaign imu_grades --workers 2`, and `scheduler="tcp://host:8786"` takes a cluster
# of many machines.
#
# ## Killed and resumed, by another number of workers
#
# What is in the folder is done. We take away half of the files, as if the machine had died, and go on without any
# cluster, one run after the other in this process (`workers=0`). Then the bytes of all files are compared.


# %%
def digests() -> dict[str, str]:
    """Return the SHA-256 of each file of results."""
    files = sorted((folder / "results").glob("*.parquet"))
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


by_two = digests()
for file in sorted((folder / "results").glob("*.parquet"))[::2]:
    file.unlink()
begun = time.perf_counter()
resumed = run_campaign(campaign, folder, workers=0)
run_s = (time.perf_counter() - begun) / resumed.n_runs
same_bytes = digests() == by_two
print(
    f"{resumed.n_found} of {resumed.n_tasks} tasks were found done, {resumed.n_runs} runs were repeated by one process;"
)
print(f"the bytes of all {len(by_two)} files are those that two workers wrote: {same_bytes}")

# %% [markdown]
# ## What came out
#
# `summary` sums the files up piece by piece, however many there are; `data_set` opens them as one data set to be
# queried. The bounds hold 99.9 % of the means of chi-square numbers over 20 independent flights.

# %%
BY = ("case_imu", "case_noise_factor")
nees = summary(folder, by=BY, columns=("nees_position", "nees_velocity", "nees_attitude", "nis_range"))
print(nees.pivot(index=list(BY), columns="column", values="mean").round(2).to_string())

rows = data_set(folder).to_table().to_pandas()
last = rows[rows["time_s"] == rows["time_s"].max()]
BLOCKS = ("position", "velocity", "attitude")
low, high = stats.chi2.ppf([0.0005, 0.9995], 3 * SEEDS) / SEEDS
figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.2))
places = []
for factor, colour in ((1.0, "C0"), (1.4, "C3")):
    for imu, marker in zip(campaign.grid["imu"], "os^", strict=True):
        chosen = last[(last["case_imu"] == imu) & (last["case_noise_factor"] == factor)]
        means = [chosen[f"nees_{block}"].mean() for block in BLOCKS]
        places.append((imu, factor, *means))
        label = f"{imu}, noise x {factor:g}"
        left.plot(range(3), means, marker, color=colour, mfc="none", label=label)
        times = rows[(rows["case_imu"] == imu) & (rows["case_noise_factor"] == factor)].groupby("time_s")
        rms = np.sqrt(times["position_error_m"].apply(lambda x: (x**2).mean()))
        right.plot(rms.index, rms, marker, color=colour, mfc="none", ms=4)
        right.plot(rms.index, times["position_sd_m"].mean(), color=colour, lw=0.6)
left.axhspan(low, high, color="k", alpha=0.1, lw=0.0, label="99.9 % of the means")
left.set_xticks(range(3), BLOCKS)
left.set(ylabel="mean NEES at the last epoch (3 is right)", xlim=(-0.4, 2.4))
figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4)
right.set(xlabel="time, s", ylabel="position error, rms, m\n(lines: sigma)", yscale="log")
at_last = pd.DataFrame(places, columns=["imu", "noise_factor", *BLOCKS])

# %% [markdown]
# The grades share their seeds, so that they meet the same satellite noise: what differs between them is the sensor
# alone. With noise that the filter does not model, the position's NEES is $1.4^2$ times as large, and so is the NIS:
# this is what tells it on a real flight, where there is no truth.

# %%
wrong = at_last[at_last["noise_factor"] == 1.4]
right_ones = at_last[at_last["noise_factor"] == 1.0]
factor_of_position = float(wrong["position"].mean() / right_ones["position"].mean())
nis = nees[nees["column"] == "nis_range"].set_index(list(BY))["mean"].unstack()
print(nis.round(3).to_string())

# %% [markdown]
# ## How far it would scale
#
# With the time of a run from above and 2 ms of scheduler and client for a task (assumed), the queue is played through
# for other numbers of workers. Tasks of 10 runs make the scheduler the bottleneck somewhere; longer tasks move that on.

# %%
size = sum(file.stat().st_size for file in (folder / "results").glob("*.parquet")) / campaign.n_runs
plans = {n: scaling_table(Costs(run_s, 2e-3, 2e3, size), 100_000, n, (2, 16, 64, 256)) for n in (1, 10, 100)}
for per_task, plan in plans.items():
    print(f"{per_task} runs a task")
    print(
        plan[["workers", "hours", "efficiency", "scheduler_load", "bottleneck"]]
        .round(3)
        .to_string(index=False)
    )
keeper.cleanup()

# %% [markdown]
# ## Answer

# %%
means = right_ones[list(BLOCKS)].to_numpy()
assert done.n_failed == 0 and not done.lost and len(by_two) == done.n_tasks
assert same_bytes and resumed.n_found == done.n_tasks // 2 and resumed.n_runs == campaign.n_runs // 2
assert low < means.min() <= means.max() < high
assert (wrong["position"] > high).all() and 1.6 < factor_of_position < 2.4
assert nis[1.0].between(0.9, 1.1).all() and nis[1.4].between(1.7, 2.1).all()
print(
    f"Answer: over {done.n_runs} flights the mean NEES of position, velocity and attitude lies in"
    f" {means.min():.2f}...{means.max():.2f} for three grades of IMU (bounds {low:.2f}, {high:.2f}); with 1.4 times the"
    f" noise that of the position is {factor_of_position:.1f} times as large and the NIS {nis[1.4].mean():.2f}; a"
    f" campaign killed under two workers and resumed by one process has the same bytes in all {len(by_two)} files."
)
