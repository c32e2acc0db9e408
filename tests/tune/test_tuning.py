import shutil
from dataclasses import replace

import numpy as np
import pytest
from fake_flight import LIFT, interrupted_after, write_campaign
from search.known_flights import BLOCK, CONTROLLER, TUNED, fly_tuned, prepare_tuned, write_tuned

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.flights.metrics import MARGIN_NAMES
from abhv_mc.folder.arrays import write_array
from abhv_mc.interfaces import Engine
from abhv_mc.io.messages import InputError
from abhv_mc_tune import tuning as module
from abhv_mc_tune.candidates import check_free_numbers
from abhv_mc_tune.constrained_search import Scores, pareto_front, tune
from abhv_mc_tune.request import TuneRequest
from abhv_mc_tune.tuning import tune_controller
from abhv_mc_vehicle.control.controller_file import read_controller


@pytest.fixture
def request_(tmp_path):
    return write_tuned(tmp_path)


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """Return the request and the result of a tuning without interruptions."""
    request = write_tuned(tmp_path_factory.mktemp("tuned"))
    return request, tune_controller(request, TUNED)


def test_finds_the_best_numbers_within_the_limit_and_writes_them(tuned):
    request, result = tuned
    law = read_controller(request.output)
    assert law.altitude.damping == pytest.approx(3.0, rel=0.05)
    assert law.altitude.bandwidth == pytest.approx(0.045, rel=0.02)  # 1.5 times the start's travel
    assert law.altitude.bandwidth <= 0.045
    assert result.shown and result.validation.high < 0.0
    text = request.output.read_text("utf-8")
    assert text.startswith("# Made by `abhv-mc tune ") and "95 % interval" in text
    numbers = result.as_json()
    assert numbers["shown_better"] and len(numbers["front"]) > 1


def test_an_interrupted_tuning_resumes_with_the_same_result(request_, tmp_path, tuned):
    with pytest.raises(KeyboardInterrupt):
        tune_controller(request_, interrupted_after(60, TUNED))
    assert not request_.output.exists()
    stored = len(list((tmp_path / "new.tuning").glob("*.npy")))
    assert stored >= 50
    result = tune_controller(
        replace(request_, workers=2), interrupted_after(113 - stored + 10, TUNED)
    )
    assert result.as_json() == tuned[1].as_json()


def test_an_edited_file_has_no_effect(request_, tmp_path, tuned):
    """Inputs are read once, so that candidates of different vehicles are never compared."""
    file = tmp_path / "files" / "tables/cl.csv"
    calls = 0

    def edit(plan, parameters, record_every=None):
        nonlocal calls
        calls += 1
        if calls == 40:
            file.write_text(f"{file.read_text()}# edited\n")
        return fly_tuned(plan, parameters, record_every)

    assert (
        tune_controller(
            replace(request_, workers=1), Engine(prepare_tuned, edit, "tuned")
        ).as_json()
        == tuned[1].as_json()
    )
    assert calls > 40


def test_damaged_results_are_computed_again(tuned, tmp_path):
    request, result = tuned
    shutil.copytree(request.output.parent, tmp_path, dirs_exist_ok=True)
    request = replace(request, output=tmp_path / request.output.name)
    files = sorted((tmp_path / "new.tuning").glob("*.npy"))
    for file, offset in zip(files, (0, 7, 60, 200, -1), strict=False):
        content = bytearray(file.read_bytes())
        content[offset] ^= 8
        file.write_bytes(content)
    files[-1].write_bytes(files[-1].read_bytes()[:50])
    files[-2].write_bytes(b"")
    for i, other in enumerate(
        [np.zeros((2, 2)), np.zeros(0), np.array([["a"]]), np.zeros((64, 3), np.int64)]
    ):
        write_array(files[-3 - i], other)  # undamaged, but not written by tuning
    request.output.unlink()
    assert tune_controller(request, TUNED).as_json() == result.as_json()


def test_no_file_is_written_without_an_improvement(request_, tmp_path):
    """The start is already the best candidate."""
    (tmp_path / "files/one.yaml").write_text(
        CONTROLLER.replace("damping: 2.4, bandwidth: 0.03", "damping: 3.0, bandwidth: 0.06"),
        "utf-8",
    )
    result = tune_controller(request_, TUNED)
    assert not result.shown
    assert not request_.output.exists()


