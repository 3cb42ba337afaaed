"""Ticks for tests of what is drawn: quiet ones to change by hand, and a whole made-up trial."""

import math

import numpy as np

from core import tick_log
from core.control.velocity_field import field_around
from core.device import Device
from core.path import Path, PathFile, Segment, build_path, outline
from core.workspace import brake_rows

TICKS_PER_S = 1000
ALONG = Segment((-0.10, 0.40), (0.10, 0.40))
ACROSS = Segment((-0.08, 0.26), (0.08, 0.42))
TIP = (0.02, 0.39)


def quiet(n: int = 16, phase: int = tick_log.MOVE, start_s: float = 0.0, **columns: float) -> np.ndarray:
    """n ticks at TIP beside ALONG; columns by their names in core.tick_log, as TIP_X=0.1 or CURRENT_B=0.4."""
    rows = np.zeros((n, tick_log.WIDTH))
    rows[:, tick_log.T] = start_s + 1e-3 * np.arange(n)
    rows[:, tick_log.PHASE] = phase
    rows[:, tick_log.TIP_X], rows[:, tick_log.TIP_Y] = TIP
    for name, value in columns.items():
        base, _, joint = name.rpartition("_")
        at = getattr(tick_log, base) + "AEBC".index(joint) if base in ("CURRENT", "TORQUE") else getattr(tick_log, name)
        rows[:, at] = value
    fill_field(build_path(ALONG, "path"), rows)
    return rows


def fill_field(path: Path, rows: np.ndarray) -> None:
    """Fill the field of a path into ticks (n, tick_log.WIDTH) of a hand that never turns back; NaN outside `move`."""
    rows[:, tick_log.PATH_DISTANCE : tick_log.DESIRED_Y + 1] = np.nan
    rows[:, tick_log.TRAVEL_SENSE] = 1.0
    moves = rows[:, tick_log.PHASE] == tick_log.MOVE
    field = field_around(path, rows[moves, tick_log.TIP_X : tick_log.TIP_Y + 1], 1.0)
    rows[moves, tick_log.PATH_DISTANCE] = np.copysign(field.distance, field.t_y * field.n_x - field.t_x * field.n_y)
    rows[moves, tick_log.FORWARD_X : tick_log.DESIRED_Y + 1] = np.column_stack(
        (field.t_x, field.t_y, field.beta_x, field.beta_y)
    )


def trial(device: Device, path: PathFile = ALONG, seconds: float = 4.0, seed: int = 1) -> np.ndarray:
    """Ticks (n, WIDTH) of a made-up trial: approach, hold, a wavering move along the path, end. Not mechanics."""
    generator = np.random.default_rng(seed)
    n, wait, rest = int(seconds * TICKS_PER_S), 1000, 300
    t = np.arange(n) / TICKS_PER_S
    s = np.clip((np.arange(n) - wait) / max(n - wait - rest, 1), 0.0, 1.0)
    points = np.asarray(outline(path, 0.002))
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    tip = np.column_stack([np.interp(s * along[-1], along, points[:, i]) for i in range(2)])
    tip[:, 1] += 0.004 * np.sin(math.pi * s) * np.sin(2.3 * t)
    tip[:, 0] += 0.002 * np.sin(math.pi * s) * np.sin(3.1 * t)
    rows = np.zeros((n, tick_log.WIDTH))
    rows[:, tick_log.T] = t
    rows[:, tick_log.PHASE] = np.select(
        [t < 0.5, s <= 0.0, s < 1.0], [tick_log.APPROACH, tick_log.HOLD, tick_log.MOVE], tick_log.END
    )
    rows[:, tick_log.TIP_X : tick_log.TIP_Y + 1] = tip
    rows[:, tick_log.PATH_DISTANCE], rows[:, tick_log.TRAVEL_SENSE] = tip[:, 1] - 0.4, 1.0
    velocity = np.gradient(tip, 1.0 / TICKS_PER_S, axis=0)
    rows[:, tick_log.TIP_VX : tick_log.TIP_VY + 1] = velocity
    push = 6.0 * np.sin(math.pi * s) * (1.0 + 0.3 * np.sin(5.0 * t)) + 0.1 * generator.normal(size=n)
    rows[:, tick_log.HAND_FX], rows[:, tick_log.HAND_FY] = (
        push * np.cos(0.3 * np.sin(t)),
        push * np.sin(0.3 * np.sin(t)),
    )
    wanted = tip + rows[:, tick_log.HAND_FX : tick_log.HAND_FY + 1] / 150.0
    rows[:, tick_log.TARGET_X : tick_log.TARGET_Y + 1] = wanted
    moving = rows[:, tick_log.PHASE] == tick_log.MOVE
    on = [("AEBC".index(joint), np.sin(4.0 * t + 1.7 * k) > 0.2) for k, joint in enumerate(device.braked)]
    for i, acts in on:
        rows[:, tick_log.CURRENT + i] = np.where(acts & moving, 0.3 + 0.2 * i, 0.0)
        rows[:, tick_log.STUCK] += np.where(acts & moving & (np.sin(9.0 * t + i) > 0.3), 1 << i, 0)
    maps = np.array([brake_rows(device.mechanism, *place) for place in tip[::20]]).repeat(20, axis=0)[:n]
    rates = np.einsum("nij,nj->ni", maps, velocity)
    for i, _ in on:
        rows[:, tick_log.TORQUE + i] = -np.sign(rates[:, i]) * (0.35 + 1.5 * rows[:, tick_log.CURRENT + i])
    rows[:, tick_log.LATENESS_US] = 14.0 * np.exp(0.35 * generator.normal(size=n))
    rows[generator.random(n) < 5e-4, tick_log.LATENESS_US] = 400.0
    rows[:, tick_log.ENERGY_KINETIC] = np.sum(velocity**2, axis=1)
    power = np.hypot(*velocity.T) * 4.0
    rows[:, tick_log.ENERGY_BRAKES] = np.cumsum(power) / TICKS_PER_S
    rows[:, tick_log.ENERGY_HAND] = rows[:, tick_log.ENERGY_BRAKES] + rows[:, tick_log.ENERGY_KINETIC]
    fill_field(build_path(path, "path"), rows)
    return rows
