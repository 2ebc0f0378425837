"""The live filter and its outputs: ``filter.engine`` and, where asked, the aiding of the tracking loops."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy.typing as npt

from insgnss.aiding.live import AidingSink, LiveAiding
from insgnss.aiding.sources import aiding_sources
from insgnss.aiding.stream import AidingStream, Message
from insgnss.config.aiding import AidingConfig, aiding_config
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import ConfigError
from insgnss.filter.engine import FilterEngine
from insgnss.filter.engine_results import EpochResult, NavState
from insgnss.filter.epoch_tables import tag_of
from insgnss.filter.output.writing import N_HYPOTHESES
from insgnss.filter.own_rows.ledger import OwnEntry
from insgnss.filter.own_rows.rows import Measurement
from insgnss.filter.setup import FilterSetup
from insgnss.filter.state import copy_bank
from insgnss.receiver import SupervisedRun
from insgnss.receiver.live import LiveSupervision
from insgnss.receiver.sources import LATEST_SAMPLE_NS, setup_and_satellites
from insgnss.runs.declared_sigmas import LiveDeclaredSigmas
from insgnss.runs.installation import LiveInstallation
from insgnss.runs.integrity.live import LiveProtection, SubFilter
from insgnss.sensors.live import forget_before, live_sensor, with_own_readings
from insgnss.tables import Event, GnssTable

# what looks back on the log, as a satellite under suspicion, goes back a minute
_READINGS_KEPT_NS = 600 * NS_PER_S


class Engine(FilterEngine):
    """A live filter.

    Call ``engine.imu(...)`` for every inertial sample and ``engine.gnss(...)`` for every epoch, at most ``latency_s``
    (a setting of the filter) after the samples of its time. ``engine.state`` is the newest state,
    ``engine.take_results()`` returns the rows that became final since the last call, ``engine.events`` has all events.
    With several antennas ([attitude] in the flight file) ``engine.gnss(epoch, "ahead")`` takes the epochs of a further
    antenna by its name, and ``EpochResult.differences`` has the status of the phase differences.
    ``engine.sensor("odometer", t_ns, speed)`` takes the readings of further sensors ([[sensor]]).

    With ``aiding``, each call of ``imu`` that reaches an output time passes the aiding to ``on_aiding`` before it
    returns. The aiding uses the epochs that are known by then and lie before the sample. If no epoch is late, it is
    bit-identical to ``run.aiding`` of a replay. (With a given start, a replay has rows from the time of the
    start on, the engine from the first epoch on.)

    With ``supervise``, ``take_supervision`` returns the search supervisor's decision for every satellite at each epoch,
    and at the usual interval while the receiver is silent. If the epochs arrive in order, the rows are
    ``run.supervision`` and ``run.transitions`` of a replay.

    With ``integrity``, ``state`` and ``EpochResult.protection`` have protection levels. They equal those of a replay
    once all satellites and constellations of a log have been used, if pairs of constellations need no sub-filter
    (``runs.integrity.live``).
    """

    def __init__(
        self,
        setup: FilterSetup,
        *,
        aiding: float | AidingConfig | None = None,
        on_aiding: Callable[[Message], None] | AidingSink | None = None,
        measurements: Sequence[Measurement] = (),
        supervise: bool = False,
        integrity: bool = False,
    ) -> None:
        """Make an engine.

        Parameters
        ----------
        setup : of the filter (``insgnss.engine_settings`` makes one from a flight file)
        aiding : rate [Hz], the filter's other settings of the aiding kept, or all settings; None: no aiding
        on_aiding : takes the messages (``aiding.stream`` says what is in them), or an ``AidingStream``
        measurements : of the user's own, as in ``replay``; each is used when the samples have reached its time, and
            ``take_measurements`` has its status
        supervise : whether the search supervisor decides at each epoch what the receiver should do about every
            satellite of the constellations that the setup names; ``take_supervision`` has the decisions
        integrity : whether ``state`` and results have protection levels; a sub-filter runs for each satellite and
            constellation so far, and asks ``measurements`` for their rows too; its settings are the filter's
            ``[integrity]``

        Raises
        ------
        MeasurementError : the name, the times or the gate of a measurement are impossible
        ConfigError : one of ``aiding`` and ``on_aiding`` without the other, or an impossible rate
        NavigationDataError : nothing says where the satellites are
        """
        if (aiding is None) != (on_aiding is None):
            raise ConfigError(
                "aiding needs a rate and a function that takes its rows",
                advice="give both aiding=... and on_aiding=..., or neither",
            )
        self._aiding: LiveAiding | None = None
        self._sink: AidingSink | None = None
        if aiding is not None and on_aiding is not None:
            config = aiding_config(aiding, setup.config.aiding)
            self._aiding = LiveAiding(aiding_sources(setup, config), setup.n_offsets)
            self._sink = AidingStream(on_aiding) if callable(on_aiding) else on_aiding
        self._week: int | None = None
        self._supervision: LiveSupervision | None = None
        if supervise:
            letters = {group[0] for group in setup.clock_groups}
            latency_ns = int(setup.config.latency_s * NS_PER_S)
            sources = setup_and_satellites(setup, letters)
            self._supervision = LiveSupervision(*sources, setup.n_offsets, latency_ns)
        self._installation = LiveInstallation(setup.layout, setup.config.process)
        super().__init__(with_own_readings(setup.with_further(measurements=measurements)))
        self._declared = LiveDeclaredSigmas(self._setup.own)
        self._protection = LiveProtection(self, self._setup) if integrity else None

    def __repr__(self) -> str:
        state = self.state
        week, in_week_ns = divmod(state.t_ns, NS_PER_WEEK)
        place = f"at {in_week_ns / NS_PER_S:.3f} s of week {week}" if state.started else "not started"
        return f"Engine({place}; {len(self.events)} events)"

    @property
    def events(self) -> list[Event]:
        """All events so far, in the order of their time."""
        all_events = super().events
        if isinstance(self._sink, AidingStream):
            all_events = sorted(
                all_events + self._sink.events, key=lambda e: -1 if e.t_ns is None else e.t_ns
            )
        return all_events

    @property
    def state(self) -> NavState:
        """The navigation state at the newest inertial sample."""
        out, t_ns = self.newest_row(), self._samples.last_ns or 0
        state = NavState.of(self._setup, out, t_ns)
        if self._protection is not None and state.started:
            state.values.update(self._protection.newest(out, t_ns))
        return state

    def imu(self, t_ns: int, gyro_radps: npt.ArrayLike, accel_mps2: npt.ArrayLike) -> None:
        """Take one inertial sample, see ``FilterEngine``."""
        super().imu(t_ns, gyro_radps, accel_mps2)
        for sub in self._sub_filters:
            sub.imu(t_ns, gyro_radps, accel_mps2)
        self._protect()

    def gnss(self, epoch: GnssTable, antenna: str | None = None) -> None:
        """Take GNSS epochs, see ``FilterEngine``."""
        if self._protection is not None and self._further.number(antenna) == 0:
            self._protection.prepare(epoch)
        super().gnss(epoch, antenna)
        for sub in self._sub_filters:
            sub.gnss(epoch, antenna)

    def take_results(self, *, all_of_them: bool = False) -> list[EpochResult]:
        """Return the epochs that have become final, see ``FilterEngine``."""
        taken = super().take_results(all_of_them=all_of_them)
        for sub in self._sub_filters:
            sub.take_results(all_of_them=all_of_them)
        self._protect()
        return taken

    @property
    def _sub_filters(self) -> list[SubFilter]:
        return [] if self._protection is None else self._protection.sub_filters

    def _protect(self) -> None:
        """Give the results that have become final their protection levels."""
        if self._protection is not None:
            self._done += self._protection.compare()

    def sensor(self, name: str, t_ns: int, values: npt.ArrayLike, sigma: npt.ArrayLike | None = None) -> None:
        """Take a reading of a further sensor of the flight file ([[sensor]]), at most ``latency_s`` late.

        A reading that arrives before the samples of its time waits for them; for a late one the filter goes back. A
        reading within ``interval_s`` of another of the sensor is left out, as in a replay. If the readings arrive in
        the order of their times, all results are bit-identical to those of a replay.

        Parameters
        ----------
        values : SI units, as ``insgnss.tables.SensorTable`` has them for each kind: of an odometer [m/s], of a
            barometer pressure altitude [m], of positions latitude, longitude [rad], height [m]; NaN: no reading
        sigma : of the values, those of the flight file when None

        Raises
        ------
        MeasurementError : there is no such sensor, or it has another number of values
        """
        source = live_sensor(self._setup.own, name)
        reading = source.live_reading(values, sigma)
        t_ns, newest = int(t_ns), self._samples.last_ns
        if newest is not None and self._is_final(t_ns):
            late_s = (newest - t_ns) / NS_PER_S
            detail = f"a reading of '{name}' came {late_s:.2f} s after the samples of its time: refused"
            self._done.append(Event(t_ns, "sensor_too_late", detail))
            return
        if not source.take(t_ns, *reading):
            return
        assert self._setup.own is not None  # a sensor was found in it
        self._setup.own.arrived.add(name, t_ns)
        self.again_from(t_ns)
        for sub in self._sub_filters:
            sub.again_from(t_ns)

    def take_measurements(self, *, all_of_them: bool = False) -> list[OwnEntry]:
        """Return the status of the rows of ``measurements`` that no late epoch can change any more, each once.

        ``all_of_them`` at the end of a log, after ``take_results(all_of_them=True)``.
        """
        newest = self._samples.last_ns
        spans = [] if newest is None else [(self._first_ns, newest)]
        until_ns = 2**62 if all_of_them else self._kept[0].t_ns
        taken = self._own.taken(self._navigator.own, spans, until_ns)
        if self._setup.own is not None and newest is not None:
            forget_before(self._setup.own, min(until_ns, newest) - _READINGS_KEPT_NS)
        return taken

    def take_supervision(self) -> SupervisedRun:
        """Return the search supervisor's decisions that have not been taken yet, in the tables of a replay.

        ``supervision`` has a row for each satellite above the horizon and epoch: the state of its channel, what antenna
        and airframe hide, the predicted pseudorange and Doppler, their sigmas and the search window. ``transitions``
        has each change with its reason, ``search_times`` the seconds so far. This call decides the newest epoch; an
        epoch that was not asked for is decided when the next one arrives.

        Raises
        ------
        ConfigError : the engine was made without ``supervise``
        """
        if self._supervision is None:
            advice = "make it with Engine(settings, supervise=True)"
            raise ConfigError("this engine does not supervise the search", key="supervise", advice=advice)
        return self._supervision.taken()

    def _finish(self, results: list[EpochResult]) -> None:
        """Look whether the epochs have determined a number of the installation, or an error beyond its sigma."""
        super()._finish(results)
        if self._protection is not None:
            self._protection.take_final(results)
        for result in results:
            if result.out.counts[0].nav:
                values = self._setup.layout.in_columns(result.out.optional[0])
                self._done += self._installation.events(result.t_ns, values)
                n_hypotheses = int(result.out.nav["value"][0, N_HYPOTHESES])
                self._done += self._declared.events(result.t_ns, values, n_hypotheses)

    def _before_epoch(self, epoch: GnssTable) -> None:
        """Pass the epoch and the filter's prediction of it to the supervisor."""
        newest = self._samples.last_ns
        if self._supervision is not None and newest is not None:
            if self._supervision.is_wanted(epoch, newest):
                self._expect(self._supervision, tag_of(epoch))

    def _expect(self, supervision: LiveSupervision, t_ns: int) -> None:
        """Pass on the filter's prediction at ``t_ns``, from the last sample before."""
        bank, sample_ns = self._navigator.bank, self._samples.last_before(t_ns)
        if bank is None or t_ns - sample_ns > LATEST_SAMPLE_NS or bank.head[0].now_ns > sample_ns:
            return
        bank = copy_bank(bank)
        if self._carry(bank, sample_ns):
            navigator = self._navigator
            work = navigator.workspace(self._rows_for_size())
            supervision.expect(t_ns, bank, self._samples.view(), navigator.parameters, work)

    def _at_sample(self, t_ns: int) -> None:
        """Look for an epoch that is missing, and hand the aiding on where the sample is an output."""
        missing_ns = None if self._supervision is None else self._supervision.missing_epoch(t_ns)
        if self._supervision is not None and missing_ns is not None:
            self._expect(self._supervision, missing_ns)
        if self._aiding is None or self._sink is None or not self._aiding.is_due(t_ns):
            return
        if self._week is None:
            self._week = t_ns // NS_PER_WEEK
        if self._live is not None:
            navigator = self._navigator
            work = navigator.workspace(self._rows_for_size())
            table = self._aiding.output(self._live, self._samples.view(), navigator.parameters, work)
            self._sink.send(table, self._week)
