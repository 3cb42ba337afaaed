"""Files of one's own beside a protocol: the shipped example of a controller, and a protocol that names it."""

from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[2] / "docs/examples/protocols"
DAMPER, MEASURE = ((EXAMPLES / name).read_text(encoding="utf-8") for name in ("my_damper.py", "my_measure.py"))
PROTOCOL = """
name = "dampers"
provenance = "assumed"
devices = ["three-brake"]
blocks = 1
[[path]]
kind = "segment"
start_m = [-0.05, 0.40]
end_m = [0.05, 0.40]
[[controller]]
name = "Damper"
algorithm = "my_damper.py"
parameters = {damping_N_s_m = 500.0}
"""
FREE = """
[[controller]]
name = "Free"
kind = "none"
"""


def own_experiment(folder: Path, text: str = PROTOCOL + FREE, **files: str) -> Path:
    """A protocol in a folder, with the files that it names; files: others, or other texts, by name without .py."""
    for name, code in {"my_damper": DAMPER, "my_measure": MEASURE, **files}.items():
        (folder / f"{name}.py").write_text(code, encoding="utf-8")
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    return folder / "mine.toml"
