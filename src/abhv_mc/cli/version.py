"""``abhv-mc version``: the program, its libraries and the machine, for a problem report."""

_LIBRARIES = ("numba", "llvmlite", "numpy", "scipy", "pandas", "pyarrow", "joblib", "pydantic", "plotly", "duckdb")


def command() -> None:
    """Print the versions of the program, Python and the libraries that results depend on."""
    import platform
    from importlib.metadata import version

    from abhv_mc import __version__

    print(f"abhv-mc {__version__}")
    print(f"python {platform.python_version()} on {platform.platform()}")
    for library in _LIBRARIES:
        print(f"{library} {version(library)}")
