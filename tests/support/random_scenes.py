"""Random devices and scenes, each from a seed: any geometry, mass, brakes, stops, commands, force and start.

Only `random.Random(seed).random()` is drawn from, which Python promises never to change: a seed is a scene for good.
"""

import math
import random
from pathlib import Path

JOINTS = "AEBC"
ARMS = (("A", "AE", "ED"), ("B", "BC", "CD"))  # base, links
SIDES = {"out": (1.0, -1.0), "in": (-1.0, 1.0), "left": (1.0, 1.0), "right": (-1.0, -1.0)}
FIDELITIES = ("ideal", "static", "mr")
STEPS = (1e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2)  # s
INTERVAL_S = 0.02  # s, from one compared tip to the next: a whole number of every step


class _Draw:
    """Draws from one seed."""

    def __init__(self, seed: int):
        self.random = random.Random(seed).random

    def flat(self, low, high):
        """Evenly from low to high."""
        return low + (high - low) * self.random()

    def log(self, low, high):
        """Evenly in the logarithm."""
        return low * (high / low) ** self.random()

    def one(self, values):
        """One of them."""
        return values[int(len(values) * self.random())]

    def chance(self, share):
        """True with this probability."""
        return self.random() < share


def random_scene(seed: int) -> tuple[dict, dict]:
    """The device (as its file's tables) and the scene of a seed."""
    draw = _Draw(seed)
    while True:
        device = _device(draw)
        tip = _tip(draw, device)
        if tip is not None:
            break
    if draw.chance(0.3):
        _theta_stops(draw, device, tip)
    return device, _scene(draw, device, tip)


def harder_scene(seed: int) -> tuple[dict, dict]:
    """That scene made harder: masses of four orders, hundreds of newtons, fast starts, brakes that stop it."""
    device, scene = random_scene(seed)
    draw = _Draw(seed * 7919 + 13)
    kind = draw.one(("plain", "spread", "force", "fast", "stop", "stop"))
    if kind == "spread":
        for name in ("AE", "ED", "BC", "CD"):
            factor, link = draw.log(1e-3, 30.0), device["mass"][name]
            link |= {key: factor * link[key] for key in ("mass_kg", "inertia_kg_m2") if key in link}
        device["mass"]["tip_kg"] *= draw.log(0.3, 50.0)
    if kind in ("force", "spread"):
        _scale_force(scene, draw.log(1.0, 30.0))
    if kind in ("fast", "stop"):
        speed, way = draw.log(0.2, 6.0), draw.flat(-math.pi, math.pi)
        scene["velocity"] = [speed * math.cos(way), speed * math.sin(way)]
    if kind == "stop":
        period, strong = draw.one((0.02, 0.04, draw.log(0.01, 0.2))), 8.0 if scene["fidelity"] == "ideal" else 1.0

        def command(joint):
            if joint not in device["brakes"]:
                return 0.0
            return strong * draw.log(0.05, 1.0) if draw.chance(0.5) else 0.0

        count = math.ceil(scene["duration"] / period)
        scene["schedule"] = [[k * period, *map(command, JOINTS)] for k in range(count)]
        _scale_force(scene, draw.log(0.3, 30.0))
    return device, scene


def _scale_force(scene: dict, factor: float) -> None:
    scene["force"] = [[t, factor * fx, factor * fy] for t, fx, fy in scene["force"]]


def _device(draw: _Draw) -> dict:
    kind = draw.one(("three", "four", "coaxial", "apart", "apart"))
    base_a, base_b, lengths, elbows = [0.0, 0.0], [0.0, 0.0], [0.3048] * 4, "out"
    if kind == "four":
        base_a, base_b, lengths = [-0.0762, 0.0], [0.0762, 0.0], [0.2794, 0.3048, 0.2794, 0.3048]
    elif kind != "three":
        lengths = [draw.log(0.12, 0.6) for _ in range(4)]
        base_a = [draw.flat(-0.2, 0.2), draw.flat(-0.1, 0.1)]
        base_b = list(base_a) if kind == "coaxial" else [draw.flat(-0.2, 0.2), draw.flat(-0.1, 0.1)]
        elbows = draw.one(("out", "in", "left", "right"))
    mass = {}
    for name, length in zip(("AE", "ED", "BC", "CD"), lengths, strict=True):
        mass[name] = {"mass_kg": draw.log(0.02, 2.0)}
        if draw.chance(0.5):
            mass[name]["com_m"] = length * draw.flat(0.0, 1.0)
            mass[name]["inertia_kg_m2"] = mass[name]["mass_kg"] * length**2 * draw.log(0.01, 0.3)
    mass["tip_kg"] = draw.log(0.03, 3.0)
    mass["joint_E_kg"] = draw.log(0.1, 2.0) if draw.chance(0.5) else 0.0
    mass["joint_C_kg"] = draw.log(0.1, 2.0) if draw.chance(0.5) else 0.0
    mass["rotor_inertia_kg_m2"] = draw.one((0.0, 1e-4, 1e-3, 5e-3))
    carried = 1 + int(15 * draw.random())
    return {
        "name": "random",
        "geometry": {
            "base_A_m": base_a,
            "base_B_m": base_b,
            **{f"L_{name}_m": length for name, length in zip(("AE", "ED", "BC", "CD"), lengths, strict=True)},
            "elbows": elbows,
        },
        "mass": mass,
        "limits": {"margin": draw.log(0.02, 0.5)},
        "brakes": {joint: "mrb-2107-3" for i, joint in enumerate(JOINTS) if carried >> i & 1},
    }


