"""Random reaches at obstacles, per device: how many hands get in with the guard, without it, and against its release.

    python -m tests.benchmarks.guard_reaches [REACHES] [SEED]

Pushes up to the push that the guard allows for; per device the largest whole one below half of what a full lock holds.
"""

import sys
import time

import numpy as np

from core.control.guard import Around, Guard, least_held, make_around, stopping_distance
from core.device import load_device, shipped_devices
from core.kernel import kernel
from experiments.assumptions import DEFAULTS, ENCODERS, Assumptions
from tests.support.reaches import guarded, pushed_device, random_task, run_reach

CALLS = 2000
BY_ENCODERS = Assumptions(sensing=ENCODERS)


@kernel
def many_bounds(around, brakes, g, mass, calls):
    """The guard's bound, again and again."""
    total = 0.0
    for _ in range(calls):
        total += min(stopping_distance(around[0], brakes[0], g, mass, 0.2, 0.1, 0.1), 1.0)
    return total


def bound_us(name: str, push: float) -> float:
    """Cost of one bound, us."""
    device = pushed_device(load_device(name), (0.0, 0.4))
    device.settle(np.zeros(4), 0.0)
    around = make_around(Around(guard=Guard(push_N=push)), device.device.brakes)
    given = around, device.brakes, device.state["g"][0], device.state["mass"][0]
    many_bounds(*given, 1)
    began = time.perf_counter()
    many_bounds(*given, CALLS)
    return 1e6 * (time.perf_counter() - began) / CALLS


def main() -> None:
    count, seed = (int(word) for word in (*sys.argv[1:], 1000, 2026)[:2])
    places = np.array([[x, y] for x in (-0.1, 0.0, 0.1) for y in (0.34, 0.4, 0.45)])
    for name in shipped_devices():
        device = load_device(name)
        held = least_held(device.mechanism, device.brakes, places)
        push = float(int(0.5 * held))
        if not push > 0.0:
            print(f"{name}: a full lock holds {held:.1f} N, too little for a guard")
            continue
        clear, pull = Guard(push_N=push, release="clear"), Guard(push_N=push)
        tries = (
            ("without the guard", None, False, DEFAULTS),
            ("guard, release: clear", clear, False, DEFAULTS),
            ("guard, release: pull", pull, False, DEFAULTS),
            ("a hand that feigns pulls, release: clear", clear, True, DEFAULTS),
            ("a hand that feigns pulls, release: pull", pull, True, DEFAULTS),
            ("by encoders, release: clear", clear, False, BY_ENCODERS),
            ("by encoders, release: pull", pull, False, BY_ENCODERS),
            ("by encoders, feigned pulls, release: clear", clear, True, BY_ENCODERS),
            ("by encoders, feigned pulls, release: pull", pull, True, BY_ENCODERS),
        )
        print(f"{name}: holds {held:.1f} N, pushes to {push:g} N; one bound takes {bound_us(name, push):.1f} us")
        for words, guard, adversary, assumed in tries:
            rng, least = np.random.default_rng(seed), []
            for _ in range(count):
                task = random_task(rng, push)
                controller, pushed = guarded(device, task.obstacle, guard, assumed), pushed_device(device, task.tip)
                least.append(run_reach(pushed, controller, task.pushes, adversary, assumed).least)
            quantiles = 1e3 * np.quantile(least, (0.0, 0.05, 0.5, 0.95))
            print(
                f"  {words:42s} entered {np.count_nonzero(np.array(least) < 0.0):4d} of {count}; least distance "
                f"{quantiles[0]:.1f}, 5 % {quantiles[1]:.1f}, median {quantiles[2]:.1f}, 95 % {quantiles[3]:.1f} mm"
            )


if __name__ == "__main__":
    main()
