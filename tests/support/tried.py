"""What the session server may say of Try: a running pass, and passes that have ended."""

from fake_client import GREEN, PRACTICE

from app.ipc import messages as m
from experiments.assumptions import IDEAL

INITIAL = m.SandboxSettings(
    "three-brake", 1, 2, {"gap_m": 0.0, "gain_N_s_m": 10_000.0}, "settled", 0.05, 2000.0, 1.0, 0.75, IDEAL
)  # fmt: skip
GAINS_FELT = 11.5  # N s/m and more


def tried(settings: m.SandboxSettings = INITIAL, *passes: m.Pass, **changes) -> m.Snapshot:
    """A pass is running with these settings."""
    state = m.SandboxState(settings, INITIAL, (), False, GAINS_FELT, passes)._replace(**changes)
    planned = PRACTICE._replace(path=settings.path, controller=settings.controller, repetition=len(passes) + 1)
    return m.Snapshot(m.RUNNING, checks=GREEN, running=planned, practice=True, tip=(0.1, 0.4), sandbox=state)


def ended(number: int, controller: int = 2, error: float | None = 0.002, changed: bool = False, **what) -> m.Pass:
    status = what.pop("status", "done")
    settings = INITIAL._replace(controller=controller, **what)
    measures = {"path_error_m": error, "mean_tip_force_N": 3.0, "acceleration_dft_sum": 40.0}
    initial = INITIAL._replace(device=settings.device, path=settings.path)
    return m.Pass(number, settings, initial, changed, status, measures | {"duration_s": 2.5})
