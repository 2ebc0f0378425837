"""One run on real samples: complex baseband, acquisition, loops, observables, tight filter, aiding back into the loops.

::

    from insgnss.runs.simulate import simulate
    from insgnss.studies import sample_receiver

    study = sample_receiver(simulate("steep_turns"), losses_db=(0.0, 10.0))
    study.summary      # C/N0, receiver: channels in lock, position and velocity errors, errors over sigma, time
    study.epochs, study.channels, study.searches, study.figure(), study.save("out/")

Both receivers have the same samples, filter and inertial sensor. The aided one gets the filter's Doppler and its rate
in its loops, which are narrow, and looks for satellites in the windows of the search supervisor. The unaided one has
loops that follow the motion themselves and searches all delays and Dopplers; its filter uses what it tracks.

Both start warm: messages, position, velocity, attitude and a clock good to ``time_sigma_s``, by which the
milliseconds and data bits of the pseudoranges are resolved. No navigation message is decoded.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final, Protocol

import numpy as np
import pandas as pd

from insgnss.aiding.sources import aiding_sources
from insgnss.config.flight import GivenStart
from insgnss.config.library import filter_config
from insgnss.config.sample_receiver import SampleReceiver
from insgnss.config.simulation import SimulationConfig
from insgnss.constants import NS_PER_S
from insgnss.errors import ConfigError, InputError
from insgnss.filter.setup import FilterSetup
from insgnss.log.iq_file import IqFile, rounded, write_iq
from insgnss.simulation.signal_samples import SignalSky, sample_blocks, signal_sky
from insgnss.simulation.simulated_log import Scenario, SimulatedLog
from insgnss.simulation.trajectory import reference_table
from insgnss.studies.figures import sample_figure
from insgnss.studies.samples.loop import SampleEquipment, SampleLoop, sampling_of
from insgnss.studies.samples.search import expected_at_start, start_outlook
from insgnss.studies.samples.tables import channel_table, epoch_table, search_table, summary_of
from insgnss.studies.saved_study import SavedStudy
from insgnss.tracking.admissible import (
    require_known,
    require_number,
    require_seed,
    require_whole,
    require_within,
    seeded,
)
from insgnss.tracking.signal import SignalSamples

if TYPE_CHECKING:
    from insgnss.studies.figures import Figure

RECEIVERS: Final = ("aided", "unaided")
Progress = Callable[[str], None]
_Tables = tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame, pd.DataFrame]  # summary, epochs, channels, searches
_SD_POSITION_M, _SD_VELOCITY_MPS, _SD_LEVEL_DEG, _SD_YAW_DEG = 100.0, 0.3, 0.5, 1.0  # of the given start
_SKY, _NOISE, _START = 1, 2, 3  # keys of the seed
_MOST_CHANGE_DB: Final = 100.0  # of C/N0, either way
_LENGTH_S: Final = 0.01  # by which a recording may be longer or shorter than declared


class SimulatedFlight(Protocol):
    """A simulated flight, as ``insgnss.runs.simulate.simulate`` gives it."""

    @property
    def config(self) -> SimulationConfig:
        """The scenario file, which is saved with the results."""

    @property
    def scenario(self) -> Scenario:
        """The scenario, whose trajectory, sky, antenna and clock count."""

    @property
    def log(self) -> SimulatedLog:
        """The logs, of which the inertial one counts."""


@dataclass(frozen=True, repr=False)
class SampleStudy(SavedStudy):
    """Results of the receivers on samples."""

    TABLES: ClassVar = ("summary", "epochs", "channels", "searches")
    PICTURES: ClassVar = {"sample_receiver": "figure"}

    summary: pd.DataFrame
    epochs: pd.DataFrame
    channels: pd.DataFrame
    searches: pd.DataFrame
    settings: SampleReceiver
    asked: Mapping[str, Any]  # scenario, losses, seed ...: the rest of the call

    def figure(self) -> Figure:
        """Return the picture: position errors with sigma, and channels in lock, for each C/N0."""
        return sample_figure(self.epochs, self.channels)

    def _settings(self) -> Mapping[str, Any]:
        return {**self.asked, "settings": self.settings.model_dump(mode="json")}


def sample_receiver(
    flight: SimulatedFlight,
    *,
    losses_db: Sequence[float] = (0.0, 10.0),
    duration_s: float = 60.0,
    receivers: Sequence[str] = RECEIVERS,
    settings: SampleReceiver | None = None,
    filter: str | Path = "tight",
    recording: str | Path | None = None,
    seed: int = 1,
    threads: int = 2,
    progress: Progress | None = None,
) -> SampleStudy:
    """Return the results of an aided and an unaided receiver on the samples of a flight, at each loss of C/N0.

    Parameters
    ----------
    flight : the simulated flight; its C/N0 comes from its antenna and link budget
    losses_db : taken from every C/N0, one run each
    duration_s : of the recording, at most that of the flight
    receivers : "aided", "unaided" or both
    settings : of sampling, acquisition and loops
    filter : a name in the library or a file; its carrier phases are not used
    recording : the samples, as ``record_samples`` wrote them for this flight, loss, settings and seed;
        None: computed again
    seed : of clock, data, noise and given start
    threads : receivers that run at the same time; the numbers do not depend on it
    progress : called with a message when a run begins

    Raises
    ------
    ConfigError : an unknown receiver, no loss, a duration beyond the flight, a sampling that folds the signal
    InputError : the recording is not of this length, or holds no signal and no noise
    """
    use = settings or SampleReceiver()
    _check_listed("receivers", receivers, f"give some of {', '.join(RECEIVERS)}")
    _check_listed("losses_db", losses_db, "give one or more losses in dB")
    for name in receivers:
        require_known(name, RECEIVERS, "receivers", "receiver")
    for loss in losses_db:
        _check_loss(loss)
    require_seed(seed)
    require_whole(1, "give the number of receivers that may run at the same time", threads=threads)
    if recording is not None:
        if len(losses_db) > 1:
            advice = "give the one loss that it was recorded with"
            raise ConfigError(f"one recording for {len(losses_db)} losses", key="losses_db", advice=advice)
        _check_recording(Path(recording), use, duration_s)
    results: list[_Tables] = []
    for loss in losses_db:
        sky = signal_sky(flight.scenario, duration_s, seeded(seed, _SKY), cn0_change_db=-loss)
        equipment = equipment_of(flight, sky, use, filter, seed)

        def one(name: str, sky: SignalSky = sky, equipment: SampleEquipment = equipment) -> _Tables:
            if progress is not None:
                progress(f"{name} receiver at {equipment.cn0_dbhz:.1f} dBHz")
            return _run(name, sky, equipment, flight, _blocks(sky, use, seed, recording))

        with ThreadPoolExecutor(threads) as pool:
            results += list(pool.map(one, receivers))
    summary, epochs, channels, searches = (
        pd.concat(tables, ignore_index=True) for tables in zip(*results, strict=True)
    )
    asked = {
        "losses_db": [float(loss) for loss in losses_db],
        "duration_s": float(duration_s),
        "receivers": list(receivers),
        "filter": str(filter),
        "recording": None if recording is None else str(recording),
        "seed": int(seed),
        "scenario": flight.config.model_dump(mode="json"),
    }
    return SampleStudy(summary, epochs, channels, searches, use, asked)


def record_samples(
    flight: SimulatedFlight,
    path: str | Path,
    loss_db: float = 0.0,
    duration_s: float = 60.0,
    settings: SampleReceiver | None = None,
    seed: int = 1,
) -> int:
    """Write the samples that the receivers of ``sample_receiver`` have to a file; return how many.

    Raises
    ------
    ConfigError : a loss that is not a number, a duration beyond the flight, a sampling that folds the signal
    ResultError : the file cannot be written
    """
    use = settings or SampleReceiver()
    require_seed(seed)
    _check_loss(loss_db)
    sky = signal_sky(flight.scenario, duration_s, seeded(seed, _SKY), cn0_change_db=-loss_db)
    write_iq(path, _samples(sky, use, seed), use.sample_type)
    return math.ceil(sky.duration_s * use.rate_hz)


def equipment_of(
    flight: SimulatedFlight, sky: SignalSky, settings: SampleReceiver, filter: str | Path, seed: int
) -> SampleEquipment:
    """Return the receivers' inputs: filter, inertial log, and the given start."""
    scenario, cn0_dbhz = flight.scenario, float(np.nanmedian(sky.cn0_dbhz[0]))
    config = filter_config(filter)
    # the loops' noise is white from epoch to epoch, and stated with each row
    white = {"correlation_time_s": 0.0}
    config = config.model_copy(
        update={
            "measurements": config.measurements.model_copy(update={"carrier": False}),
            "pseudorange_noise_m": config.pseudorange_noise_m.model_copy(update=white),
            "range_rate_noise_mps": config.range_rate_noise_mps.model_copy(update=white),
            "search": settings.search,
            "visibility": config.visibility.model_copy(update={"nominal_cn0_dbhz": cn0_dbhz}),
        }
    )
    first_ns = int(flight.log.imu.t_ns[0])
    start = given_start(scenario, first_ns, seeded(seed, _START))
    setup = FilterSetup(
        config,
        scenario.grade,
        scenario.oscillator,
        lever_arm_m=scenario.receiver.lever_arm_b,
        start=start,
        start_ns=first_ns,
        navigation=scenario.navigation,
    )
    imu = flight.log.imu
    last_ns = sky.start_ns + round(sky.duration_s * NS_PER_S)
    keep = imu.t_ns <= last_ns
    imu = type(imu)(imu.t_ns[keep], imu.w_ib_b[keep], imu.f_b[keep])
    sources = aiding_sources(setup, config.aiding)
    view = start_outlook(sources.setup, sources.arcs(first_ns, first_ns), start, imu, settings)
    sample = (first_ns - sky.start_ns) / NS_PER_S * settings.rate_hz
    expected = expected_at_start(view, sky.sv_names, sample)
    return SampleEquipment(settings, sky.sv_names, sky.codes, sky.start_ns, setup, imu, expected, cn0_dbhz)


