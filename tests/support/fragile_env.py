"""An environment that breaks when it is told to. Imports nothing heavy: processes start at once."""

import os
import signal

import gymnasium
import numpy as np


class Fragile(gymnasium.Env):
    """Counts; does as its marker file says at the third step while that has characters left; refuses NaN."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (2,), np.float64)
    action_space = gymnasium.spaces.Box(-1, 1, (1,), np.float64)

    def __init__(self, marker, how):
        self.marker, self.how = marker, how

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        if options == {"wrong": True}:
            raise ValueError("reset option 'wrong' is unknown")
        self.state = self.np_random.uniform(size=2)
        self.count = 0
        return self.state.copy(), {}

    def step(self, action):
        if np.isnan(action).any():
            raise ValueError("the action is not a number")
        self.count += 1
        left = self.marker.read_text()
        if self.count == 3 and left:
            self.marker.write_text(left[1:])
            if self.how == "dies":
                os.kill(os.getpid(), signal.SIGKILL)
            raise RuntimeError("the wheels came off")
        self.state = self.state * 0.9 + action
        return self.state.copy(), 0.0, False, self.count >= 4, {}
