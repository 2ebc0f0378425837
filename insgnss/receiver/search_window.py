"""The search window: the cells of delay and Doppler around a prediction, and the time to search them all."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.config.search import Grid, Search
from insgnss.constants import C_MPS
from insgnss.receiver.detection import Detector, accumulation
from insgnss.tables import Bool, Float64


class SignalScale(NamedTuple):
    """Factors from metres to chips and from m/s to hertz; arrays of one entry a satellite, or numbers."""

    chip_m: npt.ArrayLike
    wavelength_m: npt.ArrayLike
    code_chips: npt.ArrayLike


class SearchWindow(NamedTuple):
    """The search for a signal at a predicted delay and Doppler; arrays of one shape."""

    sigma_delay_m: Float64  # sqrt(D) of the delay
    sigma_doppler_hz: Float64  # sqrt(D) of the rate over the wavelength
    within_aperture: Bool  # the loops may be closed at the predicted place
    accumulation_s: Float64  # of one cell; inf where no allowed accumulation suffices
    delay_cells: Float64  # whole numbers; NaN where there is no prediction
    doppler_bins: Float64  # NaN where there is no prediction, or without a sufficient accumulation
    search_s: Float64  # over all cells, once; inf where no accumulation suffices


def signal_scale(grid: Grid) -> SignalScale:
    """Return the scale of the one signal that the settings name."""
    return SignalScale(C_MPS / grid.chip_rate_hz, C_MPS / grid.carrier_hz, grid.code_chips)


def search_window(
    cn0_dbhz: npt.ArrayLike,
    d_range_m2: npt.ArrayLike,
    d_rate_m2ps2: npt.ArrayLike,
    settings: Search,
    need: Detector,
    scale: SignalScale | None = None,
) -> SearchWindow:
    """Return window, accumulation and search time of each prediction, tracked or hidden.

    Equation: D = h P^- h^T; loops may be closed where n sqrt(D) < aperture, for delay and Doppler, n = 3;
              cells = ceil(2 n sqrt(D) / step), at least one, at most the code's period; Doppler step = f / T_coherent
                                            [Sokolov and Yurchenko 2015, with D = h P h^T for the printed h^T P h]

    Parameters
    ----------
    cn0_dbhz : (..., m) predicted C/N0
    d_range_m2, d_rate_m2ps2 : (..., m) D of pseudorange [m^2] and range rate [m^2/s^2]; NaN: no prediction
    need : ``detector(settings.detection)``
    scale : of each satellite's signal; that of the settings' grid if None
    """
    grid, aperture = settings.grid, settings.aperture
    scale = signal_scale(grid) if scale is None else scale
    sigma_delay_m = np.sqrt(np.asarray(d_range_m2, float, order="C"))
    sigma_doppler_hz = np.sqrt(np.asarray(d_rate_m2ps2, float, order="C")) / np.asarray(
        scale.wavelength_m, float
    )
    sigma_chips = sigma_delay_m / np.asarray(scale.chip_m, float)
    within = (aperture.sigmas * sigma_chips < aperture.delay_chips) & (
        aperture.sigmas * sigma_doppler_hz < aperture.doppler_hz
    )
    collected = accumulation(cn0_dbhz, need)
    whole_code = np.ceil(np.asarray(scale.code_chips, float) / grid.delay_step_chips)
    delay_cells = np.minimum(cells(grid.sigmas * sigma_chips, grid.delay_step_chips), whole_code)
    bins = doppler_bins(grid.sigmas * sigma_doppler_hz, collected.look_s, grid)
    search_s = search_time_s(delay_cells * bins, collected.time_s, grid.correlators)
    return SearchWindow(
        sigma_delay_m, sigma_doppler_hz, within, collected.time_s, delay_cells, bins, search_s
    )


def cells(half_width: Float64, step: npt.ArrayLike) -> Float64:
    """Return how many cells of a step cover a window, at least one; NaN stays."""
    return np.asarray(np.maximum(np.ceil(2.0 * half_width / np.asarray(step, float)), 1.0))


def doppler_bins(half_width_hz: Float64, look_s: Float64, grid: Grid) -> Float64:
    """Return how many Doppler bins cover a window; their width is inverse to the coherent accumulation time."""
    collected = np.isfinite(look_s)
    step_hz = grid.doppler_step_cycles / np.where(collected, look_s, 1.0)
    return np.where(collected, cells(half_width_hz, step_hz), np.nan)


def search_time_s(n_cells: npt.ArrayLike, accumulation_s: npt.ArrayLike, correlators: int) -> Float64:
    """Return the time to search N cells with M correlators, each of which takes a time T per cell.

    Equation: ceil(N / M) T; 1000 cells, 100 correlators, 316 ms: 3.16 s        [Sokolov and Yurchenko 2015]
    Neglects: cells that a fast Fourier transform would search in parallel.
    """
    T = np.asarray(accumulation_s, float)
    passes = np.ceil(np.asarray(n_cells, float) / correlators)
    return np.where(np.isfinite(T), passes * np.where(np.isfinite(T), T, 0.0), np.inf)


def unsupervised_sweep_s(settings: Search, need: Detector) -> float:
    """Return the time of one sweep of the whole window by a receiver without attitude [s].

    inf where its weakest signal needs more looks than allowed.
    """
    receiver, grid = settings.unsupervised, settings.grid
    collected = accumulation(receiver.cn0_dbhz, need)
    bins = doppler_bins(np.asarray(receiver.doppler_half_width_hz), np.asarray(collected.look_s), grid)
    sweep = search_time_s(receiver.delay_cells * bins, collected.time_s, grid.correlators)
    return float(sweep)
