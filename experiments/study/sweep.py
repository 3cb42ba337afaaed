"""`phd study --sweep`: many studies at once, without recordings, on all cores or a cluster, into one tidy table.

How its folder is filled, resumed and spread over workers: `jobs`.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import msgspec
from msgspec.structs import replace

from core.control.controllers import ALGORITHMS, PARAMETERS, Preset, make_preset
from core.control.own_file import read_own
from core.device import Device, inline_devices
from core.files import InputError, NotNegative, Table, choice, parse_toml, read_text, shipped_or_file
from core.tick_log import TICK_S
from experiments.analysis.metrics import BY_NAME, FIGURES, METRICS, Metric
from experiments.analysis.own_measures import own_metrics
from experiments.analysis.trials_table import TrialRow, frame_bytes
from experiments.assumptions import ENCODERS, Assumptions, encoder_counts
from experiments.atomic_files import write_new_files
from experiments.numbers import in_words
from experiments.plan import PlannedTrial
from experiments.progress import Progress, no_progress
from experiments.protocol import Protocol, load_protocol, presets_of, read_code
from experiments.protocol_file import PARAMETER_TYPES, Count, Rules, Text, plain_text
from experiments.study.jobs import Done, Work, device_texts, local_or_shipped, run_work, table_lines
from experiments.study.sweep_results import (
    SEED,
    draw_effects,
    effects,
    medians,
    moves_most,
    rank_sentences,
    ranks,
    read_sweep,
)
from experiments.study.unrecorded import after_the_last_path, person_of, run_measured, trial_of
from experiments.trial.population import USUAL, Population, load_population

Names = Annotated[tuple[Text, ...], msgspec.Meta(min_length=1)]
Seed = Annotated[int, msgspec.Meta(ge=0)]
SHIPPED_FOLDER = Path(__file__).resolve().parents[1] / "sweeps"
MOST_JOBS = 1_000_000
#: Of the table; the seed and assumptions, where they vary, stand behind the rules, the parameters and measures of one's
#: own files behind the shipped ones.
FACTORS = "population", "configuration", "rules"
MEASURED = "participant", "path", "repetition", "status", *BY_NAME, "energy_residual_J", "energy_added_max_J"


def _swept(key: str, kind: Any) -> tuple[str, Any, None]:
    """A field for every value that `key` is to have."""
    return key, Annotated[tuple[(kind, ...)], msgspec.Meta(min_length=1)] | None, None


_Swept: Any = msgspec.defstruct(
    "_Swept", [_swept(name, kind) for name, kind in PARAMETER_TYPES.items()], bases=(Table,), frozen=True, kw_only=True
)


class SweptController(_Swept, Table, frozen=True, kw_only=True):
    """One algorithm, shipped or in a file of its own, each parameter with every value that it is to have."""

    kind: Annotated[str, choice(*ALGORITHMS)] | None = None
    algorithm: Text | None = None  # in place of `kind`: a Python file beside this one, or a shipped one
    parameters: dict[str, Annotated[tuple[NotNegative, ...], msgspec.Meta(min_length=1)]] = {}  # of that file

    def __post_init__(self) -> None:
        if (self.kind is None) == (self.algorithm is None):
            raise ValueError("needs either kind or algorithm")
        if self.kind is not None and self.parameters:
            raise ValueError("parameters are for an algorithm in a file of its own")
        if math.prod(map(len, self._values().values())) > MOST_JOBS:
            raise ValueError(f"its values have more than the {MOST_JOBS} combinations that one sweep may have")
        if self.kind is not None:
            self.presets(Path())

    def _values(self) -> dict[str, tuple]:
        given = {name: getattr(self, name) for name in PARAMETERS}
        return {name: values for name, values in (given | self.parameters).items() if values is not None}

    def presets(self, folder: Path) -> list[Preset]:
        """Every combination of its values; folder: of its file. ValueError if its parameters are not its algorithm's.

        InputError if its file cannot be run.
        """
        values, own = self._values(), None
        if self.algorithm is not None:
            own = read_own(self.algorithm.removesuffix(".py"), read_code(folder, self.algorithm))
        kind = str(self.algorithm or self.kind)
        combinations = [dict(zip(values, numbers, strict=True)) for numbers in itertools.product(*values.values())]
        return [make_preset(kind, kind, numbers, own) for numbers in combinations]


_ASSUMED = get_type_hints(Assumptions, include_extras=True)
_Assumed: Any = msgspec.defstruct(
    "_Assumed", [_swept(key, _ASSUMED[key]) for key in Assumptions.__struct_fields__ if key != "low_gain"],
    bases=(Table,), frozen=True, kw_only=True,
)  # fmt: skip


class SweptAssumptions(_Assumed, Table, frozen=True, kw_only=True):
    """Assumptions, each with every value that it is to have. Gains stand with the controllers."""


class SweepFile(Table, frozen=True):
    """One sweep as it stands in its file."""

    name: Text  # in tables and figures
    #: each with `kind` or `algorithm`, and lists of values of its parameters; without any: the protocol's
    controller: tuple[SweptController, ...] = ()
    protocol: Text = "paper"  # a shipped one, or a path from this file's folder
    operators: Count = 3  # of each population
    repetitions: Count = 3
    #: a number or a list; each draws other operators and other noise
    seed: Seed | Annotated[tuple[Seed, ...], msgspec.Meta(min_length=1)] = 1
    populations: Names = (USUAL,)  # list of values
    devices: Names | None = None  # lists of values; none: the protocol's
    rules: Annotated[tuple[Rules, ...], msgspec.Meta(min_length=1)] | None = None
    #: lists of values of the keys of a protocol's `[assumptions]`, without `low_gain`
    assumptions: SweptAssumptions = SweptAssumptions()
    device: tuple[dict[str, Any], ...] = ()  # files inside this one, as in a protocol
    brake: tuple[dict[str, Any], ...] = ()

    @property
    def varied(self) -> dict[str, tuple]:
        """The assumptions that it names, with their values."""
        given = msgspec.structs.asdict(self.assumptions)
        return {key: values for key, values in given.items() if values is not None}

    @property
    def seeds(self) -> tuple[int, ...]:
        return self.seed if isinstance(self.seed, tuple) else (self.seed,)

    def __post_init__(self) -> None:
        plain_text(self.name, "name")
        named = {key: getattr(self, key) or () for key in ("populations", "devices", "rules")} | {"seed": self.seeds}
        for key, values in (named | {f"assumptions.{key}": values for key, values in self.varied.items()}).items():
            if len(set(values)) < len(values):
                raise ValueError(f"{key}: the same value is given twice")


@dataclass(frozen=True)
class SweepCell:
    """The trials of one person in one cell of the sweep: every path and repetition."""

    number: int  # in the order of the table
    population: Population
    device: Device
    protocol: Protocol  # with the seed, the rules and the assumptions of the cell
    preset: Preset
    operator: int
    repetitions: int
    varied: tuple[str, ...]  # the seed and assumptions, where they are not the same in all jobs
    parameters: tuple[str, ...]  # of any controller of the sweep
    own: tuple[Metric, ...]  # measures of the protocol's own file
    controller_name: str  # as the protocol has it, else its algorithm and parameters as the sweep has them

    def run(self) -> Done:
        """Run the trials; their rows, in the order of the table's columns."""
        person = person_of(self.population, self.protocol.seed, self.operator)
        device = after_the_last_path(self.device, self.protocol)
        lines, ticks = [], 0
        for repetition in range(1, self.repetitions + 1):
            for path in self.protocol.paths:
                planned = PlannedTrial(1, 1, self.device.name, 1, path, repetition)
                trial = trial_of(self.protocol, person, self.operator, planned, device, self.preset)
                row, more = run_measured(trial, f"{self.operator:02d}", (*METRICS, *self.own))
                lines.append(self._cells(row))
                ticks += more
        return Done(table_lines(lines), ticks)

    def _cells(self, row: TrialRow) -> list[object]:
        return [
            self.population.name, self.device.name, self.protocol.rules,
            *(self.protocol.seed if name == SEED else getattr(self.protocol.assumptions, name) for name in self.varied),
            self.preset.kind, *map(self.preset.value, self.parameters),
            *map(row.value, MEASURED), self.controller_name, *(row.value(metric.name) for metric in self.own),
        ]  # fmt: skip


