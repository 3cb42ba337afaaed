"""`phd bench`: speed against error of each integrator.

Every time is the processor's, of compiled loops alone, and the least of several repeats; the four closed-form
accelerations that a step cannot do without are timed between the repeats, so that the ratio of the two does not hang on
what else the machine does. Errors are against `event` at a tiny step, itself checked here against an independent
solution (`reference`).
"""

import math
import os
import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import NamedTuple

import msgspec
import numpy as np

from core import tick_log
from core.device import without_backlash
from core.mechanism import JOINTS
from core.simulator import stepped
from core.simulator.simulation import ROW_WIDTH, Grid, Schedule, Simulation, run_rows
from core.simulator.solver_numbers import DELTA_OMEGA
from experiments.benchmark.clock import clock
from experiments.benchmark.kernels import accelerations
from experiments.benchmark.mujoco import MujocoRun, mujoco_version
from experiments.benchmark.reference import reference_tips
from experiments.benchmark.scenes import COMPARE_S, START, STEPS_S, BenchScene, bench_devices, bench_scenes
from experiments.plan import make_plan
from experiments.progress import Progress, no_progress
from experiments.protocol import Protocol, load_protocol
from experiments.study.unrecorded import person_of, switched_on, trial_of
from experiments.trial.population import load_population
from experiments.trial.real_trial import load_kernels

#: s, step of the reference.
TINY_S = 1e-5
#: integrator and fidelity of each row. mr is run without backlash (its play adds events, not arithmetic).
RUNS = (("event", "ideal"), ("event", "mr"), ("stepping", "ideal"), ("karnopp", "ideal"))
#: Order is fitted over these steps, without errors below SMALLEST_M: they are rounding.
ORDER_STEPS_S, SMALLEST_M = (5e-3, 2e-3, 1e-3, 5e-4), 1e-12
AGAINST = "scipy DOP853 on Eq. (5), for mr with Eq. (1) as a differential equation"
DELTA_OMEGAS = (1e-1, 1e-2, 1e-3, 1e-4)  # rad/s, of Eq. (6)
REPEATS, QUICK_REPEATS, PEER_REPEATS, TICK_REPEATS = 15, 3, 3, 5


@dataclass(frozen=True)
class Peer:
    """A simulator of others on the same scenes, with ideal brakes."""

    name: str
    version: Callable[[], str | None]  # None: it is not installed
    run: type[MujocoRun]


PEERS = {"mujoco": Peer("MuJoCo", mujoco_version, MujocoRun)}


@dataclass(frozen=True)
class Row:
    """One integrator on one scene at one step."""

    integrator: str
    fidelity: str
    device: str
    scene: str
    step_s: float
    us_per_step: float
    wall_s_per_sim_s: float
    rms_error_m: float
    max_error_m: float
    creep_m_s: float | None = None  # S3 only
    four_accelerations_us: float | None = None  # None for peers, as those below
    energy_residual_J: float | None = None
    events: int | None = None
    fallbacks: int | None = None
    order: float | None = None  # None where fewer than two errors stand above rounding


def run_bench(quick: bool = False, progress: Progress = no_progress, longest_s: float = math.inf) -> dict:
    """Measure everything that `--json` prints. quick: fewer repeats, steps and devices; longest_s: of each scene."""
    devices = bench_devices()[1:] if quick else bench_devices()
    steps = (2e-3, 1e-3) if quick else STEPS_S
    repeats = QUICK_REPEATS if quick else REPEATS
    scenes = [scene.until(longest_s) for device in devices for scene in bench_scenes(device)]
    rows: list[Row] = []
    checks, band = [], []
    for n, scene in enumerate(scenes):
        progress(0.9 * n / len(scenes))
        tips = {fidelity: simulated(BenchRun(scene, "event", fidelity, TINY_S))[1] for fidelity in ("ideal", "mr")}
        checks += [check_reference(scene, fidelity, tips[fidelity]) for fidelity in tips]
        for integrator, fidelity in RUNS:
            group = [
                measure_ours(BenchRun(scene, integrator, fidelity, step), tips[fidelity], repeats) for step in steps
            ]
            rows += with_order(group)
        for integrator, other in PEERS.items():
            if other.version():
                rows += with_order([measure_peer(scene, integrator, step, tips["ideal"]) for step in steps])
        band += [karnopp_band(scene, delta, tips["ideal"]) for delta in DELTA_OMEGAS]
    progress(0.9)
    return {
        "machine": machine(),
        "rows": [asdict(row) for row in rows],
        "reference": {"step_s": TINY_S, "against": AGAINST, "checks": checks},
        "karnopp": band,
        "python": [python_steps(scene, repeats) for scene in scenes if scene.name == "S1"],
        "tick": tick_cost(quick),
    }


