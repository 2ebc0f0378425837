"""The rows of situations: what the vehicle does, with logs that are as they should be."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from insgnss.config.vehicle_kind import VehicleRows
from tests.benchmarks.trust.flying import Flown
from tests.benchmarks.trust.measuring import position_m
from tests.benchmarks.trust.motions import (
    CITY,
    CITY_S,
    CORNERS,
    CORNERS_S,
    TO_KNOWN,
    TO_KNOWN_S,
    accelerate,
    outage,
    scenario,
    steer,
    straight,
    turn,
)
from tests.benchmarks.trust.rows import (
    ALL,
    MOTION,
    NO_FALSE_HEADING,
    Check,
    Row,
    honest,
    nees,
    no_event,
)
from tests.benchmarks.trust.spoiling import without_carrier

GRADES: Final = ("mems_consumer", "industrial", "tactical_low")
UNHURT: Final = no_event("clock_jump", "reset", "restart")


def _word(carrier: bool) -> str:
    return "with carrier" if carrier else "without carrier"


def _rest(grade: str, carrier: bool) -> Row:
    """Nothing shows a heading: it stays unknown, and so does what hangs on it."""
    name = f"rest_{grade}{'_carrier' * carrier}"
    wide = Check("sigma of yaw stays >= 90 deg", "least", "all.yaw.least_sigma", low=90.0)
    return Row(
        name,
        f"rest 30 min, {_word(carrier)}",
        scenario(name, straight(1800.0), grade=grade, rate_hz=25.0, carrier=carrier),
        (
            wide,
            *no_event("heading_single", "heading_known"),
            *nees(*ALL),
            *honest(),
            *UNHURT,
            NO_FALSE_HEADING,
        ),
        grade,
        looks={"end": 1798.0},
        in_tests=carrier and grade == "industrial",
    )


def _cruise(grade: str, carrier: bool) -> Row:
    """A start in motion shows the course, not the heading; the brake and the bend show it."""
    name = f"straight_{grade}{'_carrier' * carrier}"
    moves = (straight(600.0), accelerate(22.0, 5.0), steer(45.0, 6.0), straight(60.0))
    return Row(
        name,
        f"straight 600 s at 30 m/s from a start in motion, brake, bend, {_word(carrier)}",
        scenario(name, *moves, grade=grade, speed_mps=30.0, carrier=carrier),
        (
            Check("yaw error < 3 sigma on the straight", "most", "straight.yaw.worst", high=3.0),
            # on a straight only the course is known, and the sigma stays wide whatever the error
            *(replace(check, low=0.0) for check in nees("yaw", at="before the brake")),
            *nees(*ALL),
            *honest(),
            *UNHURT,
            NO_FALSE_HEADING,
        ),
        grade,
        looks={"before the brake": 598.0, "end": 670.0},
        windows={"straight": (0.0, 600.0)},
        times=2,
        in_tests=carrier and grade != "tactical_low",
    )


def _gentle(grade: str) -> Row:
    """0.04 m/s^2 for 5 minutes tells a consumer sensor nothing; a turn does."""
    name = f"gentle_{grade}"
    moves = (straight(60.0), accelerate(12.0, 300.0), straight(30.0), steer(90.0, 10.0), straight(60.0))
    wide = Check("sigma of yaw >= 25 deg before the turn", "least", "before.yaw.least_sigma", low=25.0)
    consumer = grade == "mems_consumer"
    return Row(
        name,
        "rest 60 s, 0.04 m/s^2 to 12 m/s, then a turn",
        scenario(name, *moves, grade=grade),
        (
            *((wide,) if consumer else ()),
            *nees("yaw", at="before the turn"),
            *nees(*ALL),
            *honest(),
            *UNHURT,
            NO_FALSE_HEADING,
        ),
        grade,
        looks={"before the turn": 388.0, "end": 458.0},
        windows={"before": (0.0, 388.0)},
        times=2,
        in_tests=consumer,
    )


def _loiter(grade: str) -> Row:
    name = f"loiter_{grade}"
    moves = (
        straight(40.0),
        turn(45.0, 25.0),
        turn(-90.0, 25.0),
        straight(20.0),
        turn(3600.0, 25.0),
        straight(62.0),
    )
    return Row(
        name,
        "ten laps at 25 deg bank, 60 s after the roll-out",
        scenario(name, *moves, grade=grade, speed_mps=50.0),
        (*nees(*MOTION), *honest(), *UNHURT, NO_FALSE_HEADING),
        grade,
        looks={"end": LOITER_S + 60.0},
        in_tests=grade == "industrial",
    )


LOITER_S: Final = 780.0  # the roll-out's end, to some seconds


def _city(grade: str, lasting: bool) -> Row:
    name = f"city_{grade}{'_multipath' * lasting}"
    gnss = (
        "horizon_mask_deg = 15.0\n"
        "multipath = { floor_m = 1.0, horizon_m = 8.0, scale_deg = 20.0, correlation_time_s = 60.0 }"
        if lasting
        else "horizon_mask_deg = 15.0"
    )
    return Row(
        name,
        f"city drive with stops, {'multipath that lasts 60 s' if lasting else 'white noise'}",
        scenario(name, *CITY, grade=grade, gnss=gnss),
        (*nees(*MOTION), *honest("settled"), *UNHURT, NO_FALSE_HEADING),
        grade,
        looks={"end": CITY_S - 2.0},
        windows={"settled": (90.0, CITY_S)},
        in_tests=lasting and grade == "mems_consumer",
    )


def _city_starts() -> Row:
    """A1b: no start anywhere in a city calls a heading known that is wrong by more than five sigma."""
    gnss = "multipath = { floor_m = 1.0, horizon_m = 8.0, scale_deg = 20.0, correlation_time_s = 15.0 }"
    return Row(
        "city_starts",
        "start at a drawn place of a city drive with multipath",
        scenario("city_starts", *CITY, grade="mems_consumer", gnss=gnss),
        (NO_FALSE_HEADING, *honest(blocks=("tilt", "yaw"))),
        "mems_consumer",
        cut=True,
        times=8,
    )


def _outage(grade: str, length_s: float) -> Row:
    name = f"outage_{length_s:.0f}_{grade}"
    from_s = TO_KNOWN_S + CORNERS_S
    moves = (*TO_KNOWN, *CORNERS, *CORNERS, *CORNERS)
    return Row(
        name,
        f"no satellite for {length_s:.0f} s in a city",
        scenario(name, *moves, grade=grade, faults=outage(from_s, from_s + length_s)),
        (
            *nees(*MOTION, at="before its end"),
            *nees(*MOTION),
            *honest(),
            *UNHURT,
            NO_FALSE_HEADING,
            Check("reported by an event", "least", "events.no_measurements", low=1.0),
        ),
        grade,
        looks={"before its end": from_s + length_s - 1.0, "end": TO_KNOWN_S + 3 * CORNERS_S - 2.0},
        output=1.0,
        in_tests=length_s == 30.0 and grade == "industrial",
    )


CAR: Final = VehicleRows.model_validate({"kind": "car", "non_holonomic": {"axle_m": (0.0, 0.0, 0.0)}})


def _car_outage(grade: str, most_m: float) -> Row:
    """Corners, a stop and a start without satellites, with the rows of a car."""
    name = f"outage_60_car_{grade}"
    from_s, to_s = 200.0, 260.0
    known = Check(
        "nees position before its end, error over sigma 0.5 to 1.3",
        "nees",
        "position",
        "before its end",
        low=0.25,
        high=1.69,
    )
    return Row(
        name,
        "no satellite for 60 s in a city, vehicle kind car",
        scenario(name, *CITY, grade=grade, faults=outage(from_s, to_s)),
        (
            known,
            Check("position in its last second [m] (mean)", "mean", "position_m", high=most_m),
            *honest(),
            *UNHURT,
            *no_event("rows_contradict"),
            NO_FALSE_HEADING,
        ),
        grade,
        looks={"before its end": to_s - 1.0, "end": CITY_S - 2.0},
        vehicle=CAR,
        output=1.0,
        measures={"position_m": position_m(to_s - 1.5, to_s - 0.5)},
        times=3,  # 12 runs of a mean of 0.45 are below 0.25 once in twenty pages
    )


def _static_hour(carrier: bool) -> Row:
    """A position that nothing moves: reflections, messages and air without error, so nothing lasts."""
    name = f"static_hour{'_carrier' * carrier}"
    return Row(
        name,
        f"at rest for an hour, {_word(carrier)}",
        scenario(name, straight(3600.0), rate_hz=25.0, carrier=carrier, gnss="rate_hz = 0.5"),
        (*nees(*ALL), *honest(), *UNHURT, NO_FALSE_HEADING),
        "industrial",
        looks={"end": 3598.0},
    )


def _lasting_hour(carrier: bool) -> Row:
    """Messages and air are wrong for half an hour by what the flight file says of it."""
    name = f"lasting_errors{'_carrier' * carrier}"
    gnss = (
        "rate_hz = 0.5\n"
        "air_errors = { ionosphere_m = 1.5, troposphere_m = 0.05, correlation_time_s = 3600.0 }\n"
        "ephemeris_errors = { radial_m = 0.2, along_m = 0.5, cross_m = 0.5, clock_m = 0.43 }"
    )
    return Row(
        name,
        f"at rest for half an hour, errors of messages and air, {_word(carrier)}",
        scenario(name, straight(1800.0), rate_hz=25.0, carrier=carrier, gnss=gnss),
        (*nees("position", "velocity", "tilt"), *honest(), *UNHURT, NO_FALSE_HEADING),
        "industrial",
        looks={"end": 1798.0},
        start="given",
        times=2,
    )


def _with_states(row: Row) -> Row:
    """Return a row of range errors that last whose filter has states for them."""
    return replace(
        row,
        name=f"{row.name}_states",
        title=f"{row.title}, as states",
        settings={"process.range_bias_states": True},
        in_tests=False,
    )


def _carrier_air() -> Row:
    """A2: with a perfect model of the air the carrier's differences must not push the height away."""
    moves = (*TO_KNOWN, *CORNERS, straight(400.0))
    return Row(
        "carrier_air",
        "drive with carrier under the broadcast ionosphere, known exactly",
        scenario("carrier_air", *moves, carrier=True),
        (
            Check("mean vertical error within 0.1 m", "mean", "vertical_m", low=-0.1, high=0.1),
            *nees(*MOTION),
            *honest(),
            *UNHURT,
        ),
        "industrial",
        looks={"end": TO_KNOWN_S + CORNERS_S + 398.0},
        measures={"vertical_m": _mean_vertical},
        in_tests=True,
    )


