"""Drake on the bench scenes: a second peer of `phd bench`, where `.[bench]` has a wheel of it.

The same mechanism: two arms of two links, and the handle as a point mass on two sliding joints, tied to the end of each
arm by a ball constraint; rotors as reflected inertia. A discrete plant with the SAP solver, the only one that knows
such constraints. The hand's force is a sine on each sliding joint, half a step ahead: as it is in the step's middle.

Its joints have no dry friction. What comes nearest: on each brake's joint a motor that holds the rate at zero by a
damping (`DAMPING`), at most by the yield torque. The solver takes it implicitly, so a joint sticks as far as that
damping and the solver's own softness allow, and slips at the yield. No Python runs between the steps.
"""

import time
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

import numpy as np

from core.mechanism import JOINTS
from experiments.benchmark.scenes import COMPARE_S, START, BenchScene
from experiments.benchmark.ten_coordinates import bodies_of, coordinates

#: N m s/rad. Larger: nothing changes, the solver's own softness is left. Smaller: a locked joint creeps faster.
DAMPING = 1e6
_POINT = 1e-10  # kg m2; a body must have some inertia: the handle is a point mass but for this
_ORIGIN, _UPWARD = [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]


def drake_version() -> str | None:
    """The version of Drake; None where it is not installed."""
    return version("drake") if find_spec("pydrake") else None


class DrakeRun:
    """One scene at one step."""

    def __init__(self, scene: BenchScene, step: float):
        self.scene, self.bodies = scene, bodies_of(scene.device)
        self.tree: Any = import_module("pydrake.multibody.tree")
        self.analysis: Any = import_module("pydrake.systems.analysis")
        plants, systems = import_module("pydrake.multibody.plant"), import_module("pydrake.systems.primitives")
        builder = import_module("pydrake.systems.framework").DiagramBuilder()
        self.plant = builder.AddSystem(plants.MultibodyPlant(step))
        self.plant.set_discrete_contact_approximation(plants.DiscreteContactApproximation.kSap)
        self.plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
        self.arms, self.hand = (self.plant.AddModelInstance(name) for name in ("arms", "hand"))
        self._build()
        self.plant.Finalize()
        at_rest = builder.AddSystem(systems.ConstantVectorSource(np.zeros(2 * len(scene.device.braked))))
        builder.Connect(at_rest.get_output_port(), self.plant.get_desired_state_input_port(self.arms))
        amplitude, rate, phase = scene.wave.T
        force = builder.AddSystem(systems.Adder(2, 2))
        wave = builder.AddSystem(systems.Sine(amplitude, rate, phase + 0.5 * step * rate))
        constant = builder.AddSystem(systems.ConstantVectorSource(scene.constant))
        builder.Connect(wave.get_output_port(0), force.get_input_port(0))
        builder.Connect(constant.get_output_port(), force.get_input_port(1))
        builder.Connect(force.get_output_port(), self.plant.get_actuation_input_port(self.hand))
        self.diagram = builder.Build()

    def _build(self) -> None:
        """Handle, arms, and what ties them."""
        world = self.plant.world_body()
        rail = self.plant.AddRigidBody("rail", self.hand, self.tree.SpatialInertia.Zero())
        point = self.tree.UnitInertia(*[_POINT / self.bodies.tip_mass] * 3)
        mass = self.tree.SpatialInertia(self.bodies.tip_mass, _ORIGIN, point)
        handle = self.plant.AddRigidBody("handle", self.hand, mass)
        for name, near, far, axis in (("x", world, rail, [1.0, 0.0, 0.0]), ("y", rail, handle, [0.0, 1.0, 0.0])):
            joint = self.tree.PrismaticJoint(name, near.body_frame(), far.body_frame(), axis)
            self.plant.AddJointActuator(name, self.plant.AddJoint(joint))
        for arm in range(2):
            body, at = world, [*self.bodies.base[arm], 0.0]
            for i in (2 * arm, 2 * arm + 1):
                body, at = self._link(i, body, at), [self.bodies.length[i], 0.0, 0.0]
            self.plant.AddBallConstraint(body, at, handle, _ORIGIN)

    def _link(self, i: int, before: Any, at: list[float]) -> Any:
        """Link i, its joint at a place of the body before it, and its brake."""
        b, transform = self.bodies, import_module("pydrake.math").RigidTransform(at)
        turning = self.tree.UnitInertia(*[b.inertia[i] / b.mass[i] + b.com[i] ** 2 * x for x in (0.0, 1.0, 1.0)])
        link = self.plant.AddRigidBody(
            f"link {i}", self.arms, self.tree.SpatialInertia(b.mass[i], [b.com[i], 0.0, 0.0], turning)
        )
        frame = self.plant.AddFrame(self.tree.FixedOffsetFrame(f"joint {i}", before.body_frame(), transform))
        joint = self.plant.AddJoint(self.tree.RevoluteJoint(JOINTS[i], frame, link.body_frame(), _UPWARD))
        if JOINTS[i] in self.scene.device.braked:
            brake = self.plant.AddJointActuator(JOINTS[i], joint)
            brake.set_default_rotor_inertia(b.rotor[i])
            brake.set_default_gear_ratio(1.0)
            brake.set_controller_gains(self.tree.PdControllerGains(p=0.0, d=DAMPING))
        return link

    def _brake(self, row: int) -> None:
        """The yields of a row of the schedule from now on."""
        for joint in self.scene.device.braked:
            brake = self.plant.GetJointActuatorByName(joint)
            brake.set_effort_limit(self.scene.torques[row, JOINTS.index(joint)])

    def _start(self) -> tuple[Any, Any]:
        """The simulator at time 0, and the plant's part of its state."""
        simulator = self.analysis.Simulator(self.diagram)
        context = self.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        q = coordinates(self.scene.device, np.array(START))
        for joint, angle in zip("AEBC", (q[0], q[4] - q[0], q[1], q[7] - q[1]), strict=True):
            self.plant.GetJointByName(joint).set_angle(context, angle)
        for axis, place in zip("xy", START, strict=True):
            self.plant.GetJointByName(axis).set_translation(context, place)
        self._brake(0)
        simulator.Initialize()
        return simulator, context

    def tips(self) -> np.ndarray:
        """Tips (n, 2), m, at the times of comparison; schedules act at their times."""
        simulator, context = self._start()
        handle, found = self.plant.GetBodyByName("handle"), [np.array(START)]
        for k in range(self.scene.comparisons):
            self._brake(int(np.searchsorted(self.scene.times, k * COMPARE_S + 1e-9, "right")) - 1)
            simulator.AdvanceTo((k + 1) * COMPARE_S)
            found.append(self.plant.EvalBodyPoseInWorld(context, handle).translation()[:2])
        return np.array(found)

    def seconds(self) -> float:
        """Wall time of the whole scene in one call (s). As in MuJoCo's run the brakes stay as a schedule begins."""
        simulator, _ = self._start()
        start = time.perf_counter()
        simulator.AdvanceTo(self.scene.duration_s)
        return time.perf_counter() - start
