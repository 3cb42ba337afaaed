"""The result of `phd bench` as a table and as the work-precision plot."""

from collections.abc import Iterable

import matplotlib

from experiments.analysis.sheet import BLUE, BROWN, GREY, ORANGE, PAGE_IN, PALE, STYLE, figure_bytes, new_figure
from experiments.benchmark.bench import PEERS

#: step of the rows that the table shows
TABLE_STEP_S = 1e-3
#: Integrator and fidelity -> colour and marker.
_LOOKS = {
    ("event", "ideal"): (BLUE, "o"),
    ("event", "mr"): (PALE, "s"),
    ("stepping", "ideal"): (BROWN, "^"),
    ("karnopp", "ideal"): (ORANGE, "v"),
    ("mujoco", "ideal"): (GREY, "D"),
}
_SCENES_DRAWN = ("S1", "S2", "S4")  # in S3 nothing moves


def table(result: dict) -> str:
    """All integrators at 1 ms, the check of the reference, delta_omega and the costs."""
    lines = [
        f"{'':40}  us a  4 acc.              RMS     largest S3 creep         fall-",
        f"{'integrator':15} {'device':18} scene  step      us  ratio    error m     error m      m/s  events backs"
        "  order",
    ]
    for row in (row for row in result["rows"] if row["step_s"] == TABLE_STEP_S):
        four = row["four_accelerations_us"]
        lines.append(
            f"{row['integrator']:8} {row['fidelity']:6} {row['device']:18} {row['scene']:5} {row['us_per_step']:5.3f} "
            f"{_or_blank(four, '7.3f')} {_or_blank(four and row['us_per_step'] / four, '6.2f')} "
            f"{row['rms_error_m']:10.1e} {row['max_error_m']:11.1e} {_or_blank(row['creep_m_s'], '8.1e')} "
            f"{_or_blank(row['events'], '7d')} {_or_blank(row['fallbacks'], '5d')} {_or_blank(row['order'], '6.2f')}"
        )
    reference = result["reference"]
    lines += ["", f"reference: event at {1e6 * reference['step_s']:.0f} us a step; its largest distance (m) from",
              f"{reference['against']}, up to the first touch of a hard stop"]  # fmt: skip
    lines += [
        f"  {c['fidelity']:6} {c['device']:18} {c['scene']}  {c['max_difference_m']:.1e} in {c['compared_s']:.2f} s"
        for c in reference["checks"]
    ]
    lines += ["", *_compared(result["rows"])]
    lines += ["", "karnopp at 1 ms: RMS error (m), and creep of locked brakes (m/s), against delta_omega (rad/s)"]
    lines += [
        f"  {k['device']:18} {k['scene']}  {k['delta_omega_rad_s']:7.0e}  "
        + (f"{k['rms_error_m']:.1e} m" if k["creep_m_s"] is None else f"{k['creep_m_s']:.1e} m/s")
        for k in result["karnopp"]
    ]
    lines += ["", "one step of 1 ms from Python, with a new force (us)"]
    for cost in result["python"]:
        peers = "".join(f"   {PEERS[name].name} {cost[name]:.1f}" for name in PEERS if name in cost)
        lines.append(f"  {cost['device']:18} phd.Simulation {cost['event']:.1f}{peers}")
    tick = result["tick"]
    lines += ["", f"a whole control tick  {tick['us_per_tick']:.2f} us"]
    lines += [
        f"{tick['trials']} trials of a study    {tick['study_simulation_s']:.2f} s of computing, {tick['ticks']} ticks"
    ]
    return "\n".join(lines)


def _or_blank(value: float | None, form: str) -> str:
    width = form.split(".")[0].rstrip("d")
    return f"{'-':>{width}}" if value is None else f"{value:{form}}"


def _compared(rows: Iterable[dict]) -> list[str]:
    """`event` against its peers on the moving scenes: at equal step, and at equal error."""
    rows = [row for row in rows if row["scene"] in _SCENES_DRAWN and row["fidelity"] == "ideal"]
    lines = []
    for integrator, other in PEERS.items():
        found = [row for row in rows if row["integrator"] == integrator and row["step_s"] == TABLE_STEP_S]
        if found:
            lines += [f"event against {other.name} at 1 ms", *_ratios(rows, found)]
        else:
            lines.append(f"{other.name} is not installed (pip install -c constraints.txt '.[bench]')")
    return lines


def _ratios(rows: list[dict], peers: list[dict]) -> list[str]:
    """A line for each row of a peer, against the rows of `event` on the same scene."""
    lines = []
    for peer in peers:
        same = [row for row in rows if (row["device"], row["scene"]) == (peer["device"], peer["scene"])]
        own = [row for row in same if row["integrator"] == "event"]
        at = next(row for row in own if row["step_s"] == peer["step_s"])
        as_good = min((r for r in own if r["rms_error_m"] <= peer["rms_error_m"]), key=lambda r: r["wall_s_per_sim_s"])
        lines.append(
            f"  {peer['device']:18} {peer['scene']}  "
            f"equal step: {peer['us_per_step'] / at['us_per_step']:.0f} times faster, "
            f"error {peer['rms_error_m'] / at['rms_error_m']:.0e} times smaller; no worse error: at least "
            f"{peer['wall_s_per_sim_s'] / as_good['wall_s_per_sim_s']:.0f} times faster"
        )
    return lines


def work_precision(result: dict) -> dict[str, bytes]:
    """The work-precision plot, RMS error over time per simulated second, as "png" and "pdf"."""
    rows = result["rows"]
    devices = list(dict.fromkeys(row["device"] for row in rows))
    with matplotlib.rc_context(STYLE):
        figure = new_figure(PAGE_IN, 2.1 * len(devices) + 0.7)
        axes = figure.subplots(len(devices), len(_SCENES_DRAWN), sharex=True, sharey=True, squeeze=False)
        for device, line in zip(devices, axes, strict=True):
            for scene, ax in zip(_SCENES_DRAWN, line, strict=True):
                for (integrator, fidelity), (colour, marker) in _LOOKS.items():
                    own = [row for row in rows if row["rms_error_m"] > 0.0 and
                           (row["integrator"], row["fidelity"], row["device"], row["scene"])
                           == (integrator, fidelity, device, scene)]  # fmt: skip
                    if own:
                        name = integrator if fidelity == "ideal" else f"{integrator}, with lag and backlash"
                        spent = [1e3 * row["wall_s_per_sim_s"] for row in own]
                        ax.loglog(spent, [row["rms_error_m"] for row in own], color=colour, marker=marker, label=name,
                                  markersize=4, linewidth=1.0)  # fmt: skip
                ax.set_title(f"{scene}, {device}")
                ax.grid(True, linewidth=0.3)
        axes[-1][len(_SCENES_DRAWN) // 2].set_xlabel("Computing time (ms) per simulated second")
        for line in axes:
            line[0].set_ylabel("RMS tip error (m)")
        handles, labels = axes[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=len(labels), frameon=False)
        figure.suptitle("Error against computing time, steps of 5 to 0.1 ms")
        figure.tight_layout(rect=(0.0, 0.4 / figure.get_figheight(), 1.0, 1.0))
    return {form: figure_bytes(figure, form) for form in ("png", "pdf")}
