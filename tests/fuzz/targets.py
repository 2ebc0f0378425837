"""What is read, from which sound bytes the damage starts, and what has to hold of a result."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from insgnss.antenna.obstruction import read_obstruction
from insgnss.antenna.pattern_file import read_pattern
from insgnss.config.filter import FilterConfig
from insgnss.config.flight import FlightConfig, Reference
from insgnss.config.interference import InterferenceConfig
from insgnss.config.simulation import SimulationConfig
from insgnss.config.strict import load_toml
from insgnss.config.vehicle import Vehicle
from insgnss.log.android.reader import read_android
from insgnss.log.detect import detect_format
from insgnss.log.gnss_csv import read_gnss
from insgnss.log.imu.csv_log import read_imu
from insgnss.log.nmea import read_nmea
from insgnss.log.novatel.reader import read_novatel
from insgnss.log.precise import read_antennas, read_precise
from insgnss.log.receiver import ReceiverLog
from insgnss.log.reference import read_reference
from insgnss.log.rinex.navigation import read_navigation
from insgnss.log.rinex.observations import read_rinex_obs
from insgnss.log.rosbag.reader import read_rosbag
from insgnss.log.rtcm.reader import read_rtcm
from insgnss.log.sbf.reader import read_sbf
from insgnss.log.ubx.reader import read_ubx
from insgnss.log.ulog.reader import read_ulog
from insgnss.log.yuma import read_yuma
from insgnss.receiver.events import read_receiver_events
from insgnss.report.digest import digest
from insgnss.report.export import as_csv
from insgnss.report.geojson import as_geojson
from insgnss.report.gpx import as_gpx
from insgnss.report.kml import as_kml
from insgnss.results.record import RECORD
from insgnss.results.saving import saving, write_file
from insgnss.runs.result import TABLES, Run
from insgnss.studies.campaign.study import load_campaign, tasks_of
from tests.antenna import test_obstruction, test_pattern_file
from tests.config import test_simulation, test_strict
from tests.gnss import precise_sample
from tests.interference import test_command
from tests.log import (
    novatel_encoder,
    rtcm_encoder,
    test_fuzz,
    test_fuzz_receivers,
    test_nmea,
    test_novatel,
    test_rosbag,
    test_rtcm,
    test_ubx_fuzz,
    test_ubx_solution,
    test_ulog,
)
from tests.log.sound import check_imu, check_log, check_navigation, check_table
from tests.log.test_rinex_navigation import message
from tests.log.writing import WEEK, gnss_config, imu_config, tabbed
from tests.small_run import small_run

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "models"
MINIMISED = ROOT / "tests/fuzz/minimised"
UNIX = {"origin": "unix_epoch", "scale": "utc"}
_USED = ("nav", "measurements", "satellites", "events", "errors")  # by what is done with a run


@dataclass(frozen=True)
class Target:
    """A reader, or all that is done with a saved run."""

    name: str
    seeds: Sequence[bytes]
    read: Callable[[Path], None]  # of the damaged file
    weight: float = 1.0  # share of the cases
    ending: str = ""


def replace_file(path: Path, data: bytes) -> None:
    """Write a new file: to cut off and write an old one, some file systems wait for the disk (4 ms)."""
    path.unlink(missing_ok=True)
    path.write_bytes(data)


def _imu(path: Path, **settings: Any) -> None:
    check_imu(read_imu(imu_config(path, **settings), WEEK)[0])


def _navigation(path: Path) -> None:
    navigation, _ = read_navigation([path])
    check_navigation(navigation)
    vectors = navigation.state_vectors
    assert len(navigation.ephemerides.toe_ns) > 0 or (vectors is not None and len(vectors.t_ns) > 0)


def _campaign(path: Path) -> None:
    config = load_campaign(path)
    if config.n_runs < 10_000:
        tasks_of(config, path.parent)


def _use(run: Run) -> None:
    """Do what commands do with a run that was loaded."""
    run.status_counts()
    if not run.nav.empty:
        digest(run)
        for form in (as_csv, as_kml, as_gpx, as_geojson):
            form(run)


def _run(folder: Path, form: str, name: str) -> Target:
    """Return the saved run of which one file is damaged."""
    run = small_run(seconds=5.0)
    for table in set(TABLES) - {*_USED, name.partition(".")[0]}:
        setattr(run, table, None)  # sound tables that nothing uses take most of the time of a case
    folder = run.save(folder / name, form)  # type: ignore[arg-type]
    sound = (folder / name).read_bytes()
    (folder / RECORD).unlink()  # it has the hashes: a damaged run is to be used, too

    def read(path: Path) -> None:
        replace_file(folder / name, path.read_bytes())
        _use(Run.load(folder))

    return Target(f"run {name}", [sound], read, 0.2)


def _saved_over(folder: Path) -> Target:
    """Return a save into a folder whose record of what is ours is damaged."""
    place = folder / "record"
    with saving(place, ("a", "b"), "run") as new:
        (new / "a").write_bytes(b"a")
    sound = (place / RECORD).read_bytes()

    def read(path: Path) -> None:
        replace_file(place / RECORD, path.read_bytes())
        try:
            write_file(place / "a", b"a", "run")
        finally:
            replace_file(place / RECORD, sound)

    return Target("record", [sound], read, 0.2)


def _minimised(kind: str) -> list[bytes]:
    return _files(*sorted(MINIMISED.glob(f"{kind}_*.min")))


def _files(*paths: Path) -> list[bytes]:
    return [path.read_bytes() for path in paths]


def _toml(name: str, *seeds: bytes, read: Callable[[Path], object]) -> Target:
    return Target(f"{name}.toml", seeds, lambda path: _drop(read(path)), 1.0, ".toml")


def _clocks(sp3: bytes) -> Callable[[Path], None]:
    """Return how clocks are read, beside the orbits that belong to them."""

    def read(path: Path) -> None:
        orbits = path.with_name("orbits.sp3")
        orbits.write_bytes(sp3)
        read_precise([orbits, path])

    return read


def _resealed(
    read: Callable[[Sequence[Path]], ReceiverLog], seal: Callable[[bytes], bytes]
) -> Callable[[Path], None]:
    """Return a reader of files whose damage no checksum tells."""

    def read_sealed(path: Path) -> None:
        path.write_bytes(seal(path.read_bytes()))
        check_log(read([path]))

    return read_sealed


def _optional() -> list[Target]:
    """Return the readers whose libraries are installed."""
    found = []
    if importlib.util.find_spec("pyulog") is not None:
        found.append(Target("ulog", [test_ulog.SMALL], lambda path: check_log(read_ulog(path))))
    if importlib.util.find_spec("mcap_ros2") is not None:
        bags = [test_rosbag.recorded(packed, 2).data for packed in ("NONE", "LZ4", "ZSTD")]
        found.append(Target("mcap", bags, lambda path: check_log(read_rosbag(path))))
    return found


def _drop(_: object) -> None:
    return None


def targets(folder: Path) -> list[Target]:
    """Return all targets; the saved runs lie in ``folder``."""
    gnss, imu = test_fuzz.GNSS_TEXT.encode(), test_fuzz.IMU_TEXT.encode()
    of_1970 = b"\n".join(b"1688037" + line[1:] if line[:1] == b"1" else line for line in imu.splitlines())
    nav = [
        test_fuzz.NAV_TEXT.encode(),
        b"\n".join((ROOT / "data/sample_flight/nav.rnx").read_bytes().splitlines()[:60]),
    ]
    nav += [tabbed(test_fuzz.NAV_TEXT).encode()]
    nav += [precise_sample.NAVIGATION.encode(), (test_fuzz.NAV_HEADER + message("R07")).encode()]
    obs = [text.encode() for text in test_fuzz_receivers.TEXTS.values()]
    reference = b"\n".join((ROOT / "data/sample_flight/reference.csv").read_bytes().splitlines()[:25])
    sp3, clocks = precise_sample.sp3_text().encode(), precise_sample.clock_text().encode()
    yuma = (ROOT / "tests/fuzz/week.alm").read_bytes()
    events = b"time_s,sv,event\n293700.0,G05,lock\n293710.0,G07,loss\n293720.5,E11,lock\n"
    return [
        Target("imu csv", [imu, *_minimised("imu")], _imu),
        Target("gnss csv", [gnss], lambda path: check_table(read_gnss(gnss_config(path), WEEK)[0])),
        Target("reference csv", [reference], lambda path: _drop(read_reference(Reference(file=path), WEEK))),
        Target("receiver events", [events], lambda path: _drop(read_receiver_events(path, WEEK))),
        Target("imu csv of Unix time", [of_1970], lambda path: _imu(path, time=UNIX), 0.5),
        Target("rinex navigation", [*nav, *_minimised("nav")], _navigation),
        Target(
            "rinex observations",
            [*obs, *_minimised("obs")],
            lambda path: check_table(read_rinex_obs([path])[0]),
        ),
        Target("sp3", [sp3, *_minimised("sp3")], lambda path: _drop(read_precise([path]))),
        Target("rinex clock", [clocks], _clocks(sp3)),
        Target(
            "antex",
            [precise_sample.antex_text().encode(), *_minimised("antex")],
            lambda path: _drop(read_antennas(path)),
        ),
        Target("yuma", [yuma, *_minimised("yuma")], lambda path: _drop(read_yuma(path, WEEK))),
        Target(
            "ubx", [test_ubx_fuzz.SMALL, test_ubx_solution.FIXES], lambda path: check_log(read_ubx([path]))
        ),
        Target("sbf", [b"".join(test_fuzz_receivers.SBF_BLOCKS)], lambda path: check_log(read_sbf(path))),
        Target("novatel", [test_novatel.FUZZED], lambda path: check_log(read_novatel([path])), 0.3),
        Target(
            "novatel messages",
            [test_novatel.FUZZED],
            _resealed(read_novatel, novatel_encoder.resealed),
            0.7,
        ),
        *_optional(),
        Target("nmea", [test_nmea.EPOCHS], lambda path: check_log(read_nmea([path])), 0.3),
        Target("nmea sentences", [test_nmea.EPOCHS], _resealed(read_nmea, test_nmea.resealed), 0.7),
        Target("rtcm", [test_rtcm.STREAM], lambda path: check_log(read_rtcm([path])), 0.3),
        Target("rtcm messages", [test_rtcm.STREAM], _resealed(read_rtcm, rtcm_encoder.resealed), 0.7),
        Target(
            "android",
            [test_fuzz_receivers.ANDROID.encode(), *_minimised("android")],
            lambda path: check_log(read_android(path)),
        ),
        Target("format", [obs[0], imu, test_ubx_fuzz.SMALL], lambda path: _drop(detect_format(path)), 0.3),
        Target("antenna pattern", [test_pattern_file.GOOD.encode()], lambda path: _drop(read_pattern(path))),
        _toml("obstruction", test_obstruction.FILE.encode(), read=read_obstruction),
        _toml("flight", test_strict.GOOD.encode(), read=lambda path: load_toml(path, FlightConfig)),
        _toml(
            "filter",
            *_files(MODELS / "filters/tight.toml"),
            read=lambda path: load_toml(path, FilterConfig),
        ),
        _toml(
            "scenario",
            test_simulation.GOOD.encode(),
            *_files(MODELS / "scenarios/three_antennas.toml"),
            read=lambda path: load_toml(path, SimulationConfig),
        ),
        _toml(
            "vehicle",
            *_files(MODELS / "vehicles/triangle_1m.toml"),
            read=lambda path: load_toml(path, Vehicle),
        ),
        _toml("campaign", *_files(MODELS / "campaigns/imu_grades.toml"), read=_campaign),
        _toml(
            "emitters", test_command.EMITTERS.encode(), read=lambda path: load_toml(path, InterferenceConfig)
        ),
        *(
            _run(folder, "parquet", f"{name}.parquet")
            for name in ("nav", "measurements", "events", "errors", "aiding")
        ),
        *(_run(folder, "csv", f"{name}.csv") for name in ("nav", "measurements", "events", "transitions")),
        _run(folder, "parquet", "settings.json"),
        _saved_over(folder),
        _run(folder, "csv", "columns.json"),
    ]
