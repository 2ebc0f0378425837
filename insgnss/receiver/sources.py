"""The inputs of a replay's supervision besides the filter's trace, taken from the logs before the filter runs."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from insgnss.aiding.sources import AidingSources, aiding_sources
from insgnss.aiding.trace import FilterTrace, at_times
from insgnss.config.flight import Gnss
from insgnss.constants import NS_PER_S
from insgnss.filter.setup import FilterSetup
from insgnss.log.flight import FlightLogs
from insgnss.receiver.events import ReceiverEvents, read_receiver_events
from insgnss.receiver.predictions import SupervisionSetup, outlook
from insgnss.receiver.supervised_run import LATE_EPOCHS, Sightings, SupervisedRun, sightings_of, supervise_run
from insgnss.tables import Event, Int64

# the last sample before an epoch, at most so old: else inertial ones lack
LATEST_SAMPLE_NS: Final = NS_PER_S // 10


@dataclass(frozen=True)
class SupervisionSources:
    """The setup of a supervision, its satellites, the receiver's sightings, and the times to evaluate."""

    setup: SupervisionSetup
    satellites: AidingSources
    sightings: Sightings
    samples_ns: Int64  # (k,) the last inertial sample at or before each epoch
    epoch_ns: Int64  # (k,) the log's, and in the receiver's silences at its usual interval
    receiver_log: ReceiverEvents | None = None

    def run(self, found: FilterTrace, week: int) -> SupervisedRun:
        """Return the tables, from the filter's trace at ``samples_ns``."""
        own = at_times(found, self.samples_ns)
        t_ns = own.trace.t_ns
        first, last = (int(t_ns[0]), int(t_ns[-1])) if len(t_ns) else (int(self.samples_ns[0]),) * 2
        at_ns = self.epoch_ns[np.searchsorted(self.samples_ns, t_ns)]
        view = outlook(self.setup, self.satellites.arcs(first, last), own, at_ns)
        return supervise_run(view, self.sightings, self.setup.search, week, self.receiver_log)


def supervision_sources(
    filter: FilterSetup, logs: FlightLogs, gnss: Gnss, week: int
) -> tuple[SupervisionSources, list[Event]]:
    """Return the inputs of a replay's supervision, and the events of the files read for it.

    The satellites are those of the constellations in the receiver's log, each on the signal that the filter's settings
    name for aiding; the times are the epochs of that log, and in its silences as many.

    Parameters
    ----------
    filter : of the run: its antennas, its search settings
    gnss : of the flight file: its ``receiver_events`` are read

    Raises
    ------
    NavigationDataError : nothing says where satellites are that the log does not hold
    InputError or a subclass : the log of the receiver's events cannot be used
    """
    seen = {name[0] for name in logs.gnss.sv_names}
    setup, satellites = setup_and_satellites(filter, seen, logs.gnss.glonass_channels)
    sightings = sightings_of(logs.gnss)
    samples_ns, epoch_ns = epoch_samples(logs.imu.t_ns, without_silences(sightings.epoch_ns))
    receiver_log: ReceiverEvents | None = None
    events: list[Event] = []
    if gnss.receiver_events is not None:
        receiver_log, events = read_receiver_events(gnss.receiver_events, week, gnss.time)
    return SupervisionSources(setup, satellites, sightings, samples_ns, epoch_ns, receiver_log), events


def setup_and_satellites(
    filter: FilterSetup,
    letters: Collection[str],
    channels: Mapping[str, int] | None = None,
) -> tuple[SupervisionSetup, AidingSources]:
    """Return the setup of a supervision and its satellites: those of some constellations, on their signal for aiding.

    Raises
    ------
    NavigationDataError : nothing says where the satellites are
    """
    config = filter.config
    signals = {letter: code for letter, code in config.aiding.signals.items() if letter in letters}
    wanted = config.aiding.model_copy(update={"signals": signals})
    satellites = aiding_sources(filter, wanted, channels)
    mask_deg = config.measurements.elevation_mask_deg
    setup = SupervisionSetup(
        satellites.setup, filter.installation, config.visibility, config.search, mask_deg
    )
    return setup, satellites


def without_silences(epoch_ns: Int64) -> Int64:
    """Return a log's epochs, and more of them at their usual interval where some are left out."""
    steps = np.diff(epoch_ns)
    if not len(steps):
        return epoch_ns
    usual_ns = int(np.median(steps))
    silent = np.flatnonzero(steps > LATE_EPOCHS * usual_ns)
    between = [np.arange(epoch_ns[k] + usual_ns, epoch_ns[k + 1] - usual_ns // 2, usual_ns) for k in silent]
    return np.sort(np.concatenate([epoch_ns, *between])).astype(np.int64)


def epoch_samples(imu_ns: Int64, epoch_ns: Int64) -> tuple[Int64, Int64]:
    """Return the last inertial sample at or before each epoch, and the epoch; of epochs with one sample the last.

    Epochs without a sample in the tenth of a second before them are left out.
    """
    last = np.searchsorted(imu_ns, epoch_ns, side="right") - 1
    near = (last >= 0) & (epoch_ns - imu_ns[np.maximum(last, 0)] <= LATEST_SAMPLE_NS)
    last, epoch_ns = last[near], epoch_ns[near]
    alone = np.append(np.diff(last) > 0, True)[: len(last)]
    return imu_ns[last[alone]], epoch_ns[alone]
