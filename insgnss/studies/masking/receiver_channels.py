"""Channels of hidden satellites: they search and lock on a false signal, or wait under supervision.

Without supervision a channel searches from the loss on, sweep after sweep. It may lock on something else on the way, or
never notice the loss. When its satellite is back, the direct signal takes over a loop that stands within the
discriminator's aperture of it; a loop farther away is given up after ``release_s``, and its channel searches again.
A satellite is found when a sweep passes its cell, which is anywhere in the sweep: half a sweep on average. Both kinds
of receiver need ``guards.pull_in_s`` after that before they measure.
Under supervision the search supervisor decides for each channel, based on a filter (``supervised_channels_of``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from insgnss.aiding.satellite_arcs import PIECE_NS, PIECE_S, Arcs, SatelliteArcs, hermite_pieces
from insgnss.aiding.table import AidingSetup
from insgnss.aiding.trace import TraceSamples, traced
from insgnss.config.aiding import AidingConfig
from insgnss.config.scenario import FalseLockModel, ScenarioConfig
from insgnss.config.search import Search
from insgnss.constants import NS_PER_S
from insgnss.filter.setup import FilterSetup
from insgnss.filter.whole_log import TraceIntervals, run_filter
from insgnss.inertial.clock_model import clock_model
from insgnss.inertial.sensor_model import sensor_model
from insgnss.receiver import SupervisionSetup, outlook
from insgnss.receiver.detection import detector
from insgnss.receiver.search_window import signal_scale, unsupervised_sweep_s
from insgnss.receiver.supervisor import Supervision, supervise
from insgnss.receiver.tracking_state import TRACK
from insgnss.simulation.faults import false_lock, outage
from insgnss.simulation.observations import Fault, SignalObservations
from insgnss.simulation.sky_law import SkyLaw
from insgnss.studies.masking.banked_flight import START_NS, Spell
from insgnss.studies.saved_study import MOMENT_DECIMALS
from insgnss.tables import Float64, GnssTable, ImuTable, Int8

SEARCHED: Final = "searched"  # nothing was found until the satellite was back
How = Literal["captured", "released", "searched", "supervised", "never"]


@dataclass(frozen=True)
class ChannelSpell:
    """A hidden satellite's channel, from the loss to its next measurement; times in seconds of the scenario."""

    sv: str
    lost_s: float
    returned_s: float
    tracked_s: float  # measures again; inf where it does not within the flight
    how: How  # it came back
    lock: str = SEARCHED  # name of the false lock
    false_from_s: float = math.inf
    false_until_s: float = math.inf
    offset_m: float = 0.0
    growth_mps: float = 0.0
    rate_error_mps: float = 0.0
    cn0_dbhz: float = math.nan
    search_s: float = 0.0  # spent in search and detection
    in_vain_s: float = 0.0  # of it: before the satellite was back

    @property
    def delay_s(self) -> float:
        """From the satellite's return to its next measurement."""
        return self.tracked_s - self.returned_s

    def faults(self) -> list[Fault]:
        """Return what the channel does to the log: no rows until it tracks again, but those of the false lock."""
        gap = outage([self.sv], self.lost_s, self.tracked_s)
        if not math.isfinite(self.false_from_s):
            return [gap]
        lock = false_lock(
            self.sv,
            self.false_from_s,
            self.false_until_s,
            offset_m=self.offset_m,
            growth_mps=self.growth_mps,
            rate_error_mps=self.rate_error_mps,
            cn0_dbhz=self.cn0_dbhz,
        )
        return [gap, lock]


def unsupervised_channels(
    scenario: ScenarioConfig, spells: Sequence[Spell], rng: np.random.Generator
) -> list[ChannelSpell]:
    """Return the channels' behaviour without supervision; false locks are assigned to satellites, their sizes drawn."""
    satellites = sorted({spell.sv for spell in spells})
    order = rng.permutation(len(satellites))
    locks = scenario.false_locks
    dealt = {satellites[k]: locks[i] for i, k in enumerate(order) if i < len(locks)}
    sweep_s = unsupervised_sweep_s(scenario.search, detector(scenario.search.detection))
    return [
        _unsupervised(spell, dealt.get(spell.sv), sweep_s, scenario, rng.random(2), rng) for spell in spells
    ]


