"""Statistics of the innovations in a run's ledger: NIS against chi-square, noise factors, whiteness.

A gate cuts the innovations off at g sigmas, so the used ones are not a chi-square sample: under the hypothesis
that the filter is right, z^2 of a used row has the mean

    m(g) = 1 - 2 g phi(g) / (2 Phi(g) - 1)                       [variance of a standard normal truncated at +-g]

which is 0.9733 at 3, 0.99999 at 5 sigmas. Bounds and noise factors here are about that mean, not about 1. Rows that
another test refused (inconsistent, drifting, reflected) were cut off in no such simple way: they count as refused, and
the robust scale, a median over used and refused rows, shows whether the refused ones change the picture.

The innovations of an epoch share the error of the predicted state, which may be most of them: of range rates it is. A
weighted fit of three coordinates and the clocks (``fitted``) takes that out exactly, whatever its covariance; what is
left is noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy import optimize, stats

from insgnss.geodesy.directions import directions
from insgnss.runs.result import Run
from insgnss.studies.consistency.error_statistics import LEAST_ROWS, bounds_of_mean
from insgnss.tables import Float64, Int64

_PLACE: Final = 3
_MOST_LEVERAGE: Final = 0.95  # a row that the fit follows says nothing of its noise
_RANK: Final = 1e-9
GATE_KEYS: Final = {
    "pseudorange": "pseudorange_sigma",
    "range_rate": "range_rate_sigma",
    "carrier_difference": "carrier_sigma",
    "attitude_difference": "",  # the flight's own, near the default
}
_PREDICTED: Final = {"pseudorange": "sd_range_m", "range_rate": "sd_range_rate_mps"}
_LOOK: Final = ("az_deg", "el_deg", *_PREDICTED.values())
_LARGEST_SHARE: Final = 0.999
REFUSED: Final = ("gated", "inconsistent", "drifting", "reflected")  # for what their innovation was
_DEFAULT_GATE: Final = 5.0
_LARGEST_GATE: Final = 30.0  # sigmas: a wider one cuts nothing off
_MAD_TO_SIGMA: Final = 1.482602218505602  # of a normal distribution
_LARGEST_FACTOR: Final = 30.0


def fitted(rows: pd.DataFrame) -> tuple[Float64, Float64]:
    """Return the residuals (n,) over their sigma and the leverages (n,) of used rows of one kind, NaN without a say.

    Equation: nu = [u 1] x + v, v ~ (0, diag r); e = nu - [u 1] x_hat has the variance r_i (1 - h_ii), h_ii = r_i^-1
              a_i^T (sum_j a_j a_j^T / r_j)^-1 a_i

    Parameters
    ----------
    rows : time_s clock innovation r u_n u_e u_d; ``clock`` groups rows that may differ by a clock's offset
    """
    n = len(rows)
    if n == 0:
        return np.zeros(0), np.zeros(0)
    _, epoch = np.unique(rows["time_s"].to_numpy(), return_inverse=True)
    _, clock = np.unique(rows["clock"].to_numpy(str), return_inverse=True)
    order = np.argsort(epoch, kind="stable")
    count = np.bincount(epoch)
    place = np.empty(n, np.intp)
    place[order] = np.arange(n) - np.repeat(np.cumsum(count) - count, count)
    width = _PLACE + int(clock.max()) + 1
    A = np.zeros((len(count), int(count.max()), width))
    nu = np.zeros(A.shape[:2])
    sd = np.sqrt(rows["r"].to_numpy())
    A[epoch, place, :_PLACE] = -rows[["u_n", "u_e", "u_d"]].to_numpy() / sd[:, None]
    A[epoch, place, _PLACE + clock] = 1.0 / sd
    nu[epoch, place] = rows["innovation"].to_numpy() / sd
    inverse = np.linalg.pinv(np.einsum("eij,eik->ejk", A, A), rcond=_RANK, hermitian=True)
    x = np.einsum("ejk,eik,ei->ej", inverse, A, nu)
    left = (nu - np.einsum("eij,ej->ei", A, x))[epoch, place]
    leverage = np.einsum("eij,ejk,eik->ei", A, inverse, A)[epoch, place]
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = np.where(leverage < _MOST_LEVERAGE, left / np.sqrt(1.0 - leverage), np.nan)
    return scaled, np.where(np.isfinite(scaled), leverage, np.nan)


class InnovationRows(NamedTuple):
    """The rows of a ledger that were judged by their innovation, and what they need for the statistics."""

    table: pd.DataFrame  # time_s sv signal kind z share used residual leverage; z is innovation over sigma
    gates: dict[str, float]  # sigmas, by kind


def judged_rows(run: Run, from_s: float) -> InnovationRows:
    """Return the used rows and those refused for their innovation, from a time on.

    ``share`` is D / S, the part of an innovation's variance that is the state's: by it the rows of an epoch share the
    state's error. ``residual`` and ``leverage`` are those of ``fitted``. A ledger does not give D of carrier
    differences: their share is taken as zero and they have no residual.
    """
    m = run.measurements
    wanted = m["status"].isin(("used", *REFUSED)) & (m["time_s"] >= from_s) & np.isfinite(m["innovation"])
    table = m.loc[wanted, ["time_s", "sv", "signal", "kind", "innovation", "sd_innovation", "status"]]
    table = table.astype({"sv": "str", "signal": "str", "kind": "str"})
    table["z"] = table["innovation"] / table["sd_innovation"]
    table["used"] = (table["status"] == "used").to_numpy()
    s = run.satellites.astype({"sv": "str"})[["time_s", "sv", *_LOOK]]
    table = table.merge(s, on=["time_s", "sv"], how="left")
    sd = np.zeros(len(table))
    for kind, column in _PREDICTED.items():
        rows = (table["kind"] == kind).to_numpy()
        sd[rows] = table.loc[rows, column]
    # single precision in the ledger leaves a rounding error; a share of one would mean no noise at all
    share = np.clip(np.nan_to_num(sd**2 / table["sd_innovation"].to_numpy() ** 2), 0.0, _LARGEST_SHARE)
    table["share"] = share
    table["residual"], table["leverage"] = np.nan, np.nan
    for kind in _PREDICTED:
        rows = (table["used"] & (table["kind"] == kind)).to_numpy()
        table.loc[rows, ["residual", "leverage"]] = np.column_stack(fitted(_for_fit(table[rows], kind)))
    columns = ["time_s", "sv", "signal", "kind", "z", "used", "share", "residual", "leverage"]
    return InnovationRows(table[columns], gates_of(run.settings))


def _for_fit(rows: pd.DataFrame, kind: str) -> pd.DataFrame:
    """Return the rows of a kind as ``fitted`` wants them."""
    north, east, down = directions(rows["az_deg"], rows["el_deg"]).T
    letter = rows["sv"].str[0]
    return pd.DataFrame(
        {
            "time_s": rows["time_s"],
            "clock": letter + rows["signal"] if kind == "pseudorange" else "one drift",
            "innovation": rows["innovation"],
            "r": rows["sd_innovation"] ** 2 * (1.0 - rows["share"]),
            "u_n": north,
            "u_e": east,
            "u_d": down,
        }
    )


def gates_of(settings: Mapping[str, Any]) -> dict[str, float]:
    """Return the gate of each kind in sigmas, from a run's settings."""
    gates = settings.get("filter", {}).get("gates", {})
    return {kind: min(float(gates.get(key, _DEFAULT_GATE)), _LARGEST_GATE) for kind, key in GATE_KEYS.items()}


