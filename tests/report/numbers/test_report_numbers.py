import json

from report.synthetic import write_campaign

from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.report.numbers.report_numbers import make_numbers
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.plain import plain
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS


def test_the_same_folder_gives_the_same_numbers(failing_folder, failing_numbers):
    again = json.dumps(make_numbers(Models(read_flown(failing_folder))), allow_nan=False)
    assert again == json.dumps(failing_numbers, allow_nan=False)


def test_the_planted_driver_and_rule_are_found(failing_numbers):
    part = failing_numbers["drivers"]["controllers"]["lqr"]
    kinds = failing_numbers["failures"]["controllers"]["lqr"]
    early = next(kind for kind in kinds if kind["kind"] == "ended early")
    assert early["rules"][0]["conditions"][0]["parameter"] == "atmosphere.density"
    assert early["rules"][0]["rule"].startswith("density > +")
    speed = part["metrics"]["angle_of_attack_error_rms_deg"]["parameters"]
    assert {entry["parameter"] for entry in speed if entry["driver"]} >= {"atmosphere.density", "aero.lift"}


def test_dependent_designs_get_estimates(tmp_path):
    models = Models(read_flown(write_campaign(tmp_path / "c", runs=16, sampling="lhs")))
    assert {models[VERDICTS].statuses(name)[0] for name in models.names.controllers} == {"ESTIMATE"}
    assert plain(models[FLIGHTS].counts["tlc"].failure_share) == {"value": 0.0, "low": None, "high": None}


def test_convergence_ends_with_the_table(failing_numbers):
    trace = failing_numbers["convergence"]["controllers"]["tlc"]
    assert trace["flights"][-1] == 100
    last = trace["metrics"]["speed_error_max_mps"]["q95"]["value"][-1]
    assert (
        last
        == failing_numbers["metrics"]["table"]["speed_error_max_mps"]["controllers"]["tlc"]["quantiles"]["q95"]["value"]
    )
