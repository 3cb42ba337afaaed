"""The sentences of report.md: each function makes one of them, or "" or none where there is nothing to say."""

from collections.abc import Iterator, Mapping, Sequence

from experiments.analysis.findings import CONTROLLER
from experiments.analysis.metrics import BY_NAME, JUDGED, Metric
from experiments.analysis.sensitivity import swapped
from experiments.analysis.statistics import Result, finished_share, least_p_holm, people_of
from experiments.analysis.trials_table import COUNTED, Trials, is_coded
from experiments.numbers import fixed, in_words, percent, significant

DOES_NOT_COUNT = "aborted, stopped, redone, recovered, skipped or excluded"


def name_of(controller: int | str, names: Mapping[int, str]) -> str:
    """The name of a controller by its number; one that the protocol does not name keeps its number."""
    return names.get(int(controller), f"controller {controller}")


def signed(result: Result, scale: float, digits: int) -> str:
    """A number with its sign and, if it has one, its interval: "-1.20 (-2.00 to -0.40)"."""
    text = fixed(scale * (result.value or 0.0), digits, "+")
    if result.low is None or result.high is None:
        return text
    low, high = sorted((scale * result.low, scale * result.high))
    return f"{text} ({fixed(low, digits, '+')} to {fixed(high, digits, '+')})"


