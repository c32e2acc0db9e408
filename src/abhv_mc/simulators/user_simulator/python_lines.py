"""The program that a user's Python simulator runs in: a flight is a line of JSON in, and a line out.

It imports nothing of this package. Files beside the simulator that its campaign does not name are not read: no hash
would tell that they changed.
"""

import importlib.util
import json
import os
import sys
import sysconfig
from pathlib import Path
from typing import Any


def main(python: str, source: str, *declared: str) -> None:
    """Run the requests on standard input until there are no more.

    ``python`` and ``declared`` lie in the working folder; ``source`` is the user's own folder.
    """
    # What a flight starts inherits neither pipe: it would swallow requests and write answers.
    requests = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, 0)
    os.close(null)
    os.dup2(2, 1)  # what it prints is no answer
    folder = Path.cwd()
    readable = {str(place / name) for place in (folder, Path(source)) for name in declared}
    sys.addaudithook(_only(readable, f"{source}{os.sep}"))
    sys.path.insert(0, str(folder))
    try:
        spec = importlib.util.spec_from_file_location("simulator", folder / python)
        module: Any = importlib.util.module_from_spec(spec)  # type: ignore[arg-type]
        sys.modules["simulator"] = module
        spec.loader.exec_module(module)  # type: ignore[union-attr]
        fly = module.fly
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
                raise TypeError(f"fly returned {result!r:.80}, which is no mapping")
            if "flight" in result:
                raise ValueError("fly returned 'flight', a key that is reserved")
            start = dumps(result, default=_plain)[:-1] + ", " * bool(result)
            answer = f'{start}"flight": "{request["flight"]}"}}\n'.encode()
        except Exception as error:
            answer = _line({"error": _words(error, python), "flight": request["flight"]})
        if os.getpid() != own:
            os._exit(0)  # a child that the flight has forked answers nothing
        answers.write(answer)


def _line(answer: dict[str, Any]) -> bytes:
    return json.dumps(answer).encode() + b"\n"


def _plain(value: Any) -> Any:
    """Numbers and arrays of numpy as Python's."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"a {type(value).__name__} among what fly returned")


def _words(error: BaseException, python: str) -> str:
    """What was raised, and the last line of the simulator that it came from."""
    at, trace = "", error.__traceback__
    while trace is not None:
        if Path(trace.tb_frame.f_code.co_filename).name == Path(python).name:
            at = f" ({Path(python).name}, line {trace.tb_lineno})"
        trace = trace.tb_next
    return f"{type(error).__name__}: {error}{at}"


def _only(declared: set[str], folder: str) -> Any:
    """An audit hook that refuses to read files of the folder that are not declared, but of installed packages."""
    installed = tuple(
        f"{path}{os.sep}" for path in (*sysconfig.get_paths().values(), sys.prefix, sys.base_prefix)
    )

    def check(event: str, arguments: tuple[Any, ...]) -> None:
        if (
            event == "open"
            and isinstance(arguments[0], str)
            and str(arguments[1] or "r").startswith("r")
        ):
            path = os.path.abspath(arguments[0])  # noqa: PTH100  links are as their user named them
            if path.startswith(folder) and not path.startswith(installed):
                kept = path.endswith(".pyc") and Path(path).parent.name == "__pycache__"
                path = importlib.util.source_from_cache(path) if kept else path
                if path not in declared and Path(path).is_file():
                    raise PermissionError(
                        f"it reads {path.removeprefix(folder)}, which 'files' does not name"
                    )

    return check


if __name__ == "__main__":
    main(*sys.argv[1:])
