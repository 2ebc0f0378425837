"""The schema of a search supervisor: how a signal is detected, how far a prediction is trusted, when states change."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from insgnss.config.quantities import NotNegative, Positive, Probability
from insgnss.config.strict import StrictModel

Count = Annotated[int, Field(ge=1)]


class Detection(StrictModel):
    """The probabilities of a detection, and how the signal-to-noise ratio that it needs is computed."""

    pd: Probability = Field(0.99, description="probability that a present signal is detected")
    pfa: Probability = Field(1e-3, description="probability that noise alone is taken for a signal, per cell")
    loss_db: NotNegative = Field(2.5, description="implementation loss: grid, filter, quantisation")
    method: Literal["albersheim", "exact", "coherent"] = Field(
        "albersheim",
        description="Albersheim's approximation, Marcum's Q function, or a carrier of known phase",
    )
    # None: the paper's table, which holds for pilot signals and for data bits known or wiped off. GPS L1 C/A: 0.02 s.
    coherent_limit_s: Positive | None = Field(
        None, description="longest coherent accumulation; longer ones sum the squares of such pieces"
    )
    max_looks: Annotated[int, Field(ge=1, le=10_000)] = Field(
        500,
        description="largest number of looks summed non-coherently; 500 of 20 ms take 10 s, a practical limit",
    )

    @field_validator("pfa")
    @classmethod
    def _below_pd(cls, pfa: float, info: ValidationInfo) -> float:
        if pfa >= info.data.get("pd", 1.0):
            raise ValueError("a false alarm must be less probable than a detection (pd)")
        return pfa


class Grid(StrictModel):
    """The cells of a search. With the default steps the mean loss over a cell is 1.6 dB."""

    chip_rate_hz: Positive = Field(
        1.023e6, description="chip rate of the code; GPS L1 C/A, IS-GPS-200N 3.3.2.3"
    )
    code_chips: Count = Field(1023, description="period of the code: no search is wider")
    carrier_hz: Positive = Field(
        1575.42e6, description="carrier frequency, to convert range rates to Doppler; GPS L1"
    )
    delay_step_chips: Positive = Field(
        0.5,
        description="step in delay; the signal is at most 0.25 chip away, where the correlation loses 2.5 dB",
    )
    doppler_step_cycles: Positive = Field(
        2.0 / 3.0,
        description="step in Doppler times coherent accumulation time; sinc^2 loses 1.6 dB at the edge",
    )
    sigmas: Positive = Field(3.0, description="half width of the window in sigmas of the prediction")
    correlators: Count = Field(100, description="cells that are searched in parallel")


class Aperture(StrictModel):
    """The largest errors at which a discriminator still pulls in."""

    delay_chips: Positive = Field(0.5, description="linear part of early minus late, one chip apart: 147 m")
    doppler_hz: Positive = Field(25.0, description="range of a frequency discriminator over 20 ms: 1 / (2 T)")
    sigmas: Positive = Field(3.0, description="this many sigmas of the prediction must be inside")


class Guards(StrictModel):
    """When a state changes: thresholds, hysteresis, and how long a condition must hold."""

    threshold_cn0_dbhz: NotNegative = Field(
        20.0, description="a signal is hidden if its predicted C/N0 is lower"
    )
    hysteresis_db: NotNegative = Field(
        1.0, description="a hidden signal becomes visible this far above the threshold"
    )
    fall_s: NotNegative = Field(0.0, description="time hidden before tracking becomes extrapolation")
    rise_s: NotNegative = Field(0.2, description="time visible before a detection is tried")
    loss_s: NotNegative = Field(0.5, description="time without reception before the signal counts as lost")
    pull_in_s: NotNegative = Field(0.5, description="pull-in time of the loops after a detection")
    control_attempts: Count = Field(
        1, description="detections tried at the predicted delay and Doppler before a search"
    )
    max_sweeps: Count = Field(3, description="sweeps of the search window before the satellite is given up")
    retry_s: Positive = Field(30.0, description="time after which an abandoned satellite is tried again")
    max_hold_s: Positive = Field(600.0, description="longest extrapolation before a satellite is given up")


class UnsupervisedReceiver(StrictModel):
    """The receiver without attitude that the supervisor is compared with: it searches as soon as a signal is lost.

    The defaults are the example of Sokolov and Yurchenko (2015): 1000 delays, the Doppler known, an accumulation for
    20 dBHz. They flatter it: a real one looks in several Doppler bins too.
    """

    delay_cells: Count = Field(1000, description="delays that it searches for each Doppler")
    doppler_half_width_hz: NotNegative = Field(
        0.0, description="half width of its search in Doppler; 0: one bin"
    )
    cn0_dbhz: Positive = Field(20.0, description="weakest signal that its search can detect")


class Search(StrictModel):
    """The search supervisor."""

    detection: Detection = Detection()
    grid: Grid = Grid()
    aperture: Aperture = Aperture()
    guards: Guards = Guards()
    unsupervised: UnsupervisedReceiver = UnsupervisedReceiver()
