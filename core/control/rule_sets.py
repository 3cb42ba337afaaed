"""The two named rule sets of the controllers: the paper's rules read literally, and the same rules settled.

Read literally the rules deadlock (at rest no brake has a direction, so the slightest outward force locks all) and
chatter (the sign of a stuck joint's rate is noise). `settled` is our choice; its points are numbered here 1 to 6.
A controller that decides otherwise is a new rule set, never a silent change of one of these.
"""

from typing import NamedTuple

from core.files import InputError


class Rules(NamedTuple):
    """Thresholds of the decision, those of `settled`: unit, then what breaks at the wrong value."""

    # (1) At rest, decide with the motion that is about to begin: rest_speed along M^-1 F.
    rest_speed: float = 0.002  # m/s. Zero: at rest no brake has a direction, a start deadlocks
    felt_force: float = 0.5  # N. Too small: sensor noise picks the brake; too large: late at the start
    # (2) A joint this slow is stuck or turning: take the sense in which the hand is about to turn it.
    still_rate: float = 0.02  # rad/s. Zero: rounding picks the sense, and a wrong stuck brake holds the tip on its arc
    # (3) The hand pushes away from the path if its outward force exceeds both.
    away_force: float = 0.5  # N. Zero: a push of noise locks all brakes
    away_share: float = 0.5  # of |F|. Zero: a push along the path that leans out by a degree locks all brakes
    # (4) The travel sense turns only if the hand pushes back along the path, and the motion does not disagree.
    turn_force: float = 1.0  # N. Zero: t flips with noise as the hand lets go, and beta by up to 180 degrees with it
    turn_speed: float = 0.005  # m/s. Zero: noise forbids a turn; large: t flips when the hand only slows the tip down
    # (5) v_beta_x below minus this locks (at least four times the velocity noise).
    back_speed: float = 0.005  # m/s. Zero: velocity noise of 1 mm/s locks some hundred times a second
    # Both sets.
    least_shown: float = 0.5  # N. Zero: brakes come on for a force that is not felt, and stay on by noise
    on_path: float = 1e-9  # m. (6) This near is d = 0 and the last side is kept: above rounding, far below any encoder
    span_rounding: float = 1e-9  # of a unit vector. Zero: an SDOF path along t or n itself is in or out by rounding
    no_effect: float = 0.02  # of |force|: a smaller component counts as none in H. Zero: [0 -1] is never seen
    along_beta: bool = True  # H_x: True: along +beta counts as increasing; False: as the paper words it


SETTLED = Rules()
LITERAL = SETTLED._replace(  # thresholds that never act
    rest_speed=0.0, felt_force=0.0, still_rate=0.0, away_force=0.0, away_share=0.0, turn_force=0.0,
    turn_speed=float("inf"), back_speed=0.0, along_beta=False,
)  # fmt: skip

RULE_SETS = {"settled": SETTLED, "literal": LITERAL}

NOISE_MARGIN = 4.0  # back_speed over the velocity noise: a normal noise exceeds it 30 times in a million ticks


def rule_set(name: str, velocity_noise: float = 0.0) -> Rules:
    """The named rule set; `settled` widens back_speed (5) to four times the velocity noise (m/s, rms)."""
    if name not in RULE_SETS:
        raise InputError(f"rules: {name!r} is not one of {', '.join(RULE_SETS)}")
    if not 0.0 <= velocity_noise < float("inf"):
        raise InputError(f"rules: velocity noise {velocity_noise!r} must be finite and not negative, in m/s")
    rules = RULE_SETS[name]
    if name == "settled":
        rules = rules._replace(back_speed=max(rules.back_speed, NOISE_MARGIN * float(velocity_noise)))
    return rules
