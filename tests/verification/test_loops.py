"""The loops' rows see a wrong gain, and without what the design model leaves out the plant is the design model."""

import numpy as np
import pytest
from verification import loops
from verification.linear_plant import LOOPS, Distance, compare_linear_plant
from verification.loops import NOMINALS, verify_differentiator, verify_tlc_loops
from verification.nominals import Design, draw_nominals, make_design
from verification.shown import check

from abhv_mc.kernel.laws import tlc_loops


@pytest.fixture(scope="module")
def design() -> Design:
    return make_design()


@pytest.fixture(scope="module")
def distances() -> dict[tuple[str, str], Distance]:
    found = list(compare_linear_plant())
    print()
    for one in found:
        print(" | ".join([one.loop, one.plant, *(f"{number:.1e}" for number in one[2:])]))
    return {(distance.loop, distance.plant): distance for distance in found}


def test_the_loops_are_exact(design: Design) -> None:
    check([*verify_tlc_loops(design, draw_nominals(design, NOMINALS)), *verify_differentiator()])


@pytest.mark.parametrize("name", ["attitude_gains", "rate_gains"])
def test_a_gain_that_is_one_part_in_a_million_off_is_seen(
    design: Design, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = getattr(tlc_loops, name)
    monkeypatch.setattr(loops, name, lambda *arguments: (1.0 + 1e-6) * np.array(right(*arguments)))
    rows = verify_tlc_loops(design, draw_nominals(design, 3))
    assert sum(not row.ok for row in rows) == 1


def test_without_damping_on_a_still_sphere_the_plant_is_the_design_model(
    distances: dict[tuple[str, str], Distance],
) -> None:
    """Differences of the compiled plant, good to some 1e-11, against complex steps of the design model."""
    for loop in LOOPS[1:]:
        assert distances[loop, "both"].entry_worst < 1e-9
        assert distances[loop, "both"].pole_worst < 1e-9


def test_damping_and_the_earth_are_seen_where_they_act(distances: dict[tuple[str, str], Distance]) -> None:
    assert distances[LOOPS[2], "on a still sphere"].entry_worst > 0.1
    earth_rate = 7.3e-5
    assert 0.1 * earth_rate < distances[LOOPS[1], "without damping"].entry_worst < 3.0 * earth_rate
    assert distances[LOOPS[0], "both"].entry_worst < 1e-3
