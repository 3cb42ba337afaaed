"""The search for tip positions: it meets workspaces however small, and what it rules out does not exist."""

import math

import numpy as np
import pytest
from devices import FiveBar
from scipy.spatial import cKDTree

from core.device import build_mechanism, load_device, shipped_devices
from core.device_file import DeviceFile
from core.files import InputError, parse_toml
from core.mechanism import JOINTS, Mechanism
from core.workspace import FINEST_M, free_tips, tip_is_free, why_impossible
from experiments.paper_figures.workspace import joint_angles


def random_bar(generator: np.random.Generator) -> FiveBar:
    """Any lengths, bases and elbows; it may not close anywhere."""
    apart = float(generator.uniform(0.0, 0.3) * generator.integers(0, 2))
    return FiveBar(
        base_a=(-0.5 * apart, 0.0), base_b=(0.5 * apart, float(generator.uniform(-0.1, 0.1))),
        lengths=tuple(map(float, generator.uniform(0.15, 0.5, 4))), elbows=str(generator.choice(["out", "in", "left"])),
        limits=f"margin = {generator.uniform(0.02, 0.6):.3f}",
    )  # fmt: skip


def with_stops(bar: FiveBar, stops: dict[str, tuple[float, float]]) -> FiveBar:
    """The same five-bar with theta stops besides its margin."""
    lines = [bar.limits] + [f"theta_{joint}_rad = [{low!r}, {high!r}]" for joint, (low, high) in stops.items()]
    return FiveBar(**{**bar.__dict__, "limits": "\n".join(lines)})


def mechanism_of(bar: FiveBar) -> Mechanism:
    """Its constants, also where it is no device that can exist."""
    return build_mechanism(parse_toml(bar.text, DeviceFile, "device.toml"))


def test_a_device_whose_stops_leave_room_around_a_pose_is_accepted():
    """Random poses of random five-bars, each joint with a stop 1e-4 to 0.1 rad to either side, or with none."""
    generator = np.random.default_rng(1)
    accepted = 0
    while accepted < 12:
        bar = random_bar(generator)
        if why_impossible(loose := mechanism_of(bar)):
            continue
        tips = free_tips(loose)
        x, y = tips[generator.integers(len(tips))]
        theta = joint_angles(loose, x, y)
        theta -= 2.0 * math.pi * np.sign(theta) * generator.integers(0, 2, 4)  # or a turn away
        stops = {
            joint: (float(angle - low), float(angle + high))
            for joint, angle, low, high in zip(
                JOINTS, theta, *10.0 ** generator.uniform(-4.0, -1.0, (2, 4)), strict=True
            )
            if generator.random() < 0.7
        }
        tight = mechanism_of(with_stops(bar, stops))
        away = np.linspace(0.0, 2.0 * math.pi, 60)
        if not tip_is_free(tight, x + FINEST_M * np.cos(away), y + FINEST_M * np.sin(away)).all():
            continue  # the margin or y > 0 leaves less than the room that is promised
        assert why_impossible(tight) == "", (bar, stops, x, y)
        accepted += 1


@pytest.mark.parametrize(
    "stops, certain",
    [
        ({"E": (0.1, 0.2)}, True),  # the elbow's other side
        ({"A": (2.0, 2.01), "E": (-1.0, -0.99), "B": (2.0, 2.01), "C": (1.0, 1.01)}, True),  # the arms do not meet
        ({"A": (-1.6, -1.5), "E": (-1.0, -0.5)}, True),  # behind the bases
    ],
)
def test_a_device_without_a_tip_position_is_refused_and_the_sentence_names_its_stops(stops, certain):
    bar = with_stops(FiveBar(), stops)
    with pytest.raises(InputError, match="no tip position in y > 0 at which both arms close within the margin") as said:
        _ = bar.device
    assert all(f"theta_{joint}_rad" in str(said.value) for joint in stops)
    assert ("of room" not in str(said.value)) == certain


@pytest.mark.parametrize("name", shipped_devices())
def test_the_tips_found_spread_over_the_whole_workspace(name):
    """Against a grid of the plane: no free tip is further than 2 cm from one of those found."""
    mechanism = load_device(name).mechanism
    x, y = np.meshgrid(np.linspace(-0.7, 0.7, 141), np.linspace(0.005, 0.7, 70))
    free = tip_is_free(mechanism, x, y)
    far, _ = cKDTree(free_tips(mechanism)).query(np.column_stack((x[free], y[free])))
    assert free.any() and far.max() < 0.02
