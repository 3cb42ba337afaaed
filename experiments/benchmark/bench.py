"""`phd bench`: speed against error of each integrator (DESIGN section 6).

Every time is the least of several repeats inside compiled loops over whole scenes; the four closed-form accelerations
that a step cannot do without are timed between the repeats, so that the ratio of the two does not hang on what else
the machine does. Errors are against `event` at a tiny step, itself checked here against an independent solution
(`reference`).
"""

import math
import os
import platform
import time
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from core.simulator.simulation import Simulation, run_rows
from experiments.benchmark.costs import fallback_costs, study_errors, tick_cost
from experiments.benchmark.kernels import accelerations
from experiments.benchmark.mujoco import MujocoRun, mujoco_version
from experiments.benchmark.reference import reference_tips
from experiments.benchmark.scenes import COMPARE_S, START, STEPS_S, BenchScene, bench_devices, bench_scenes
from experiments.progress import Progress, unseen

#: s, step of the reference.
TINY_S = 1e-5
#: integrator and fidelity of each row. mr is run without backlash (its play adds events, not arithmetic).
RUNS = (("event", "ideal"), ("event", "mr"), ("stepping", "ideal"), ("karnopp", "ideal"))
#: Order is fitted over these steps, without errors below SMALLEST_M: they are rounding.
ORDER_STEPS_S, SMALLEST_M = (5e-3, 2e-3, 1e-3, 5e-4), 1e-12
AGAINST = "scipy DOP853 on Eq. (5), for mr with Eq. (1) as a differential equation"
DELTA_OMEGAS = (1e-1, 1e-2, 1e-3, 1e-4)  # rad/s, of Eq. (6)
REPEATS, QUICK_REPEATS = 15, 3


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


def run_bench(quick: bool = False, progress: Progress = unseen) -> dict:
    """All of it; the JSON of DESIGN section 6 with more beside the rows. quick: fewer repeats, steps and devices."""
    devices = bench_devices()[1:] if quick else bench_devices()
    steps = (2e-3, 1e-3) if quick else STEPS_S
    repeats = QUICK_REPEATS if quick else REPEATS
    scenes = [scene for device in devices for scene in bench_scenes(device)]
    rows: list[Row] = []
    checks, band = [], []
    for n, scene in enumerate(scenes):
        progress(0.9 * n / len(scenes))
        tips = {fidelity: simulated(scene, "event", fidelity, TINY_S)[1] for fidelity in ("ideal", "mr")}
        checks += [check(scene, fidelity, tips[fidelity]) for fidelity in tips]
        for integrator, fidelity in RUNS:
            group = [ours(scene, integrator, fidelity, step, tips[fidelity], repeats) for step in steps]
            rows += with_order(group)
        if mujoco_version():
            rows += with_order([peer(scene, step, tips["ideal"], repeats) for step in steps])
        band += [band_row(scene, delta, tips["ideal"]) for delta in DELTA_OMEGAS]
    progress(0.9)
    return {
        "machine": machine(),
        "rows": [asdict(row) for row in rows],
        "reference": {"step_s": TINY_S, "against": AGAINST, "checks": checks},
        "karnopp": band,
        "fallback": fallback_costs(repeats),
        "tick": tick_cost(quick),
        "study_errors": [one._asdict() for one in study_errors()],
    }


