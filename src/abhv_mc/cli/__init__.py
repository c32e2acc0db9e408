"""Commands of the command line, which parse arguments, call the library and print results.

Slow imports are made inside the functions of the commands.
"""

import os
import sys

if os.name != "posix":  # checked before any module imports fcntl
    print("abhv-mc needs Linux or macOS (POSIX file locks and processes)", file=sys.stderr)
    sys.exit(2)
