"""Gymnasium environments of the built-in vehicle (``pip install 'abhv-mc[gym]'``)."""

from abhv_mc_gym.environments import Env, VectorEnv

__all__ = ["Env", "VectorEnv"]
