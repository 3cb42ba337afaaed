"""The search for tip positions: it meets workspaces however small, and what it rules out does not exist."""

import math

import numpy as np
import pytest
from devices import FiveBar
from scipy.spatial import cKDTree

from core import workspace
from core.device import build_mechanism, load_device, shipped_devices
from core.device_file import DeviceFile
from core.files import InputError, parse_toml
from core.mechanism import JOINTS, Mechanism
from core.workspace import FINEST_M, free_tips, tip_is_free, why_impossible
from experiments.paper_figures.workspace import joint_angles, sdof_family, workspace_of

#: Two devices whose workspaces are 0.3 mm and 0.6 mm thin: coaxial, stops of 0.02 to 0.06 rad.
STRETCHED = FiveBar(
    base_a=(0.0, 0.0), base_b=(0.0, 0.0), lengths=(0.3048,) * 4, braked="BC",
    limits="margin = 0.1\ntheta_E_rad = [-0.11777305360280244, 0.11228696439257521]\n"
    "theta_B_rad = [1.2481701525014617, 1.2973217776640609]",
)  # fmt: skip
LOPSIDED = FiveBar(
    base_a=(0.017572035157577506, 0.03081762416523723), base_b=(0.017572035157577506, 0.03081762416523723),
    lengths=(0.46857190712666885, 0.4612225037298324, 0.18935439023936207, 0.4915785162081383), elbows="in",
    braked="EC", limits="margin = 0.5\ntheta_A_rad = [1.5531335383419946, 1.576906327599925]\n"
    "theta_B_rad = [2.707494118383021, 2.765979604322116]\n"
    "theta_C_rad = [-0.5361425011204208, -0.5211330718609212]",
)  # fmt: skip


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


@pytest.mark.parametrize("bar, tip", [(STRETCHED, (0.134317, 0.593625)), (LOPSIDED, (-0.44496, 0.504637))])
def test_devices_with_narrow_stops_load_and_their_workspace_is_found(bar, tip):
    mechanism = bar.device.mechanism
    tips = free_tips(mechanism)
    assert len(tips) >= workspace.ENOUGH and tip_is_free(mechanism, *tips.T).all()
    assert np.min(np.hypot(*(tips - tip).T)) < 1e-3
    assert bar.device.force_normalised_N > 0.0
    assert all(len(sdof_family(workspace_of(mechanism), joint, 0.002)) for joint in bar.braked)


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
