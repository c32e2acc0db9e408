"""Tests of the processor time of commands, including processes without a waiting parent."""

import sys

import pytest

from benchmarks.processes import measure_all

ORPHAN = """
import subprocess, sys
subprocess.Popen([sys.executable, "-S", "-c", '''
import time
while time.process_time() < 0.4:
    pass
'''])
"""


@pytest.mark.skipif(sys.platform != "linux", reason="subreapers exist only on Linux")
def test_the_time_of_an_orphaned_process_is_included():
    assert measure_all([sys.executable, "-S", "-c", ORPHAN])[0] > 0.4
