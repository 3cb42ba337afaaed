"""Scenes of `phd simulate`: what files mean, what is refused and written, that no hand gets past the guard."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exports import rows as csv_rows
from refusals import refusal

from app.cli import main
from core.control.guard import Around
from core.device import load_device
from core.files import InputError
from core.workspace import free_tips
from experiments.simulate.cobot_scene import CobotRun, read_cobot_scene
from experiments.simulate.leaving import Leaving
from experiments.simulate.scene import Scene, read_scene
from experiments.simulate.simulate import SceneRun, simulate

SCENE = """\
device = "three-brake"
duration_s = 0.02
step_s = 1e-3
initial_tip_m = [0.05, 0.40]
"""


@pytest.fixture
def scene(tmp_path: Path):
    """A function that writes a scene (and files beside it) and reads it."""

    def read(more: str = "", *changes: tuple[str, str], **files: str):
        text = SCENE + more
        for pattern, replacement in changes:
            assert re.search(pattern, text), pattern
            text = re.sub(pattern, replacement, text)
        for name, content in files.items():
            (tmp_path / f"{name}.csv").write_text(content)
        (tmp_path / "scene.toml").write_text(text)
        return read_scene(tmp_path / "scene.toml")

    return read


def test_constants_hold_for_the_whole_scene_and_unnamed_joints_are_zero(scene):
    s = scene("[brakes]\ntorque_N_m = {A = 5.6, B = 0.3, C = 0}\n[force]\nconstant_N = [10, -1]\n")
    assert s.schedule.tolist() == [[5.6, 0.0, 0.3, 0.0]] and s.schedule_t[0] <= 0.0
    assert np.all(s.force == [10.0, -1.0])


def test_a_schedule_overrides_the_constants_in_columns_of_any_order_that_may_be_zero_without_a_brake(scene):
    more = '[brakes]\ntorque_N_m = {A = 1}\nschedule = "brakes.csv"\n'
    s = scene(more, brakes="t_s,B,C,A\n-1,0.1,0,0.2\n0.005,0.3,0,0.4\n")
    assert s.schedule_t.tolist() == [-1.0, 0.005]
    assert s.schedule.tolist() == [[0.2, 0.0, 0.1, 0.0], [0.4, 0.0, 0.3, 0.0]]


def test_paths_are_relative_to_the_scene_file(scene, tmp_path: Path, monkeypatch):
    from core.device import load_device

    (tmp_path / "mine.toml").write_text(load_device("four-brake").text)
    monkeypatch.chdir("/")
    assert scene("", ('"three-brake"', '"mine.toml"')).device.braked == "AEBC"


def test_a_duration_may_miss_a_whole_number_of_steps_by_rounding_only(scene):
    assert scene("", ("= 0.02", "= 0.020000000000001")).steps == 20
    with pytest.raises(InputError, match="not a whole number of output intervals"):
        scene("", ("= 0.02", "= 0.02000001"))


TABLE = '[brakes]\nschedule = "brakes.csv"\n'
FORCE = '[force]\nfile = "force.csv"\n'
HEAD = "t_s,fx_N,fy_N\n"
BAD_SCENES = {
    "part of a step": ("output_interval_s = 1.5e-3\n", {}, r"interval_s \(0.0015 s\) is not a whole"),
    "torque without a brake": ("[brakes]\ntorque_N_m = {C = 1}\n", {}, "torque_N_m.C: three-brake has no brake"),
    "torque for mr": ('fidelity = "mr"\n[brakes]\ntorque_N_m = {A = 1}\n', {}, "torque_N_m does not go with"),
    "current above the limit": ('fidelity = "mr"\n[brakes]\ncurrent_amperes = {A = 1.1}\n', {}, "at most 1 A"),
    "file and constant": ('[force]\nfile = "f"\nconstant_N = [1, 1]\n', {}, "either file or constant_N"),
    "schedule starts late": (TABLE, {"brakes": "t_s,A\n0.1,1\n"}, "line 2: the first time must be 0 or earlier"),
    "schedule stands still": (TABLE, {"brakes": "t_s,A\n0,1\n\n1,1\n1,2\n"}, "line 5: time must rise, but 1 s"),
    "schedule negative": (TABLE, {"brakes": "t_s,A\n0,1\n1,-1\n"}, "line 3: A must not be negative, not -1"),
    "force too short": (FORCE, {"force": HEAD + "0,0,0\n0.019,0,0\n"}, "ends at 0.019 s, before the scene does"),
}  # fmt: skip


@pytest.mark.parametrize("more, files, says", BAD_SCENES.values(), ids=BAD_SCENES)
def test_a_scene_that_cannot_run_is_refused_with_file_key_and_reason(scene, more, files, says):
    with pytest.raises(InputError, match=says) as refusal:
        scene(more, **files)
    assert re.search(r"(scene\.toml|brakes\.csv|force\.csv)", str(refusal.value))


EXAMPLES = Path(__file__).resolve().parents[2] / "experiments" / "scenes"
SCOOTER_PATH, SCOOTER_WALL = ((EXAMPLES / f"{name}.toml").read_text() for name in ("scooter", "scooter-wall"))
ONE_CASTOR = """
name = "one castor"
mass_kg = 3.0
inertia_kg_m2 = 1.0
hubs_m = [[0.0, 0.0]]
steering_rate_max_rad_s = 30.0
"""
FREE = 'cobot = "scooter"\nduration_s = 1.0\nstep_s = 1e-3\n[force]\n'


def simulated(tmp_path, capsys, text, name="scene"):
    """Columns of the file and the summary of a scene."""
    (tmp_path / f"{name}.toml").write_text(text)
    out = tmp_path / f"{name}.csv"
    assert main(["simulate", str(tmp_path / f"{name}.toml"), "--out", str(out), "--json"]) == 0
    rows = csv_rows(out)
    words = [row.pop("limited") for row in rows]
    columns = {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}
    return columns, words, json.loads(capsys.readouterr().out)


def test_the_scooter_comes_to_the_path_and_to_its_heading_by_the_hands_energy_alone(tmp_path, capsys):
    columns, limited, summary = simulated(tmp_path, capsys, SCOOTER_PATH)
    assert len(columns["t_s"]) == 401 and columns["t_s"][-1] == 4.0
    assert abs(columns["y_m"][-1]) < 1e-6 and abs(columns["heading_rad"][-1]) < 1e-2 and columns["x_m"][-1] > 2.0
    assert columns["kinetic_J"] == pytest.approx(columns["work_J"], abs=1e-9) and summary["energy_residual_J"] < 1e-9
    assert any(limited) and {*"".join(limited)} <= {*"123"}
    assert summary["half_step_differs_m"] < 3e-4 and summary["warnings"] == [] and summary["assumed"]


def test_the_scooter_is_kept_from_the_wall_and_slides_along_it(tmp_path, capsys):
    columns, _, summary = simulated(tmp_path, capsys, SCOOTER_WALL)
    assert columns["y_m"].max() < 0.4 and columns["y_m"][-1] > 0.39 and columns["x_m"][-1] > 1.0
    assert summary["least_distance_from_wall_m"] == pytest.approx(0.4 - columns["y_m"].max())


def test_a_cobot_may_have_one_castor_and_a_long_scene_is_the_same_in_chunks(tmp_path):
    (tmp_path / "one.toml").write_text(ONE_CASTOR)
    (tmp_path / "scene.toml").write_text(FREE.replace("scooter", "one.toml") + "constant = [3.0, 6.0, 0.0]\n")
    scene = read_cobot_scene(tmp_path / "scene.toml")
    whole, run = CobotRun(scene).run_chunk(1001), CobotRun(scene)
    parts = np.concatenate([run.run_chunk(400), run.run_chunk(601)])
    assert np.array_equal(parts, whole)
    assert whole[-1, 2] / whole[-1, 1] == pytest.approx(2.0, abs=0.2), "it turned into the force"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (FREE.replace("scooter", "skater"), "unknown cobot"),
        (FREE + 'constant = [1, 0, 0]\nfile = "x.csv"\n', "not both"),
        (FREE.replace("scooter", "one.toml") + "constant = [0.0, 0.0, 1.0]\n", "torque must be 0"),
        (SCOOTER_PATH + SCOOTER_WALL[SCOOTER_WALL.index("[wall]") :], "not both"),
        (SCOOTER_WALL.replace("at_m = [0.0, 0.4]", "at_m = [0.0, -0.4]"), "behind the wall"),
        (SCOOTER_WALL.replace("normal = [0.0, -1.0]", "normal = [0.0, 0.0]"), "direction"),
        (SCOOTER_PATH.replace("heading_rad = 0.0", f"heading_rad = {10**400}"), "heading_rad"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_a_sentence_and_nothing_is_written(tmp_path, capsys, text, reason):
    (tmp_path / "one.toml").write_text(ONE_CASTOR)
    (tmp_path / "scene.toml").write_text(text)
    assert reason in refusal(capsys, "simulate", tmp_path / "scene.toml", "--out", tmp_path / "motion.csv")
    assert not (tmp_path / "motion.csv").exists()
    with pytest.raises(InputError):
        read_cobot_scene(tmp_path / "scene.toml")


IN_AND_OUT = """
device = "three-brake"
duration_s = 0.3
step_s = 1e-3
initial_tip_m = [0.05, 0.40]
fidelity = "mr"
[brakes]
current_amperes = {A = 0.4, B = 0.1}
[force]
file = "push.csv"
"""


def test_a_scene_writes_what_went_in_and_the_energies_balance(tmp_path, capfdbinary):
    (tmp_path / "scene.toml").write_text(IN_AND_OUT)
    (tmp_path / "push.csv").write_text("t_s,fx_N,fy_N\n0,0,0\n0.1,12,-3\n0.3,8,5\n")
    assert main(["simulate", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "motion.csv")]) == 0
    table = csv_rows(tmp_path / "motion.csv")
    column = {name: np.array([float(row[name]) for row in table]) for name in table[0] if name != "stuck"}
    t = column["t_s"]
    for name, values in (("hand_fx_N", [0, 12, 8]), ("hand_fy_N", [0, -3, 5])):
        assert column[name] == pytest.approx(np.interp(t, [0, 0.1, 0.3], values), abs=1e-9)
    currents = {joint: set(column[f"current_{joint}_A"]) for joint in "AEB"}
    assert currents == {"A": {0.4}, "E": {0.0}, "B": {0.1}} and "current_C_A" not in column
    left = column["work_hand_J"] - column["heat_brakes_J"] - column["kinetic_J"] - column["lost_at_stops_J"]
    assert np.abs(left).max() < 1e-6 < 1e-2 < column["work_hand_J"][-1]
    assert np.all(np.diff(column["heat_brakes_J"]) >= -1e-12)
    moved = np.gradient(column["tip_x_m"], t), np.gradient(column["tip_y_m"], t)
    power = column["hand_fx_N"] * moved[0] + column["hand_fy_N"] * moved[1]
    assert column["work_hand_J"][-1] == pytest.approx(np.trapezoid(power, t), rel=1e-2)
    capfdbinary.readouterr()
    assert main(["simulate", str(tmp_path / "scene.toml"), "--out", "-"]) == 0
    out, err = capfdbinary.readouterr()
    assert out == (tmp_path / "motion.csv").read_bytes() and b"301 rows" in err
    (tmp_path / "ideal.toml").write_text(IN_AND_OUT.replace('"mr"', '"ideal"').replace("current_amperes", "torque_N_m"))
    assert main(["simulate", str(tmp_path / "ideal.toml"), "--out", str(tmp_path / "ideal.csv")]) == 0
    header = (tmp_path / "ideal.csv").read_text().splitlines()[0]
    assert "current_" not in header and header.endswith("work_hand_J,heat_brakes_J,kinetic_J,lost_at_stops_J")


def test_a_row_shows_the_state_after_what_happens_at_its_time(scene, tmp_path: Path):
    more = '[brakes]\nschedule = "brakes.csv"\n[force]\nconstant_N = [3, 2]\n'
    s = scene(more, brakes="t_s,A,E,B\n0,5,5,5\n0.005,0,0,0\n0.0125,5,5,5\n")
    simulate(s, tmp_path / "out.csv")
    whole, run = SceneRun(s).run_chunk(21), SceneRun(s)
    assert np.array_equal(np.concatenate([run.run_chunk(8), run.run_chunk(13)]), whole)
    rows = [line.split(",") for line in (tmp_path / "out.csv").read_text().split("\n")[1:-1]]
    assert [float(row[0]) for row in rows] == [float(f"{k}e-3") for k in range(21)]
    tips = np.array([[float(cell) for cell in row[1:5]] for row in rows])
    assert all(row[8] == "AEB" for row in rows[:5]) and np.all(tips[:6] == tips[0])
    assert all(row[8] == "" and set(row[5:8]) == {"0"} for row in rows[5:13])
    assert np.all(np.diff(np.hypot(tips[5:13, 2], tips[5:13, 3])) > 0)
    assert all(set(row[5:8]) != {"0"} for row in rows[13:])


def test_a_scene_of_more_rows_than_are_made_at_once_has_each_of_them_once(scene, tmp_path: Path):
    summary = simulate(scene("[force]\nconstant_N = [0.1, 0.0]\n", ("= 0.02", "= 20.005")), tmp_path / "out.csv")
    rows = np.loadtxt(tmp_path / "out.csv", delimiter=",", skiprows=1, usecols=(0, 1, 3))
    assert summary["rows"] == len(rows) == 20_006 and np.array_equal(rows[:, 0], np.arange(20_006) / 1000.0)
    last = rows[19_900:]
    assert np.diff(last[:, 1]) == pytest.approx(0.5e-3 * (last[1:, 2] + last[:-1, 2]), abs=1e-7), "no jump"


def test_a_result_that_half_the_step_contradicts_carries_a_warning(scene, tmp_path: Path, capsys):
    """First order at 20 ms is off by millimetres and says so, in the summary, on stderr and in --json."""
    s = scene("integrator = 'stepping'\n[force]\nconstant_N = [20.0, 5.0]\n", ("= 0.02", "= 0.4"))
    coarse = replace(s, step_s=0.02, steps=20, output_every=1, output_interval_s=0.02)
    found = simulate(coarse, tmp_path / "coarse.csv")
    assert found["half_step_differs_m"] > 1e-3
    assert any("half the step" in sentence for sentence in found["warnings"])
    fine = simulate(replace(s, integrator="event"), tmp_path / "fine.csv")
    assert fine["half_step_differs_m"] < 1e-8 and fine["warnings"] == []
    path = tmp_path / "scene.toml"
    path.write_text(path.read_text().replace("step_s = 1e-3", "step_s = 0.02"))
    assert main(["simulate", str(path), "--out", str(tmp_path / "verb.csv"), "--json"]) == 0
    said = capsys.readouterr()
    assert said.err.startswith("warning: ")
    assert len(json.loads(said.out)["warnings"]) >= 1


BEHIND = """device = "four-brake"
duration_s = {}
step_s = 1e-3
initial_tip_m = [0.2, 0.36]
output_interval_s = {}
[force]
constant_N = {}
"""
AT_T = re.compile(r"the tip leaves the workspace at t = (\S+) s: it passes behind the bases, at \((\S+), (\S+)\) m")


def warnings_of(tmp_path, duration, interval, force):
    (tmp_path / "scene.toml").write_text(BEHIND.format(duration, interval, force))
    return simulate(read_scene(tmp_path / "scene.toml"), tmp_path / f"{duration}-{interval}.csv")["warnings"]


@pytest.mark.parametrize("interval", [0.5, 0.001])
def test_a_tip_that_passes_behind_its_bases_is_warned_of_once_however_far_apart_the_rows(tmp_path, interval):
    (warning,) = warnings_of(tmp_path, 2.0, interval, [4.0, -6.0])
    found = AT_T.fullmatch(warning)
    assert found and float(found[1]) == pytest.approx(0.59, abs=0.006) and -0.01 < float(found[3]) <= 0.0


def test_a_tip_that_is_pushed_against_a_hard_stop_has_not_left(tmp_path):
    assert warnings_of(tmp_path, 0.5, 0.01, [20.0, 60.0]) == []


def test_whatever_is_beyond_a_stop_or_out_of_reach_has_left_and_what_is_free_has_not():
    mechanism = load_device("four-brake").mechanism
    tips = free_tips(mechanism)
    leaving = Leaving(mechanism)
    leaving.look(np.arange(len(tips)) * 1e-3, *tips.T)
    assert leaving.warning == ""
    leaving.look(np.array([7.0, 8.0]), np.array([0.0, 0.0]), np.array([0.4, 5.0]))
    assert leaving.warning.startswith(
        "the tip leaves the workspace at t = 8 s: it is beyond a hard stop, at (0.000, 5.0"
    )


WALL = "[[obstacle]]\nhalf_plane_m = [0.0, 0.44, 0.0, -1.0]\n"
GUARD = "[guard]\npush_N = 10.0\n"
MR = 'fidelity = "mr"\n'
PUSH = "[force]\nconstant_N = [0.0, 10.0]\n"
GO, LOCKED = "", "lock"


@pytest.fixture
def with_guard(tmp_path: Path):
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
BAD_GUARDS = {
    "guard of ideal brakes": (WALL + GUARD, "guard needs fidelity 'static' or 'mr': it locks the brakes by their"),
    "guard of nothing": (MR + GUARD, "guard: there is no obstacle to guard"),
    "push beyond a full lock": (
        MR + WALL + "[guard]\npush_N = 500.0\n",
        r"guard: push_N \(500\) must be less than the \d+\.\d N that three-brake holds at initial_tip_m",
    ),
    "start in an obstacle": (
        MR + "[[obstacle]]\ndisc_m = [0.0, 0.36, 0.01]\n" + GUARD,
        r"initial_tip_m: \(0, 0.36\) m is in an obstacle, there is nothing to guard",
    ),
    "too many obstacles": (BOXES, "obstacle: they have 68 edges together, 64 at most"),
}  # fmt: skip


@pytest.mark.parametrize("more, says", BAD_GUARDS.values(), ids=BAD_GUARDS)
def test_a_guard_that_can_promise_nothing_is_refused_in_a_sentence(with_guard, more, says):
    with pytest.raises(InputError, match=says) as refusal:
        with_guard(more)
    assert "scene.toml" in str(refusal.value) and "\n" not in str(refusal.value)


@pytest.mark.parametrize("step", ["1.6e-3", "3.2e-4", "0.8"])
def test_a_step_that_a_look_of_the_guard_falls_into_is_refused(with_guard, step):
    assert with_guard(MR + WALL, step=step).step_s == float(step)
    if float(step) >= 0.8:
        assert with_guard(MR + WALL + GUARD, step=step).step_s == 1e-3
        return
    with pytest.raises(InputError, match=r"step_s \(.* s\) must be a whole number of milliseconds, or one"):
        with_guard(MR + WALL + GUARD, step=step)


@pytest.mark.parametrize("device", ["er-two-brake", "three-brake", "four-brake", "pter"])
def test_a_push_of_all_that_is_allowed_gets_in_without_the_guard_and_not_with_it(with_guard, tmp_path, device):
    columns, summary = ran(with_guard(MR + PUSH + WALL, device), tmp_path)
    assert summary["least_obstacle_m"] < 0.0 and "guard" not in columns and "guard_ticks" not in summary
    columns, summary = ran(with_guard(MR + PUSH + WALL + GUARD, device), tmp_path)
    assert summary["least_obstacle_m"] > 0.0 and summary["warnings"] == []
    assert summary["guard_ticks"] == 801 and 0 < summary["guard_locked_ticks"] < 801
    assert summary["guard_too_late_ticks"] == 0 and set(columns["guard"]) == {GO, LOCKED}


def test_hands_that_turn_and_feign_get_into_no_wall_by_any_integrator_or_step(with_guard, tmp_path):
    """The force file is what the person who doubts the promise writes: to and fro, aside, with pulls between."""
    rng = np.random.default_rng(8)
    for n in range(12):
        times = np.append(np.arange(0.0, 0.79, (0.02, 0.1, 0.3)[n % 3]), 0.8)
        ways = rng.uniform(-1.3, 1.3, len(times)) + math.pi * (rng.random(len(times)) < 0.25)
        force = "".join(f"{t},{10 * math.sin(a)},{10 * math.cos(a)}\n" for t, a in zip(times, ways, strict=True))
        for kind in ("event", "stepping"):
            how = f'fidelity = "{("mr", "static")[n % 2]}"\nintegrator = "{kind}"\n'
            guarded = with_guard(how + WALL + GUARD, ("er-two-brake", "three-brake", "pter")[n // 4], force=force)
            _, summary = ran(guarded, tmp_path)
            assert summary["least_obstacle_m"] > 0.0, (n, kind)
            sure = n // 4 != 0 or summary["guard_too_late_ticks"] == 0  # without play a turn changes nothing
            assert sure, (n, kind)


def test_obstacles_and_a_guard_that_need_not_lock_change_no_bit_of_the_motion(with_guard, tmp_path):
    force = "0,0,1\n0.113,4,-2\n0.3,-5,3\n0.8,6,-1\n"
    brakes = "[brakes]\ncurrent_amperes = {A = 0.3, B = 0.2}\n"
    far = "[[obstacle]]\nhalf_plane_m = [0.0, 1.5, 0.0, -1.0]\n"
    bare, _ = ran(with_guard(MR + brakes, force=force), tmp_path)
    beside, _ = ran(with_guard(MR + brakes + far, force=force), tmp_path)
    guarded, summary = ran(with_guard(MR + brakes + far + GUARD, force=force), tmp_path)
    assert list(bare)[-1] == "lost_at_stops_J" and summary["guard_locked_ticks"] == 0
    assert list(beside) == [*bare, "obstacle_m"] and list(guarded) == [*bare, "obstacle_m", "guard"]
    assert all(bare[name] == beside[name] == guarded[name] for name in bare)
    assert beside["obstacle_m"] == guarded["obstacle_m"] and set(guarded["guard"]) == {GO}
    away = 1.5 - np.array(bare["tip_y_m"], dtype=float)
    assert np.array(beside["obstacle_m"], dtype=float) == pytest.approx(away, abs=1e-15)


def test_the_guard_looks_every_millisecond_however_long_a_step_is(with_guard, tmp_path):
    last = {}
    for step in ("1e-4", "1e-3", "5e-3"):
        columns, summary = ran(with_guard(MR + "output_interval_s = 5e-3\n" + PUSH + WALL + GUARD, step=step), tmp_path)
        assert summary["least_obstacle_m"] > 0.0 and summary["guard_ticks"] == 801 and summary["warnings"] == []
        assert len(columns["t_s"]) == 161
        last[step] = np.array([float(columns[name][-1]) for name in ("tip_x_m", "tip_y_m")])
    assert np.array_equal(last["5e-3"], last["1e-3"]), "a scene step of 5 ms is five steps"
    assert last["1e-4"] == pytest.approx(last["1e-3"], abs=1e-4)


def test_a_lock_replaces_the_schedule_and_the_schedule_has_its_say_again(with_guard, tmp_path):
    """The hand pushes, is stopped, and pulls away: the brakes it then feels are those of the schedule."""
    force = "0,0,10\n0.5,0,10\n0.51,0,-10\n0.8,0,-10\n"
    (tmp_path / "brakes.csv").write_text("t_s,A,B\n0,0,0\n0.1003,0.1,0\n0.6,0.1,0.1\n")
    guarded = with_guard(MR + '[brakes]\nschedule = "brakes.csv"\n' + WALL + GUARD, force=force)
    columns, summary = ran(guarded, tmp_path)
    words, y = columns["guard"], np.array(columns["tip_y_m"], dtype=float)
    assert words[0] == GO and LOCKED in words[:450] and words[510:680] == [GO] * 170
    assert y[-1] < y[500] - 0.01 and summary["least_obstacle_m"] > 0.0
    first = words.index(LOCKED)
    free = replace(guarded, around=Around(obstacles=guarded.around.obstacles))
    alone = SceneRun(free).run_chunk(free.rows)
    assert np.array_equal(alone[: first + 1, 2], y[: first + 1]), "until the first lock it is the schedule's motion"


def test_a_hand_that_pushes_harder_than_the_guard_allows_for_is_named(with_guard, tmp_path, capsys):
    push = "0,0,4\n0.4,3,12.0\n0.8,0,0\n"
    _, summary = ran(with_guard(MR + WALL + GUARD, force=push), tmp_path)
    assert summary["warnings"][-1].startswith("the hand pushes with up to 12.37 N, more than the 10 N (push_N)")
    after = "0,0,10\n0.8,0,10\n0.9,0,90\n"  # the file goes on after the scene has ended
    assert ran(with_guard(MR + WALL + GUARD, force=after), tmp_path)[1]["warnings"] == []
