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
# # 07 Discriminators and loops
#
# **Question.** How well do the closed forms of discriminator and bandwidth predict a tracking loop, and where do they
# fail?
#
# A loop is designed with three numbers: the slope of its discriminator, the variance of its noise, and a bandwidth.
#
# An integration over $T$ at the C/N0 $q$ has the signal ratio $a=2qT$. Correlators are scaled so that a matched one has
# the mean $a$ and each of its quadratures the variance $a$; $e$ is what is received minus the replica:
#
# $$I+jQ=a\,\rho(e_\tau)\,e^{j e_\varphi}+n,\qquad \operatorname{var} n_I=\operatorname{var} n_Q=a .$$
#
# The equations are those of Surikov (2012), cited by their numbers in the docstrings, with misprints corrected; the
# numbers asserted below were computed from them by hand.

# %%
import math

import matplotlib.pyplot as plt
import numpy as np

from insgnss.constants import C_MPS
from insgnss.errors import ConfigError
from insgnss.gnss.signals import L1_HZ
from insgnss.report.figures import STYLE
from insgnss.tracking.admissible import signal_ratio
from insgnss.tracking.codes import gps_ca
from insgnss.tracking.combined_filter import CODE, PHASE, CombinedModel
from insgnss.tracking.combined_loop import linear_transient, nonlinear_transient, read_response
from insgnss.tracking.delay_discriminators import DelayDiscriminator
from insgnss.tracking.discriminators import equivalent_variance, linear_range, pull_in_range, simulate
from insgnss.tracking.loop_filters import LARGEST_BT, continuous_gains, digital_filter, filter_from_continuous
from insgnss.tracking.phase_discriminators import PhaseDiscriminator
from insgnss.tracking.trial import CarrierDynamics, assess, design_channels, simulation_of

plt.rcParams.update(STYLE | {"figure.dpi": 120, "figure.constrained_layout.use": True})
T = 1e-3
PHASE_KINDS = ("iq", "sign", "atan", "q", "atan2")
DELAY_KINDS = ("product", "sign", "tanh", "dot", "power")
rng = np.random.default_rng(2012)

# %% [markdown]
# ## S-curves: lines in closed form, dots simulated
#
# Divided by their slopes all curves begin alike. Those that do not feel the data's sign (`iq`, `sign`, `atan`) repeat
# after half a turn; the others reach twice as far, but need a signal without data.

# %%
a = signal_ratio(37.0, T)
figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 2.8))
worst = 0.0
for axes, found, kinds, grid in (
    (left, PhaseDiscriminator, PHASE_KINDS, np.linspace(-math.pi, math.pi, 241)),
    (right, DelayDiscriminator, DELAY_KINDS, np.linspace(-1.5, 1.5, 241)),
):
    for number, kind in enumerate(kinds):
        one = found(kind)
        (line,) = axes.plot(grid, one.mean(grid, a) / one.slope(a), label=kind)
        dots = simulate(one, grid[4 + number :: 12], a, 4000, rng)
        axes.plot(grid[4 + number :: 12], dots.mean / one.slope(a), ".", ms=4, color=line.get_color())
        away = (dots.mean - one.mean(grid[4 + number :: 12], a)) / dots.sd_mean
        worst = max(worst, float(np.abs(away).max()))
    axes.legend(loc="upper left")
left.set_xlabel("phase offset, rad")
left.set_ylabel("mean output over slope, rad")
right.set_xlabel("delay offset, chips (spacing one chip)")
right.set_ylabel("mean output over slope, chips")
figure.suptitle("37 dBHz, 1 ms")

product, iq = DelayDiscriminator("product"), PhaseDiscriminator("iq")
at = np.array([0.1, 0.25, 0.5, 0.75, 1.0])
print(
    "delay, product, at 0.1 ... 1 chip:", product.mean(at, a).round(4), " slope", round(product.slope(a), 3)
)
print(f"largest distance of {5 * (20 + 20)} dots from the lines: {worst:.1f} sigma")
for kind in ("iq", "atan", "atan2"):
    one = PhaseDiscriminator(kind)
    straight, unstable = linear_range(one, a, math.pi), pull_in_range(one, a, math.pi)
    print(f"{kind}: straight to 10 % up to {straight:.2f} rad, unstable point at {unstable:.2f} rad")

# %% [markdown]
# ## Noise: what the discriminator costs
#
# The equivalent observation has the variance of the output over the slope squared. For `iq` it is
#
# $$D_\varphi=\frac{1}{2qT}\left(1+\frac{1}{2qT}\right),$$
#
# the second factor being the squaring loss: without data it would not be there (`q`). Dots are simulated at 4000 looks.

