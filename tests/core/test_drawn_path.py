"""Paths drawn in a CSV table or an SVG picture."""

import math

import numpy as np
import pytest

from core.drawn_path import read_path
from core.files import InputError
from core.path import MOST_POINTS, build_path

pytestmark = pytest.mark.nojit


def read(text, **entry):
    return read_path({"kind": "drawing", "file": "it.csv"} | entry, lambda _: text, "path 1")


def table(points):
    return "x_m,y_m\n" + "".join(f"{x!r},{y!r}\n" for x, y in np.asarray(points).tolist())


def picture(d, around="{}"):
    inside = around.format(f'<path d="{d}"/>')
    return f'<svg xmlns="http://www.w3.org/2000/svg">{inside}</svg>'


SVG = {"file": "it.svg", "width_m": 0.1, "centre_m": [0.0, 0.36]}
SPOTS = [(0.0, 0.3), (0.05, 0.3), (0.05, 0.35), (0.0, 0.4)]


def test_without_smoothing_a_table_is_the_polyline_of_its_points():
    path, about = read(table(SPOTS))
    assert path.points_m == tuple(SPOTS) and about == "it.csv, 4 points, not smoothed"
    moved, _ = read(table(SPOTS), width_m=0.1, centre_m=[0.1, 0.2])
    assert np.array(moved.points_m) == pytest.approx(2.0 * (np.array(SPOTS) - (0.025, 0.35)) + (0.1, 0.2))


def test_smoothing_takes_the_noise_of_a_hand_and_keeps_the_ends():
    generator, angles = np.random.default_rng(0), np.linspace(0.0, math.pi, 800)
    arc = 0.05 * np.column_stack([np.cos(angles), np.sin(angles)]) + (0.0, 0.3)
    noisy = arc + generator.normal(size=arc.shape) * 1e-4
    rough, _ = read(table(noisy))
    path, about = read(table(noisy), smoothing_m=0.002)
    assert "smoothed over 2 mm (moved by at most" in about
    points = np.array(path.points_m)
    assert points[0] == pytest.approx(noisy[0], abs=1e-6) and points[-1] == pytest.approx(noisy[-1], abs=1e-6)
    assert build_path(path, "it").length == pytest.approx(0.05 * math.pi, rel=0.01)
    assert build_path(rough, "it").length > 1.1 * 0.05 * math.pi
    assert np.abs(np.hypot(*(points - (0.0, 0.3)).T) - 0.05).max() < 2e-4


def test_a_closed_drawing_is_smoothed_round_its_end_and_stays_closed():
    angles = np.linspace(0.0, 2.0 * math.pi, 4 * MOST_POINTS)
    circle = 0.05 * np.column_stack([np.cos(angles), np.sin(angles)]) + (0.0, 0.3)
    circle[-1] = circle[0]
    path, _ = read(table(circle), smoothing_m=0.003)
    points = np.array(path.points_m)
    assert len(points) <= MOST_POINTS + 1 and path.points_m[0] == path.points_m[-1]
    assert np.ptp(np.hypot(*(points - (0.0, 0.3)).T)) < 1e-5, "nothing shows where it begins"


def test_a_picture_is_placed_with_its_curves_and_y_upwards():
    path, about = read(picture("M 0 0 a 10 10 0 0 1 20 0 l 20 0"), **SVG)
    points, built = np.array(path.points_m), build_path(path, "it")
    assert points[0] == pytest.approx((-0.05, 0.3475)) and points[-1] == pytest.approx((0.05, 0.3475))
    assert built.length == pytest.approx(0.025 * math.pi + 0.05, rel=1e-3)
    assert points[:, 1].max() == pytest.approx(0.3725, abs=1e-5), "sweep 1 is above in a picture"
    assert "not smoothed" in about
    closed, _ = read(picture("M0,0 L10,0 L10,10 Z"), **SVG)
    assert closed.points_m[0] == closed.points_m[-1] and len(closed.points_m) == 4


@pytest.mark.parametrize(
    ("text", "entry", "reason"),
    [
        ("x_m,y_m\n0,0\n", {}, "has 1 points"),
        ("x_m,y_m\n0,0\n0,0\n", {}, "fewer than two different points"),
        ("x_m,y_m\n0,0\n0,1\n", {"width_m": 0.1}, "no width"),
        ("x_m,y_m\n0,0\n0,1\n", {"smooth": 0.1}, "unknown key smooth"),
        (picture("M0 0 L1 1"), {"file": "it.svg"}, "width_m and centre_m are required"),
        (picture("M0 0 L1 1 M2 2 L3 3"), SVG, "has 2 separate lines"),
        (picture(""), SVG, "has 0 separate lines"),
    ],
)
def test_a_drawing_that_is_no_path_is_refused_in_a_sentence(text, entry, reason):
    with pytest.raises(InputError, match=rf"^path 1.*{reason}"):
        read(text, **entry)
