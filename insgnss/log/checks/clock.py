"""The receiver clock's behaviour: free-running, with jumps, or steered; and whether its two drifts agree.

Also whether it drifts as the declared oscillator does: the filter takes unexpected drift for motion.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.config.flight import Oscillator
from insgnss.config.library import find, names
from insgnss.config.strict import load_toml
from insgnss.constants import C_MPS, SIGMA_PER_MEDIAN
from insgnss.inertial.clock_model import clock_model
from insgnss.log.checks.rates import clock_jumps, leaps_finding
from insgnss.log.checks.report import Finding, Proposal
from insgnss.log.checks.track import GnssTrack
from insgnss.tables import Float64

MIN_EPOCHS: Final = 10
STEERED_M: Final = 300.0  # a clock that stays within a microsecond is held there by the receiver
PPM_MPS: Final = 1e-6 * C_MPS
# The code's clock and the range rates' drift differ by less in every receiver that has one clock
DRIFT_AGREES_MPS: Final = 1.0


def clock_findings(track: GnssTrack) -> list[Finding]:
    """Return the clock's offset, drift, jumps, and the drift by pseudoranges against that of the range rates."""
    if len(track.t_s) < MIN_EPOCHS:
        return []
    step_s = np.diff(track.t_s)
    change = np.diff(track.clock_m)
    drift = track.drift_mps
    by_rates = bool(np.isfinite(drift).all())
    mean = 0.5 * (drift[1:] + drift[:-1]) if by_rates else np.full(len(change), np.median(change / step_s))
    beyond_m = change - mean * step_s
    jumped, leaped = clock_jumps(beyond_m)
    jumps = len(jumped)
    smooth = float(np.median(mean))
    span = f"{track.clock_m.min() / C_MPS * 1e3:+.4g} to {track.clock_m.max() / C_MPS * 1e3:+.4g} ms"
    by_jumps = np.zeros(len(track.clock_m))
    by_jumps[jumped + 1] = beyond_m[jumped]
    kind = _kind(track.clock_m, np.cumsum(by_jumps), smooth, float(track.t_s[-1] - track.t_s[0]))
    text = f"receiver clock {kind}: offset {span}, drift {smooth:+.4g} m/s ({smooth / PPM_MPS:+.3g} ppm)"
    if jumps:
        size = float(np.median(np.abs(beyond_m[jumped]))) / C_MPS * 1e3
        text += f", {jumps} jump(s) of {size:.3g} ms"
    findings = [Finding("ok", "gnss", text)]
    if len(leaped):
        findings.append(leaps_finding(beyond_m[leaped]))
    smooth_at = np.delete(np.arange(len(change)), np.append(jumped, leaped))
    return findings + (_agreement(change[smooth_at], step_s[smooth_at], mean[smooth_at]) if by_rates else [])


def _kind(clock_m: Float64, by_jumps_m: Float64, drift_mps: float, span_s: float) -> str:
    """Return how the receiver treats its clock; ``by_jumps_m`` is the part of the offset that jumps made so far."""
    if by_jumps_m.any():
        is_held = np.ptp(clock_m) < np.ptp(clock_m - by_jumps_m)
        return "held near GPS time by jumps" if is_held else "moved away from GPS time by jumps"
    wandered = float(np.ptp(clock_m))
    if wandered < STEERED_M and abs(float(np.median(clock_m))) < STEERED_M:
        return "steered to GPS time" if abs(drift_mps) * span_s > 2.0 * STEERED_M else "near GPS time"
    return "not steered"


def _agreement(change: Float64, step_s: Float64, mean: Float64) -> list[Finding]:
    if len(change) < MIN_EPOCHS:
        return []
    by_code = float(np.sum(change) / np.sum(step_s))
    by_rates = float(np.sum(mean * step_s) / np.sum(step_s))
    if abs(by_code - by_rates) < DRIFT_AGREES_MPS:
        return []
    text = (
        f"the clock drifts {by_code:+.3g} m/s by the pseudoranges and {by_rates:+.3g} m/s by the range rates"
    )
    advice = "the receiver steers one of them: give gnss.oscillator enough noise for the difference"
    return [Finding("warning", "gnss", text, advice)]


SHORT_S: Final = 10.0  # over which the drift is compared with itself: reflections last less
LONG_S: Final = 30.0
TIMES_DECLARED: Final = 100.0  # density of the drift's noise: ten times in sigma
LEAST_MPS: Final = 0.2  # in the time between the two: the air changes what satellites have in common by less
MIN_PAIRS: Final = 30
_SURE: Final = "sure: nothing but a clock changes all range rates so"


def oscillator_findings(track: GnssTrack, declared: Oscillator) -> list[Finding]:
    """Return a finding if the clock's drift wanders far more than the declared oscillator allows.

    Equation: E[(d(t + T) - d(t))^2] = 2 r + S T for a drift that is driven by noise of density S and measured with the
    variance r. The difference between two T is free of r, and of errors that last less than both.

    Parameters
    ----------
    track : solutions of single epochs; their drifts are those of the range rates
    """
    known = np.isfinite(track.drift_mps)
    t_s, drift = track.t_s[known], track.drift_mps[known]
    if len(t_s) < MIN_PAIRS or t_s[-1] - t_s[0] < 2.0 * LONG_S:
        return []
    short = _mean_square(t_s, drift, SHORT_S)
    wandered = _mean_square(t_s, drift, LONG_S) - short
    density = wandered / (LONG_S - SHORT_S)
    allowed = clock_model(declared).drift_density
    if not (wandered > max(LEAST_MPS**2, 0.5 * short) and density > TIMES_DECLARED * allowed):
        return []
    text = (
        f"the receiver clock's drift changes by {math.sqrt(density * SHORT_S):.2g} m/s in {SHORT_S:g} s, and the"
        f" declared oscillator's by {math.sqrt(allowed * SHORT_S):.2g} m/s: the filter would take the rest for motion"
    )
    name = _noisy_enough(density)
    proposal = Proposal("gnss.oscillator", name, f"the drift's noise has the density {density:.2g} m^2/s^3")
    return [Finding("error", "gnss", text, sure=_SURE, proposals=(proposal,))]


def _mean_square(t_s: Float64, drift: Float64, lag_s: float) -> float:
    """Return the mean square of the drift's change over a lag, by the median size; 0 with too few pairs."""
    later = np.minimum(np.searchsorted(t_s, t_s + lag_s - 1e-3), len(t_s) - 1)
    pairs = np.abs(t_s[later] - t_s - lag_s) < 0.1 * lag_s
    if pairs.sum() < MIN_PAIRS:
        return 0.0
    return float((SIGMA_PER_MEDIAN * np.median(np.abs(drift[later] - drift)[pairs])) ** 2)


def _noisy_enough(density: float) -> str:
    """Return the quietest oscillator of the library that may wander so, within a factor of three, or the noisiest."""
    known = {
        name: clock_model(load_toml(find("oscillators", name), Oscillator)).drift_density
        for name in names("oscillators")
    }
    enough = [name for name in known if 3.0 * known[name] > density]
    return min(enough, key=known.__getitem__) if enough else max(known, key=known.__getitem__)
