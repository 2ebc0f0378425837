"""Fault identification: the last minute rerun under each supposed fault.

When all satellites together contradict the filter's own prediction (``integrity``), the filter of about a minute ago
runs over the samples and epochs since once more: as it was; with the accelerometers' or the gyros' biases unknown from
some instant on, or wrong for a moment; with more noise in all satellites' rows or all inertial samples; without
satellites that may run away; without range rates, or with range rates that lag; with tags or a lever arm that are
off; with a further sensor that is less accurate than it says, or late. Each explanation has a prior and a likelihood,
integrated over what it does not know (onset, size, axis, rate), which gives its posterior:

    log odds = log prior + log likelihood - log likelihood of the filter as it was

An explanation is believed when its odds against all others together, the sound filter among them, are large, and it was
suspected before already. Then the filter that knew of it in time takes the place of the one
that did not: with its honest covariance, and with all else as it was. Where accelerometers and gyros explain the same,
the biases of both become unknown until one is believed.                     [Willsky & Jones 1976; Kass & Raftery 1995]
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import reduce
from itertools import chain
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.further_sensors import sensors_in_question, without_sensor, wrong_sensor
from insgnss.filter.diagnosis.hindsight import NOISY, WITHOUT_S, Hindsight, Verdict
from insgnss.filter.diagnosis.jumps import ACCELEROMETER, GYRO, bias_of
from insgnss.filter.diagnosis.late_rates import LONG_LAG_S, late_rates
from insgnss.filter.diagnosis.offset_state import with_installation_states, wrong_lever_arm
from insgnss.filter.diagnosis.past import FilterHistory
from insgnss.filter.diagnosis.supposed_faults import (
    CLEAR,
    FURTHER_SENSOR,
    IMU_TAGS,
    INERTIAL_NOISE,
    INSTALLATION,
    LAPSE,
    LATE_RATES,
    LOG_PRIOR,
    NOISE,
    RATES,
    SATELLITES,
    SENSORS,
    SHOCK,
    SURE,
)
from insgnss.filter.diagnosis.tag_faults import other_imu_tags
from insgnss.filter.diagnosis.witnesses import MOST_SATELLITES
from insgnss.filter.headings.heading_bank import merge_into
from insgnss.filter.layout import Layout
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.setup import FilterSetup
from insgnss.filter.state import Bank, joined_banks, select_members
from insgnss.filter.update.satellite_memory import LEFT_OUT_S
from insgnss.gnss.observation_rows import CARRIER, N_BANDS
from insgnss.tables import Float64

# A state that is unknown explains anything, pseudoranges that jump together too, and so do range rates that may wander
# as they like: the lie must have been a large one
_PRIOR_OF_LARGE_LIES: Final = 10.0 * LOG_PRIOR
_LARGE_LIES: Final = (LAPSE, RATES)
_ALL_AXES: Final = 3  # of a sensor, whose noise has risen
_MOST: Final = 0.7  # of the log odds: 0.74 to 0.83 where tags are 20 ms late, 0.6 at most in vibration
_COARSE: Final = 3.0 * SURE  # a ramp of one rate may fit a satellite worse by that much likelihood
_WORTH_A_LOOK: Final = math.log(1e-3)  # odds; a sound log of the trust campaign stays below
# so long what late tags have done, which the filter does not mend, looks like other faults
_TAGS_LAST_NS: Final = 120 * NS_PER_S


class Explanation(NamedTuple):
    """A fault, and how much better it explains the last minute than a sound filter does."""

    suspect: str
    log_odds: float
    best: Verdict  # the likeliest, or one that fits and is nearly as likely
    verdicts: tuple[Verdict, ...]  # over all onsets that were tried, in their order


def explanations(results: Iterable[Verdict], as_it_was: float) -> list[Explanation]:
    """Return the explanations of the last minute, the likeliest first, each set of satellites, axes or kinds one."""
    of: dict[tuple[str, tuple[int, ...], tuple[int, ...], tuple[str, ...]], list[Verdict]] = defaultdict(list)
    for verdict in results:
        if math.isfinite(verdict.log_likelihood):
            of[verdict.suspect, verdict.satellites, verdict.axes, verdict.kinds].append(verdict)
    ranked = []
    for (suspect, satellites, axes, _), verdicts in of.items():
        parts = _ALL_AXES if suspect == INERTIAL_NOISE else max(len(satellites), len(axes), 1)
        prior = _PRIOR_OF_LARGE_LIES if suspect in _LARGE_LIES else LOG_PRIOR * parts
        verdicts.sort(key=_unknown)
        gain = prior + float(np.logaddexp.reduce(log_weights(verdicts))) - as_it_was
        ranked.append(Explanation(suspect, gain, _best(verdicts), tuple(verdicts)))
    return sorted(ranked, key=lambda each: -each.log_odds)


def _best(verdicts: list[Verdict]) -> Verdict:
    """Return the likeliest verdict, or one that fits where the odds between the two leave the choice open."""
    least = max(verdict.log_likelihood for verdict in verdicts) - SURE
    return max((v for v in verdicts if v.log_likelihood > least), key=lambda v: (v.fits, v.log_likelihood))


def log_weights(verdicts: Sequence[Verdict]) -> Float64:
    """Return ln w_i L_i of an onset or an error of the tags; their sum is the mean likelihood over its range.

    w_i is the part of the range that is nearer to i than to any other that was tried; ``verdicts`` are in order.
    """
    at = np.array([_unknown(verdict) for verdict in verdicts], dtype=np.float64)
    likelihood = np.array([verdict.log_likelihood for verdict in verdicts])
    if at[-1] <= at[0]:
        return np.asarray(likelihood - math.log(len(at)))
    edges = np.concatenate((at[:1], 0.5 * (at[1:] + at[:-1]), at[-1:]))
    with np.errstate(divide="ignore"):  # of two at the same place one has no part
        return np.asarray(likelihood + np.log(np.diff(edges) / (at[-1] - at[0])))


def over_onsets(explanation: Explanation, layout: Layout) -> Verdict:
    """Return the verdict whose filter is that of all onsets together: their mean, and what they differ by as variance.

    When a sensor failed is not known to some seconds, and the size of the fault depends on it.
    """
    best = explanation.best
    if best.suspect not in SENSORS:
        return best
    bank = reduce(joined_banks, (verdict.bank for verdict in explanation.verdicts))._replace(
        slow=best.bank.slow
    )
    bank.state["log_weight"] = log_weights(explanation.verdicts)
    heavy = np.flatnonzero(bank.state["log_weight"] > bank.state["log_weight"].max() - SURE)
    bank = select_members(bank, heavy)
    lead = int(bank.head[0].leader)
    for i in range(len(heavy)):
        if i != lead:
            merge_into(bank, lead, i, layout)
    return best._replace(bank=select_members(bank, np.array([lead], np.int64)))


def with_sound_axes(explanation: Explanation, again: Hindsight) -> Explanation:
    """Return an explanation by a sensor's jump with filters that know the axes which have not jumped."""
    if explanation.suspect not in (ACCELEROMETER, GYRO):
        return explanation
    weights = log_weights(explanation.verdicts)
    heavy = weights > weights.max() - SURE
    renewed = {
        id(verdict): again.with_sound_axes(verdict)
        for verdict, counts in zip(explanation.verdicts, heavy, strict=True)
        if counts or verdict is explanation.best
    }
    verdicts = tuple(renewed.get(id(verdict), verdict) for verdict in explanation.verdicts)
    return explanation._replace(verdicts=verdicts, best=renewed[id(explanation.best)])


