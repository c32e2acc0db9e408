"""The commands: one file each, nothing but parsing, calling and printing. What is heavy is imported in the body."""

import os
import sys

if os.name != "posix":  # said here, before anything imports fcntl
    print(
        "abhv-mc needs Linux or macOS: its locks and worker processes are those of POSIX",
        file=sys.stderr,
    )
    sys.exit(2)
