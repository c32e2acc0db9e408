"""The same ratios for asv, which keeps them from commit to commit; times would not compare from machine to machine.

    pip install asv && asv machine --yes --config benchmarks/asv.conf.json
    ASV_PYTHONPATH=$PWD asv run --config benchmarks/asv.conf.json --python=same --set-commit-hash=$(git rev-parse HEAD)
    asv publish --config benchmarks/asv.conf.json && asv preview --config benchmarks/asv.conf.json

Larger is better. asv drops PYTHONPATH: hence the other name.
"""

from abhv_mc.bench.speed import CONTROLLERS, make_work
from abhv_mc.flight.plan import LANES
from benchmarks.kernels.functions import PAIRS, measure_function
from benchmarks.kernels.look_up import COMPARED, measure_look_up
from benchmarks.watch import measure_gain


def track_flight(controller: str) -> float:
    plans, parameters = make_work(LANES)
    return measure_gain(plans[controller], parameters)


def track_look_up(compared: str) -> float:
    return measure_look_up(compared)


def track_function(name: str) -> float:
    return measure_function(name)


for _track, _names in ((track_flight, CONTROLLERS), (track_look_up, COMPARED), (track_function, PAIRS)):
    _track.params = list(_names)  # type: ignore[attr-defined]
    _track.param_names = ["of"]  # type: ignore[attr-defined]
    _track.unit = "slower / faster"  # type: ignore[attr-defined]
