"""What a shell offers while a command is typed: shipped inputs and files, campaigns' folders, metrics, controllers."""

from collections.abc import Callable
from pathlib import Path

from abhv_mc.shipped import shipped_files

Complete = Callable[[str], list[str]]


def complete_input(*kinds: str) -> Complete:
    """Names of the shipped files of these kinds, then YAML files and folders."""

    def complete(incomplete: str) -> list[str]:
        names = [name for kind in kinds for name in shipped_files(kind) if name.startswith(incomplete)]
        return names + _paths(incomplete, lambda path: path.is_dir() or path.suffix in (".yaml", ".yml"))

    return complete


def complete_folder(incomplete: str) -> list[str]:
    """Campaigns' folders, those in `reports` first; then other folders."""
    flown = [path.parent.as_posix() for path in sorted(Path("reports").glob("*/manifest.json"))]
    return [name for name in flown if name.startswith(incomplete)] + _paths(incomplete, Path.is_dir)


def complete_metric(incomplete: str) -> list[str]:
    """Names of the built-in metrics."""
    from abhv_mc.flight.metrics import BUILT_IN

    return [name for name in BUILT_IN if name.startswith(incomplete)]


def complete_controllers(incomplete: str) -> list[str]:
    """Names of the shipped controllers, after those that stand already before a comma."""
    before, comma, last = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in shipped_files("control") if name.startswith(last)]


def _paths(incomplete: str, wanted: Callable[[Path], bool]) -> list[str]:
    folder, _, begun = incomplete.rpartition("/")
    parent = Path(folder or ("/" if incomplete.startswith("/") else "."))
    found = sorted(parent.iterdir()) if parent.is_dir() else []
    chosen = [path for path in found if path.name.startswith(begun) and wanted(path)]
    return [f"{path.as_posix()}{'/' if path.is_dir() else ''}" for path in chosen if begun or path.name[0] != "."]