def _links(device: dict, x: float, y: float) -> list[tuple[float, float, float, float]] | None:
    """Proximal and distal link (x, y, x, y) of each arm at a tip; None: out of reach."""
    found = []
    for (base, first, second), side in zip(ARMS, SIDES[device["geometry"]["elbows"]], strict=True):
        (bx, by), l1, l2 = (device["geometry"][f"{key}_m"] for key in (f"base_{base}", f"L_{first}", f"L_{second}"))
        rx, ry = x - bx, y - by
        r = math.hypot(rx, ry)
        # Heron's form: exact near the stretched and the folded arm
        area = (l1 + l2 + r) * (l1 + l2 - r) * (r + l1 - l2) * (r - l1 + l2)
        if not abs(l1 - l2) < r < l1 + l2 or not area > 0.0:
            return None
        cosine, sine = (l1 * l1 + r * r - l2 * l2) / (2.0 * l1 * r), side * math.sqrt(area) / (2.0 * l1 * r)
        px, py = l1 * (rx * cosine - ry * sine) / r, l1 * (ry * cosine + rx * sine) / r
        found.append((px, py, rx - px, ry - py))
    return found


def _room(device: dict, x: float, y: float) -> float:
    """By how much the sines of both elbows and of the distal links exceed the margin; negative out of reach."""
    if (links := _links(device, x, y)) is None:
        return -1.0
    (ax, ay, bx, by), (cx, cy, dx, dy) = links
    pairs = ((ax, ay, bx, by), (cx, cy, dx, dy), (bx, by, dx, dy))
    sines = (abs(x1 * y2 - y1 * x2) / (math.hypot(x1, y1) * math.hypot(x2, y2)) for x1, y1, x2, y2 in pairs)
    return min(sines) - device["limits"]["margin"]


def _tip(draw: _Draw, device: dict) -> list[float] | None:
    """A tip clear of every stop; half of the time the nearest to a stop of many. None: hardly any to be found."""
    near, best, found = draw.chance(0.5), None, 0
    reach = max(sum(device["geometry"][f"L_{name}_m"] for name in arm) for arm in (("AE", "ED"), ("BC", "CD")))
    for _ in range(600):
        tip = [draw.flat(-reach, reach), draw.flat(0.01, reach)]
        room = _room(device, *tip)
        if room < 1e-3:
            continue
        found += 1
        if best is None or room < best[0]:
            best = (room, tip)
        if not near or found == 20:
            break
    return best[1] if best else None