def p_value(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"= {p:.3f}"


# ----------------------------------------------------------------------------------------------------------- the trials


def about_trials(trials: Trials, names: Mapping[int, str], timeouts: bool) -> str:
    """How many people and trials there are, and which trials did not reach the end."""
    late = (trials["status"] == "timeout").sum()
    if not late and not _some_aborted(trials):
        return f"{_how_many(trials)}; all reached the end."
    counted = "count in" if timeouts else "are left out of"
    sentence = f"{_how_many(trials)}; {late} of them ran out of time and {counted} the statistics."
    return sentence if is_coded(trials) else f"{sentence} {_reached_the_end(trials, names)}"


def _some_aborted(trials: Trials) -> bool:
    return bool((trials["status"] == "aborted").any())


def _how_many(trials: Trials) -> str:
    people, counted = len(people_of(trials)), trials["status"].isin(COUNTED).sum()
    text = f"{people} participant{'s' if people != 1 else ''}, {counted} trials that count"
    others = len(trials) - counted
    return f"{text}, {others} that do not ({DOES_NOT_COUNT})" if others else text


def _reached_the_end(trials: Trials, names: Mapping[int, str]) -> str:
    shares = finished_share(trials)
    below = sorted((share, cell) for cell, share in shares.items() if share < 1.0)
    listed = ", ".join(f"{name_of(k, names)} on {device} {percent(share)}" for share, (device, k) in below)
    aborted = " (aborted: not)" if _some_aborted(trials) else ""
    others = "; all others 100 %" if len(below) < len(shares) else ""
    return f"Reached the end{aborted}: {listed}{others}."


# ---------------------------------------------------------------------------------------------------- what else to know


def sentences(
    results: Sequence[Result], names: Mapping[int, str] = CONTROLLER, own: Sequence[Metric] = ()
) -> list[str]:
    """Differences, trend, speed, reaction time and the order of controllers, each in a sentence or two."""
    written = [
        *_differences(results, own), *_trend(results, own), *_speed(results), *_equal_speed(results, names),
        *_reaction_times(results), *_orders(results, names),
    ]  # fmt: skip
    return written or ["There is nothing to compare."]


def _differences(results: Sequence[Result], own: Sequence[Metric]) -> Iterator[str]:
    for metric in (*JUDGED, *own):
        tests = [r for r in results if (r.measure, r.statistic) == (metric.name, "chi_square")]
        chances = {r.configuration: r.p for r in tests if r.p is not None}
        if chances:
            listed = ", ".join(f"{where} p {p_value(p)}" for where, p in chances.items())
            differs = "differs" if all(p < 0.05 for p in chances.values()) else "does not everywhere differ"
            yield f"{metric.title} {differs} between controllers (Friedman: {listed})."
    if few := next((r.missing for r in results if r.statistic == "chi_square" and r.missing), ""):
        yield f"Whether the controllers differ is not tested: {few}."


def _trend(results: Sequence[Result], own: Sequence[Metric]) -> Iterator[str]:
    found = {r.measure: r for r in results if r.test == "trend"}
    metrics = [metric for metric in (*JUDGED, BY_NAME["duration_s"], *own) if metric.name in found]
    if metrics:
        changed = "; ".join(f"{metric.short} {signed(found[metric.name], 1.0, 1)} %" for metric in metrics)
        few = next((r.missing for r in found.values() if r.missing), "")
        clear = [m.short for m in metrics if _is_clear(found[m.name])]
        trend = f"learning or fatigue in {in_words(clear)}" if clear else "no clear learning or fatigue"
        meaning = f"no trend can be told ({few})" if few else trend
        yield f"Over ten trials, in the same task, the median participant changed: {changed}; {meaning}."


def _is_clear(result: Result) -> bool:
    """Whether its interval leaves 0 out."""
    return result.low is not None and result.high is not None and not result.low <= 0.0 <= result.high


def _speed(results: Sequence[Result]) -> Iterator[str]:
    for r in results:
        if r.statistic == "m_per_doubling" and r.value is not None:
            yield f"Twice the speed, same person and task: path error {signed(r, 1e3, 2)} mm; {_effect_of_speed(r)}."


def _effect_of_speed(slope: Result) -> str:
    if slope.low is None or slope.high is None:
        return "too few people to judge"
    if slope.low <= 0.0 <= slope.high:
        return "no clear effect of speed"
    return "slow trials do look accurate" if slope.low > 0.0 else "fast trials are the more accurate ones"


def _equal_speed(results: Sequence[Result], names: Mapping[int, str]) -> Iterator[str]:
    errors: dict[str, dict[str, dict[str, float]]] = {}  # device -> statistic -> controller -> mm
    for r in results:
        if r.test == "speed" and r.configuration != "all" and r.value is not None:
            errors.setdefault(r.configuration, {}).setdefault(r.statistic, {})[r.first] = 1e3 * r.value
    for device, found in errors.items():
        measured, adjusted = found["mean_error"], found["error_at_common_speed"]
        listed = ", ".join(f"{name_of(k, names)} {measured[k]:.2f} and {adjusted[k]:.2f}" for k in measured)
        is_same = sorted(measured, key=measured.__getitem__) == sorted(adjusted, key=adjusted.__getitem__)
        order = "stays" if is_same else "changes"
        yield f"Path error as measured and at equal speed, {device} (mm): {listed}; the order {order}."


def _reaction_times(results: Sequence[Result]) -> Iterator[str]:
    without: dict[str, dict[str, float]] = {}  # device -> measure -> its change
    for r in results:
        if r.test == "reaction" and r.value is not None:
            without.setdefault(r.configuration, {})[r.measure] = r.value - 1.0
    for device, changed in without.items():
        share = -changed.pop("duration_s")
        listed = ", ".join(f"{BY_NAME[measure].short} {percent(by, sign='+')}" for measure, by in changed.items())
        yield (
            f"On {device} {percent(share)} of the movement pass before the tip has moved 1 mm (median "
            f"trial); every measure holds this reaction time. Without it: {listed}."
        )


def _orders(results: Sequence[Result], names: Mapping[int, str]) -> Iterator[str]:
    """The order of the controllers by a measure on a device, and what other definitions of the measure make of it."""
    orders = [r for r in results if r.test == "order"]
    for base in orders:
        if base.measure == base.second:
            here = [r for r in orders if (r.second, r.configuration) == (base.measure, base.configuration)]
            yield _order(base, here[1:], names)


def _order(base: Result, others: Sequence[Result], names: Mapping[int, str]) -> str:
    same: list[str] = []  # the definitions that give the same order
    swaps: dict[str, list[str]] = {}  # those that swap some controllers, by which
    for other in others:
        pairs = ", ".join(f"{name_of(a, names)} and {name_of(b, names)}" for a, b in swapped(base.first, other.first))
        (swaps.setdefault(pairs, []) if pairs else same).append(_measure(other.measure))
    order = " < ".join(name_of(controller, names) for controller in base.first.split(" < "))
    said = [f"Order of controllers by {_measure(base.measure)}, {base.configuration}, least first: {order}."]
    if same:
        said.append(f"The same by {'; '.join(same)}.")
    for pairs, measures in swaps.items():
        said.append(f"{pairs[:1].upper()}{pairs[1:]} change places by {'; '.join(measures)}.")
    return " ".join(said)


def _measure(definition: str) -> str:
    """A measure, or another definition of one ("dft_sum, Hann window"), in a sentence."""
    name, comma, how = definition.partition(", ")
    short = BY_NAME[name].short if name in BY_NAME else name.replace("dft_sum", "DFT of acceleration")
    return f"{short}{comma}{how}"


# -------------------------------------------------------------------------------------------------- how to read a table


def reading_contrasts(contrasts: Sequence[Result]) -> str:
    """The end of the sentence under the pairs of controllers."""
    if all(r.p_holm is None for r in contrasts):
        few = next((r.missing for r in contrasts if r.missing), "")
        return f"; neither interval nor p: {few}." if few else "."
    return " with the 95 % interval of Wilcoxon's test; p after Holm's correction for all pairs of the same rows."


def reading_against_none(changes: Sequence[Result], results: Sequence[Result]) -> str:
    """How to read the changes against no control; results: of all pairs."""
    interval = " with the 95 % interval of that test; *: p < 0.05 after Holm's correction for all pairs"
    if few := next((r.missing for r in changes if r.missing), ""):
        interval = f"; neither interval nor *: {few}"
    how = (
        "Change between the means of each participant's trials, as above, but its middle by Hodges and Lehmann, which "
        f"goes with Wilcoxon's test and takes no distribution{interval}."
    )
    return " ".join([how, *_out_of_reach(changes, results)])


def _out_of_reach(changes: Sequence[Result], results: Sequence[Result]) -> Iterator[str]:
    """Where too few people can get a star in the table, a sentence for each number of people and pairs."""
    devices: dict[str, list[str]] = {}
    judged = [metric.name for metric in JUDGED]
    for device, measure in dict.fromkeys((r.configuration, r.measure) for r in changes):
        pairs = [r for r in results if (r.configuration, r.measure) == (device, measure) and r.p_holm is not None]
        if measure in judged and pairs and least_p_holm(pairs) >= 0.05:
            devices.setdefault(_smallest_p(pairs), []).append(device)
    for why, where in devices.items():
        yield f"On {' and '.join(dict.fromkeys(where))} {why}."


def _smallest_p(pairs: Sequence[Result]) -> str:
    people = max(pair.people for pair in pairs)
    return (
        f"no *, however they differ: the smallest p of Wilcoxon's test with {people} participants is "
        f"{significant(2.0 * 0.5**people)}, after Holm's correction for {len(pairs)} pairs "
        f"{significant(least_p_holm(pairs), 2)}"
    )
