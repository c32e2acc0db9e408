"""Packages that a user's code imports stand in the manifest with their versions."""

from importlib import metadata

from abhv_mc.user_code.source import UserSource, find_package_versions

LAW = """
import math
import numpy as np
from mylaw.gains import K
def design(model, settings):
    from scipy.linalg import solve
"""


def test_packages_are_found_in_the_law_and_in_the_modules_that_it_declares():
    files = (("law.py", LAW.encode()), ("mylaw/gains.py", b"import yaml\nfrom . import more\n"), ("odd.py", b"print 1"))
    found = find_package_versions(
        [UserSource(LAW, "law.py", files), UserSource('{"law": "c", "library": null}', "law.c")]
    )
    assert found == {name: metadata.version(name) for name in ("numpy", "scipy", "PyYAML")}