def machine() -> dict:
    """What the times were measured on."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            names = [line.split(":", 1)[1].strip() for line in file if line.startswith("model name")]
    except OSError:
        names = []
    versions = {"python": platform.python_version(), "numpy": np.__version__, "mujoco": mujoco_version()}
    return {"cpu": names[0] if names else platform.processor(), "cores": os.cpu_count(),
            "system": platform.platform(), **versions}  # fmt: skip


def new_simulation(scene: BenchScene, integrator: str, fidelity: str, **options: Any) -> Simulation:
    """The scene before its first step."""
    return Simulation(scene.device, START, (0.0, 0.0), fidelity, integrator, scene.hand(), False, **options)


def simulated(
    scene: BenchScene, integrator: str, fidelity: str, step: float, **options: Any
) -> tuple[Simulation, np.ndarray]:
    """The simulation after the scene, and its tips (n, 2) at the times of comparison."""
    simulation = new_simulation(scene, integrator, fidelity, **options)
    n = scene.comparisons
    per_row = round(COMPARE_S / step)
    rows = simulation.rows(n + 1, step, per_row, scene.times, scene.commands(fidelity), 0, n)
    return simulation, rows[:, 1:3].copy()


def seconds(scene: BenchScene, integrator: str, fidelity: str, step: float, out: np.ndarray) -> float:
    """Wall time of one run of the whole scene inside the kernel (s)."""
    s, n = new_simulation(scene, integrator, fidelity), round(scene.duration_s / step)
    commands = scene.commands(fidelity)
    start = time.perf_counter()
    run_rows(s.mechanism, s.brakes, s.hand, s.state, s.step_scratch, scene.times, commands,
             0, 1, n, step, s.fidelity, s.integrator, out)  # fmt: skip
    return time.perf_counter() - start


def four_accelerations(simulation: Simulation) -> float:
    """Wall time of four closed-form accelerations (us)."""
    torque, count = np.array([0.3, -0.3, 0.3, -0.3]), 2000
    start = time.perf_counter()
    accelerations(simulation.mechanism, torque, 0.05, 0.40, 0.1, -0.2, 4 * count)
    return (time.perf_counter() - start) / count * 1e6


def ours(scene: BenchScene, integrator: str, fidelity: str, step: float, tips: np.ndarray, repeats: int) -> Row:
    """One row of this simulator."""
    simulation, found = simulated(scene, integrator, fidelity, step)
    ledger, out = simulation.ledger(), np.zeros((2, 10))
    seconds(scene, integrator, fidelity, step, out)
    four = wall = math.inf
    for _ in range(repeats):
        four = min(four, four_accelerations(simulation))
        wall = min(wall, seconds(scene, integrator, fidelity, step, out))
    row = row_of(scene, integrator, fidelity, step, found, tips, wall)
    return replace(row, four_accelerations_us=four, energy_residual_J=ledger.residual, events=ledger.events,
                   fallbacks=ledger.fallbacks)  # fmt: skip


def peer(scene: BenchScene, step: float, tips: np.ndarray, repeats: int) -> Row:
    """One row of MuJoCo."""
    run = MujocoRun(scene, step)
    found = run.tips()
    return row_of(scene, "mujoco", "ideal", step, found, tips, min(run.seconds() for _ in range(min(repeats, 5))))


def row_of(
    scene: BenchScene, integrator: str, fidelity: str, step: float, found: np.ndarray, tips: np.ndarray, wall: float
) -> Row:
    """What is known of any simulator: the tips (n, 2) that it found beside the right ones, m, and its wall time (s)."""
    return Row(
        integrator, fidelity, scene.device.name, scene.name, step, wall / round(scene.duration_s / step) * 1e6,
        wall / scene.duration_s, *errors(found, tips), creep(scene, found),
    )  # fmt: skip


def check(scene: BenchScene, fidelity: str, tips: np.ndarray) -> dict:
    """How far the reference's tips (n, 2), m, are from an independent solution, as far as that goes."""
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


def band_row(scene: BenchScene, delta_omega: float, tips: np.ndarray) -> dict:
    """What delta_omega of Eq. (6) does at 1 ms: the error, and in S3 the creep after a throw at half the band."""
    rms = creeps = None
    if scene.name != "S3":
        rms, _ = errors(simulated(scene, "karnopp", "ideal", 1e-3, delta_omega=delta_omega)[1], tips)
    else:
        still = new_simulation(scene, "karnopp", "ideal", delta_omega=delta_omega)
        fastest = np.linalg.norm(still.state["g"][0, :4], axis=1).max()  # rad/s of a joint per m/s of the tip
        still.state["tip"][0, 2:] = 0.5 * delta_omega / fastest, 0.0
        rows = still.rows(2, 1e-3, round(scene.duration_s / 1e-3), scene.times, scene.commands("ideal"), 0, 1)
        creeps = float(np.linalg.norm(rows[-1, 1:3] - START) / scene.duration_s)
    return {"delta_omega_rad_s": delta_omega, "device": scene.device.name, "scene": scene.name, "rms_error_m": rms,
            "creep_m_s": creeps}  # fmt: skip