def _unsupervised(
    spell: Spell,
    lock: FalseLockModel | None,
    sweep_s: float,
    scenario: ScenarioConfig,
    place: Float64,
    rng: np.random.Generator,
) -> ChannelSpell:
    """Return one channel's spell.

    Parameters
    ----------
    place : (2,) where in the sweep the cells of the satellite and of the false peak lie, 0 to 1
    """
    lost, back = spell.from_s, spell.until_s
    own, false = float(place[0]), float(place[1])
    pull_in_s = scenario.search.guards.pull_in_s
    at_once = lock is not None and lock.begins == "at_loss"
    first_s = lost if at_once else round(lost + false * sweep_s, MOMENT_DECIMALS)
    if lock is None or first_s >= back:
        found_s = _next_pass(lost, sweep_s, own, back)
        searched = found_s - lost
        return ChannelSpell(
            spell.sv,
            lost,
            back,
            found_s + pull_in_s,
            "searched",
            search_s=searched,
            in_vain_s=min(searched, back - lost),
        )
    offset, growth, rate_error, cn0 = (
        float(rng.uniform(*limits))
        for limits in (lock.offset_m, lock.growth_mps, lock.rate_error_mps, lock.cn0_dbhz)
    )
    if lock.rate_follows:
        rate_error = growth
    off_m = offset + growth * (back - first_s)
    captured = within_aperture(off_m, rate_error, scenario.search)
    until_s = round(back if captured else back + scenario.channels.release_s, MOMENT_DECIMALS)
    again_s = 0.0 if captured else own * sweep_s
    return ChannelSpell(
        spell.sv,
        lost,
        back,
        until_s + again_s + pull_in_s,
        "captured" if captured else "released",
        lock.name,
        first_s,
        until_s,
        offset,
        growth,
        rate_error,
        cn0,
        search_s=first_s - lost + again_s,
        in_vain_s=first_s - lost,
    )


def _next_pass(begun_s: float, sweep_s: float, place: float, from_s: float) -> float:
    """Return when sweeps that began at ``begun_s`` pass a cell for the first time not before ``from_s``."""
    passes = math.ceil((from_s - begun_s) / sweep_s - place)
    return begun_s + (max(passes, 0) + place) * sweep_s


def within_aperture(offset_m: float, rate_error_mps: float, settings: Search) -> bool:
    """Return whether the direct signal takes over a loop that stands so far from it."""
    scale, aperture = signal_scale(settings.grid), settings.aperture
    chips = abs(offset_m) / float(np.asarray(scale.chip_m))
    return chips < aperture.delay_chips and abs(rate_error_mps) / float(np.asarray(scale.wavelength_m)) < (
        aperture.doppler_hz
    )


def supervised_channels(
    spells: Sequence[Spell], t_s: Float64, sv_names: Sequence[str], said: Supervision
) -> list[ChannelSpell]:
    """Return the channels' behaviour under supervision: no false locks, measurements in the state "track".

    Search and detection are those of the whole flight, reported with a satellite's first interval.

    Parameters
    ----------
    t_s : (n,) times of the supervisor's states
    sv_names : of its m satellites
    said : its decisions
    """
    channel_spells: list[ChannelSpell] = []
    for spell in spells:
        k = list(sv_names).index(spell.sv)
        again = np.flatnonzero((said.state[:, k] == TRACK) & (t_s >= spell.until_s))
        first = all(earlier.sv != spell.sv for earlier in channel_spells)
        channel_spells.append(
            ChannelSpell(
                spell.sv,
                spell.from_s,
                spell.until_s,
                float(t_s[again[0]]) if len(again) else math.inf,
                "supervised" if len(again) else "never",
                search_s=float(said.totals.search_s[k] + said.totals.control_s[k]) if first else 0.0,
                in_vain_s=float(said.totals.in_vain_s[k]) if first else 0.0,
            )
        )
    return channel_spells


def presence_of(spells: Sequence[Spell], t_s: Float64, sv_names: Sequence[str]) -> Int8:
    """Return (n, m) 1 where the satellite's signal truly reaches the antenna, 0 where not."""
    present = np.ones((len(t_s), len(sv_names)), np.int8)
    for spell in spells:
        away = (t_s >= spell.from_s) & (t_s < spell.until_s)
        present[away, list(sv_names).index(spell.sv)] = 0
    return present


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