def machine() -> dict:
    """The machine and the versions that the times were measured with."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            names = [line.split(":", 1)[1].strip() for line in file if line.startswith("model name")]
    except OSError:
        names = []
    versions = {"python": platform.python_version(), "numpy": np.__version__}
    peers = {integrator: other.version() for integrator, other in PEERS.items()}
    return {"cpu": names[0] if names else platform.processor(), "cores": os.cpu_count(),
            "system": platform.platform(), **versions, **peers}  # fmt: skip


class BenchRun(NamedTuple):
    """A scene, and how it is simulated."""

    scene: BenchScene
    integrator: str
    fidelity: str
    step: float  # s

    @property
    def schedule(self) -> Schedule:
        """The commands to the brakes."""
        return Schedule(self.scene.times, self.scene.commands(self.fidelity))


def new_simulation(run: BenchRun, delta_omega: float = DELTA_OMEGA) -> Simulation:
    """The scene before its first step; delta_omega: the band of `karnopp`, rad/s."""
    device = without_backlash(run.scene.device)
    simulation = Simulation(device, START, (0.0, 0.0), run.fidelity, run.integrator, run.scene.hand())
    simulation.body["delta_omega"][0] = delta_omega
    return simulation


def simulated(run: BenchRun, delta_omega: float = DELTA_OMEGA) -> tuple[Simulation, np.ndarray]:
    """The simulation after the scene, and its tips (n, 2) at the times of comparison."""
    simulation, n = new_simulation(run, delta_omega), run.scene.comparisons
    rows = simulation.rows(n + 1, run.schedule, Grid(0, n, round(COMPARE_S / run.step), run.step))
    return simulation, rows[:, 1:3].copy()


def seconds(run: BenchRun, out: np.ndarray) -> float:
    """Time of one run of the whole scene inside the kernel (s)."""
    simulation, n = new_simulation(run), round(run.scene.duration_s / run.step)
    schedule = run.schedule
    start = clock()
    run_rows(simulation.model, simulation.data, schedule, Grid(0, 1, n, run.step), out)
    return clock() - start


def four_accelerations(simulation: Simulation) -> float:
    """Time of four closed-form accelerations (us)."""
    torque, tip, count = np.array([0.3, -0.3, 0.3, -0.3]), (0.05, 0.40, 0.1, -0.2), 2000
    start = clock()
    accelerations(simulation.mechanism, torque, tip, 4 * count)
    return (clock() - start) / count * 1e6


def measure_ours(run: BenchRun, tips: np.ndarray, repeats: int) -> Row:
    """Measure this simulator on a scene; tips: the reference's."""
    simulation, found = simulated(run)
    ledger, out = simulation.ledger(), np.zeros((2, ROW_WIDTH))
    seconds(run, out)
    four = least = math.inf
    for _ in range(repeats):
        four = min(four, four_accelerations(simulation))
        least = min(least, seconds(run, out))
    row = row_of(run, found, tips, least)
    return replace(row, four_accelerations_us=four, energy_residual_J=ledger.residual, events=ledger.events,
                   fallbacks=ledger.fallbacks)  # fmt: skip


def measure_peer(scene: BenchScene, integrator: str, step: float, tips: np.ndarray) -> Row:
    """Measure another simulator on a scene; tips: the reference's."""
    other = PEERS[integrator].run(scene, step)
    found, least = other.tips(), min(other.seconds() for _ in range(PEER_REPEATS))
    return row_of(BenchRun(scene, integrator, "ideal", step), found, tips, least)


def row_of(run: BenchRun, found: np.ndarray, tips: np.ndarray, least: float) -> Row:
    """A row for any simulator, from the tips (n, 2) that it found, the reference's tips (m), and its time (s)."""
    scene, integrator, fidelity, step = run
    return Row(
        integrator, fidelity, scene.device.name, scene.name, step, least / round(scene.duration_s / step) * 1e6,
        least / scene.duration_s, *errors(found, tips), creep(scene, found),
    )  # fmt: skip


def check_reference(scene: BenchScene, fidelity: str, tips: np.ndarray) -> dict:
    """The largest distance of the reference's tips (n, 2), m, from an independent solution, until a stop is touched."""
    apart = np.linalg.norm(tips - reference_tips(scene, fidelity), axis=1)
    apart = apart[np.isfinite(apart)]
    return {"device": scene.device.name, "scene": scene.name, "fidelity": fidelity,
            "compared_s": (len(apart) - 1) * COMPARE_S, "max_difference_m": float(apart.max())}  # fmt: skip


def errors(found: np.ndarray, tips: np.ndarray) -> tuple[float, float]:
    """RMS and largest distance (m) between tips (n, 2)."""
    apart = np.linalg.norm(found - tips, axis=1)
    return float(np.sqrt(np.mean(apart**2))), float(apart.max())


def creep(scene: BenchScene, found: np.ndarray) -> float | None:
    """Largest displacement over elapsed time (m/s) where all brakes are locked; None elsewhere."""
    if scene.name != "S3":
        return None
    elapsed = np.arange(1, len(found)) * COMPARE_S
    return float(np.max(np.linalg.norm(found[1:] - START, axis=1) / elapsed))