def test_the_best_candidate_outside_the_limits_is_written_as_rejected(request_, tmp_path):
    """If no candidate meets the limits, the best one is kept as rejected."""
    text = BLOCK.replace("below_start_times: 1.5", "below: 0.01")
    request_.block.write_text(text, "utf-8")
    result = tune_controller(request_, TUNED)
    assert not result.shown and not request_.output.exists()
    rejected = module.rejected_file(request_.output)
    assert rejected == tmp_path / "new.rejected.yaml"
    assert rejected.read_text("utf-8").startswith("# REJECTED: ")
    values = result.numbers.values(result.tuning.best_point)
    assert read_controller(rejected).altitude.bandwidth == pytest.approx(
        float(str(values["altitude.bandwidth"]).split()[0])
    )
    assert [item.metric for item in result.comparisons[-4:]] == list(MARGIN_NAMES)


def test_validate_checks_the_names_of_free_numbers(tmp_path):
    """`validate` rejects a block `tune` with a number that no controller has."""

    def read(block):
        lines = "".join(f"  {line}\n" for line in block.splitlines())
        path = write_campaign(tmp_path, tune=f"\n{lines}")
        for name in ("one", "two"):
            (tmp_path / f"{name}.yaml").write_text(CONTROLLER, "utf-8")
        return read_campaign(path)

    check_free_numbers(read(BLOCK))
    with pytest.raises(InputError, match=r"campaign.yaml:\d+:\d+.*'altitude.gain'"):
        check_free_numbers(read(BLOCK.replace("altitude.damping,", "altitude.gain,")))


def test_a_stability_margin_is_a_limit_of_the_nominal_vehicle_or_of_all_corners(
    request_, monkeypatch
):
    """The fake margin decreases with bandwidth and with the lift's distance from nominal."""
    seen = []

    def margins_of(self, candidate):
        bandwidth = candidate.plan.gains[0, 1]
        lift = np.abs(self.vehicles[:, LIFT] - 1.0) / 0.05
        seen.append((len(lift), self.margins_at))
        return np.tile(((12.0 - 100.0 * bandwidth) - lift)[:, None], (1, 4))

    monkeypatch.setattr("abhv_mc_tune.candidates.Trials.margins_of", margins_of)
    text = (
        "limits: [{metric: gain_margin_min_db, above: 7%s}]\nmargins_at: [trim, 1 s]\n"
        "candidates: 161\n"
    )
    start = BLOCK[: BLOCK.index("limits:")]
    for vehicles, vehicle_count, expected in (("", 1, 0.05), (", vehicles: corners", 3, 0.02)):
        request_.block.write_text(start + text % vehicles, "utf-8")
        out = request_.output.with_name(f"new{vehicle_count}.yaml")
        result = tune_controller(
            TuneRequest(request_.campaign, out, block=request_.block, workers=2), TUNED
        )
        assert set(seen) == {(vehicle_count, ("trim", 1.0))}
        seen.clear()
        assert read_controller(result.numbers.document.path).altitude.bandwidth == 0.03
        values = result.numbers.values(result.tuning.best_point)
        assert float(str(values["altitude.bandwidth"]).split()[0]) == pytest.approx(
            expected, rel=0.05
        )
        margin = result.comparisons[1]
        assert (
            margin.best == pytest.approx(7.0, abs=0.3)
            and margin.best >= 7.0
            and margin.quantile is None
        )
        assert result.as_json()["fresh"][1]["vehicles"] == (
            vehicles.split()[-1] if vehicles else "nominal"
        )


def test_invalid_controllers_are_skipped(request_):
    def prepare_some(vehicle, mission, controller, name):
        if read_controller(controller).altitude.damping > 3.5:
            raise InputError(controller, "too much", "less")
        return prepare_tuned(vehicle, mission, controller, name)

    assert tune_controller(request_, Engine(prepare_some, fly_tuned, "some")).shown


def test_the_block_may_be_in_the_campaign_or_below_its_key(request_, tmp_path):
    wrapped = tmp_path / "wrapped.yaml"
    wrapped.write_text("tune:\n" + "".join(f"  {line}\n" for line in BLOCK.splitlines()), "utf-8")
    campaign = read_campaign(request_.campaign)
    alone, _, _ = module.read_tune_block(campaign, request_.block)
    below, _, _ = module.read_tune_block(campaign, wrapped)
    assert alone == below
    inside = write_campaign(
        tmp_path / "files", dispersions="{aero.lift: {distribution: normal, sigma: 5 %}}",
        tune="\n" + "".join(f"  {line}\n" for line in BLOCK.splitlines()),
    )  # fmt: skip
    assert module.read_tune_block(read_campaign(inside), None)[0] == alone


