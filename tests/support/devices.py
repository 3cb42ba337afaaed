"""Five-bars for tests of the mechanics, and their physics by a route of its own.

`FiveBar` holds the numbers of a device file. What is written here comes from link geometry (angles by the law of
cosines, energies body by body), not from the code under test. Joint order A, E, B, C.
"""

import math
import tomllib
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from core.device import SHIPPED_FOLDER, Device, build_device
from core.mechanism import JOINTS
from core.simulator.state import pack_mechanism
from core.stops import distal_sine, stop_gap

BRAKE_TEXT = (SHIPPED_FOLDER.parent / "brake_files" / "mrb-2107-3.toml").read_text()
#: signs of theta_E, theta_C
OUT = {"out": (-1.0, 1.0), "in": (1.0, -1.0), "left": (-1.0, -1.0), "right": (1.0, 1.0)}
LINKS = ("AE", "ED", "BC", "CD")


def rods(mass: float, lengths: tuple[float, ...]) -> tuple[tuple[float, float, float], ...]:
    """Uniform rods: (mass, com, inertia) of each link."""
    return tuple((mass, 0.5 * length, mass * length**2 / 12.0) for length in lengths)


def slope(function, p: np.ndarray, direction: np.ndarray, h: float = 5e-5):
    """Directional derivative by differences, fourth order."""
    near = function(p + h * direction) - function(p - h * direction)
    far = function(p + 2 * h * direction) - function(p - 2 * h * direction)
    return (8 * near - far) / (12 * h)


