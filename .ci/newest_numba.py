"""Fly a few flights with the newest numba there is, pre-releases included, and say what came of it.

Never fails.

    python .ci/newest_numba.py

It goes into a folder of its own that disappears again; the environment stays as it is.
"""

import os
import subprocess
import sys
import tempfile
from importlib.metadata import distributions, version
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src"
INSTALLING, FLYING = 180, 600  # s, at most

FLIGHT = """
import hashlib, warnings
warnings.simplefilter("always")
from dataclasses import replace
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.prepare import prepare
from abhv_mc_vehicle.kernel.jit import compiler
from abhv_mc.shipped import shipped_configs
configs = shipped_configs()
plan = prepare(configs / "vehicle/ghame_x.yaml", configs / "mission/level.yaml", \
configs / "control/tlc.yaml", "tlc")
short = replace(plan, timing=plan.timing._replace(ticks=100))
print(compiler(), hashlib.sha256(fly(short, nominal_parameters(4)).metrics.tobytes()).hexdigest())
"""


def fly(*folders: Path) -> list[str]:
    """Which interface of numba compiled, and the hash of what was flown."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (*folders, SOURCE)))}
    command = [sys.executable, "-c", FLIGHT]
    done = subprocess.run(  # noqa: S603
        command, env=environment, check=True, capture_output=True, text=True, timeout=FLYING
    )
    return done.stdout.split()


def try_newest(folder: Path) -> str:
    """Return a sentence on the newest numba."""
    command = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "--pre",
        "--no-deps",
    ]
    packages = ["--only-binary=:all:", "--target", str(folder), "numba", "llvmlite"]
    subprocess.run(  # noqa: S603
        [*command, *packages], check=True, capture_output=True, text=True, timeout=INSTALLING
    )
    newest = {found.name: found.version for found in distributions(path=[str(folder)])}
    if newest["numba"] == version("numba"):
        return f"{newest['numba']} is the newest, and the one installed"
    compiler, flown = fly(folder)
    same = (
        "the same flights" if flown == fly()[1] else f"OTHER flights than with {version('numba')}"
    )
    return (
        f"{newest['numba']} with llvmlite {newest['llvmlite']}: {same}, its {compiler} "
        "interface compiles"
    )


def main() -> None:
    """Print one line."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            said = try_newest(Path(folder))
        except subprocess.CalledProcessError as error:
            lines = error.stderr.strip().splitlines() or ["nothing said"]
            said = f"not tried or not flown: {lines[-1]}"
        except (subprocess.TimeoutExpired, OSError, KeyError, ValueError) as error:
            said = f"not tried or not flown: {error}"
    print(f"newest numba: {said}")


if __name__ == "__main__":
    main()
