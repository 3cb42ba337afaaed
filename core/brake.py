"""The MR brake: torque gain and its inverse, time constant, lag, backlash (paper section III-A).

Currents in A, torques in N m, rates in rad/s (Eq. (4) itself is in rpm). Joint index i in the order A, E, B, C.
"""

import math

from core.kernels import inlined, kernel
from core.torque_table import FROM, SLOPE, SQUARE, TORQUE

RPM_PER_RAD_S = 60.0 / (2.0 * math.pi)


@kernel
def torque_gain(brakes, i, current):
    """Torque gain K, Eq. (2): steady torque (N m) of brake i at a current (A). At I = 0 it is k_2, the off torque.

        K = k_1 I + k_2                  I < knee (0.2 A in the paper)
        K = k_3 I^2 + k_4 I + k_5        I >= knee

    Our choice: a brake may have a torque table in its place (`core.torque_table`).
    """
    k, knee = brakes.k, brakes.knee[i]
    if current < knee:
        return k[i, 0] * current + k[i, 1]
    if knee < 0.0:
        return torque_on_curve(brakes.curve[i], current)
    return (k[i, 2] * current + k[i, 3]) * current + k[i, 4]


@kernel
def torque_on_curve(curve, current):
    """K (N m) of a torque table's curve (PIECES, 4)."""
    n = 0
    while n + 1 < curve.shape[0] and curve[n + 1, FROM] <= current:
        n += 1
    past = current - curve[n, FROM]
    return (curve[n, SQUARE] * past + curve[n, SLOPE]) * past + curve[n, TORQUE]


@kernel
def current_on_curve(curve, torque):
    """Inverse of `torque_on_curve`: the current (A) for a torque (N m) that is not below the curve's first one."""
    n = 0
    while n + 1 < curve.shape[0] and curve[n + 1, TORQUE] <= torque:
        n += 1
    missing = torque - curve[n, TORQUE]
    slope = curve[n, SLOPE]
    divisor = slope + math.sqrt(max(slope * slope + 4.0 * curve[n, SQUARE] * missing, 0.0))  # 0 for a flat piece
    return curve[n, FROM] + (2.0 * missing / divisor if divisor > 0.0 else 0.0)


@kernel
def current_for_torque(brakes, i, torque):
    """Inverse of Eq. (2): the current (A) at which brake i holds `torque` (N m) in steady state.

    Zero below k_2, clipped to [0, current_max], monotone.
    """
    if brakes.present[i] == 0.0:
        return 0.0
    k1, k2, k3, k4, k5 = brakes.k[i, 0], brakes.k[i, 1], brakes.k[i, 2], brakes.k[i, 3], brakes.k[i, 4]
    knee, largest = brakes.knee[i], brakes.current_max[i]
    if torque <= k2:
        return 0.0
    if torque >= torque_gain(brakes, i, largest):
        return largest
    if knee < 0.0:
        return min(max(current_on_curve(brakes.curve[i], torque), 0.0), largest)
    if torque < k1 * knee + k2:
        return min(max((torque - k2) / k1, 0.0), largest)
    # root of k3 I^2 + k4 I + (k5 - torque) on the rising branch, in the form that also stands for k3 -> 0
    c = k5 - torque
    root = math.sqrt(max(k4 * k4 - 4.0 * k3 * c, 0.0))
    current = -2.0 * c / (k4 + root)
    return min(max(current, min(knee, largest)), largest)


@kernel
def time_constant(brakes, i, current, rate, rising):
    """Time constant a, Eq. (4), in s, at a commanded current (A) and a joint rate (rad/s).

    At omega_0 and above it is a_avg; below the floor it is held at its value there (omega -> 0 would diverge).
    """
    speed = abs(rate)
    if speed >= brakes.omega_0[i]:
        return brakes.rise[i, 0] if rising else brakes.fall[i, 0]
    b0, b1, b2 = below_omega_0(brakes, i, current, rising)
    w = octaves(max(speed, brakes.floor[i]))
    return b0 + (b1 + b2 * w) * w


@inlined
def below_omega_0(brakes, i, current, rising):
    """Eq. (4) below omega_0 at a commanded current (A): a = b_0 + b_1 omega_L + b_2 omega_L^2, s."""
    a = brakes.rise[i] if rising else brakes.fall[i]
    return a[6] + current * a[1], a[2] + current * a[3], a[4] + current * a[5]


@inlined
def octaves(speed):
    """omega_L of Eq. (4) at a joint's speed (rad/s): log2 of rpm (our reading: the test grid of 0.5 .. 64 rpm)."""
    return math.log2(speed * RPM_PER_RAD_S)


@inlined
def inverse(seconds):
    """1/a (1/s) of a time constant (s); infinite for a brake without lag, a <= 0."""
    return 1.0 / seconds if seconds > 0.0 else math.inf


@kernel
def lagged_yield(gain, torque_yield, elapsed, constant):
    """Yield torque (N m) `elapsed` seconds on, Eq. (1) with one time constant (s): y = K + (y_0 - K) exp(-t / a).

    Differs from the paper: the lag acts on the yield magnitude, not on the signed torque, which would drive with the
    motion after each reversal.
    """
    if elapsed <= 0.0:
        return torque_yield
    return gain + (torque_yield - gain) * math.exp(-elapsed * inverse(constant))
