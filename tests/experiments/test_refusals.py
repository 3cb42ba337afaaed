"""What is asked wrongly on the command line: exit code 2, one sentence, nothing computed and nothing written."""

import pytest
from refusals import refusal
from sessions import files

HERE = "{here}"  # a folder with a file `mine`, a sweep file, an empty folder and a figure
WRONG = {
    "study into a folder with files": (["study", "--out", HERE], "not empty"),
    "study below a file": (["study", "--out", f"{HERE}/mine/below"], "cannot be used"),
    "study of no operator": (["study", "--operators", "0", "--out", "out"], "--operators"),
    "study on a cluster": (["study", "--cluster", "tcp://x:1", "--out", "out"], "--cluster: is for --sweep alone"),
    "sweep and operators": (
        ["study", "--sweep", f"{HERE}/sweep.toml", "--operators", "3", "--out", "out"],
        "--operators: stands in the file of a sweep",
    ),
    "analyze of nothing": (["analyze", f"{HERE}/empty"], "no recordings"),
    "analyze of no folder": (["analyze", f"{HERE}/gone"], "there is no such folder"),
    "export of no session": (["export", HERE, "--csv", "out"], "holds no session"),
    "export to nowhere": (["export", HERE], "nothing to write"),
    "replay of nothing": (["replay", f"{HERE}/gone.parquet", "--json"], "cannot be read"),
    "figures over a file": (["figures", "--out", f"{HERE}/mine"], "mine"),
    "figures over a figure": (["figures", "--out", HERE], "displays.pdf: exists already"),
    "figures of an unknown device": (["figures", "--out", "out", "--device", "six-brake"], "unknown device"),
    "figures to nowhere": (["figures"], "--out"),
    "bench over a folder": (["bench", "--out", HERE], "never overwritten"),
    "bench below no folder": (["bench", "--out", f"{HERE}/gone/b"], "gone"),
    "identify with a speed of 0": (["identify", f"{HERE}/mine", "--omega-0", "0"], "--omega-0: must be"),
    "identify with no backlash": (["identify", f"{HERE}/mine", "--backlash-deg", "nan"], "--backlash-deg: must be"),
    "identify below no folder": (["identify", f"{HERE}/mine", "--out", f"{HERE}/gone/b.toml"], "folder does not exist"),
    "simulate over a file": (["simulate", f"{HERE}/scene.toml", "--out", f"{HERE}/mine"], "exists already"),
}


@pytest.mark.parametrize("arguments, says", WRONG.values(), ids=WRONG)
def test_what_is_asked_wrongly_is_one_sentence_and_leaves_nothing(arguments, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    for name in ("mine", "displays.pdf"):
        (tmp_path / name).write_text("mine")
    (tmp_path / "sweep.toml").write_text('name = "it"\noperators = 1\n[[controller]]\nkind = "none"\n')
    scene = 'device = "three-brake"\nduration_s = 0.01\nstep_s = 1e-3\ninitial_tip_m = [0.05, 0.40]\n'
    (tmp_path / "scene.toml").write_text(scene)
    before = files(tmp_path)
    assert says in refusal(capsys, *(argument.replace(HERE, str(tmp_path)) for argument in arguments))
    assert files(tmp_path) == before and not (tmp_path / "out").exists()