def load_sweep(name_or_path: str | Path) -> Work[SweepCell]:
    """A shipped sweep by its name, or that of a file. InputError, one sentence with file and key, for anything that
    cannot be run.
    """
    path = shipped_or_file(name_or_path, SHIPPED_FOLDER, Path(), "unknown sweep")
    text = read_text(path)
    file = parse_toml(text, SweepFile, str(path))
    protocol = _protocol_of(file, path)
    populations = _populations_of(file, path)
    presets = _presets_of(file, path, protocol)
    rules = file.rules or (protocol.rules,)
    factors = populations, protocol.devices, file.seeds, rules, presets, *file.varied.values()
    count = file.operators * math.prod(map(len, factors))
    if count > MOST_JOBS:  # before they are spread out
        raise InputError(f"{path}: {count} people in cells are more than the {MOST_JOBS} that one sweep may have")
    protocols = _protocols_of(file, protocol, rules)
    varied = tuple(key for key, values in {SEED: file.seeds, **file.varied}.items() if len(values) > 1)
    parameters = tuple(dict.fromkeys([*PARAMETERS, *(name for preset in presets for name in preset.named)]))
    own, names = own_metrics(protocol), _names_of(presets, presets_of(protocol))
    columns = (*FACTORS, *varied, "kind", *parameters, *MEASURED, "controller_name", *(metric.name for metric in own))
    if len(set(columns)) < len(columns):
        twice = next(name for name in columns if columns.count(name) > 1)
        raise InputError(f"{path}: {twice} is a parameter of an own controller, and another column of the table")
    cells = itertools.product(populations, protocol.devices, protocols, presets, range(1, file.operators + 1))
    jobs = tuple(
        SweepCell(
            number, population, device, cell_protocol, cell_protocol.assumptions.controller(preset), operator,
            file.repetitions, varied, parameters, own, names[preset],
        )
        for number, (population, device, cell_protocol, preset, operator) in enumerate(cells, start=1)
    )  # fmt: skip
    texts = {"sweep": text, f"protocol {protocol.name}": protocol.text, **device_texts(protocol.devices)}
    texts |= {f"population {population.name}": population.text for population in populations}
    texts |= {f"file {preset.kind}": preset.own.text for preset in presets if preset.own}
    texts |= {f"file {name}": own.text for name, own in protocol.code.items()}
    return Work("sweep", file.name, texts, columns, jobs)


