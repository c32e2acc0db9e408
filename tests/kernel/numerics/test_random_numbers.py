"""MRG32k3a against its published start, and its seeding against what independent streams must look like."""

import numpy as np
import pytest
from scipy import stats

from abhv_mc.kernel.jit import kernel
from abhv_mc.kernel.numerics.random_numbers import M1, M2, next_uniform, normal_pair, seed_word


@kernel
def _stream(state, n):
    out = np.empty(n)
    s0, s1, s2, s3, s4, s5 = state[0], state[1], state[2], state[3], state[4], state[5]
    for i in range(n):
        out[i], s0, s1, s2, s3, s4, s5 = next_uniform(s0, s1, s2, s3, s4, s5)
    return out


def _seeded(seed: float, n: int) -> np.ndarray:
    words = [seed_word(seed, float(i), M1 if i < 3 else M2) for i in range(6)]
    return _stream(np.array(words), n)


def test_published_sequence() -> None:
    """L'Ecuyer's own first numbers for the seed 12345 in all six words (RngStreams' documentation)."""
    expected = [0.12701112204657714, 0.3185275653967945, 0.3091860155832701, 0.8258468629271136, 0.2216299157820229]
    assert _stream(np.full(6, 12345.0), 5) == pytest.approx(expected, abs=1e-15)


def test_arithmetic_is_exact() -> None:
    """The same recurrence in Python's integers."""
    s = [12345] * 6
    m1, m2 = int(M1), int(M2)
    numbers = []
    for _ in range(2000):
        p1 = (1403580 * s[1] - 810728 * s[0]) % m1
        p2 = (527612 * s[5] - 1370589 * s[3]) % m2
        s = [s[1], s[2], p1, s[4], s[5], p2]
        numbers.append((p1 - p2 if p1 > p2 else p1 - p2 + m1) * 2.328306549295728e-10)
    assert np.array_equal(_stream(np.full(6, 12345.0), 2000), numbers)


@pytest.mark.parametrize("seed", [0.0, 0.25, 0.5, 1.0 - 2**-53])
def test_a_seed_gives_uniform_numbers(seed: float) -> None:
    numbers = _seeded(seed, 20_000)[8:]
    assert numbers.min() > 0.0 and numbers.max() < 1.0
    assert stats.kstest(numbers, "uniform").pvalue > 1e-3
    assert abs(np.corrcoef(numbers[:-1], numbers[1:])[0, 1]) < 0.03


def test_seeds_do_not_share_streams() -> None:
    """Words are valid, and the first useful number is uniform and uncorrelated over neighbouring seeds."""
    seeds = np.random.default_rng(1).random(4000)
    words = np.array([[seed_word(seed, float(i), M1 if i < 3 else M2) for i in range(6)] for seed in seeds])
    assert (words >= 1.0).all() and (words[:, :3] < M1).all() and (words[:, 3:] < M2).all()
    assert (words == np.round(words)).all()
    first = np.array([_stream(word, 9)[8] for word in words])
    assert stats.kstest(first, "uniform").pvalue > 1e-3
    assert abs(np.corrcoef(first, seeds)[0, 1]) < 0.06
    close = np.array([_seeded(0.4 + k * 1e-12, 9)[8] for k in range(500)])
    assert np.unique(close).size == close.size
    assert stats.kstest(close, "uniform").pvalue > 1e-3


def test_normal_pair() -> None:
    u = _seeded(0.3, 40_000)
    pairs = np.array([normal_pair(a, b) for a, b in u.reshape(-1, 2)[:8000]])
    assert stats.kstest(pairs[:, 0], "norm").pvalue > 1e-3
    assert stats.kstest(pairs[:, 1], "norm").pvalue > 1e-3
    assert abs(np.corrcoef(pairs.T)[0, 1]) < 0.05
