"""A Gymnasium environment: steer a hand along a line with brakes alone. python docs/examples/gymnasium_env.py

The hand pulls to a goal and is pushed aside by noise. An action is a current for each brake, held for 10 ms; brakes
only resist, so the reward is for a tip that is near the line and yet moves on.
"""

import gymnasium
import numpy as np

import phd

START, GOAL = np.array([-0.08, 0.40]), np.array([0.08, 0.40])  # m
PULL, NOISE, CALM = 6.0, 3.0, 2.0  # N, N, N s/m
STEPS, STEP_S, LIMIT = 10, 1e-3, 300  # of the simulation in an action; actions in an episode


class GuideAlongLine(gymnasium.Env):
    """Observation: tip (m), velocity (m/s), hand force (10 N). Action: share of each brake's largest current."""

    metadata = {"render_modes": []}

    def __init__(self, device="three-brake", fidelity="mr"):
        self.simulation = phd.Simulation(device, fidelity)
        brakes = len(self.simulation.braked)
        self.action_space = gymnasium.spaces.Box(0.0, 1.0, (brakes,), np.float32)
        self.observation_space = gymnasium.spaces.Box(-10.0, 10.0, (6,), np.float64)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.simulation.reset(START)
        self.push, self.actions = np.zeros(2), 0
        return self._look(), {}

    def step(self, action):
        self.push = 0.9 * self.push + 0.436 * NOISE * self.np_random.standard_normal(2)
        currents = np.clip(action, 0.0, 1.0) * self.simulation.currents_max_A
        for _ in range(STEPS):
            self.simulation.step(currents, self.force, STEP_S)
        seen = self._look()
        self.actions += 1
        arrived = bool(np.linalg.norm(GOAL - seen[:2]) < 0.005)
        reward = float(seen[2]) - 10.0 * abs(float(seen[1]) - START[1])
        return seen, reward, arrived, self.actions >= LIMIT, {"stuck": self.state.stuck}

    def _look(self):
        """Look at the state; the hand's force for the next action follows from it."""
        self.state = self.simulation.state
        away = GOAL - self.state.tip_m
        pull = PULL * away / max(np.linalg.norm(away), 0.02)
        self.force = pull + self.push - CALM * self.state.velocity_m_s
        return np.clip([*self.state.tip_m, *self.state.velocity_m_s, *self.force / 10.0], -10.0, 10.0)


if __name__ == "__main__":
    environment = GuideAlongLine()
    seen, _ = environment.reset(seed=1)
    done, total = False, 0.0
    while not done:
        seen, reward, arrived, over, _ = environment.step(np.zeros(3))
        done, total = arrived or over, total + reward
    print(f"without brakes: {environment.actions} actions, tip at ({seen[0]:.3f}, {seen[1]:.3f}) m, reward {total:.1f}")
