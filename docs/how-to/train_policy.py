"""Train a linear policy by the cross-entropy method, and write it as a control law.

Usage: python train_policy.py [GENERATIONS]
"""

import sys
from pathlib import Path

import numpy as np

from abhv_mc_gym import VectorEnv

GENERATIONS = int(sys.argv[1]) if sys.argv[1:] else 20
CANDIDATES, FLIGHTS, BEST = 48, 4, 10  # each candidate computes FLIGHTS flights with other samples

env = VectorEnv(
    {"base": "level", "duration": "10 s"},
    num_envs=CANDIDATES * FLIGHTS,
    observation={
        "altitude_error_m / 100": (-3.0, 3.0),
        "flight_path_angle / 0.02": (-3.0, 3.0),
        "(angle_of_attack - 0.048) / 0.02": (-3.0, 3.0),
        "pitch_rate / 0.02": (-3.0, 3.0),
        "speed_error_mps / 10": (-3.0, 3.0),
        "bank / 0.1": (-3.0, 3.0),
        "roll_rate / 0.1": (-3.0, 3.0),
        "sideslip / 0.02": (-3.0, 3.0),
        "yaw_rate / 0.02": (-3.0, 3.0),
    },
    action={
        "aileron": (-0.1, 0.1),
        "rudder": (-0.1, 0.1),
        "elevator": (-0.115, 0.085),
        "equivalence_ratio": (0.7, 1.0),
    },
    reward="-(altitude_error_m / 100)**2 - (speed_error_mps / 10)**2 - (bank / 0.1)**2"
    " - 100 * failed",
    dispersions={
        "aero.lift": {"distribution": "uniform", "half_width": "10 %"},
        "initial.bank": {"distribution": "uniform", "low": "-10 deg", "high": "10 deg"},
    },
    ticks=5,
)

# observations that each command uses
used = np.zeros((4, 9), bool)
used[0, 5:8] = used[1, 7:] = used[2, :4] = used[3, 4] = True


def weights_of(candidates):
    """Return weights [candidate, command, observation] of vectors [candidate, number]."""
    weights = np.zeros((len(candidates), *used.shape))
    weights[:, used] = candidates
    return weights


rng = np.random.default_rng(1)
mean, deviation = np.zeros(used.sum()), np.full(used.sum(), 0.2)
for generation in range(GENERATIONS):
    candidates = mean + deviation * rng.standard_normal((CANDIDATES, mean.size))
    weights = np.repeat(weights_of(candidates), FLIGHTS, axis=0)
    observation, _ = env.reset(seed=generation)
    total, ended = np.zeros(env.num_envs), np.zeros(env.num_envs, bool)
    while not ended.all():
        action = np.einsum("fco,fo->fc", weights, observation)
        observation, reward, terminated, truncated, _ = env.step(action)
        total += reward
        ended = terminated | truncated
    score = total.reshape(CANDIDATES, FLIGHTS).mean(axis=1)
    best = candidates[np.argsort(score)[-BEST:]]
    mean, deviation = best.mean(axis=0), best.std(axis=0) + 0.01
    print(f"generation {generation}: mean return {score.mean():.1f}, best {score.max():.1f}")

Path("policy.py").write_text(f"""\
import numpy as np
from abhv_mc.extend import Command, controller

WEIGHTS = np.array({weights_of(mean[None])[0].round(4).tolist()})


@controller(compiled=False)
def policy(measured, reference):
    observation = [
        (measured.altitude - reference.altitude) / 100,
        measured.flight_path_angle / 0.02,
        (measured.angle_of_attack - 0.048) / 0.02,
        measured.pitch_rate / 0.02,
        (measured.speed - reference.speed) / 10,
        measured.bank / 0.1,
        measured.roll_rate / 0.1,
        measured.sideslip / 0.02,
        measured.yaw_rate / 0.02,
    ]
    action = np.clip(WEIGHTS @ np.clip(observation, -3.0, 3.0), -1.0, 1.0)
    aileron, rudder, elevator, throttle = action.tolist()
    return Command(0.1 * aileron, 0.1 * rudder, -0.015 + 0.1 * elevator, 0.85 + 0.15 * throttle)
""")
Path("policy.yaml").write_text("law: python\nfile: policy.py\nrate: 100 Hz\n")
