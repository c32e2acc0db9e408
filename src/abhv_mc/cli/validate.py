"""``abhv-mc validate``: check files without flying."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abhv_mc.cli.options import Json
from abhv_mc.cli.printing import beside, say, show

if TYPE_CHECKING:
    from abhv_mc.execution.estimate import Estimate


def command(
    files: Annotated[
        list[str],
        typer.Argument(metavar="FILE...", help="Campaign, vehicle, mission, controller; or a shipped name."),
    ],
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Fly a few flights of each campaign; say what all of them will cost.")
    ] = False,
    json: Json = None,
) -> None:
    """Check files, and the files that they name, without flying."""
    from abhv_mc.cli.announce import announce_warnings
    from abhv_mc.io.documents import InputError, InputErrors
    from abhv_mc.shipped import find_input
    from abhv_mc.simulators.check_inputs import check_inputs

    errors: list[InputError] = []
    paths = [find_input(file, "campaign", "vehicle", "mission", "control") for file in files]
    for file in paths:
        try:
            checked = check_inputs(file)
        except InputErrors as several:
            errors.extend(several.errors)
            continue
        for found in checked:
            say(f"{found.path}: a valid {found.kind} file", file=beside(json))
            announce_warnings(f"{found.path}: {warning}" for warning in found.warnings)
    if errors:
        raise InputErrors(errors)
    costs = {str(file): cost for file in paths if dry_run and (cost := _estimate(file)) is not None}
    if json is not None or costs:
        show(costs, json, lambda: _print_costs(costs))


def _estimate(file: Path) -> "Estimate | None":
    """What a campaign will cost; None for another kind of file."""
    from abhv_mc.campaign.file.check import read_campaign
    from abhv_mc.campaign.file.kinds import find_kind
    from abhv_mc.cli.announce import announce_compiling, announce_warnings
    from abhv_mc.execution.estimate import estimate_campaign
    from abhv_mc.simulators.engine import make_engine

    if find_kind(file) != "campaign":
        return None
    announce_compiling()
    cost = estimate_campaign(read_campaign(file), make_engine())
    announce_warnings(cost.warnings)
    return cost


def _print_costs(costs: "dict[str, Estimate]") -> None:
    for file, cost in costs.items():
        say(f"{file}: {cost.flights} flights of {cost.controllers} {cost.kind}s, blocks of {cost.batch}")
        if cost.searched:
            say(f"  search  {cost.searched} flights of each, for the worst values of the unknowns")
        each = f"{1e3 * cost.flight_s:.2f} ms a flight and core"
        say(f"  time    {cost.flying_s:.0f} s with {cost.workers} workers ({each})")
        kept, flying = f"{cost.kept} histories {cost.histories_bytes / 1e6:.1f}", f"{cost.envelope_bytes / 1e6:.1f}"
        say(f"  disk    {cost.disk_bytes / 1e6:.1f} MB at most", end="")
        say(f" (rows {cost.rows_bytes / 1e6:.1f}, {kept}, envelopes while flying {flying})")