def with_order(group: list[Row]) -> list[Row]:
    """The rows with their common order: the least-squares slope of log RMS over log step."""
    clear = [row for row in group if row.step_s in ORDER_STEPS_S and row.rms_error_m >= SMALLEST_M]
    steps, errors = [math.log(row.step_s) for row in clear], [math.log(row.rms_error_m) for row in clear]
    order = float(np.polyfit(steps, errors, 1)[0]) if len(clear) >= 2 else None
    return [replace(row, order=order) for row in group]


def karnopp_band(scene: BenchScene, delta_omega: float, tips: np.ndarray) -> dict:
    """The effect of delta_omega, Eq. (6), at 1 ms: the error, and in S3 the creep after a throw at half the band."""
    rms = creeps = None
    run = BenchRun(scene, "karnopp", "ideal", 1e-3)
    if scene.name != "S3":
        rms, _ = errors(simulated(run, delta_omega)[1], tips)
    else:
        still = new_simulation(run, delta_omega)
        fastest = np.linalg.norm(still.body["g"][0, :4], axis=1).max()  # rad/s of a joint per m/s of the tip
        still.body["tip"][0, 2:] = 0.5 * delta_omega / fastest, 0.0
        rows = still.rows(2, run.schedule, Grid(0, 1, round(scene.duration_s / run.step), run.step))
        creeps = float(np.linalg.norm(rows[-1, 1:3] - START) / scene.duration_s)
    return {"delta_omega_rad_s": delta_omega, "device": scene.device.name, "scene": scene.name, "rms_error_m": rms,
            "creep_m_s": creeps}  # fmt: skip


# -------------------------------------------------------------------------------------- what is timed beside the scenes


def python_steps(scene: BenchScene, repeats: int) -> dict:
    """The time of one step of 1 ms from Python (us), `phd.Simulation` and its peers, each with a new force."""
    simulation, count = stepped.Simulation(scene.device, "ideal"), 1000
    torques = scene.torques[0][[JOINTS.index(joint) for joint in simulation.braked]].tolist()
    forces = [tuple(scene.force(k * 1e-3).tolist()) for k in range(count)]
    least = math.inf
    for _ in range(repeats):
        simulation.reset(START)
        start = clock()
        for force in forces:
            simulation.step(torques, force, 1e-3)
        least = min(least, clock() - start)
    found = {"device": scene.device.name, "event": least / count * 1e6}
    for name, other in PEERS.items():
        if other.version():
            run = other.run(scene, 1e-3)
            found[name] = min(run.python_seconds(count) for _ in range(repeats)) / count * 1e6
    return found


def tick_cost(quick: bool) -> dict:
    """One whole control tick (operator, decide, four MR brakes, step, log row), and the 180-trial study's simulation.

    A study of 3 operators x 2 devices x 2 segments x 5 controllers x 3 trials (quick: one operator, one block), ticks
    alone: what recording, measures and figures cost is not in it.
    """
    load_kernels()  # no clock runs while they are compiled
    protocol = load_protocol()
    if quick:
        protocol = msgspec.structs.replace(protocol, blocks=1)
    passes = [spent_on_ticks(protocol, 1 if quick else 3) for _ in range(QUICK_REPEATS if quick else TICK_REPEATS)]
    least = {device.name: min(spent[device.name] for spent in passes) for device in protocol.devices}
    seconds, ticks, trials = map(sum, zip(*least.values(), strict=True))
    return {
        "trials": trials,
        "ticks": ticks,
        "study_simulation_s": seconds,
        "us_per_tick": seconds / ticks * 1e6,
        "us_per_tick_by_device": {name: spent.s / spent.ticks * 1e6 for name, spent in least.items()},
    }


class Spent(NamedTuple):
    """The time of the ticks of a study with one device (s), how many ticks and how many trials they are."""

    s: float = 0.0
    ticks: int = 0
    trials: int = 0


def spent_on_ticks(protocol: Protocol, operators: int) -> dict[str, Spent]:
    """Simulate a study once: what its ticks take, by device."""
    rows = np.empty((8192, tick_log.WIDTH))
    spent = {device.name: Spent() for device in protocol.devices}
    for operator in range(1, operators + 1):
        person = person_of(load_population(), protocol.seed, operator)
        devices = {device.name: switched_on(device, protocol) for device in protocol.devices}
        for planned in make_plan(protocol, f"{operator:02d}", coded=False):
            preset = protocol.controllers[int(planned.controller)]
            trial = trial_of(protocol, person, operator, planned, devices[planned.configuration], preset)
            before = spent[planned.configuration]
            s, ticks = before.s, before.ticks
            while not trial.finished:
                start = clock()
                ticks += trial.run(rows)
                s += clock() - start
            spent[planned.configuration] = Spent(s, ticks, before.trials + 1)
    return spent
