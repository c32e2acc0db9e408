"""Processor time of commands: processes that nobody waits for count, too."""

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


@pytest.mark.skipif(sys.platform != "linux", reason="subreapers are Linux's")
def test_time_of_a_process_that_nobody_waits_for_counts():
    assert measure_all([sys.executable, "-S", "-c", ORPHAN])[0] > 0.4