def _unknown(verdict: Verdict) -> float:
    return verdict.size if verdict.suspect in (IMU_TAGS, LATE_RATES) else verdict.onset_ns / NS_PER_S


def log_odds(of: list[Explanation], against: list[Explanation]) -> float:
    """Return the odds of some explanations against all others and the sound filter."""
    chosen = {id(each) for each in of}  # two may be equal: of satellites without a used row
    others = [each.log_odds for each in against if id(each) not in chosen]
    return float(np.logaddexp.reduce([each.log_odds for each in of]) - np.logaddexp.reduce([0.0, *others]))


def run_away(
    past: FilterHistory, bank: Bank, setup: FilterSetup, imu: ImuSamples, parameters: npt.NDArray[Any]
) -> tuple[Verdict | None, FilterHistory]:
    """Return the filter that has left out from the start the satellites which ``bank`` has just found to creep."""
    past, span = past.judged()
    if span is None:
        return None, past
    satellites = left_out(bank, span[1])
    again = Hindsight(past.of_late(int(WITHOUT_S * NS_PER_S)), setup, imu, parameters, span)
    in_vain = replace(past, in_vain=past.in_vain + 1)
    if not again.came_through or not 0 < len(satellites) <= MOST_SATELLITES:
        return None, in_vain
    verdict, _ = again.leaving_out(again.before[0], satellites) or (None, [])
    if verdict is None or not verdict.fits:
        return None, in_vain
    # of rates all of which are wrong some creep
    ranking = explanations([verdict, *again.sensor(RATES)], again.as_it_was)
    if ranking[0].suspect == RATES and ranking[0].log_odds > _WORTH_A_LOOK and not again.noisy_ranges:
        return None, past.suspecting(_accused(ranking[0]))
    if log_odds([each for each in ranking if each.suspect == SATELLITES], ranking) < SURE:
        return None, in_vain
    lasting = again.to_the_end(verdict)
    return (None, in_vain) if lasting is None else (lasting, past.after_verdict())


