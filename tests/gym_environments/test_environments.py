"""Gymnasium environments: the checks of Gymnasium, bounds, ends of flights and the how-to page."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env

import abhv_mc
from abhv_mc.io.messages import InputError
from abhv_mc_gym import Env, VectorEnv

TASK = {
    "observation": {
        "angle_of_attack": (-0.1, 0.2),
        "pitch_rate": (-0.5, 0.5),
        "altitude_error_m / 1000": (-1.0, 1.0),
    },
    "action": {"elevator": (-0.2, 0.2), "equivalence_ratio": (0.5, 1.0)},
    "reward": "-abs(altitude_error_m) / 1000 - 10 * failed",
}
DISPERSIONS = {"aero.lift": {"distribution": "uniform", "half_width": "10 %"}}


def test_the_environment_passes_the_checks_of_gymnasium():
    env = Env("level", **TASK, dispersions=DISPERSIONS)
    check_env(env, skip_render_check=True)
    first, second = (env.reset(seed=seed)[0] for seed in (1, 1))
    np.testing.assert_array_equal(first, second)


def test_flights_end_apart_and_keep_their_last_observation():
    mission = {"base": "level", "duration": "3 s"}
    env = VectorEnv(mission, num_envs=3, **TASK, ticks=50)
    observation, _ = env.reset(seed=2)
    assert observation in env.observation_space
    actions = np.array([[0.0, 0.0], [-1.0, 0.0], [1.0, 0.0]], np.float32)
    rewards, ends, before = [], [], observation
    for _ in range(7):
        observation, reward, terminated, truncated, info = env.step(actions)
        assert observation in env.observation_space
        held = ends[-1][0] if ends else np.zeros(3, bool)
        np.testing.assert_array_equal(observation[held], before[held])
        assert not reward[held].any()
        rewards.append(reward)
        ends.append((terminated, truncated))
        before = observation
    assert terminated.tolist() == [code != "ok" for code in info["outcome"]]
    assert terminated.any()
    assert (np.array(rewards) < -9.0).sum() == terminated.sum()
    assert not (terminated & truncated).any() and (terminated | truncated).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"reward": "no_such_channel"}, "no_such_channel"),
        ({"observation": {"bank": (-np.inf, 1.0)}}, "finite"),
        ({"action": {"flap": (0.0, 1.0)}}, "flap"),
    ],
)
def test_invalid_arguments_are_named(change, message):
    with pytest.raises(InputError, match=message):
        Env("level", **{**TASK, **change})


@pytest.mark.thorough
def test_the_programs_of_the_page_run(repository, tmp_path, monkeypatch):
    """The loop around Plant, and a policy that is trained and flies beside TLC and LQR."""
    monkeypatch.chdir(tmp_path)
    folder, short = repository / "docs/how-to", '{"base": "level", "duration": "2 s"}'
    Path("loop.py").write_text((folder / "close_loop.py").read_text().replace('"level"', short))
    for program in (["loop.py"], [folder / "train_policy.py", "1"]):
        subprocess.run([sys.executable, *program], check=True)
    study = {"name": "policy", "runs": 4, "mission": "level", "vehicle": "abhv"}
    study["dispersions"] = DISPERSIONS
    study["controllers"] = {"policy": "policy.yaml", "tlc": "tlc", "lqr": "lqr"}
    flown = abhv_mc.Campaign.make(study).run().flights.groupby("controller").size()
    assert flown.to_dict() == {"lqr": 4, "policy": 4, "tlc": 4}