# %%
cn0 = np.arange(20.0, 50.1, 1.0)
figure, axes = plt.subplots(figsize=(5.5, 2.8))
variance_misfit = 0.0
for kind in PHASE_KINDS:
    one = PhaseDiscriminator(kind)
    rms = np.degrees(np.sqrt([equivalent_variance(one, signal_ratio(c, T)) for c in cn0]))
    (line,) = axes.semilogy(cn0, rms, label=kind)
    for c in (25.0, 35.0, 45.0):
        ratio = signal_ratio(c, T)
        drawn = simulate(one, 0.0, ratio, 4000, rng)
        shown = math.degrees(math.sqrt(drawn.variance) / one.slope(ratio))
        axes.plot(c, shown, "o", ms=4, color=line.get_color())
        off = abs(float((drawn.variance - one.variance(0.0, ratio)) / drawn.sd_variance))
        variance_misfit = max(variance_misfit, off)
axes.set_xlabel("C/N0, dBHz")
axes.set_ylabel("rms of one observation of 1 ms, deg")
axes.legend()

D_phase = equivalent_variance(iq, a)
chip_s = 1.0 / 511e3
D_delay = equivalent_variance(product, a) * chip_s**2
print(f"37 dBHz, 1 ms: phase {D_phase:.5f} rad² ({math.sqrt(D_phase):.4f} rad), delay {D_delay:.4e} s²")
print(
    f"that is {math.sqrt(D_delay) * C_MPS:.1f} m of code of 511 kchip/s; largest misfit {variance_misfit:.1f} sigma"
)

# %% [markdown]
# ## The bandwidth that a loop really has
#
# The gains of a continuous loop, multiplied by $T$, make a digital one whose noise bandwidth
# $B=\operatorname{var}\tilde x/(2T\operatorname{var} y)$ is larger than the wanted one, until it runs away.
# `digital_filter` solves for the gains whose *true* bandwidth is the one asked for, up to the limit that its order has.

# %%
figure, axes = plt.subplots(figsize=(5.5, 2.6))
ends = {}
for order in (1, 2, 3):
    wanted, true = [], []
    for bt in np.logspace(-3.0, 0.0, 80):
        try:
            loop = filter_from_continuous(continuous_gains(order, bt / T), T)
        except ConfigError as error:
            ends[order] = error.message
            break
        wanted.append(bt)
        true.append(loop.noise_bandwidth_hz() * T)
    axes.semilogx(wanted, np.array(true) / wanted, label=f"order {order}, gains of the continuous loop")
designed = digital_filter(3, 300.0, T).noise_bandwidth_hz()
axes.axhline(1.0, color="k", lw=0.8, ls="--", label="digital_filter, all orders")
axes.set_ylim(0.9, 4.0)
axes.set_xlabel("wanted bandwidth times T")
axes.set_ylabel("true bandwidth over wanted")
axes.legend()
euler = filter_from_continuous(continuous_gains(3, 50.0), T).noise_bandwidth_hz()
print(f"order 3, 50 Hz asked for at 1 ms: continuous gains give {euler:.1f} Hz; largest B T {LARGEST_BT}")
for order, told in ends.items():
    print(f"order {order}: {told}")

# %% [markdown]
# Does a loop with real discriminators have the error of the linear theory? Twelve channels of GPS C/A at 40 dBHz, with
# data, third order of 15 Hz; and the same down to where they slip.

# %%
levels, seen = (45.0, 40.0, 35.0, 30.0, 27.0), []
for c in levels:
    carrier, delay = digital_filter(3, 15.0, T), digital_filter(1, 1.0, T)
    design = design_channels(gps_ca(7), L1_HZ, c, carrier, delay, phase_kind="iq")
    simulation = simulation_of(design, gps_ca(7), L1_HZ, CarrierDynamics(), seconds=12.0, channels=12, seed=7)
    seen.append(assess(simulation, simulation.run(seed=7)))
print("C/N0   phase rms   linear theory   slipped   C/N0 by moments, narrow-wide")
for c, one in zip(levels, seen, strict=True):
    print(
        f"{c:4.0f}   {math.degrees(one.phase_rms_rad):7.2f}°   {math.degrees(one.phase_noise_rad):9.2f}°"
        f"   {one.slipped:4d}/{one.channels}"
        + (f"     {one.moment_dbhz:.1f}, {one.narrow_wide_dbhz:.1f} dBHz" if one.slipped == 0 else "     -")
    )

# %% [markdown]
# ## Code and phase in one filter
#
# The state is [code range, rate, phase range] in metres, with one white noise on the rate, $S_\xi=\sigma_a^2/\beta$:
#
# $$D_{11}=\sqrt{2\sqrt{S_\xi S_e^3}},\qquad \frac1{S_e}=\frac1{S_\tau}+\frac1{S_{\tau_d}},\quad S=D\,T .$$

# %%
CARRIER_HZ, CHIP_HZ = 1.6e9, 511e3


def model(sigma_a: float = 10.0, cn0_dbhz: float = 37.0) -> CombinedModel:
    """Return the filter for a standard deviation of the acceleration [m/s^2] with beta = 1/s."""
    return CombinedModel(cn0_dbhz, CARRIER_HZ, CHIP_HZ, sigma_a**2)


