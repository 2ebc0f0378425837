"""The schema of a receiver on samples: how it samples, acquires, tracks, and its knowledge at the start."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from insgnss.config.quantities import Positive
from insgnss.config.search import Detection, Guards, Search
from insgnss.config.strict import StrictModel


class SampledLoops(StrictModel):
    """The loops of the channels; the code loop is aided by the carrier."""

    order: Annotated[int, Field(ge=1, le=3)] = Field(3, description="order of the phase loop")
    bandwidth_hz: Positive = Field(18.0, le=100.0, description="bandwidth of the phase loop, true, one-sided")
    frequency_bandwidth_hz: Annotated[float, Field(ge=0.0, le=50.0)] = Field(
        2.0, description="bandwidth of the frequency loop that assists it while it pulls in; 0: none"
    )
    code_bandwidth_hz: Positive = Field(1.0, le=20.0, description="bandwidth of the code loop, of order 1")


class SampleReceiver(StrictModel):
    """A receiver on samples with its tight filter."""

    rate_hz: Annotated[float, Field(ge=1e5, le=1e9)] = Field(4e6, description="samples per second")
    intermediate_hz: float = Field(0.0, description="frequency of the carrier without Doppler in the samples")
    is_complex: bool = Field(True, description="in-phase and quadrature, or real samples")
    sample_type: Literal["int8", "int16"] = Field("int8", description="to which the samples are rounded")
    integration_ms: Literal[1, 2, 4, 5, 10, 20] = Field(
        20, description="integration time of the correlators; a data bit lasts 20 ms"
    )
    spacing_chips: Annotated[float, Field(ge=0.05, le=1.0)] = Field(
        0.25, description="spacing of the correlators, early to late"
    )
    unaided: SampledLoops = SampledLoops()
    # the aiding takes the motion out: what is left is the oscillator's drift and the noise of the aiding
    aided: SampledLoops = SampledLoops(order=2, bandwidth_hz=4.0, frequency_bandwidth_hz=1.0)
    epoch_rate_hz: Annotated[float, Field(ge=0.1, le=10.0)] = Field(
        1.0,
        description="rate of the observables handed to the filter; of a code loop of 1 Hz the noise is then white",
    )
    aiding_rate_hz: Annotated[float, Field(ge=1.0, le=200.0)] = Field(
        50.0, description="rate of the Doppler and Doppler rate handed to the loops"
    )
    look_ms: Literal[1, 2, 4, 5, 10] = Field(
        10, description="coherent part of an acquisition, at most half a data bit without a known delay"
    )
    looks: Annotated[int, Field(ge=1, le=500)] = Field(80, description="looks of an acquisition")
    pfa: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        1e-4, description="largest probability that a whole acquisition finds a signal where none is"
    )
    unseeded_doppler_hz: Positive = Field(
        5000.0, le=50_000.0, description="half width of an acquisition without a prediction"
    )
    unseeded_retry_s: Positive = Field(
        10.0, description="time between two searches where no supervisor decides"
    )
    time_sigma_s: Positive = Field(
        2e-5,
        le=1e-3,
        description="sigma of the receiver's clock at the start, which resolves milliseconds and data bits",
    )
    drift_sigma_mps: Positive = Field(10.0, description="sigma of the clock's rate at the start")
    pull_in_s: Positive = Field(1.0, description="time of the loops before their lock is judged")
    enter_lock: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        0.55,
        description="phase-lock indicator over a second, noise left in, from which on observables are used",
    )
    leave_lock: Annotated[float, Field(gt=-1.0, lt=1.0)] = Field(0.35, description="below it they are not")
    drop_after_s: Positive = Field(
        2.0, description="without lock, then the channel is closed and searched again"
    )
    search: Search = Search(
        detection=Detection(coherent_limit_s=0.01), guards=Guards(threshold_cn0_dbhz=20.0, retry_s=2.0)
    )

    @property
    def integration_s(self) -> float:
        """Return the length of an integration [s]."""
        return 1e-3 * self.integration_ms

    @property
    def look_s(self) -> float:
        """Return the coherent part of an acquisition [s]."""
        return 1e-3 * self.look_ms