def with_noise_of_grade(
    past: FilterHistory, setup: FilterSetup, imu: ImuSamples, parameters: npt.NDArray[Any]
) -> tuple[Verdict | None, FilterHistory]:
    """Return the filter that has had the grade's noise again for a minute, if that explains the minute far better."""
    looked_at, span = past.judged()
    if span is None:
        return None, past
    again = Hindsight(looked_at, setup, imu, parameters, span)
    bank = again.oldest()
    bank.state["noise_excess"] = 0.0
    verdict = again.verdict(INERTIAL_NOISE, bank, again.stretches) if again.came_through else None
    if verdict is None or not verdict.fits or verdict.log_likelihood < again.as_it_was + SURE:
        return None, past
    calm = again.to_the_end(verdict)
    return (None, past) if calm is None else (calm, looked_at.after_verdict())


def left_out(bank: Bank, t_ns: int) -> tuple[int, ...]:
    """Return the satellites that are left out at a time because they run away from the others."""
    until_s = bank.memory[0, :, LEFT_OUT_S]
    return tuple(int(n) for n in np.unique(np.flatnonzero(until_s > t_ns * 1e-9) // N_BANDS))


def every_fault(again: Hindsight) -> list[Verdict]:
    """Return the results of the last minute for every supposed fault; they are tried side by side."""
    # a sensor that is said to have no bias cannot have one that jumps
    jumps = [each for each in (ACCELEROMETER, GYRO) if bias_of(each, again.setup)[2].sigma > 0.0]
    with ThreadPoolExecutor(again.setup.threads) as pool:
        sensors = [
            pool.submit(again.sensor, each) for each in (*jumps, SHOCK, LAPSE, INERTIAL_NOISE, NOISE, RATES)
        ]
        others = [
            pool.submit(list[Verdict], verdicts_of(again))
            for verdicts_of in (other_imu_tags, late_rates, wrong_lever_arm)
        ]
        others += [
            pool.submit(list[Verdict], wrong_sensor(again, kind)) for kind in sensors_in_question(again)
        ]
        satellites = again.without_satellites(pool)
    return [*_results(sensors), *satellites, *_results(others)]


def _results(running: list[Future[list[Verdict]]]) -> Iterator[Verdict]:
    return chain.from_iterable(each.result() for each in running)


def judge(
    past: FilterHistory, setup: FilterSetup, imu: ImuSamples, parameters: npt.NDArray[Any]
) -> tuple[Verdict | None, FilterHistory]:
    """Return the failed part, if it is clear, and the past with open suspicions."""
    past, span = past.judged()
    if span is None:
        return None, past
    again = Hindsight(past, setup, imu, parameters, span)
    if not again.came_through:
        return None, replace(past, in_vain=past.in_vain + 1)
    ranking = explanations(every_fault(again), again.as_it_was)
    if not ranking:
        return None, replace(past, in_vain=past.in_vain + 1)
    fitting = [each for each in ranking if each.best.fits]
    # noise would not name late tags; rates that lag by much are uncertain by much, which explains noise, too
    if any(_explains_most(ranking, each, INERTIAL_NOISE) for each in INSTALLATION):
        fitting, ranking = _without(fitting, INERTIAL_NOISE), _without(ranking, INERTIAL_NOISE)
    elif _is_long_lag(ranking) and _explains_most(ranking, INERTIAL_NOISE, LATE_RATES):
        fitting, ranking = _without(fitting, LATE_RATES), _without(ranking, LATE_RATES)
    if fitting and fitting[0].suspect in (SATELLITES, FURTHER_SENSOR) and fitting[0].log_odds > SURE:
        ranking = fitting  # it is enough that the others agree; of a sensor that explains much in any case it is not
    first, before = ranking[0], past.suspected
    excused = _is_excused(ranking, past, again)
    suspected = before if excused else _accused(first)
    past = past.suspecting(suspected if first.log_odds > _WORTH_A_LOOK else frozenset())
    if excused or not first.best.fits:
        return None, past
    likely = [each for each in ranking if each.log_odds > first.log_odds - SURE]
    chosen = shared(likely)
    if chosen is not None and chosen.best.fits and _is_shown(_with(chosen, ranking), ranking, before):
        verdict = _filter_of(chosen, again)
        if verdict is None:
            return None, replace(past, in_vain=past.in_vain + 1)
        if chosen.suspect in INSTALLATION:
            verdict = with_installation_states(verdict, again, {each.suspect: each.best for each in likely})
        return verdict, past.after_verdict(tags_off=chosen.suspect == IMU_TAGS and verdict.setup is None)
    sensors = [each for each in ranking if each.suspect in SENSORS]
    if past.opened or first not in sensors or not _is_shown(sensors, ranking, before):
        return None, past
    either = explanations(again.either([each.best for each in likely]), again.as_it_was)
    verdict = again.to_the_end(over_onsets(either[0], setup.layout)) if either else None
    return verdict, past if verdict is None else replace(past, opened=True)


def _is_long_lag(ranking: list[Explanation]) -> bool:
    """Return whether the likeliest lag of the range rates is about the longest that is tried."""
    return any(each.suspect == LATE_RATES and each.best.size >= LONG_LAG_S for each in ranking)


def _explains_most(ranking: list[Explanation], suspect: str, of: str) -> bool:
    """Return whether a suspicion that fits explains most of what another one does."""
    odds, others = (
        max((each.log_odds for each in ranking if each.suspect == name and each.best.fits), default=0.0)
        for name in (suspect, of)
    )
    return odds > max(SURE, _MOST * others)


def _without(ranking: list[Explanation], suspect: str) -> list[Explanation]:
    return [each for each in ranking if each.suspect != suspect]


def _filter_of(chosen: Explanation, again: Hindsight) -> Verdict | None:
    """Return the verdict of an explanation with the filter that knew of it in time, at the last epoch."""
    if chosen.suspect == FURTHER_SENSOR:
        return without_sensor(again, chosen.verdicts)
    return again.to_the_end(over_onsets(with_sound_axes(chosen, again), again.setup.layout))


def _is_shown(of: list[Explanation], ranking: list[Explanation], before: frozenset[str | int]) -> bool:
    """Return whether some explanations are far likelier than all others, and were ``before`` or are so clearly now."""
    seen = all(_accused(each) <= before for each in of[:1])
    return log_odds(of, ranking) > (SURE if seen else CLEAR)


def _accused(explanation: Explanation) -> frozenset[str | int]:
    """Return the failed part of an explanation: the inertial sensors, satellites, further sensors, tags."""
    if explanation.suspect == SATELLITES:
        return frozenset(explanation.best.satellites)
    if explanation.suspect == FURTHER_SENSOR:
        return frozenset(explanation.best.kinds)
    groups = {"sensors": SENSORS, "installation": INSTALLATION}
    return frozenset(
        next(((name,) for name, of in groups.items() if explanation.suspect in of), (explanation.suspect,))
    )


def _is_excused(ranking: list[Explanation], past: FilterHistory, again: Hindsight) -> bool:
    """Return whether the best explanation is not credible.

    Rows that contradict each other do not mean a sensor fault, nor a fault of the range rates alone if the pseudoranges
    do so, too; nor do reflections mean that the inertial samples are noisy. Nor is a sensor at fault where few
    satellites explain nearly as much: a bias that is unknown explains much. Nor is what late tags have done to the
    filter a fault of anything else.
    """
    first = ranking[0]
    least = max(SURE, first.log_odds - _COARSE)
    few = any(each.suspect == SATELLITES and each.best.fits and each.log_odds > least for each in ranking)
    noise = first.suspect == NOISE or (again.stormy and first.suspect in (*SENSORS, *INSTALLATION))
    noise = noise or (again.noisy_ranges and first.suspect in (RATES, LATE_RATES))
    were_noisy = bool(again.before[0].state["noise_factor"][0, :CARRIER].max() > NOISY)
    noise = noise or (were_noisy and first.suspect == INERTIAL_NOISE)
    # early samples and late range rates look alike
    late = first.suspect not in (*INSTALLATION, LATE_RATES) and past.tags_were_off(_TAGS_LAST_NS)
    return noise or late or (few and first.suspect in SENSORS)


def shared(likely: list[Explanation]) -> Explanation | None:
    """Return the common part of explanations: the only one, or the satellites or axes that are in all of them.

    If noise of all inertial samples is the likeliest and the others are faults of inertial sensors, it is the noise.
    """
    if likely[0].suspect == INERTIAL_NOISE and all(each.suspect in SENSORS for each in likely):
        return likely[0]
    parts = {id(each): _parts(each.best) for each in likely}
    common = frozenset.intersection(*parts.values())
    return next((each for each in likely if common and parts[id(each)] == common), None)


def _with(chosen: Explanation, ranking: list[Explanation]) -> list[Explanation]:
    """Return the explanations that contain the chosen fault; noise explains what any inertial sensor does.

    A lever arm and inertial tags are one installation: at constant speed they look alike.
    """
    if chosen.suspect == INERTIAL_NOISE:
        return [each for each in ranking if each.suspect in SENSORS]
    if chosen.suspect in INSTALLATION:
        return [each for each in ranking if each.suspect in INSTALLATION]
    return [each for each in ranking if _parts(chosen.best) <= _parts(each.best)]


def _parts(verdict: Verdict) -> frozenset[tuple[str, int | str]]:
    parts = verdict.satellites or verdict.axes or verdict.kinds or (0,)
    name = "installation" if verdict.suspect in INSTALLATION else verdict.suspect
    return frozenset((name, part) for part in parts)
