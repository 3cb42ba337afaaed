"""The first hour with an experiment of one's own: a folder to start from, words nearly right, completion."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest

from app.cli import main, make_parser, with_verb
from core.device import load_device, shipped_devices
from core.workspace import free_tips


def test_the_command_line_takes_every_command_that_a_page_shows():
    root = Path(__file__).resolve().parents[2]
    pages = [root / "README.md", *root.glob("docs/*.md"), root / "app/verbs/new_experiment/README.md"]
    blocks = re.findall(r"^```sh\n(.*?)^```", "".join(page.read_text(encoding="utf-8") for page in pages), re.M | re.S)
    shown = re.findall(r"^(?:\./)?phd\b(.*)$", "".join(blocks), re.M)
    commands = [words for line in shown if (words := shlex.split(line, comments=True))[:1] != ["test"]]
    parser = make_parser()
    assert len(commands) > 15 and [words for words in commands if parser.parse_known_args(with_verb(words))[1]] == []


@pytest.mark.parametrize("device", shipped_devices())
def test_a_new_experiment_can_be_planned_and_a_misspelt_key_of_it_is_asked_about(device: str, tmp_path: Path, capsys):
    folder = tmp_path / "mine"
    assert main(["new", str(folder), "--device", device]) == 0
    protocol = folder / "experiment.toml"
    assert main(["run", str(protocol), "--print-plan"]) == 0
    assert "18 trials" in capsys.readouterr().out
    assert main(["new", str(folder)]) == 2, "nothing is overwritten"
    protocol.write_text(protocol.read_text().replace("blocks", "bloks"))
    assert main(["run", str(protocol), "--print-plan"]) == 2
    assert "unknown key bloks, did you mean blocks?" in capsys.readouterr().err


def test_a_path_out_of_reach_is_refused_with_how_far_the_device_reaches(tmp_path: Path, capsys):
    assert main(["new", str(tmp_path / "mine")]) == 0
    protocol = tmp_path / "mine/experiment.toml"
    protocol.write_text(protocol.read_text().replace("[0.10, 0.40]", "[0.10, 0.80]"))
    assert main(["run", str(protocol), "--print-plan"]) == 2
    said = capsys.readouterr().err
    place, x, y = re.search(r"at \((.+)\) m \(of x (.+) m, y (.+) m\)$", said.strip()).groups()
    tips = free_tips(load_device("three-brake").mechanism)
    for text, axis in ((x, 0), (y, 1)):
        ends = [float(end) for end in text.split(" to ")]
        assert ends == pytest.approx([tips[:, axis].min(), tips[:, axis].max()], abs=5e-4)
    assert float(place.split(", ")[1]) > 0.4


def test_a_shell_completes_the_verbs(tmp_path: Path, capsys):
    assert main(["completion", "bash"]) == 0
    (script := tmp_path / "phd.bash").write_text(capsys.readouterr().out)
    asked = "COMP_WORDS=(phd stu); COMP_CWORD=1; COMPREPLY=(); _shtab_phd phd stu phd; echo ${COMPREPLY[@]}"
    ask = f"source {script}; {asked}"
    found = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True).stdout
    assert found.split() == ["study"]
