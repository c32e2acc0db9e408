"""``abhv-mc version``: the program, its libraries and the machine, for a problem report."""

from abhv_mc.cli.printing import say

_LIBRARIES = ("numba", "llvmlite", "numpy", "scipy", "pandas", "pyarrow", "joblib", "pydantic", "plotly", "duckdb")


def command() -> None:
    """Print the versions of the program, Python and the libraries that results depend on."""
    import platform
    from importlib.metadata import version

    from abhv_mc import __version__

    say(f"abhv-mc {__version__}")
    say(f"python {platform.python_version()} on {platform.platform()}")
    for library in _LIBRARIES:
        say(f"{library} {version(library)}")