def given_start(scenario: Scenario, t_ns: int, rng: np.random.Generator) -> GivenStart:
    """Return the true state at a time with errors of the sigmas that are given with it."""
    motion = scenario.trajectory.motion(np.array([(t_ns - scenario.start_ns) / NS_PER_S]))
    truth = reference_table(motion, scenario.start_ns)
    n, e, d = _SD_POSITION_M * rng.standard_normal(3)
    level, yaw = _SD_LEVEL_DEG * rng.standard_normal(2), _SD_YAW_DEG * rng.standard_normal(1)
    lat = float(truth.lat_deg[0])
    per_m = 1.0 / 111_320.0
    return GivenStart(
        lat_deg=lat + n * per_m,
        lon_deg=float(truth.lon_deg[0]) + e * per_m / math.cos(math.radians(lat)),
        h_m=float(truth.h_m[0]) - d,
        v_ned_mps=tuple(truth.v_n[0] + _SD_VELOCITY_MPS * rng.standard_normal(3)),
        rpy_deg=tuple(truth.rpy_deg[0] + np.concatenate([level, yaw])),
        sd_position_m=_SD_POSITION_M,
        sd_velocity_mps=_SD_VELOCITY_MPS,
        sd_roll_pitch_deg=_SD_LEVEL_DEG,
        sd_yaw_deg=_SD_YAW_DEG,
    )