columns, rows = (32.0, 37.0, 40.0), (1.0, 10.0, 30.0, 50.0, 100.0)
steady_mm = np.array([[1e3 * math.sqrt(model(s, c).steady_variance()) for c in columns] for s in rows])
print("steady rms, mm, at", columns, "dBHz")
for s, row in zip(rows, steady_mm, strict=True):
    print(f"  {s:5.0f} m/s²: {row.round(3)}")

# %% [markdown]
# The formula says nothing of the time it takes. Code and phase differ by a constant that the code's noise alone
# averages, $1/(1/P_0+k/(D_\tau+D_{\tau_d}))$: the phase range is good to millimetres at once, the code range not.
# A step of the phase shows the same: 0.3 rad die out in 25 ms, and pull the code along for good.

# %%
variances = model().variances(np.diag([1e6, 1e4, 1e6]), 10_000).filtered
after = T * np.arange(1, 10_001)
gains = model().steady_gains().gains
step = linear_transient(model(), gains, 0.3, 200)
response = read_response(step.time_s, step.phase_rad)

figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 2.8))
left.loglog(after, np.sqrt(variances[:, CODE, CODE]), label="code range")
left.loglog(after, np.sqrt(variances[:, PHASE, PHASE]), label="phase range")
left.axhline(1e-3 * steady_mm[1, 1], color="k", ls="--", lw=0.8, label="closed form for both")
left.set_xlabel("time, s")
left.set_ylabel("rms after the update, m")
left.legend()
right.plot(1e3 * step.time_s[:80], step.phase_rad[:80], "k--", label="0.3 rad, linear")
ends_at = {}
for start in (0.3, 0.8, 1.2, 1.5, 1.7):
    bent = nonlinear_transient(model(), gains, start, 600)
    ends_at[start] = float(bent.phase_rad[-1])
    right.plot(1e3 * bent.time_s[:80], bent.phase_rad[:80], label=f"{start} rad, with correlators")
right.set_xlabel("time, ms")
right.set_ylabel("phase offset, rad")
right.legend()
code_pull_m = float(step.code_m[-1])
print(f"step of 0.3 rad: zero after {1e3 * response.zero_crossing_s:.0f} ms,", end=" ")
print(f"overshoot {100 * response.overshoot:.1f} %, within 5 % after {1e3 * response.settling_s:.0f} ms;")
print(f"the code is left {1e3 * code_pull_m:.1f} mm off")
code_after = np.sqrt(variances[[199, 999, 9999], CODE, CODE])
phase_mm = 1e3 * math.sqrt(variances[99, PHASE, PHASE])
print(f"code range after 0.2, 1, 10 s: {code_after.round(2)} m; phase range after 0.1 s: {phase_mm:.2f} mm")

# %% [markdown]
# ## Answer
#
# The linear theory is good to the point where the first channels slip. A loop comes back from 1.5 rad and not from
# 1.7: $\pi/2$ is the limit, not the end of the straight part of the curve (0.39 rad).

# %%
misfit, doubled_dbhz = max(worst, variance_misfit), 10.0 * math.log10(1.0 / (2.0 * T))
off = max(abs(one.phase_rms_rad / one.phase_noise_rad - 1.0) for one in seen[:3])

assert worst < 4.5 and variance_misfit < 4.0
assert np.allclose(product.mean(at, a), [18.0856, 37.6783, 50.2377, 18.8391, 0.0], atol=2e-4)
assert math.isclose(product.slope(a), 200.951, abs_tol=1e-3)
assert math.isclose(D_phase, 0.10972, abs_tol=1e-5) and math.isclose(D_delay, 2.1009e-13, rel_tol=1e-4)
assert abs(designed - 300.0) < 1e-6 and euler > 53.0
assert off < 0.1 and seen[-1].slipped > 0
assert np.allclose(steady_mm[1], [8.183, 4.969, 3.769], atol=1e-3)
assert np.allclose(code_after, [9.7, 4.34, 1.37], rtol=5e-3)
assert math.isclose(response.zero_crossing_s, 0.006) and math.isclose(response.settling_s, 0.025)
assert math.isclose(code_pull_m, -8.9e-3, abs_tol=1e-4)
assert abs(ends_at[1.5]) < 1e-3 and math.isclose(ends_at[1.7], math.pi, abs_tol=1e-3)
print(
    f"Answer: means and variances hold, no simulated dot is further off than {misfit:.1f} of its sigma; at 37 dBHz and"
    f" 1 ms one observation has {math.sqrt(D_phase):.3f} rad and {math.sqrt(D_delay) * C_MPS:.0f} m, the squaring loss"
    f" doubles the variance at {doubled_dbhz:.0f} dBHz; gains of a continuous loop give {euler:.0f} Hz for 50 Hz; the"
    f" linear theory tells the rms to {100 * off:.0f} % down to 35 dBHz, but at {levels[-1]:.0f} dBHz"
    f" {seen[-1].slipped} of 12 channels slip; combined with code the phase range has {steady_mm[1, 1]:.2f} mm at once,"
    f" the code range {code_after[2]:.1f} m after 10 s."
)
