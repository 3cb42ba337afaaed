"""`phd fit-operator`: the numbers of a person from recorded trials, with intervals, as a population file.

What is not seen in such recordings stays as in a named population, and is marked assumed. Of one person each number is
a value; of several, mean and sd of people.
"""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from scipy import stats

from core.files import InputError
from experiments.numbers import significant
from experiments.operator_fit.arm import ACROSS, fit_across, fit_along, fit_pace, half_width
from experiments.operator_fit.motions import LEAST_TRIALS, Motion, read_motions
from experiments.operator_fit.unrest import fit_unrest
from experiments.progress import Progress, no_progress
from experiments.recording.atomic_files import refuse_existing_files, write_new_files
from experiments.trial.operator import Person
from experiments.trial.population import ASSUMED, LIMITS, Population, Spread, load_population

GROUPS = 20  # of trials, each left out once
#: Our choice: errors of the reactions of simulated people had twice the standard deviation that their courses show.
COURSE_ERROR = 4.0
_ARM = "force against displacement, velocity and acceleration while the brakes move the handle"
_SHAKEN = "as their own tremor and noise move the handle"
_ANSWER = "late answer of the force to the distance from the path, of the assumed form"
_COURSE = "a minimum-jerk course through the virtual hand that force and stiffness show"
_REST = "force of the hand at rest, by likelihood"

#: What each number rests on; and how much its interval is widened, share of it and flat. Our choice, from the errors of
#: simulated people whose numbers were known: what the hand's own noise does to the handle and so to the fit.
RESTS_ON: dict[str, tuple[str, float, float]] = {
    "stiffness_along_N_m": (f"{_ARM}, along the path and after its end", 0.08, 0.0),
    "stiffness_across_N_m": (f"{_ARM}, across the path", 0.06, 0.0),
    "damping_N_s_m": (f"{_ARM}, across the path; of simulated people some 7 % too low, {_SHAKEN}", 0.08, 0.0),
    "mass_kg": (f"{_ARM}, across the path; of simulated people some 2 % too low, {_SHAKEN}", 0.04, 0.0),
    "felt_gain": (f"{_ANSWER}; of simulated people some 13 % too low, {_SHAKEN}", 0.0, 0.08),
    "seen_gain_per_s": (_ANSWER, 0.2, 0.0),
    "felt_delay_s": (_ANSWER, 0.0, 0.005),
    "seen_delay_s": (_ANSWER, 0.0, 0.01),
    "reaction_s": (_COURSE, 0.0, 0.025),
    "reaction_spread_s": (f"{_COURSE}; variance from trial to trial, less that of the fit", 0.0, 0.0),
    "movement_s": (_COURSE, 0.02, 0.0),
    "noise_share": (_REST, 0.06, 0.0),
    "tremor_N": (_REST, 0.04, 0.0),
    "tremor_Hz": (_REST, 0.01, 0.0),
    "tremor_band_Hz": (_REST, 0.1, 0.0),
}


class Estimate(NamedTuple):
    """One number of a person with its 95 % interval."""

    name: str
    value: float
    low: float
    high: float
    rests_on: str


class Fitted(NamedTuple):
    """A person as the recorded trials show it."""

    participant: str
    trials: int
    numbers: list[Estimate]  # in the order of `RESTS_ON`

    @property
    def unseen(self) -> list[str]:
        """The numbers that these recordings do not show."""
        seen = {n.name for n in self.numbers}
        return [key for key in Person._fields if key not in seen]


def fit_operator(
    folder: Path, participant: str | None, out: Path | None, like: Population, progress: Progress = no_progress
) -> list[Fitted]:  # fmt: skip
    """Fit every person of a session or study folder, or one; write the population file where `out` is given.

    InputError as `read_motions`, or where the trials do not determine an arm.
    """
    if out is not None:
        refuse_existing_files([out])
    found = []
    people = read_motions(folder, participant)
    for number, (label, trials) in enumerate(people.items(), start=1):
        try:
            found.append(fit_person(label, trials, like))
        except InputError as error:
            raise InputError(f"{folder}: participant {label}: {error}") from None
        progress(number / len(people))
    if out is not None:
        text = population_text(out.stem, found, like)
        write_new_files({out: text.encode()})
        load_population(out)
    return found