def _air_errors(carrier: bool) -> Row:
    """A2: what the model leaves of the ionosphere lasts; the carrier must not make more of it than the code does."""
    moves = (*TO_KNOWN, *CORNERS, straight(900.0))
    gnss = "air_errors = { ionosphere_m = 1.5, correlation_time_s = 1800.0 }"
    name = f"air_errors{'_carrier' * carrier}"
    return Row(
        name,
        f"drive, 1.5 m of ionosphere at the zenith that no model has, {_word(carrier)}",
        scenario(name, *moves, carrier=True, gnss=gnss),
        (*nees("velocity", "tilt", "yaw"), *honest(blocks=("velocity", "tilt", "yaw")), *UNHURT),
        "industrial",
        looks={"end": TO_KNOWN_S + CORNERS_S + 898.0},
        measures={"vertical.square": _vertical_square},
        # the same draw of all errors in both rows
        spoil=None if carrier else without_carrier,
    )


def _vertical_square(flown: Flown) -> float:
    errors = flown.run.errors
    assert errors is not None
    late = flown.since(errors["time_s"].to_numpy()) > 100.0
    return float(((errors["d_d_m"] / errors["sd_d_m"]).to_numpy()[late] ** 2).mean())


def _mean_vertical(flown: Flown) -> float:
    errors = flown.run.errors
    assert errors is not None
    late = flown.since(errors["time_s"].to_numpy()) > 100.0
    return float(errors["d_d_m"].to_numpy()[late].mean())


