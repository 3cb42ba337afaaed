"""`phd bench --scale`: what each command costs on studies of several sizes."""

import pytest
from protocols import short

from app.verbs import growth
from app.verbs.growth import Cost, cost_of, measure_all, table
from core.files import InputError


def test_every_command_is_measured_on_every_study(monkeypatch, tmp_path):
    (tmp_path / "short.toml").write_text(short(paths=1).text)

    def of_short_studies(name, trials, arguments, out):
        protocol = [str(tmp_path / "short.toml")] if name == "study" else []
        return cost_of(name, trials, (arguments[0], *protocol, *arguments[1:]), out)

    monkeypatch.setattr(growth, "cost_of", of_short_studies)
    monkeypatch.setattr(growth, "PEOPLE", (1,))
    monkeypatch.setattr(
        growth,
        "COMMANDS",
        {"verify": ("verify", "{study}"), "export --csv --compress": growth.COMMANDS["export --csv --compress"]},
    )
    done = []
    rows = measure_all(done.append)
    assert [(row["command"], row["trials"]) for row in rows] == [
        ("study", 60), ("verify", 60), ("export --csv --compress", 60)
    ]  # fmt: skip
    assert all(row["seconds"] > 0.1 and row["memory_MB"] > 10.0 for row in rows) and done[-1] == 1.0
    assert [row["written_MB"] > 1.0 for row in rows] == [True, False, True]


def test_a_command_that_fails_is_named(tmp_path):
    with pytest.raises(InputError, match=r"phd verify: ended with 2 .*nowhere"):
        cost_of("verify", 0, ("verify", str(tmp_path / "nowhere")), tmp_path)


def test_the_table_gives_start_slope_and_power():
    costs = [Cost("verify", n, 0.5 + 0.01 * n, 100.0, 0.0)._asdict() for n in (100, 200, 400)]
    line = next(line for line in table(costs).splitlines() if line.startswith("verify"))
    assert line.split() == ["verify", "1.50", "2.50", "4.50", "0.5", "10.0", "0.85", "100", "100", "0.000"]
