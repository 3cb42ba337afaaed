"""Direct control of a force towards the path: the brakes cancel what the hand pushes away from it.

The wanted force is f = -(F . n) n, F the hand's, n the normal towards the path; it is shown as the nearest force that
the brakes can exert (`reflect`). Our reconstruction: of Cho, Song and Kim, "Design and control of a planar haptic
device with passive actuators based on passive force manipulability ellipsoid analysis" (2005), we have the abstract.

Our choice: a hand that pushes towards the path (F . n >= 0) is left alone; f would lead away from the path.
"""

from core.control.algorithm import GAP_M, Algorithm
from core.control.reflect import show
from core.control.velocity_field import WANTED
from core.kernels import kernel


@kernel
def outward_push(seen, field):
    """What the hand pushes away from the path, N; 0 where it pushes towards it."""
    return max(-(seen.fx * field.n_x + seen.fy * field.n_y), 0.0)


@kernel
def decide(controller, field, tick):
    """Show -(F . n) n."""
    force = outward_push(tick.seen, field)
    tick.memory[WANTED], tick.memory[WANTED + 1] = force * field.n_x, force * field.n_y
    return show(tick, controller.rules)


ALGORITHM = Algorithm("direct-force", (GAP_M,), ("direct {J}", "direct {J}, in part"), decide)
