"""All the proof, section by section, as one list of rows."""

from collections.abc import Callable, Iterator
from pathlib import Path

from abhv_mc.io.input_error import InputError
from abhv_mc.verification.ghame6 import verify_ghame6
from abhv_mc.verification.invariants import verify_invariants
from abhv_mc.verification.look_up import verify_look_up
from abhv_mc.verification.loops import verify_loops
from abhv_mc.verification.nesc import verify_nesc
from abhv_mc.verification.order import verify_order
from abhv_mc.verification.responses import verify_responses
from abhv_mc.verification.roots import verify_roots
from abhv_mc.verification.rows import Row
from abhv_mc.verification.step_study import verify_step
from abhv_mc.verification.vehicles import verify_usage, verify_vehicles
from abhv_mc.verification.world import verify_atmosphere, verify_earth

# What needs no data of others.
SECTIONS: dict[str, Callable[[], list[Row]]] = {
    "invariants": verify_invariants,
    "order of the integrator": verify_order,
    "atmosphere": verify_atmosphere,
    "Earth": verify_earth,
    "tables": verify_look_up,
    "root finder": verify_roots,
    "loops": verify_loops,
    "step responses": verify_responses,
    "vehicles": verify_vehicles,
    "control usage": verify_usage,
}


def verify_sections(scale: float = 1.0) -> Iterator[tuple[str, list[Row]]]:
    """Names and rows of SECTIONS; ``scale`` multiplies the tolerances."""
    for name, section in SECTIONS.items():
        yield name, [scale_row(row, scale) for row in section()]


def verify_references(folder: Path, scale: float = 1.0) -> Iterator[tuple[str, list[Row]]]:
    """Names and rows of the reference data in a folder: check-cases in ``nesc``, recordings in ``cadac-ghame6``."""
    recordings = sorted((folder / "cadac-ghame6").glob("*.csv*"))
    if not recordings:
        raise InputError(folder, None, None, "no recording", "a CSV file in its folder cadac-ghame6")
    yield "check-cases", verify_nesc(folder / "nesc", scale)
    for recording in recordings:
        yield f"recording {recording.name}", verify_ghame6(recording, scale)


def verify_everything(folder: Path | None, scale: float = 1.0) -> Iterator[tuple[str, list[Row]]]:
    """Names and rows of the references in a folder, if any, of SECTIONS and of the step study."""
    if folder is not None:
        yield from verify_references(folder, scale)
    yield from verify_sections(scale)
    yield "step study", verify_step(scale=scale)


def scale_row(row: Row, scale: float) -> Row:
    """A row with its tolerance multiplied."""
    return Row(row.case, row.simulator, row.quantity, row.unit, row.difference, scale * row.tolerance)