def _run(
    name: str,
    sky: SignalSky,
    equipment: SampleEquipment,
    flight: SimulatedFlight,
    blocks: Iterator[SignalSamples],
) -> _Tables:
    """Return the four tables of one receiver."""
    began = time.perf_counter()
    loop = SampleLoop(equipment, aided=name == "aided")
    loop.run(blocks)
    took_s = time.perf_counter() - began
    epochs = epoch_table(loop, flight.scenario)
    channels = channel_table(loop, sky)
    searches = search_table(loop, sky)
    summary = pd.DataFrame([summary_of(epochs, channels, took_s, sky.duration_s)])
    for table in (summary, epochs, channels, searches):
        table.insert(0, "cn0_dbhz", equipment.cn0_dbhz)
        table.insert(1, "receiver", name)
    return summary, epochs, channels, searches


def _blocks(
    sky: SignalSky, settings: SampleReceiver, seed: int, recording: str | Path | None
) -> Iterator[SignalSamples]:
    """Return the samples as the front end gives them: integers."""
    if recording is not None:
        return _recorded(Path(recording), settings).blocks()
    return (rounded(block, settings.sample_type) for block in _samples(sky, settings, seed))


def _recorded(path: Path, settings: SampleReceiver) -> IqFile:
    return IqFile(path, sampling_of(settings), settings.sample_type)


def _check_listed(key: str, given: object, advice: str) -> None:
    """Refuse what is not a sequence that holds something; text is none."""
    if isinstance(given, str) or not isinstance(given, Sequence | np.ndarray) or len(given) == 0:
        raise ConfigError(f"{given!r} is not a list of one or more", key=key, advice=advice)


def _check_loss(loss_db: float) -> None:
    require_within(-_MOST_CHANGE_DB, _MOST_CHANGE_DB, "give the loss of C/N0 in dB", loss_db=loss_db)


def _check_recording(path: Path, settings: SampleReceiver, duration_s: float) -> None:
    """Refuse a recording of another length: then rate, type or duration are not those it was made with."""
    held_s = _recorded(path, settings).duration_s
    if abs(held_s - require_number("duration_s", duration_s)) > _LENGTH_S:
        samples = f"{settings.sample_type} samples at {settings.rate_hz:g} Hz"
        detail = f"holds {held_s:.6g} s of {samples}, not {duration_s:g} s"
        advice = "give the duration, rate and sample type that it was recorded with"
        raise InputError(f"the recording {detail}", file=path, advice=advice)


def _samples(sky: SignalSky, settings: SampleReceiver, seed: int) -> Iterator[SignalSamples]:
    """Return the samples of a sky with the noise of a seed."""
    noise = int(np.random.SeedSequence(seed, spawn_key=(_NOISE,)).generate_state(1)[0])
    return sample_blocks(sky, sampling_of(settings), noise)
