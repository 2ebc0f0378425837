"""How the receiver's clock behaves: not steered, moved by jumps, or steered; do both its drifts agree."""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.constants import C_MPS
from insgnss.log.checks.rates import clock_jumps, leaps_finding
from insgnss.log.checks.report import Finding
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