@dataclass(frozen=True)
class FiveBar:
    """A five-bar as its file says it (SI)."""

    base_a: tuple[float, float] = (-0.05, 0.0)
    base_b: tuple[float, float] = (0.05, 0.0)
    lengths: tuple[float, ...] = (0.27, 0.30, 0.27, 0.30)  # AE, ED, BC, CD
    links: tuple[tuple[float, float, float], ...] = rods(0.3, (0.27, 0.30, 0.27, 0.30))
    tip: float = 0.3
    elbow_masses: tuple[float, float] = (0.0, 0.0)  # at E, at C
    rotor: float = 1e-4
    braked: str = "AEBC"
    elbows: str = "out"
    limits: str = "margin = 0.3"
    name: str = "bench four-brake"
    couplings: tuple[tuple[str, float, float], ...] = ()  # (E or C, factors of the rates of A and B)

    @property
    def text(self) -> str:
        """The device file."""
        names = zip(LINKS, self.lengths, strict=True)
        masses = zip(LINKS, self.links, strict=True)
        return "\n".join(
            [f'name = "{self.name}"', "[geometry]"]
            + [f"base_{j}_m = [{x!r}, {y!r}]" for j, (x, y) in (("A", self.base_a), ("B", self.base_b))]
            + [f"L_{link}_m = {length!r}" for link, length in names]
            + [f'elbows = "{self.elbows}"', "[mass]"]
            + [f"{n} = {{mass_kg = {m!r}, com_m = {c!r}, inertia_kg_m2 = {i!r}}}" for n, (m, c, i) in masses]
            + [f"tip_kg = {self.tip!r}", f"rotor_inertia_kg_m2 = {self.rotor!r}"]
            + [f"joint_{j}_kg = {m!r}" for j, m in zip("EC", self.elbow_masses, strict=True)]
            + ["[limits]", self.limits, "[brakes]"]
            + [f'{j} = "test-brake"' for j in self.braked]
            + ["[couplings]"]
            + [f"{j} = {{A = {a!r}, B = {b!r}}}" for j, a, b in self.couplings]
        )

    @cached_property
    def device(self) -> Device:
        """The device that the code under test builds from the file."""
        return build_device(self.text, {"test-brake": BRAKE_TEXT}, self.name)

    @property
    def rotors(self) -> np.ndarray:
        """Rotor inertia of each brake (4,), kg m2."""
        return self.rotor * np.array([float(j in self.braked) for j in JOINTS])

    def angles(self, p: np.ndarray) -> np.ndarray:
        """theta (4,) at a tip, by the law of cosines; NaN out of reach."""
        theta = []
        for base, (proximal, distal), bend in zip(
            (self.base_a, self.base_b), (self.lengths[:2], self.lengths[2:]), OUT[self.elbows], strict=True
        ):
            reach = math.hypot(p[0] - base[0], p[1] - base[1])
            cosine = (reach**2 - proximal**2 - distal**2) / (2 * proximal * distal)
            if not -1.0 < cosine < 1.0:
                return np.full(4, math.nan)
            elbow = bend * math.acos(cosine)
            turned = math.atan2(distal * math.sin(elbow), proximal + distal * math.cos(elbow))
            theta += [math.atan2(p[1] - base[1], p[0] - base[0]) - turned, elbow]
        return np.array(theta)

    def sines(self, p: np.ndarray) -> np.ndarray:
        """Sines (3,) of elbow E, elbow C and the angle between the distal links at a tip."""
        a, e, b, c = self.angles(p)
        return np.sin([e, c, b + c - a - e])

    def is_open(self, p: np.ndarray, least: float = 0.35) -> bool:
        """True where every sine keeps `least` from zero."""
        return bool(np.all(np.abs(self.sines(p)) >= least) and p[1] > 0.05)

    def open_tips(self, rng: np.random.Generator, n: int, least: float = 0.35) -> np.ndarray:
        """n random tips (n, 2) well inside the workspace."""
        found: list[np.ndarray] = []
        for _ in range(20000):
            p = rng.uniform((-0.5, 0.05), (0.5, 0.6))
            if self.is_open(p, least):
                found.append(p)
                if len(found) == n:
                    break
        assert len(found) == n, "no such tips"
        return np.array(found)

    def jacobians(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """J1, J2 (2, 2) of Eqs. (9) and (10)."""
        a, e, b, c = self.angles(p)
        both = []
        for base, elbow, (one, two) in ((a, e, self.lengths[:2]), (b, c, self.lengths[2:])):
            x, y = -two * math.sin(base + elbow), two * math.cos(base + elbow)
            both.append(np.array([[x - one * math.sin(base), x], [y + one * math.cos(base), y]]))
        return both[0], both[1]

    def joint_rows(self, p: np.ndarray) -> np.ndarray:
        """g (4, 2): joint rates = g v."""
        return np.linalg.inv(np.array(self.jacobians(p))).reshape(4, 2)

    def brake_rates(self, of_joints: np.ndarray) -> np.ndarray:
        """What the brakes act on (4, ...), from the same of the joints: these, or combinations of A and B."""
        found = np.array(of_joints)
        for joint, a, b in self.couplings:
            found[JOINTS.index(joint)] = a * of_joints[0] + b * of_joints[2]
        return found

    def rows(self, p: np.ndarray) -> np.ndarray:
        """g (4, 2): rates that the brakes act on = g v."""
        return self.brake_rates(self.joint_rows(p))

    def kinetic(self, p: np.ndarray, v: np.ndarray) -> float:
        """Kinetic energy (J) summed over bodies: four links, elbow masses, rotors, tip."""
        _, e, _, c = self.angles(p)
        rates = self.joint_rows(p) @ v
        total = 0.5 * self.tip * float(v @ v) + 0.5 * float(self.rotors @ self.brake_rates(rates) ** 2)
        for bend, rate, bending, k in ((e, *rates[:2].tolist(), 0), (c, *rates[2:].tolist(), 2)):
            (m1, c1, i1), (m2, c2, i2) = self.links[k], self.links[k + 1]
            elbow, second = self.lengths[k] * rate, rate + bending  # m/s of the elbow; rad/s of the second link
            com = elbow**2 + (c2 * second) ** 2 + 2.0 * elbow * c2 * second * math.cos(bend)  # square of its speed
            total += 0.5 * (m1 * c1**2 + i1) * rate**2 + 0.5 * self.elbow_masses[k // 2] * elbow**2
            total += 0.5 * m2 * com + 0.5 * i2 * second**2
        return total


def shipped(name: str) -> FiveBar:
    """A shipped device's numbers, read from its file."""
    data = tomllib.loads((SHIPPED_FOLDER / f"{name}.toml").read_text())
    geometry, mass = data["geometry"], data["mass"]
    return FiveBar(
        tuple(geometry["base_A_m"]),
        tuple(geometry["base_B_m"]),
        tuple(geometry[f"L_{link}_m"] for link in LINKS),
        tuple((mass[k]["mass_kg"], mass[k]["com_m"], mass[k]["inertia_kg_m2"]) for k in LINKS),
        mass["tip_kg"],
        (mass.get("joint_E_kg", 0.0), mass.get("joint_C_kg", 0.0)),
        mass["rotor_inertia_kg_m2"],
        "".join(j for j in JOINTS if j in data["brakes"]),
        geometry["elbows"],
        name=name,
        couplings=tuple((j, row["A"], row["B"]) for j, row in data.get("couplings", {}).items()),
    )


THREE, FOUR = shipped("three-brake"), shipped("four-brake")
BENCH_FOUR = FiveBar()
BENCH_THREE = replace(
    BENCH_FOUR,
    base_a=(0.0, 0.0),
    base_b=(0.0, 0.0),
    lengths=(0.30,) * 4,
    links=rods(0.3, (0.30,) * 4),
    braked="AEB",
    name="bench three-brake",
)
BENCH = (BENCH_THREE, BENCH_FOUR)
PTER = shipped("pter")
UNEQUAL = replace(
    BENCH_THREE,
    lengths=(0.30, 0.27, 0.26, 0.32),
    links=rods(0.3, (0.30, 0.27, 0.26, 0.32)),
    braked="AEBC",
    rotor=1e-3,
    elbow_masses=(0.4, 0.0),
    couplings=(("E", 2.0, -1.0), ("C", 1.0, 1.0)),
    name="couplings of unequal arms",
)
#: one coupling parallel to a base joint, one to the elbows
PARALLEL = replace(UNEQUAL, couplings=(("E", -2.0, 0.0), ("C", -1.0, 1.0)), name="parallel couplings")
#: bases apart: no two rows are parallel, and the stops of elbows and D meet in corners
APART = replace(UNEQUAL, base_a=(-0.05, 0.0), base_b=(0.06, 0.01), name="couplings on bases apart")
COUPLED = (PTER, UNEQUAL, PARALLEL, APART)
FIXED = (THREE, FOUR, BENCH_THREE, BENCH_FOUR)


def random_five_bar(seed: int) -> FiveBar:
    """A five-bar of random sizes, masses and elbows; every fourth has coaxial bases."""
    rng = np.random.default_rng(seed)
    for _ in range(1000):
        half = 0.0 if seed % 4 == 0 else rng.uniform(0.01, 0.12)
        lengths = tuple(rng.uniform(0.2, 0.35, 4).tolist())
        shape = rng.uniform((0.05, 0.2, 0.02), (1.0, 0.8, 0.2), (4, 3)).tolist()
        links = tuple((m, x * length, m * length**2 * k) for (m, x, k), length in zip(shape, lengths, strict=True))
        bar = FiveBar(
            (-half, 0.0), (half, rng.uniform(-0.02, 0.02) if half else 0.0), lengths, links,
            rng.uniform(0.1, 1.0), tuple(rng.uniform(0.0, 1.5, 2).tolist()), rng.uniform(0.0, 1e-3),
            ("AEB", "AEBC", "ABC", "AEC")[seed // 4 % 4], ("out", "out", "left", "right")[seed % 4],
            name=f"random-{seed}",
        )  # fmt: skip
        if any(bar.is_open(p, 0.4) for p in rng.uniform((-0.4, 0.1), (0.4, 0.55), (40, 2))):
            return bar
    raise AssertionError("no five-bar with a workspace")


def waves(x: tuple[float, float], y: tuple[float, float]) -> np.ndarray:
    """Scene force (ax sin 2 pi fx t, ay sin(2 pi fy t - pi/2) = -ay cos 2 pi fy t) for `wave_hand`: (amplitude, Hz)."""
    return np.array([[x[0], 2 * math.pi * x[1], 0.0], [y[0], 2 * math.pi * y[1], -0.5 * math.pi]])


S1 = waves((6.0, 2.0), (6.0, 1.4))
S4 = waves((15.0, 1.0), (-10.0, 0.7))


def yields(bar: FiveBar, slipping: float, **locked: float) -> np.ndarray:
    """Commands (4,): `slipping` N m on every brake but the named ones."""
    return np.array([locked.get(j, slipping) if j in bar.braked else 0.0 for j in JOINTS])


def switching(bar: FiveBar, duration: float, high: float = 5.0, low: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """Schedule of scene S4: every 10 ms the next brake alone at `high`, in the order A, B, E(, C)."""
    order = [j for j in "ABEC" if j in bar.braked]
    times = np.arange(round(duration / 0.01)) * 0.01
    return times, np.array([yields(bar, low, **{order[k % len(order)]: high}) for k in range(len(times))])


def stops_of(device: Device, *tips: np.ndarray) -> np.ndarray:
    """Distance (n, 7) of each place to its nearest hard stop at each tip; negative: the tip is not allowed."""
    gaps, side, theta = np.zeros((len(tips), 7)), np.zeros(7), np.zeros(4)
    mechanism = pack_mechanism(device.mechanism)[0]
    for gap, (x, y) in zip(gaps, tips, strict=True):
        stop_gap(mechanism, math.copysign(1.0, distal_sine(mechanism, x, y)), x, y, theta, gap, side)
    return gaps
