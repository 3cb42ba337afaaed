"""MuJoCo on the bench scenes, tuned as an expert would: the peer of `phd bench` where `.[bench]` is installed.

The same mechanism: four links with their own mass and inertia, the loop closed by an equality constraint between two
sites, friction loss and armature at each joint. Euler, Newton with 100 iterations to 1e-10, contact and gravity off;
friction and closure as hard as the step allows (solref two steps and critically damped, solimp 0.9999). The force goes
in at the handle once a step, as it is in the step's middle (the most accurate choice). Runs through `mujoco.rollout`:
no Python between steps.
"""

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

import numpy as np

from core.mechanism import JOINTS
from experiments.benchmark.clock import clock
from experiments.benchmark.scenes import COMPARE_S, START, BenchScene
from experiments.benchmark.ten_coordinates import bodies_of, coordinates

_POINT = 1e-10  # kg m2; a body must have some inertia: the handle is a point mass but for this
_MODEL = """
<mujoco>
  <compiler angle="radian" inertiafromgeom="false"/>
  <option timestep="{step!r}" integrator="Euler" solver="Newton" iterations="100" tolerance="1e-10">
    <flag contact="disable" gravity="disable"/>
  </option>
  <default>
    <joint type="hinge" axis="0 0 1" solreffriction="{stiff}" solimpfriction="{imp}"/>
    <equality solref="{stiff}" solimp="{imp}"/>
  </default>
  <worldbody>{arms}</worldbody>
  <equality><connect site1="end_1" site2="end_2"/></equality>
</mujoco>
"""
_ARM = """
<body pos="{base[0]!r} {base[1]!r} 0">
  <joint name="{joints[0]}" armature="{rotor[0]!r}" frictionloss="1"/>
  <inertial pos="{com[0]!r} 0 0" mass="{mass[0]!r}" diaginertia="{inertia[0]!r} {inertia[0]!r} {inertia[0]!r}"/>
  <body pos="{length[0]!r} 0 0">
    <joint name="{joints[1]}" armature="{rotor[1]!r}" frictionloss="1"/>
    <inertial pos="{com[1]!r} 0 0" mass="{mass[1]!r}" diaginertia="{inertia[1]!r} {inertia[1]!r} {inertia[1]!r}"/>
    <site name="end_{arm}" pos="{length[1]!r} 0 0"/>{handle}
  </body>
</body>
"""
_HANDLE = """
    <body name="handle" pos="{length[1]!r} 0 0">
      <inertial pos="0 0 0" mass="{mass!r}" diaginertia="{point} {point} {point}"/>
    </body>"""


def mujoco_version() -> str | None:
    """The version of MuJoCo; None where it is not installed."""
    return import_module("mujoco").__version__ if find_spec("mujoco") else None


def model_text(scene: BenchScene, step: float) -> str:
    """The scene's mechanism as a MuJoCo model. The bench devices have no elbow masses."""
    b = bodies_of(scene.device)
    arms = ""
    for arm in range(2):
        links = slice(2 * arm, 2 * arm + 2)
        own = {name: getattr(b, name)[links].tolist() for name in ("rotor", "length", "com", "mass", "inertia")}
        handle = "" if arm else _HANDLE.format(length=own["length"], mass=b.tip_mass, point=_POINT)
        arms += _ARM.format(arm=arm + 1, base=b.base[arm].tolist(), joints=JOINTS[links], handle=handle, **own)
    return _MODEL.format(step=step, stiff=f"{2 * step!r} 1", imp="0.9999 0.9999 0.001 0.5 2", arms=arms)


class MujocoRun:
    """One scene at one step."""

    def __init__(self, scene: BenchScene, step: float):
        self.scene, self.step = scene, step
        self.mujoco: ModuleType = import_module("mujoco")
        self.rollout: ModuleType = import_module("mujoco.rollout")
        self.model = self.mujoco.MjModel.from_xml_string(model_text(scene, step))
        self.data = self.mujoco.MjData(self.model)
        q = coordinates(scene.device, np.array(START))
        self.data.qpos[:] = q[0], q[4] - q[0], q[1], q[7] - q[1]
        self.mujoco.mj_forward(self.model, self.data)
        self.bodies = bodies_of(scene.device)
        n = round(scene.duration_s / step)
        handle = self.model.body("handle").id
        self.forces = np.zeros((n, 6 * self.model.nbody))  # a wrench on each body
        for axis in range(2):
            self.forces[:, 6 * handle + axis] = [scene.force((k + 0.5) * step)[axis] for k in range(n)]

    def tips(self) -> np.ndarray:
        """Tips (n, 2), m, at the times of comparison; schedules act at their times."""
        state = self._start()
        every = round(COMPARE_S / self.step)
        q = [state[1:5]]
        for k in range(self.scene.comparisons):
            row = min(int(np.searchsorted(self.scene.times, k * COMPARE_S + 1e-9, "right")) - 1, len(self.scene.times))
            self.model.dof_frictionloss[:] = self.scene.torques[row]
            state = self._roll(state, self.forces[k * every : (k + 1) * every])[-1]
            q.append(state[1:5])
        angle = np.array(q)
        length = self.bodies.length
        absolute = angle[:, 0] + angle[:, 1]
        return self.bodies.base[0] + np.stack(
            [length[0] * np.cos(angle[:, 0]) + length[1] * np.cos(absolute),
             length[0] * np.sin(angle[:, 0]) + length[1] * np.sin(absolute)], axis=1,
        )  # fmt: skip

    def seconds(self) -> float:
        """Time of the whole scene in one call (s). The brakes stay as a schedule's first row has them: a change
        would need a new call, and its cost is not the engine's."""
        self.model.dof_frictionloss[:] = self.scene.torques[0]
        state = self._start()
        start = clock()
        self._roll(state, self.forces)
        return clock() - start

    def python_seconds(self, count: int) -> float:
        """Time of so many steps from Python (s), each with a new force and the brakes' torques."""
        data, step, wrench = self.mujoco.MjData(self.model), self.mujoco.mj_step, self.model.body("handle").id
        friction, torques = self.model.dof_frictionloss, self.scene.torques[0]
        forces = [self.scene.force(k * self.step) for k in range(count)]
        self.mujoco.mj_copyData(data, self.model, self.data)
        start = clock()
        for force in forces:
            data.xfrc_applied[wrench, :2] = force
            friction[:] = torques
            step(self.model, data)
        return clock() - start

    def _start(self) -> np.ndarray:
        size = self.mujoco.mj_stateSize(self.model, self.mujoco.mjtState.mjSTATE_FULLPHYSICS)
        state = np.zeros(size)
        self.mujoco.mj_getState(self.model, self.data, state, self.mujoco.mjtState.mjSTATE_FULLPHYSICS)
        return state

    def _roll(self, state: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """States after each step (n, size): time, then the four joint angles, then their rates."""
        data = self.mujoco.MjData(self.model)
        spec = int(self.mujoco.mjtState.mjSTATE_XFRC_APPLIED)
        return self.rollout.rollout(self.model, data, state[None], forces[None], control_spec=spec)[0][0]
