"""An experiment of one's own in twenty minutes: the page's files are written and its commands run as they stand, but
that `phd power` counts people on a shorter plan. The table of results is what the study gives."""

import re
import shlex
from pathlib import Path

import pytest
from simulated_loop import local_window

from app.cli import main, make_parser
from app.frames import load_trials
from app.ipc import messages as m
from app.ipc.messages import Setup
from experiments.protocol import load_protocol

PAGE = Path(__file__).resolve().parents[2] / "docs/your-own-experiment.md"
#: a file, named at the beginning of the line above its block, or commands
BLOCK = re.compile(r"(?:^`([\w.-]+)`[^\n]*:\n\n)?^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SESSION_TRIALS = 2
#: outputs that the page names after a verb
LEFT = {
    "study": ("study-1/report/report.md", "study-1/figures/boxplots.png", "study-1/trials.csv"),
    "power": ("power-1/power.png", "power-1/power.csv"),
    "analyze": ("analysis-1/report/report.md", "analysis-1/figures/boxplots.png"),
    "export": ("csv-1/README.md", "csv-1/trials.csv", "bids-1/dataset_description.json"),
}


def run_session(words: list[str]) -> None:
    """`phd run` with its window's button pressed for it, until the trials that the page asks for are kept."""
    args = make_parser().parse_args(words)
    setup = Setup(args.data_dir.absolute(), args.protocol, hand=args.input, participant=args.participant, sync=False)
    with local_window(setup) as window:
        window.open(args.participant)
        for done in range(SESSION_TRIALS):
            window.client.send(m.Start())
            window.until(lambda s, done=done: len(s.rows) > done and s.stage == m.READY)


def in_short(protocol: Path) -> str:
    """The same experiment on one path, without repetitions."""
    text = re.sub(r"(?m)^(blocks|repetitions) = \d+", r"\1 = 1", protocol.read_text(encoding="utf-8"))
    before, *paths = re.split(r"(?m)^(?=\[\[path\]\])", text)
    text = before + paths[0] + paths[-1][paths[-1].index("\n[") + 1 :]
    Path("short.toml").write_text(text, encoding="utf-8")
    return "short.toml"


def test_every_command_of_the_page_runs_and_leaves_what_the_page_names(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    said = {}
    steps, _, rest = PAGE.read_text(encoding="utf-8").partition("\n## People\n")
    for name, language, text in BLOCK.findall(steps):
        if language != "sh":
            assert name, f"a block without the name of its file:\n{text}"
            Path(name).write_text(text, encoding="utf-8")
            continue
        for line in text.splitlines():
            program, *words = shlex.split(line)
            if words[:1] == ["power"]:
                words[1] = in_short(Path(words[1]))
            if program == "cd":
                monkeypatch.chdir(words[0])
            elif words[0] == "run" and "--print-plan" not in words:
                run_session(words)
            else:
                assert program == "phd" and main(words) == 0, (line, capsys.readouterr().err)
                said[words[0]] = capsys.readouterr().out
            for output in LEFT.get(words[0], ()):
                assert Path(output).exists(), (line, output)
    assert said.keys() >= {"new", "check-controller", "run", "verify", *LEFT}
    medians = load_trials("study-1").query("status == 'done'").groupby(["path", "controller_name"])["path_error_m"]
    for number, row in enumerate(re.findall(r"^\| (?:star|spiral|letter) \| (.*) \|$", steps, re.MULTILINE), 1):
        found = 1e3 * medians.median()[number][["No control", "Soft guide", "Stiff guide", "Damper"]]
        assert found.tolist() == pytest.approx([float(cell) for cell in row.split(" | ")], abs=0.02)
    people, _, tables = BLOCK.search(rest)[3].partition("\n\n")
    Path("people.toml").write_text(f"{people}\n" + Path("experiment.toml").read_text() + tables, encoding="utf-8")
    assert load_protocol("people.toml").blind
    assert "24 trials" in said["run"] and "small-five-bar (assumed)" in said["run"]
    assert "checks: passed" in said["check-controller"] and "failed           0" in said["check-controller"]
    assert re.search(r"\d+ people \(95 %", said["power"])
    assert all(name in Path("study-1/report/report.md").read_text() for name in ("Soft guide", "Damper"))