def fit_person(label: str, trials: list[Motion], like: Population) -> Fitted:
    """Fit one person. like: the population whose medians stand for what the fit takes for granted."""
    base = {key: spread.quantile(0.5, LIMITS[key]) for key, spread in like.spreads.items()}
    groups = [np.arange(len(trials)) % GROUPS != g for g in range(min(GROUPS, len(trials)))]
    across = dict(zip(ACROSS, fit_across(trials, base, groups).T, strict=True))
    damping, mass = across["damping_N_s_m"][0], across["mass_kg"][0]
    along = fit_along(trials, damping, mass, groups)
    samples = across | {"stiffness_along_N_m": along}
    arm = {key: float(own[0]) for key, own in samples.items()}
    if not min(arm["stiffness_along_N_m"], arm["stiffness_across_N_m"], damping, mass) > 0.0:
        raise InputError("force and motion are not those of an arm: its stiffness, damping or mass would be negative")
    found = {key: with_interval(own[0], half_width(own[1:])) for key, own in samples.items() if not np.isnan(own).any()}
    pace = fit_pace(trials, along[0], damping, mass)
    if len(pace) >= LEAST_TRIALS:
        half = stats.t.ppf(0.975, len(pace) - 1) * stats.sem(pace)
        found["reaction_s"], found["movement_s"] = (with_interval(pace[:, i].mean(), half[i]) for i in (0, 1))
        found["reaction_spread_s"] = spread_of(pace[:, 0], COURSE_ERROR * float(pace[:, 2].mean()))
    for key, (value, log_error) in fit_unrest(trials, arm, base["noise_corner_Hz"]).items():
        found[key] = with_interval(value, value * (np.exp(1.96 * log_error) - 1.0))
    numbers = []
    for key, (rests_on, share, flat) in RESTS_ON.items():
        if key in found:
            value, low, high = map(float, found[key])
            more = share * abs(value) + flat
            numbers.append(Estimate(key, value, low - more, high + more, rests_on))
    return Fitted(label, len(trials), numbers)


def with_interval(value: float, half: float) -> tuple[float, float, float]:
    """A number with its interval, from the half-width."""
    return value, value - half, value + half


def spread_of(values: np.ndarray, error: float) -> tuple[float, float, float]:
    """Standard deviation of normal numbers with its 95 % interval; error: the variance that each value (n,) adds.

    The variance of the values is a multiple of chi-squared; the error's is taken off.
    """
    freedom = len(values) - 1
    square = np.var(values, ddof=1)
    bounds = (square * freedom / stats.chi2.ppf(share, freedom) for share in (0.975, 0.025))
    value, low, high = (float(np.sqrt(max(part - error, 0.0))) for part in (square, *bounds))
    return value, low, high


def population_text(name: str, found: list[Fitted], like: Population) -> str:
    """The population file. A number that is not seen of every person stays as in `like`."""
    seen = {key: [n for fitted in found for n in fitted.numbers if n.name == key] for key in RESTS_ON}
    people = ", ".join(fitted.participant for fitted in found)
    lines = [
        f"# Fitted by phd fit-operator to {sum(fitted.trials for fitted in found)} trials of participants {people};",
        f"# what they do not show is as in the population {like.name}, and assumed.",
        f"name = {json.dumps(name, ensure_ascii=False)}",
        "changed_after_findings = []   # a sentence for each number that was set after findings had been looked at",
        "",
    ]
    for key in Person._fields:
        every = seen.get(key, [])
        if len(every) == len(found):
            each = "; ".join(
                f"{significant(n.value, 4)} ({significant(n.low)} to {significant(n.high)})" for n in every
            )
            source = f"fitted to participant {people}: {each}; {every[0].rests_on}"
            values = [min(max(n.value, LIMITS[key][0]), LIMITS[key][1]) for n in every]
            spread = Spread(source, value=float(f"{values[0]:.6g}"))
            if len(values) > 1:
                mean, sd = float(f"{np.mean(values):.6g}"), float(f"{np.std(values, ddof=1):.6g}")
                spread = Spread(source, mean=mean, sd=sd)
        else:
            source = like.spreads[key].source.removeprefix(f"{ASSUMED}: ")
            spread = replace(like.spreads[key], source=f"{ASSUMED}, as in {like.name}: {source}")
        given = ((kind, getattr(spread, kind)) for kind in ("value", "low", "high", "mean", "sd"))
        forms = ", ".join(f"{kind} = {float(number)!r}" for kind, number in given if number is not None)
        lines.append(f"{key} = {{{forms}, source = {json.dumps(spread.source, ensure_ascii=False)}}}")
    return "\n".join(lines) + "\n"
