"""Random numbers that belong to a seed, a name and a flight, and to nothing else.

Each (seed, name) keys its own counter-based Philox generator and the flight's number is its counter. So flight k
does not depend on how many flights there are or in what order they are drawn, an added parameter shifts nothing,
and neighbouring seeds share nothing. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011.
"""

import hashlib

import numpy as np
from numpy.typing import NDArray

_WORDS = 4  # 64-bit words of one Philox4x64 counter value


def stream_key(seed: int, name: str, purpose: str = "sample") -> int:
    """128-bit key of a stream."""
    text = f"abhv-mc stream 1|{purpose}|{seed}|{name}"
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=16).digest(), "little")


def draw_uniforms(key: int, first: int, count: int) -> NDArray[np.float64]:
    """One uniform number ``[flight]``, strictly between 0 and 1, of the flights ``first`` .. ``first + count - 1``."""
    generator = np.random.Philox(key=key)
    generator.advance(first)
    words = generator.random_raw(_WORDS * count)[::_WORDS]
    return (words >> np.uint64(12)).astype(np.float64) * 2.0**-52 + 2.0**-53


def make_generator(seed: int, name: str, purpose: str) -> np.random.Generator:
    """A generator for what is drawn once for a whole campaign: scrambles, permutations."""
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(stream_key(seed, name, purpose))))