def _theta_stops(draw: _Draw, device: dict, tip) -> None:
    """Stops a little to either side of where some joints are."""
    links = _links(device, *tip)
    for i, joint in enumerate(JOINTS):
        px, py, dx, dy = links[i // 2]
        theta = math.atan2(py, px) if i % 2 == 0 else math.atan2(px * dy - py * dx, px * dx + py * dy)
        if draw.chance(0.5):
            low, high = theta - draw.log(0.01, 0.6), theta + draw.log(0.01, 0.6)
            device["limits"][f"theta_{joint}_rad"] = [low, high]


def _scene(draw: _Draw, device: dict, tip) -> dict:
    fidelity = draw.one(FIDELITIES)
    duration = INTERVAL_S * round(draw.flat(0.4, 1.0) / INTERVAL_S)
    speed, way = draw.log(0.01, 1.5) if draw.chance(0.4) else 0.0, draw.flat(-math.pi, math.pi)
    return {
        "fidelity": fidelity,
        "tip": list(tip),
        "velocity": [speed * math.cos(way), speed * math.sin(way)],
        "schedule": _schedule(draw, device, fidelity, duration),
        "force": _force(draw, duration),
        "duration": duration,
    }


def _schedule(draw: _Draw, device: dict, fidelity: str, duration: float) -> list[list[float]]:
    """Rows t, A, E, B, C; one row for constant commands."""

    def command(joint):
        if joint not in device["brakes"]:
            return 0.0
        if fidelity == "ideal":
            return 0.0 if draw.chance(0.1) else draw.log(0.02, 8.0)
        return draw.one((0.0, 1.0)) if draw.chance(0.4) else draw.random()

    period = draw.one((duration, duration, draw.log(0.01, 0.2), 0.02 * (1 + int(5 * draw.random()))))
    count = max(1, math.ceil(duration / period - 1e-6))
    return [[k * period, *(command(joint) for joint in JOINTS)] for k in range(count)]


def _force(draw: _Draw, duration: float) -> list[list[float]]:
    """Knots t, fx, fy; one knot for a constant force."""
    kind = draw.one(("constant", "wave", "wave", "random", "flips"))
    size, way = draw.log(1.0, 60.0), draw.flat(-math.pi, math.pi)
    if kind == "constant":
        return [[0.0, size * math.cos(way), size * math.sin(way)]]
    spacing = draw.one((0.005, 0.01, draw.log(0.004, 0.05)))
    if kind != "wave":
        spacing = draw.one((0.02, 0.04, draw.log(0.01, 0.1)))
    fast = [draw.flat(1.0, 25.0) for _ in range(2)]
    knots = []
    for k in range(math.ceil(duration / spacing - 1e-6) + 1):
        t = k * spacing
        if kind == "wave":
            knots.append([t, size * math.sin(fast[0] * t + way), size * math.cos(fast[1] * t)])
        elif kind == "random":
            knots.append([t, size * draw.flat(-1.0, 1.0), size * draw.flat(-1.0, 1.0)])
        else:
            sign = draw.one((-1.0, 1.0))
            knots.append([t, sign * size * math.cos(way), sign * size * math.sin(way)])
    return knots


def write_scene(device: dict, scene: dict, step: float, folder: Path, integrator: str = "event") -> Path:
    """The files of a scene with a step (s) in `folder`, for `phd simulate`."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "device.toml").write_text(_device_text(device), encoding="utf-8")
    lines = [
        'device = "device.toml"',
        f"duration_s = {scene['duration']!r}",
        f"step_s = {step!r}",
        f"output_interval_s = {max(step, INTERVAL_S)!r}",
        f"initial_tip_m = {scene['tip']!r}",
        f"initial_tip_velocity_m_s = {scene['velocity']!r}",
        f'fidelity = "{scene["fidelity"]}"',
        f'integrator = "{integrator}"',
        "[brakes]",
    ]
    key = "torque_N_m" if scene["fidelity"] == "ideal" else "current_amperes"
    if len(scene["schedule"]) == 1:
        lines.append(f"{key} = {_inline(dict(zip(JOINTS, scene['schedule'][0][1:], strict=True)))}")
    else:
        lines.append('schedule = "brakes.csv"')
        _write_table(folder / "brakes.csv", "t_s,A,E,B,C", scene["schedule"])
    lines.append("[force]")
    if len(scene["force"]) == 1:
        lines.append(f"constant_N = {scene['force'][0][1:]!r}")
    else:
        lines.append('file = "force.csv"')
        _write_table(folder / "force.csv", "t_s,fx_N,fy_N", scene["force"])
    path = folder / f"scene_{integrator}_{step!r}.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _write_table(path: Path, header: str, rows: list[list[float]]) -> None:
    path.write_text("\n".join([header, *(",".join(map(repr, row)) for row in rows)]) + "\n", encoding="utf-8")


def _inline(values: dict) -> str:
    return "{" + ", ".join(f"{key} = {value!r}" for key, value in values.items()) + "}"


def _device_text(device: dict) -> str:
    lines = [f'name = "{device["name"]}"']
    for table in ("geometry", "mass", "limits", "brakes"):
        lines.append(f"[{table}]")
        for key, value in device[table].items():
            if isinstance(value, dict):
                text = _inline(value)
            else:
                text = f'"{value}"' if isinstance(value, str) else repr(value)
            lines.append(f"{key} = {text}")
    return "\n".join(lines) + "\n"
