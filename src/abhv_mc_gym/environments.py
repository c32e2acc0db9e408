"""Environments around :class:`abhv_mc.Plant`."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import pandas as pd
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from abhv_mc.api import InputError, Plant, PlantState

Bounds = Mapping[str, tuple[float, float]]
Array = NDArray[Any]
Step = tuple[Array, Array, Array, Array, dict[str, Any]]


class VectorEnv(gymnasium.vector.VectorEnv[Array, Array, Array]):
    """Flights that start together, and are reset together.

    Observations and reward are expressions (:func:`pandas.eval`) of measured quantities
    in SI units and radians, of channels, and of ``failed``, which is 1 at the step at which a limit
    ends the flight. After the end of a flight, its observations are constant and its reward is 0.

    Parameters
    ----------
    mission, vehicle
        Shipped name, path or mapping, see :func:`abhv_mc.fly`.
    num_envs
        Number of flights.
    observation
        Bounds of each observation, to which its values are clipped.
    action
        Bounds of each command of the plant, which correspond to the actions -1 and 1.
    reward
        Expression of the reward of a step.
    ticks
        Control ticks of a step.
    **options
        Further arguments of :class:`abhv_mc.Plant`, such as ``dispersions`` and ``rate``.

    Raises
    ------
    InputError
        If an input is invalid.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.DISABLED}

    def __init__(
        self,
        mission: Any,
        vehicle: Any = "abhv",
        num_envs: int = 1,
        *,
        observation: Bounds,
        action: Bounds,
        reward: str,
        ticks: int = 10,
        **options: Any,
    ) -> None:
        self.num_envs = num_envs
        self._ticks = ticks
        self._expressions = (*observation, reward)
        for name, (low, high) in {**observation, **action}.items():
            if not -np.inf < low < high < np.inf:
                raise InputError(name, f"the bounds {low} and {high}", "finite, ascending bounds")
        self._low, self._high = np.array([*action.values()]).T
        self._plant = Plant(mission, vehicle, flights=num_envs, commands=tuple(action), **options)
        self._bounds = np.array([*observation.values()], np.float32).T
        self.single_observation_space = Box(*self._bounds)
        self.single_action_space = Box(-1.0, 1.0, (len(action),))
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.reset(seed=0)  # Expressions are checked here.

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Return all flights to the start of the mission, with new samples."""
        super().reset(seed=seed)
        state = self._plant.reset(int(self.np_random.integers(2**31)))
        self._values: dict[str, Array] = {}
        self._ended = np.zeros(self.num_envs, bool)
        return self._observe(state)[0], {}

    def step(self, actions: Array) -> Step:
        """Advance all flights with actions [flight, command] between -1 and 1."""
        share = (np.clip(actions, -1.0, 1.0) + 1.0) / 2.0
        state = self._plant.step(self._low + share * (self._high - self._low), self._ticks)
        observation, reward = self._observe(state)
        reward = np.where(self._ended, 0.0, reward)
        self._ended = state.outcome != ""
        truncated = state.outcome == "ok"
        return observation, reward, self._ended & ~truncated, truncated, {"outcome": state.outcome}

    def _observe(self, state: PlantState) -> tuple[Array, Array]:
        """Return the observations [flight, observation] and the rewards [flight]."""
        failed = ~self._ended & ~np.isin(state.outcome, ("", "ok"))
        columns: dict[str, Array] = {**state.channels, **state.measured, "failed": 1.0 * failed}
        for name, values in columns.items():
            self._values[name] = np.where(np.isnan(values), self._values.get(name, np.nan), values)
        *observed, reward = map(self._evaluate, self._expressions)
        return np.clip(np.array(observed, np.float32).T, *self._bounds), reward

    def _evaluate(self, text: str) -> Array:
        try:
            values = pd.eval(text, engine="python", local_dict=self._values, global_dict={})
        except (NameError, SyntaxError, TypeError, ValueError) as error:
            raise InputError(
                text, str(error), "an expression of measured quantities, channels and 'failed'"
            ) from None
        return np.broadcast_to(np.asarray(values, np.float64), self.num_envs)


class Env(gymnasium.Env[Array, Array]):
    """One flight; the arguments are those of :class:`VectorEnv`, except ``num_envs``."""

    def __init__(self, mission: Any, vehicle: Any = "abhv", **options: Any) -> None:
        self._flights = VectorEnv(mission, vehicle, **options)
        self.observation_space = self._flights.single_observation_space
        self.action_space = self._flights.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Return the flight to the start of the mission, with new samples."""
        super().reset(seed=seed)
        observation, info = self._flights.reset(seed=int(self.np_random.integers(2**31)))
        return observation[0], info

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Advance the flight with an action [command] between -1 and 1."""
        observation, reward, terminated, truncated, _ = self._flights.step(action[None])
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), {}