def _hour_without_gnss(given: bool) -> Row:
    name = f"hour_without_gnss_{'given' if given else 'aligned'}"
    align = (
        straight(60.0),
        turn(180.0, 25.0),
        straight(120.0),
        turn(-180.0, 25.0),
        straight(120.0),
    )
    moves = (straight(60.0),) if given else align
    begin_s = 50.0 if given else 460.0
    text = scenario(
        name,
        *moves,
        straight(begin_s + 3640.0 - (60.0 if given else 446.0)),
        speed_mps=120.0,
        grade="navigation",
        rate_hz=25.0,
        faults=outage(begin_s, begin_s + 3600.0),
    )
    return Row(
        name,
        f"an hour without satellites, {'start given' if given else 'aligned in turns'}",
        text,
        (*nees(*MOTION, at="before its end"), *nees(*MOTION), *honest(), NO_FALSE_HEADING),
        "navigation",
        looks={"before its end": begin_s + 3598.0, "end": begin_s + 3630.0},
        start="given" if given else "automatic",
        output=1.0,
    )


# The sea's mirror makes the same error in every seed, so one instant is one draw: the mean over the run counts
SHIPS_POSITION: Final = Check(
    "position e/s (rms of the run)", "rms", "all.position.square", low=0.7, high=1.5
)


