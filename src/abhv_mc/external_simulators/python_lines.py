"""Host program of custom Python simulators, which exchanges JSON lines with abhv-mc.

The program imports nothing of abhv-mc except the read guard, which it loads by path. The guard
rejects files that the campaign does not list, because changes to such files would not be detected.
"""

import importlib.util
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

_GUARD = Path(__file__).parents[1] / "custom_code" / "read_guard.py"


def main(python: str, source: str, campaign: str, *declared: str) -> None:
    """Process requests from standard input until the end of the input.

    ``python`` and ``declared`` are in the working folder; ``source`` is the folder of the simulator
    and ``campaign`` the folder of the campaign file.
    """
    started = time.time()
    # Child processes must not inherit the pipes of requests and replies.
    requests = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, 0)
    os.close(null)
    os.dup2(2, 1)  # Text that the simulator prints must not be read as a reply.
    folder = Path.cwd()
    guard = _load("_abhv_mc_read_guard", _GUARD)
    guard.watch_reads(
        guard.simulator_guard(declared, source, campaign, str(folder), started), source
    )
    sys.path.insert(0, str(folder))
    try:
        fly = _load("simulator", folder / python).fly
    except BaseException as error:
        answers.write(_line({"error": _words(error, python)}))
        return
    answers.write(_line({"ready": True}))
    read, loads, dumps, own = requests.readline, json.loads, json.dumps, os.getpid()
    while line := read():
        request = loads(line)
        try:
            result = fly(request["inputs"], request["settings"])
            if not isinstance(result, dict):
                raise TypeError(f"fly returned {result!r:.80}, which is not a mapping")
            if "flight" in result:
                raise ValueError("fly returned the reserved key 'flight'")
            start = dumps(result, default=_plain)[:-1] + ", " * bool(result)
            answer = f'{start}"flight": "{request["flight"]}"}}\n'.encode()
        except Exception as error:
            answer = _line({"error": _words(error, python), "flight": request["flight"]})
        if os.getpid() != own:
            os._exit(0)  # A forked child must not send replies.
        answers.write(answer)


def _line(answer: dict[str, Any]) -> bytes:
    return json.dumps(answer).encode() + b"\n"


def _plain(value: Any) -> Any:
    """Convert numpy numbers and arrays to Python objects."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"fly returned a value of type {type(value).__name__}")


def _words(error: BaseException, python: str) -> str:
    """Return the message of an exception and the number of the last line reached in the file."""
    location, trace = "", error.__traceback__
    while trace is not None:
        if Path(trace.tb_frame.f_code.co_filename).name == Path(python).name:
            location = f" ({Path(python).name}, line {trace.tb_lineno})"
        trace = trace.tb_next
    return f"{type(error).__name__}: {error}{location}"


def _load(name: str, path: Path) -> Any:
    """Run a Python file as the module ``name``."""
    spec: Any = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    main(*sys.argv[1:])
