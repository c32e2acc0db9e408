"""Examples in the docstrings of the public names of ``abhv_mc`` and ``abhv_mc.extend``."""

import doctest
import inspect
import types

import pytest
from report.synthetic import write_campaign

import abhv_mc
import abhv_mc.extend
from abhv_mc_vehicle.kernel.jit import scalar

COMPILED = type(scalar(lambda x: x))  # elementary functions, listed in the module's docstring
REQUIREMENT = "{metric: sideslip_max_deg, below: 5, probability: 0.99, consumer_risk: 0.10}"


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Write the results that the examples open as ``reports/study``; return the working folder."""
    root = tmp_path_factory.mktemp("examples")
    (root / "reports").mkdir()
    write_campaign(
        root / "reports" / "study",
        runs=12,
        controllers=("tlc", "lqr"),
        requirements=[REQUIREMENT],
    )
    return root


@pytest.mark.parametrize("module", [abhv_mc, abhv_mc.extend], ids=lambda module: module.__name__)
def test_examples_run(module, study, monkeypatch):
    monkeypatch.chdir(study)
    values = {name: getattr(module, name) for name in module.__all__}
    finder = doctest.DocTestFinder()
    examples = finder.find(module, module.__name__, globs=values | {"abhv_mc": abhv_mc})
    for name, value in values.items():
        if not isinstance(value, types.ModuleType | str | COMPILED):
            globs = values | {"abhv_mc": abhv_mc}
            examples += finder.find(value, name, module=inspect.getmodule(value), globs=globs)
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    output = []
    for example in examples:
        runner.run(example, out=output.append)
    assert runner.tries > 3 and not runner.failures, "".join(output)