def _shipped(name: str, title: str, today_s: float, *more: Check) -> Row:
    """A scenario of models/scenarios: the heading is known at most 30 s later than in version 87510aa."""
    # at 90 deg of pitch, in a loop, roll and yaw are not defined apart
    blocks = ("position", "velocity") if name == "aerobatics" else MOTION
    known = Check("heading known (median) [s]", "median", "known_s", high=today_s + 30.0)
    return Row(
        name,
        title,
        name,
        (
            *nees(*MOTION),
            *honest(blocks=blocks),
            NO_FALSE_HEADING,
            *((known,) if math.isfinite(today_s) else ()),
            *more,
        ),
        looks={"end": -5.0},
    )


def situation_rows() -> tuple[Row, ...]:
    """Return all rows of this file."""
    both = (False, True)
    return (
        *(_rest(grade, carrier) for grade in GRADES for carrier in both),
        *(_cruise(grade, carrier) for grade in GRADES for carrier in both),
        *(_gentle(grade) for grade in GRADES),
        *(_loiter(grade) for grade in ("mems_consumer", "industrial", "tactical")),
        *(_city(grade, lasting) for grade in ("mems_consumer", "industrial") for lasting in both),
        _city_starts(),
        *(_outage(grade, s) for grade in ("mems_consumer", "industrial") for s in (10.0, 30.0, 60.0)),
        _car_outage("industrial", 2.5),
        _car_outage("mems_consumer", 9.0),
        *(_static_hour(carrier) for carrier in both),
        *(_lasting_hour(carrier) for carrier in both),
        _with_states(_lasting_hour(carrier=False)),
        _with_states(_city("industrial", lasting=True)),
        _carrier_air(),
        *(_air_errors(carrier) for carrier in both),
        *(_hour_without_gnss(given) for given in both),
        _shipped("turning_flight", "small aircraft, turns that hide satellites", 62.0),
        _shipped("over_the_pole", "airliner over the pole", 101.0),
        _shipped("fast_jet", "jet, 250 to 400 m/s, turns of 60 to 75 deg", 40.0),
        _shipped("city_car", "car with multipath of 15 s", 30.0),
        _shipped("small_drone", "drone, vibration, jitter, lost samples", 44.0),
        _shipped("aerobatics", "loop, rolls, no satellite while inverted", math.inf),
        _shipped("sounding_rocket", "rocket, 10 g, spin", math.inf),
        _shipped("ship_in_waves", "ship of 60 m in waves", math.inf, SHIPS_POSITION),
    )
