"""What a board makes of a trial's measures."""

from experiments.protocol import load_protocol
from tests.benchmarks.board_bench import on_the_board, on_the_simulated_device, settings

#: By which a trial of controllers 1, 3 and 5 on the board may differ from the simulated one (docs/bench.md).
TOLERANCE = {"path_error_m": 0.05, "mean_tip_force_N": 0.01, "acceleration_dft_sum": 0.07, "duration_s": 0.01}


def test_a_board_changes_the_measures_by_less_than_the_stated_tolerance() -> None:
    trials = settings(load_protocol(low_gain=5.0, sensing="ideal"))
    setting = next(
        one for one in trials if one.planned.configuration == "four-brake" and one.planned.controller == 3
    )  # fmt: skip
    (there, here), (status, board) = on_the_simulated_device(setting), on_the_board(setting)
    assert status == there == "done"
    off = {name: abs(board[name] / here[name] - 1.0) for name in TOLERANCE}
    assert all(off[name] <= most for name, most in TOLERANCE.items()), off
    assert max(off.values()) > 0.0, "the board leaves no mark"
