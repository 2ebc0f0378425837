"""The supervised receiver of a study: the search supervisor's decisions for each channel, based on a filter."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insgnss.aiding.satellite_arcs import PIECE_NS, PIECE_S, Arcs, SatelliteArcs, hermite_pieces
from insgnss.aiding.table import AidingSetup
from insgnss.aiding.trace import TraceSamples, traced
from insgnss.config.aiding import AidingConfig
from insgnss.config.scenario import ScenarioConfig
from insgnss.constants import NS_PER_S
from insgnss.filter.setup import FilterSetup
from insgnss.filter.whole_log import TraceIntervals, run_filter
from insgnss.inertial.clock_model import clock_model
from insgnss.inertial.sensor_model import sensor_model
from insgnss.receiver import SupervisionSetup, outlook
from insgnss.receiver.supervisor import Supervision, supervise
from insgnss.receiver.tracking_state import TRACK
from insgnss.simulation.observations import SignalObservations
from insgnss.simulation.sky_law import SkyLaw
from insgnss.studies.masking.banked_flight import START_NS, Spell
from insgnss.studies.masking.receiver_channels import presence_of
from insgnss.tables import Float64, GnssTable, ImuTable

# over which the satellites' acceleration is differenced: within 1e-9 m/s^2 of the law's own
_DIFFERENCE_S = 1.0


@dataclass(frozen=True)
class SupervisedChannels:
    """The supervisor's states over a flight."""

    t_s: Float64  # (n,) from the filter's start on
    sv_names: tuple[str, ...]  # (m,)
    supervision: Supervision

    def lets_through(self, observations: SignalObservations) -> SignalObservations:
        """Return the observations of the channels that the supervisor has in track; all of them before it begins."""
        at = np.searchsorted(self.t_s, observations.tag_s + 1e-9) - 1
        columns = [self.sv_names.index(name) for name in observations.sv_names]
        tracks = self.supervision.state[np.maximum(at, 0)][:, columns] == TRACK
        tracks[at < 0] = True
        return replace(observations, tracked=observations.tracked & tracks)


def law_arcs(sky: SkyLaw, sv_names: tuple[str, ...], last_s: float) -> SatelliteArcs:
    """Return the law's satellites as the pieces that the aiding's kernels read, from t = 0 to ``last_s``."""
    count = int(last_s // PIECE_S) + 1
    t_s = np.broadcast_to((PIECE_S * np.arange(count + 1))[:, None], (count + 1, len(sv_names)))
    state = sky.states(t_s)
    ahead, behind = (sky.states(t_s + side * 0.5 * _DIFFERENCE_S).v_e for side in (1.0, -1.0))
    clock = np.stack([state.clock_s, state.clock_rate], axis=-1)
    node = np.concatenate([state.r_e, state.v_e, (ahead - behind) / _DIFFERENCE_S, clock], axis=-1)
    node = np.swapaxes(node, 0, 1)
    pieces = hermite_pieces(np.stack([node[:, :-1], node[:, 1:]], axis=2))
    # pieces lie on a grid of GPS time: the first one begins with the week, as the scenario does
    return SatelliteArcs(sv_names, Arcs(START_NS // PIECE_NS * PIECE_NS, pieces))


def supervised_channels_of(
    scenario: ScenarioConfig,
    sky: SkyLaw,
    spells: tuple[Spell, ...],
    setup: FilterSetup,
    imu: ImuTable,
    gnss: GnssTable,
) -> SupervisedChannels:
    """Return the supervisor's decisions, based on a filter that runs over a log.

    Whether a channel finds its signal where it looks is the truth: ``spells`` of the airframe.

    Parameters
    ----------
    setup : of the filter, with its antenna
    imu, gnss : the log; the rows that the filter has while a satellite is hidden bear on D
    """
    rate_hz = scenario.channels.supervisor_rate_hz
    out, _ = run_filter(
        setup, imu, setup.rows(gnss, None), "gnss", trace=TraceIntervals(rate_hz, 1.0 / rate_hz)
    )
    filter_trace = traced(out.trace, TraceSamples(imu.t_ns, imu.w_ib_b, imu.f_b))
    aiding = AidingSetup(
        AidingConfig(horizon_deg=-90.0, sigma_interval_s=1.0 / rate_hz),
        sensor_model(setup.grade),
        clock_model(setup.oscillator),
        troposphere=False,
    )
    supervised = SupervisionSetup(
        aiding,
        setup.installation,
        setup.config.visibility,
        scenario.search,
        setup.config.measurements.elevation_mask_deg,
    )
    t_s = (filter_trace.trace.t_ns - START_NS) / NS_PER_S
    view = outlook(supervised, law_arcs(sky, scenario.sv_names, float(t_s[-1])), filter_trace)
    present = presence_of(spells, t_s, view.sv_names)
    return SupervisedChannels(
        t_s, view.sv_names, supervise(view.predicted, present, scenario.search, view.scale)
    )
