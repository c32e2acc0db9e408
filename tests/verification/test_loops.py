"""TLC's loops are exact; without what the design model leaves out the plant is the design model."""

from verification.linear_plant import LOOPS, compare_linear_plant
from verification.loops import NOMINALS, verify_differentiator, verify_tlc_loops
from verification.nominals import draw_nominals, make_design
from verification.shown import check

EARTH_RATE = 7.3e-5  # rad/s


def test_the_loops_are_exact() -> None:
    design = make_design()
    check([*verify_tlc_loops(design, draw_nominals(design, NOMINALS)), *verify_differentiator()])


def test_without_damping_on_a_still_sphere_the_plant_is_the_design_model() -> None:
    """Differences of the compiled plant, good to some 1e-11, against complex steps of the design model."""
    distances = {(one.loop, one.plant): one for one in compare_linear_plant()}
    for one in distances.values():
        print(" | ".join([one.loop, one.plant, *(f"{number:.1e}" for number in one[2:])]))
    for loop in LOOPS[1:]:
        assert distances[loop, "both"].entry_worst < 1e-9
        assert distances[loop, "both"].pole_worst < 1e-9
    # Damping and the Earth are seen where they act.
    assert distances[LOOPS[2], "on a still sphere"].entry_worst > 0.1
    assert 0.1 * EARTH_RATE < distances[LOOPS[1], "without damping"].entry_worst < 3.0 * EARTH_RATE
    assert distances[LOOPS[0], "both"].entry_worst < 1e-3
