"""Compile the kernels of a default campaign for each x86-64 level, for the wheel.

Only the levels that this processor has are compiled.

    python .ci/prebuild.py SOURCE       writes SOURCE/src/abhv_mc_vehicle/prebuilt

The kernels are those of this interpreter, numba and llvmlite, beside those that other interpreters
have written there. Other processors and interpreters compile on first use.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

_MOST = 4_000_000  # bytes of all builds


def main(source: Path) -> None:
    """Compile, pack and check the size."""
    sys.path.insert(0, str(source / "src"))
    import llvmlite.binding as llvm

    from abhv_mc_vehicle.kernel.cache import LEVELS, pack

    into = source / "src/abhv_mc_vehicle/prebuilt"
    into.mkdir(exist_ok=True)
    for level in LEVELS:
        if lacks := level.lacks(llvm.get_host_cpu_features()):
            print(f"no kernels for {level.cpu}: this processor has no {', '.join(lacks)}")
            continue
        with tempfile.TemporaryDirectory() as folder:
            environment = {
                **os.environ,
                "PYTHONPATH": str(source / "src"),
                "XDG_CACHE_HOME": folder,
                "NUMBA_CPU_NAME": level.cpu,
                "NUMBA_CPU_FEATURES": level.features,
                "PYTHONHASHSEED": "0",
            }
            run = "-m", "abhv_mc", "run", str(source / "campaigns/s_manoeuvre.yaml")
            words = sys.executable, *run, "--runs", "64", "-o", f"{folder}/flown"
            done = subprocess.run(  # noqa: S603
                words, env=environment, stdout=subprocess.DEVNULL, check=False
            )
            if done.returncode not in {0, 1}:  # 1: a requirement failed
                raise SystemExit(f"the campaign failed with exit code {done.returncode}")
            (cache,) = (tried.parent for tried in Path(folder, "abhv-mc").glob("*/tried"))
            pack(level, cache, into)
    sizes = {file.name: file.stat().st_size for file in sorted(into.iterdir())}
    print(*(f"{size:8d} {name}" for name, size in sizes.items()), sep="\n")
    if sum(sizes.values()) > _MOST:
        raise SystemExit(f"{sum(sizes.values())} bytes of kernels: more than {_MOST}")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
