"""An adversary of the guard of obstacles: hands that keep to its push, drawn at random or bred from the nearest so far.

    python -m tests.benchmarks.guard_reaches [HANDS] [SEED] [DEVICE ...]

Per device: how many hands got in, of those that began where the guard is sure; the same without the guard, and by
encoders. A hand pushes with exactly the largest push (`PUSHES_N`).
"""

import sys
import time

import numpy as np

from core.control.guard import Guard
from core.device import Device, load_device
from experiments.assumptions import DEFAULTS, ENCODERS, Assumptions
from tests.support.reaches import KINDS, PUSHES_N, Attack, Reached, attack_with, changed_attack, random_attack

BY_ENCODERS = Assumptions(sensing=ENCODERS)
GENERATION = 100
KEPT = 30  # of a kind, from which the next are bred


def search(
    device: Device, guard: Guard | None, assumed: Assumptions, hands: int, seed: int
) -> dict[str, list[Reached]]:
    """So many hands, the kinds in turn; half of each generation are changed from the nearest ones so far."""
    rng = np.random.default_rng(seed)
    found: dict[str, list[Reached]] = {kind: [] for kind in KINDS}
    nearest: list[list[tuple[float, Attack]]] = [[] for _ in KINDS]
    while sum(map(len, found.values())) < hands:
        for kind, best in enumerate(nearest):
            for n in range(GENERATION // len(KINDS)):
                fresh = n % 2 == 0 or not best
                attack = random_attack(rng, kind) if fresh else changed_attack(rng, best[rng.integers(len(best))][1])
                came = attack_with(attack, device, guard, assumed)
                if came is None:
                    continue
                found[KINDS[kind]].append(came)
                if came.first_unsure > 0.0:  # it began where the guard is sure
                    best.append((came.least, attack))
            best.sort(key=lambda one: one[0])
            del best[KEPT:]
    return found


def report(what: str, came: list[Reached]) -> None:
    """A line on hands of one kind."""
    least = 1e3 * np.array([one.least for one in came])
    unsure, got_in = (np.array([getattr(one, name) for one in came]) for name in ("first_unsure", "entered"))
    sure, entered = unsure > 0.0, np.isfinite(got_in)
    counts = [np.count_nonzero(one) for one in (entered, sure, entered & sure, entered & (unsure > got_in))]
    print(
        f"  {what} {len(came):6d} hands, entered {counts[0]:5d}; began sure {counts[1]:6d}, of them entered "
        f"{counts[2]:4d}, unmarked {counts[3]:3d}; least {least[sure].min(initial=np.inf):.1f}, median "
        f"{np.median(least):.1f} mm",
        flush=True,
    )


def main() -> None:
    hands, seed = (int(word) for word in (sys.argv[1:3] if len(sys.argv) > 2 else ("1000", "2026")))
    for name in sys.argv[3:] or PUSHES_N:
        device = load_device(name)
        guard = Guard(push_N=PUSHES_N[name])
        tries = (
            ("without the guard", None, DEFAULTS, hands // 10),
            ("guard", guard, DEFAULTS, hands),
            ("guard, release: clear", Guard(push_N=PUSHES_N[name], release="clear"), DEFAULTS, hands // 10),
            ("guard, by encoders", guard, BY_ENCODERS, hands // 4),
        )
        print(f"{name}: pushes of {PUSHES_N[name]:g} N", flush=True)
        for what, how, assumed, count in tries:
            began = time.process_time()
            found = search(device, how, assumed, count, seed)
            spent = time.process_time() - began
            for kind, came in found.items():
                report(f"{what:22s} {kind:9s}", came)
            print(f"  {what}: {1e3 * spent / max(sum(map(len, found.values())), 1):.1f} ms a hand", flush=True)


if __name__ == "__main__":
    main()