def _protocol_of(file: SweepFile, path: Path) -> Protocol:
    """The protocol of a sweep, with the sweep's devices."""
    inline = inline_devices(file.device, file.brake, path.parent, str(path))
    devices = None
    if file.devices is not None:
        devices = [inline.get(name) or local_or_shipped(path, name) for name in file.devices]
    return load_protocol(local_or_shipped(path, file.protocol), devices=devices)


def _populations_of(file: SweepFile, path: Path) -> list[Population]:
    populations = [load_population(local_or_shipped(path, name)) for name in file.populations]
    names = [population.name for population in populations]
    if len(set(names)) < len(names):
        raise InputError(f"{path}: populations: two have the same name ({', '.join(names)})")
    return populations


def _presets_of(file: SweepFile, path: Path, protocol: Protocol) -> list[Preset]:
    """The controllers of a sweep; those of the protocol where it names none."""
    try:
        given = [preset for controller in file.controller for preset in controller.presets(path.parent)]
    except ValueError as error:  # of an own controller: the others were checked with the file
        raise InputError(f"{path}: controller: {error}") from None
    presets = given or presets_of(protocol)
    if len(set(presets)) < len(presets):
        raise InputError(f"{path}: controller: the same controller is given twice")
    return presets


def _protocols_of(file: SweepFile, protocol: Protocol, all_rules: Sequence[str]) -> list[Protocol]:
    """The protocol under each seed, each rule set and each combination of assumptions."""
    chosen = [dict(zip(file.varied, values, strict=True)) for values in itertools.product(*file.varied.values())]
    assumed = [replace(protocol.assumptions, **changes) for changes in chosen]
    if any(assumptions.sensing == ENCODERS for assumptions in assumed):
        for device in protocol.devices:
            encoder_counts(device)
    return [
        replace(
            protocol, seed=seed, rules=rules, assumptions=assumptions,
            trial=replace(protocol.trial, assumptions=assumptions),
        )
        for seed in file.seeds for rules in all_rules for assumptions in assumed
    ]  # fmt: skip


def _names_of(presets: Sequence[Preset], in_protocol: Sequence[Preset]) -> dict[Preset, str]:
    """What each controller is called: as the protocol calls it, else its algorithm and parameters in words."""
    names = {(preset.kind, preset.values, preset.own): preset.name for preset in in_protocol}
    return {
        preset: preset.name if preset in in_protocol
        else names.get((preset.kind, preset.values, preset.own), preset.words)
        for preset in presets
    }  # fmt: skip


def run_sweep(
    sweep: Work[SweepCell],
    out: Path,
    resume: bool = False,
    cluster: str | None = None,
    progress: Progress = no_progress,
) -> dict:
    """Run every job that is not done yet, then write the table and, in out/figures, what it says; the summary.

    As `run_work`. Figures that are there are left as they are.
    """
    finished = run_work(sweep, Path(out), resume, cluster, progress)
    assumed = dict.fromkeys(
        part for job in sweep.jobs for part in (*job.protocol.assumed_of, *job.population.assumed_of)
    )
    first = sweep.jobs[0]
    measures = (*FIGURES, *first.own)
    trials = read_sweep(finished.table, [*MEASURED[MEASURED.index("status") + 1 :], *(own.name for own in first.own)])
    found = effects(trials, first.varied, first.parameters, measures)
    ranked = ranks(trials, first.varied)
    figures = Path(out) / "figures"
    if not figures.exists():
        files = {"medians.csv": medians(trials, first.varied, measures), "effects.csv": found, "ranks.csv": ranked}
        results = {figures / name: frame_bytes(frame) for name, frame in files.items() if len(frame)}
        if len(found):
            results[figures / "effects.png"] = draw_effects(found, measures, sweep.name)
        write_new_files(results)
    return {
        "out": str(finished.table),
        "name": sweep.name,
        "jobs": len(sweep.jobs),
        "already_done": finished.already_done,
        "trials": len(trials),
        "share_done": float((trials["status"] == "done").mean()),
        "assumed": in_words(assumed) or "nothing",
        "simulated_s": finished.ticks * TICK_S,
        "wall_s": finished.wall_s,
        "moves_most": moves_most(found, measures),
        "ranks": rank_sentences(ranked),
    }