def truncated_mean(gate: npt.ArrayLike) -> Float64:
    """Return the mean of z^2 for a standard normal z cut off at +-gate."""
    g = np.asarray(gate, np.float64)
    return np.asarray(1.0 - 2.0 * g * stats.norm.pdf(g) / (2.0 * stats.norm.cdf(g) - 1.0))


def independent_count(time_s: Float64, share: Float64) -> float:
    """Return how many independent values the rows are worth.

    Equation: Var(sum z_i^2) = 2 sum_ij rho_ij^2, rho_ij^2 <= d_i d_j with d = D / S within an epoch, 0 between epochs
    """
    _, epoch = np.unique(time_s, return_inverse=True)
    total = np.bincount(epoch, weights=share)
    spread = len(share) + float(np.sum(total**2) - np.sum(share**2))
    return len(share) ** 2 / spread if len(share) else 0.0


class Nis(NamedTuple):
    """Normalised innovations squared of one group of rows."""

    used: int
    refused: int
    dof: float  # independent values among the used
    mean_nis: float
    expected: float  # of a consistent filter behind its gate
    low: float
    high: float
    share_95: float  # of the used below the 95 % point of chi-square, 0.95 is right
    mean_z: float  # innovation over sigma
    mean_z_bound: float
    robust_scale: float  # of z, 1 is right; of used and refused
    factor: float  # on the assumed sigma of the noise, NaN where it is undetermined


