"""Instructions told apart, and the tick found among them."""

import numpy as np
import pytest

from benchmarks.kernels.instructions import KINDS, SHORTEST, find_tick, kind_of


@pytest.mark.parametrize(
    ("instruction", "kind"),
    [
        ("vmulpd (%rsi,%r8,1),%zmm0,%zmm0", "vectors: add, multiply"),
        ("vfnmadd213pd %zmm1,%zmm2,%zmm3", "vectors: add, multiply"),
        ("vdivpd %zmm6,%zmm7,%zmm6", "vectors: divide, root"),
        ("vmovupd %zmm0,(%rcx,%r8,1)", "vectors: load, store, spread"),
        ("vcmplepd %zmm8,%zmm5,%k1", "vectors: compare, choose, convert"),
        ("vmulsd (%rax),%xmm1,%xmm2", "single floats"),
        ("mov    0x68(%rsp),%rbp", "integers, addresses"),
        ("jne    0x7f60bc284f00", "jumps"),
    ],
)
def test_kinds(instruction: str, kind: str) -> None:
    assert kind in KINDS
    assert kind_of(instruction) == kind


def test_a_tick_is_what_lies_between_two_of_an_instruction_that_comes_back_evenly() -> None:
    loop = np.arange(100, 110)
    ticks = [np.concatenate([[50], np.tile(loop, SHORTEST // 10), [60], [3] * extra]) for extra in (0, 7, 3, 0)]
    steps = np.concatenate([loop, *ticks]).astype(np.int64)
    start, stop = find_tick(steps, 40, 200)
    assert stop - start == len(ticks[0])
    assert steps[start] == steps[stop] in (50, 60)


def test_nothing_is_found_where_nothing_comes_back_evenly() -> None:
    with pytest.raises(ValueError, match="no control tick"):
        find_tick(np.arange(10 * SHORTEST), 0, 10 * SHORTEST)
