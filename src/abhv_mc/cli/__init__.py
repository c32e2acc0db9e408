"""Commands, which parse arguments, call the library and print results."""

import os
import sys

if os.name != "posix":  # Check the operating system before any module imports fcntl.
    print("abhv-mc needs Linux or macOS (POSIX file locks and processes)", file=sys.stderr)
    sys.exit(2)