def nis_of(rows: pd.DataFrame, gate: float, confidence: float, of_kind: float | None = None) -> Nis | None:
    """Return the statistics of rows of one kind, None where there are too few.

    ``of_kind`` is the noise factor of the whole kind where the rows are one satellite's, None where they are the kind's
    own.
    """
    used = rows[rows["used"]]
    if len(used) < LEAST_ROWS:
        return None
    z, share = used["z"].to_numpy(), used["share"].to_numpy()
    count = independent_count(used["time_s"].to_numpy(), share)
    expected = float(truncated_mean(gate))
    low, high = bounds_of_mean(count, confidence)
    normal = stats.norm.isf(0.5 * (1.0 - confidence))
    # a sum of innovations is worth less than one of their squares: correlations count once, not squared
    of_mean = _count_for_mean(used["time_s"].to_numpy(), share)
    return Nis(
        used=len(used),
        refused=int((~rows["used"]).sum()),
        dof=count,
        mean_nis=float(np.mean(z**2)),
        expected=expected,
        low=expected * low,
        high=expected * high,
        share_95=float(np.mean(z**2 <= stats.chi2.ppf(0.95, 1))),
        mean_z=float(np.mean(z)),
        mean_z_bound=float(normal / math.sqrt(of_mean)),
        robust_scale=float(_MAD_TO_SIGMA * np.median(np.abs(rows["z"]))),
        factor=common_factor(used, gate) if of_kind is None else satellite_factor(used, of_kind),
    )


def _count_for_mean(time_s: Float64, share: Float64) -> float:
    """Return how many independent values the rows are worth for their mean: |rho_ij| <= sqrt(d_i d_j)."""
    _, epoch = np.unique(time_s, return_inverse=True)
    total = np.bincount(epoch, weights=np.sqrt(share))
    return len(share) ** 2 / (len(share) + float(np.sum(total**2) - np.sum(share)))


def common_factor(used: pd.DataFrame, gate: float) -> float:
    """Return the factor on a kind's assumed sigma of noise, NaN where its rows have no redundancy.

    Equation: f^2 (1 - c (1 - m(g / sqrt(q)))) = sum e_i^2 / sum (1 - h_ii), e over sqrt(r), q = d + f^2 (1 - d),
              c = f^2 (1 - d) / q, d the mean share: a gate on the innovation takes of the noise's variance what it
              takes of the innovation's, times their correlation squared
    """
    rows = used[np.isfinite(used["residual"])]
    freedom = 1.0 - rows["leverage"].to_numpy()
    if freedom.sum() < LEAST_ROWS:
        return math.nan
    mean_square = float(np.sum(rows["residual"].to_numpy() ** 2 * freedom) / freedom.sum())
    share = float(rows["share"].mean())

    def excess(log_f: float) -> float:
        f2 = math.exp(2.0 * log_f)
        q = share + f2 * (1.0 - share)
        taken = 1.0 - float(truncated_mean(gate / math.sqrt(q)))
        return mean_square - f2 * (1.0 - f2 * (1.0 - share) / q * taken)

    return _factor_at_zero(excess)  # NaN: as even as the gate lets through