@pytest.mark.parametrize(
    "old, new, match",
    [
        ("altitude.damping,", "altitude.gain,", r"block.yaml:1:8.*'altitude.gain'"),
        ("below_start_times: 1.5", "below: 3, above: 2", r"\bbelow\b.*\babove\b"),
        ("quantile: 0.9}", "quantile: 0.9973}", r"block.yaml:6:.*validation: 1373\b"),
        (
            "elevator_travel_deg, quantile: 0.5",
            "gain_margin_min_db, quantile: 0.5",
            r"yaml:\d+:.*quantile",
        ),
        (
            "elevator_travel_deg, quantile: 0.5, below_start_times: 1.5}",
            "gain_margin_min_db, above: 6}\nmargins_at: [trim, 900 s]",
            r"block.yaml:5:\d+.*900 s",
        ),
    ],
)
def test_a_wrong_block_is_rejected_with_its_location(request_, old, new, match):
    request_.block.write_text(BLOCK.replace(old, new), "utf-8")
    with pytest.raises(InputError, match=match):
        tune_controller(request_, TUNED)
    assert not request_.output.exists()
    assert not request_.output.with_suffix(".tuning").exists()


@pytest.mark.parametrize(
    ("name", "pattern"),
    [("new.tuning", "tuning'"), ("new.html", "html'"), ("block.yaml", "already exists")],
)
def test_an_existing_or_reserved_name_is_rejected(request_, tmp_path, name, pattern):
    """Names of the candidates' folder, of the page and of existing files are rejected."""
    with pytest.raises(InputError, match=pattern):
        tune_controller(replace(request_, output=tmp_path / name), TUNED)
    assert not list(tmp_path.glob("new.*")) and request_.block.read_text("utf-8") == BLOCK


SHIFTS = np.random.default_rng(5).normal(0.0, 0.3, (200, 1, 4))


def noisy_quadratic(shifts, points):
    """Return the squared distances [shift, point] to (0.5, -0.3, 0.2, 0) after random shifts."""
    target = np.array([0.5, -0.3, 0.2, 0.0])
    return ((points + shifts - target) ** 2).sum(axis=2)


def measure(points):
    objective = noisy_quadratic(SHIFTS, points).mean(axis=0)
    usage = np.abs(points).sum(axis=1)
    return Scores(objective, (points[:, :1] - 0.2), usage)


def test_finds_the_best_point_within_the_limit():
    tuning = tune(measure, np.full(4, -0.5), 800, seed=3)
    centre = np.array([0.5, -0.3, 0.2, 0.0]) - SHIFTS.mean(axis=(0, 1))
    assert tuning.best_point[0] == pytest.approx(0.2, abs=0.01)
    np.testing.assert_allclose(tuning.best_point[1:], centre[1:], atol=0.05)
    assert tuning.scores.allowed[tuning.best] and tuning.scores.allowed[tuning.front].all()
    assert len(tuning.points) <= 800


def test_one_free_parameter():
    def line(points):
        return Scores((points[:, 0] - 0.7) ** 2, np.zeros((len(points), 0)), points[:, 0])

    assert tune(line, np.zeros(1), 300).best_point[0] == pytest.approx(0.7, abs=1e-3)


def test_feasible_candidates_rank_first_and_lost_flights_last():
    scores = Scores(
        np.array([5.0, 1.0, 0.5, np.inf, 4.0]),
        np.array([[0.0, -1.0], [0.1, 0.0], [0.3, 0.2], [-1.0, -1.0], [-2.0, 0.0]]),
        np.zeros(5),
    )
    assert scores.rank().tolist() == [1, 2, 3, 4, 0]
    assert scores.allowed.tolist() == [True, False, False, False, True]


def test_the_front_has_the_non_dominated_candidates():
    costs = np.array([[1.0, 5.0], [2.0, 3.0], [2.0, 4.0], [3.0, 3.0], [4.0, 1.0], [0.5, 9.0]])
    assert pareto_front(costs).tolist() == [5, 0, 1, 4]
    assert len(pareto_front(np.empty((0, 2)))) == 0
