"""Scenes with obstacles and the guard: what is refused, what the file holds, that no hand within its push gets in."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exports import rows as csv_rows

from core.control.guard import Around
from core.files import InputError
from experiments.simulate.scene import Scene, read_scene
from experiments.simulate.simulate import SceneRun, simulate

WALL = "[[obstacle]]\nhalf_plane_m = [0.0, 0.44, 0.0, -1.0]\n"
GUARD = "[guard]\npush_N = 10.0\n"
MR = 'fidelity = "mr"\n'
PUSH = "[force]\nconstant_N = [0.0, 10.0]\n"
FREE, LOCKED = "", "lock"


@pytest.fixture
def scene(tmp_path: Path):
    """A function that writes and reads a scene; with a force file where rows of one are given."""

    def read(more: str, device: str = "three-brake", step: str = "1e-3", force: str = "") -> Scene:
        plain = f'device = "{device}"\nduration_s = 0.8\nstep_s = {step}\ninitial_tip_m = [0.0, 0.36]\n'
        (tmp_path / "force.csv").write_text("t_s,fx_N,fy_N\n" + force)
        (tmp_path / "scene.toml").write_text(plain + more + ('[force]\nfile = "force.csv"\n' if force else ""))
        return read_scene(tmp_path / "scene.toml")

    return read


def ran(scene: Scene, folder: Path) -> tuple[dict[str, list[str]], dict]:
    """Columns of the file, and the summary."""
    out = folder / f"{len(list(folder.iterdir()))}.csv"
    summary = simulate(scene, out)
    found = csv_rows(out)
    return {name: [row[name] for row in found] for name in found[0]}, summary


BOXES = "".join(
    f"[[obstacle]]\npolygon_m = [[{x}, 0.6], [{x}.1, 0.6], [{x}.1, 0.7], [{x}, 0.7]]\n" for x in range(1, 18)
)
BAD_SCENES = {
    "guard of ideal brakes": (WALL + GUARD, "guard needs fidelity 'static' or 'mr': it locks the brakes by their"),
    "guard of nothing": (MR + GUARD, "guard: there is no obstacle to guard"),
    "push beyond a full lock": (
        MR + WALL + "[guard]\npush_N = 500.0\n",
        r"guard: push_N \(500\) must be less than the \d+\.\d N that three-brake holds at initial_tip_m",
    ),
    "no push given": (MR + WALL + "[guard]\npush_N = 0.0\n", "guard.push_N must be at least 1e-06, not 0.0"),
    "start in an obstacle": (
        MR + "[[obstacle]]\ndisc_m = [0.0, 0.36, 0.01]\n" + GUARD,
        r"initial_tip_m: \(0, 0.36\) m is in an obstacle, there is nothing to guard",
    ),
    "obstacle of no kind": ("[[obstacle]]\n", "must be one of disc_m, half_plane_m, polygon_m"),
    "too many obstacles": (BOXES, "obstacle: they have 68 edges together, 64 at most"),
    "unknown key": (MR + WALL + "[guard]\nforce_N = 1\n", r"unknown key guard\.force_N"),
}  # fmt: skip


@pytest.mark.parametrize("more, says", BAD_SCENES.values(), ids=BAD_SCENES)
def test_a_guard_that_can_promise_nothing_is_refused_in_a_sentence(scene, more, says):
    with pytest.raises(InputError, match=says) as refusal:
        scene(more)
    assert "scene.toml" in str(refusal.value) and "\n" not in str(refusal.value)


@pytest.mark.parametrize("step", ["1.6e-3", "3.2e-4", "0.8"])
def test_a_step_that_a_look_of_the_guard_falls_into_is_refused(scene, step):
    assert scene(MR + WALL, step=step).step_s == float(step)
    if float(step) >= 0.8:
        assert scene(MR + WALL + GUARD, step=step).step_s == 1e-3
        return
    with pytest.raises(InputError, match=r"step_s \(.* s\) must be a whole number of milliseconds, or one"):
        scene(MR + WALL + GUARD, step=step)


@pytest.mark.parametrize("device", ["er-two-brake", "three-brake", "four-brake", "pter"])
def test_a_push_of_all_that_is_allowed_gets_in_without_the_guard_and_not_with_it(scene, tmp_path, device):
    columns, summary = ran(scene(MR + PUSH + WALL, device), tmp_path)
    assert summary["least_obstacle_m"] < 0.0 and "guard" not in columns and "guard_ticks" not in summary
    columns, summary = ran(scene(MR + PUSH + WALL + GUARD, device), tmp_path)
    assert summary["least_obstacle_m"] > 0.0 and summary["warnings"] == []
    assert summary["guard_ticks"] == 801 and 0 < summary["guard_locked_ticks"] < 801
    assert summary["guard_too_late_ticks"] == 0 and set(columns["guard"]) == {FREE, LOCKED}


def test_hands_that_turn_and_feign_get_into_no_wall_by_any_integrator_or_step(scene, tmp_path):
    """The force file is what the person who doubts the promise writes: to and fro, aside, with pulls between."""
    rng = np.random.default_rng(8)
    for n in range(12):
        times = np.append(np.arange(0.0, 0.79, (0.02, 0.1, 0.3)[n % 3]), 0.8)
        ways = rng.uniform(-1.3, 1.3, len(times)) + math.pi * (rng.random(len(times)) < 0.25)
        force = "".join(f"{t},{10 * math.sin(a)},{10 * math.cos(a)}\n" for t, a in zip(times, ways, strict=True))
        for kind in ("event", "stepping"):
            how = f'fidelity = "{("mr", "static")[n % 2]}"\nintegrator = "{kind}"\n'
            guarded = scene(how + WALL + GUARD, ("er-two-brake", "three-brake", "pter")[n // 4], force=force)
            _, summary = ran(guarded, tmp_path)
            assert summary["least_obstacle_m"] > 0.0, (n, kind)
            sure = n // 4 != 0 or summary["guard_too_late_ticks"] == 0  # without play a turn changes nothing
            assert sure, (n, kind)


def test_obstacles_and_a_guard_that_need_not_lock_change_no_bit_of_the_motion(scene, tmp_path):
    force = "0,0,1\n0.113,4,-2\n0.3,-5,3\n0.8,6,-1\n"
    brakes = "[brakes]\ncurrent_amperes = {A = 0.3, B = 0.2}\n"
    far = "[[obstacle]]\nhalf_plane_m = [0.0, 1.5, 0.0, -1.0]\n"
    bare, _ = ran(scene(MR + brakes, force=force), tmp_path)
    beside, _ = ran(scene(MR + brakes + far, force=force), tmp_path)
    guarded, summary = ran(scene(MR + brakes + far + GUARD, force=force), tmp_path)
    assert list(bare)[-1] == "lost_at_stops_J" and summary["guard_locked_ticks"] == 0
    assert list(beside) == [*bare, "obstacle_m"] and list(guarded) == [*bare, "obstacle_m", "guard"]
    assert all(bare[name] == beside[name] == guarded[name] for name in bare)
    assert beside["obstacle_m"] == guarded["obstacle_m"] and set(guarded["guard"]) == {FREE}
    away = 1.5 - np.array(bare["tip_y_m"], dtype=float)
    assert np.array(beside["obstacle_m"], dtype=float) == pytest.approx(away, abs=1e-15)


def test_the_guard_looks_every_millisecond_however_long_a_step_is(scene, tmp_path):
    last = {}
    for step in ("1e-4", "1e-3", "5e-3"):
        columns, summary = ran(scene(MR + "output_interval_s = 5e-3\n" + PUSH + WALL + GUARD, step=step), tmp_path)
        assert summary["least_obstacle_m"] > 0.0 and summary["guard_ticks"] == 801 and summary["warnings"] == []
        assert len(columns["t_s"]) == 161
        last[step] = np.array([float(columns[name][-1]) for name in ("tip_x_m", "tip_y_m")])
    assert np.array_equal(last["5e-3"], last["1e-3"]), "a guarded step of 5 ms is five steps"
    assert last["1e-4"] == pytest.approx(last["1e-3"], abs=1e-4)


def test_a_lock_replaces_the_schedule_and_the_schedule_has_its_say_again(scene, tmp_path):
    """The hand pushes, is stopped, and pulls away: the brakes it then feels are those of the schedule."""
    force = "0,0,10\n0.5,0,10\n0.51,0,-10\n0.8,0,-10\n"
    (tmp_path / "brakes.csv").write_text("t_s,A,B\n0,0,0\n0.1003,0.1,0\n0.6,0.1,0.1\n")
    guarded = scene(MR + '[brakes]\nschedule = "brakes.csv"\n' + WALL + GUARD, force=force)
    columns, summary = ran(guarded, tmp_path)
    words, y = columns["guard"], np.array(columns["tip_y_m"], dtype=float)
    assert words[0] == FREE and LOCKED in words[:450] and words[510:680] == [FREE] * 170
    assert y[-1] < y[500] - 0.01 and summary["least_obstacle_m"] > 0.0
    first = words.index(LOCKED)
    free = replace(guarded, around=Around(obstacles=guarded.around.obstacles))
    alone = SceneRun(free).run_chunk(free.rows)
    assert np.array_equal(alone[: first + 1, 2], y[: first + 1]), "until the first lock it is the schedule's motion"


def test_a_hand_that_pushes_harder_than_the_guard_allows_for_is_named(scene, tmp_path, capsys):
    push = "0,0,4\n0.4,3,12.0\n0.8,0,0\n"
    _, summary = ran(scene(MR + WALL + GUARD, force=push), tmp_path)
    assert summary["warnings"][-1].startswith("the hand pushes with up to 12.37 N, more than the 10 N (push_N)")
    after = "0,0,10\n0.8,0,10\n0.9,0,90\n"  # the file goes on after the scene has ended
    assert ran(scene(MR + WALL + GUARD, force=after), tmp_path)[1]["warnings"] == []
