"""A user law tried before it flies: read, compiled, and one control tick of a nominal flight."""

from dataclasses import replace
from pathlib import Path

from abhv_mc.control.law_file import UserController
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.prepare import prepare
from abhv_mc.io.documents import InputError
from abhv_mc.shipped import DEFAULT_VEHICLE, shipped_configs
from abhv_mc.user_code.child import run_in_thread
from abhv_mc.user_code.law_source import law_place, read_law_source
from abhv_mc.user_code.trust import is_in_a_folder, is_trusted

_LONGEST = 600.0  # s, compiling included
_BROKEN = {
    Outcome.NOT_FINITE: "a law whose command at the first tick is not a number",
    Outcome.LAW_FAILED: "a law that raises an exception at the first tick (above)",
}


def try_law(file: Path, controller: UserController, vehicle: Path | None, mission: Path | None) -> list[str]:
    """Compile a controller and fly one tick, on the campaign's vehicle and mission or shipped ones; its warnings.

    Code of a campaign's folder that this user has not flown is not run. Raises InputError.
    """
    place = law_place(controller)
    if is_in_a_folder(place) and not is_trusted(read_law_source(controller)):
        return ["its code was not run: it is a folder's, and you have not flown it"]
    configs = shipped_configs()
    vehicle = vehicle or configs / "vehicle" / f"{DEFAULT_VEHICLE}.yaml"
    mission = mission or configs / "mission" / "level.yaml"
    plan = prepare(vehicle, mission, file, file.stem)
    one_tick = replace(plan, timing=plan.timing._replace(ticks=0))
    try:
        block = run_in_thread(lambda: fly(one_tick, nominal_parameters()), _LONGEST)
    except TimeoutError:
        found = f"a law whose first tick is not done in {_LONGEST:g} s"
        raise InputError(place, found, "a law whose loops end") from None
    broken = _BROKEN.get(Outcome(int(block.outcome[0])))
    if broken is not None:
        raise InputError(place, broken, "finite commands")
    return []
