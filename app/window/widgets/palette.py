"""The colours, dark and light, of the same meaning. A window knows a colour by its role: what it is for."""

from typing import NamedTuple

from experiments.analysis.colours import ON_DARK, ON_LIGHT


class Palette(NamedTuple):
    """What each colour is for."""

    ground: str  # behind everything
    panel: str
    field: str  # buttons
    canvas: str  # the workspace and the participant's view: set off from the panels, so that what moves stands out
    line: str
    edge: str  # of cards, that lie over panels
    text: str
    quiet: str
    good: str
    bad: str
    caution: str
    bad_ground: str  # behind what is wrong
    bad_text: str  # on it
    on_bad: str  # text on `bad` itself
    brake_off: str  # also: what cannot be used now
    brake_slipping: str
    brake_stuck: str
    arm: str
    arm_core: str
    pointer: str
    end_ring: str
    trace: str
    accent: str
    accent_ground: str  # behind the text of what comes first
    handle: str  # and the path
    handle_name: str  # its colour, to the participant
    wedge: str
    wedge_edge: str
    joints: tuple[str, str, str, str]  # A, E, B, C: no hue, which would mean a controller
    controllers: tuple[str, ...]  # 1 ..

    @property
    def start_ring(self) -> str:
        return self.good


#: The colours of brakes are from Okabe and Ito's set; in the light palette the same hues are darker. Nothing is said by
#: colour alone.
DARK = Palette(
    ground="#12161b", panel="#1a2027", field="#242c35", canvas="#0d1115", line="#2a323c", edge="#3d4854",
    text="#e6eaee", quiet="#8b96a3", good="#3fb68b", bad="#e5604d", caution="#e0a33e",
    bad_ground="#3a1c1a", bad_text="#f3a598", on_bad="#180806",
    brake_off="#5b6672", brake_slipping="#e69f00", brake_stuck="#d55e00",
    arm="#2e363f", arm_core="#505b67", pointer="#c6ced6", end_ring="#e69f00",
    trace="#58b4e8", accent="#4f9de0", accent_ground="#1f4b7a", handle="#ffffff", handle_name="white",
    wedge="#cc79a7", wedge_edge="#7d5070",
    joints=("#f3f3f3", "#c2c2c2", "#949494", "#6c6c6c"), controllers=ON_DARK,
)  # fmt: skip
LIGHT = Palette(
    ground="#e9edf1", panel="#fbfcfd", field="#e3e8ed", canvas="#f5f7f9", line="#cfd6dd", edge="#aab4be",
    text="#1b2229", quiet="#56616c", good="#0b6e4b", bad="#b3301f", caution="#835400",
    bad_ground="#fbe3df", bad_text="#8c2013", on_bad="#ffffff",
    brake_off="#7c8792", brake_slipping="#8a5c00", brake_stuck="#b04a00",
    arm="#c3ccd5", arm_core="#8d99a5", pointer="#46505a", end_ring="#c47400",
    trace="#1c6fa8", accent="#1d6cba", accent_ground="#cde2f7", handle="#12161b", handle_name="dark",
    wedge="#b5568a", wedge_edge="#c98bad",
    joints=("#141414", "#3e3e3e", "#686868", "#919191"), controllers=ON_LIGHT,
)  # fmt: skip
PALETTES = {"dark": DARK, "light": LIGHT}
#: in place of each colour its role
ROLES: Palette = Palette._make(
    role if isinstance(colour, str) else tuple(f"{role}-{place}" for place in range(len(colour)))
    for role, colour in DARK._asdict().items()
)
chosen = DARK  # of this process


def choose(name: str) -> None:
    """The palette of this process, by its name."""
    global chosen
    chosen = PALETTES.get(name, DARK)


def colour_for(role: str) -> str:
    """The colour of a role in the chosen palette; a colour stays as it is."""
    name, _, place = role.partition("-")
    found = getattr(chosen, name, role)
    return found[int(place)] if place else found