def satellite_factor(used: pd.DataFrame, of_kind: float) -> float:
    """Return the factor on the assumed sigma of one satellite's noise, the others' being that of the kind.

    Equation: sum_i w_i (e_i^2 / q_i - 1) = 0, q_i = h_i + f^2 (1 - h_i), w_i = (1 - h_i) / q_i: maximum likelihood of
              f, e over sqrt(r (1 - h)): the residual against the fit of the other rows has r (f^2 + h / (1 - h))
    """
    rows = used[np.isfinite(used["residual"])]
    if len(rows) < LEAST_ROWS or not of_kind > 0.0:
        return math.nan
    z2, h = (rows["residual"].to_numpy() / of_kind) ** 2, rows["leverage"].to_numpy()

    def score(log_f: float) -> float:
        q = h + math.exp(2.0 * log_f) * (1.0 - h)
        return float(np.sum((1.0 - h) / q * (z2 / q - 1.0)))

    return of_kind * _factor_at_zero(score)


def _factor_at_zero(falling: Callable[[float], float]) -> float:
    """Return the factor at whose logarithm a falling function is zero, NaN where it is beyond the largest factors."""
    ends = -math.log(_LARGEST_FACTOR), math.log(_LARGEST_FACTOR)
    if not falling(ends[0]) > 0.0 > falling(ends[1]):
        return math.nan
    return math.exp(float(optimize.brentq(falling, *ends, xtol=1e-6)))


class Whiteness(NamedTuple):
    """Autocorrelation of a sequence of innovations, and the Ljung-Box test over its lags."""

    correlation: Float64  # (k,) at lag 1 .. k, about zero mean
    bound: Float64  # (k,) of each
    pairs: Int64  # (k,)
    q: float
    p_value: float
    correlation_time_s: float  # of an exponential through lag one, 0 where there is no correlation


def whiteness_of(rows: pd.DataFrame, period_s: float, lags: int, confidence: float) -> Whiteness | None:
    """Return the autocorrelation of used innovations over successive epochs, all satellites and signals together.

    Equation: Q = n (n + 2) sum_k rho_k^2 / (n - k) ~ chi2(lags)                             [Ljung & Box 1978]
    n is the number of independent innovations of lag one. The mean is not taken off: it should be zero.

    Parameters
    ----------
    rows : of one kind, used
    period_s : between epochs
    """
    n_rows = len(rows)
    if n_rows <= LEAST_ROWS + lags:
        return None
    step = np.rint((rows["time_s"].to_numpy() - rows["time_s"].min()) / period_s).astype(np.int64)
    series = rows.groupby(["sv", "signal"], sort=False).ngroup().to_numpy()
    z = np.full((int(series.max()) + 1, int(step.max()) + 1), np.nan)
    z[series, step] = rows["z"]
    shared = independent_count(rows["time_s"].to_numpy(), rows["share"].to_numpy()) / n_rows
    power = float(np.nanmean(z**2))
    normal = stats.norm.isf(0.5 * (1.0 - confidence) / lags)  # Bonferroni over the lags
    rho, pairs = np.zeros(lags), np.zeros(lags, np.int64)
    for k in range(1, lags + 1):
        product = z[:, :-k] * z[:, k:]
        pairs[k - 1] = np.count_nonzero(np.isfinite(product))
        rho[k - 1] = np.nanmean(product) / power if pairs[k - 1] else 0.0
    worth = np.maximum(pairs * shared, 1.0)
    q = float(np.sum((worth + 2.0) * rho**2))  # n (n + 2) / (n - k) with n - k the pairs of lag k
    time_s = -period_s / math.log(rho[0]) if 0.0 < rho[0] < 1.0 else 0.0
    return Whiteness(rho, normal / np.sqrt(worth), pairs, q, float(stats.chi2.sf(q, lags)), time_s)


def period_of(time_s: Float64) -> float:
    """Return the time between epochs: the median step."""
    steps = np.diff(np.unique(time_s))
    return float(np.median(steps)) if len(steps) else 1.0
