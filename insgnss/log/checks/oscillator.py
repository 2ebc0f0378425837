"""Whether the receiver's clock wanders as its declared oscillator does: one declared too quiet passes for motion."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.config.flight import Oscillator
from insgnss.config.library import find, names
from insgnss.config.strict import load_toml
from insgnss.constants import SIGMA_PER_MEDIAN
from insgnss.inertial.clock_model import clock_model
from insgnss.log.checks.report import Finding, Proposal
from insgnss.log.checks.track import GnssTrack
from insgnss.tables import Float64

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
