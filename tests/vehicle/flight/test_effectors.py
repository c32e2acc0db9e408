"""Tests of effectors that a custom control law commands by name.

They cover control effort, rejected inputs and loss of effectiveness.
"""

import numpy as np
import pytest
from short_flights import cut, rows_of, short_plan, write_law

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.kernel.laws.columns import LQR_SETTINGS, TLC_SETTINGS
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.one_flight.fly_once import make_document, write_inputs

LAW = """
from abhv_mc.extend import Command, controller

@controller(compiled={compiled})
def law(reference):
    return Command({aileron}, 0.0, reference.elevator, \
equivalence_ratio=reference.equivalence_ratio{effectors})
"""
MIXED = {"left": {"aileron": -1, "elevator": 1}, "right": {"aileron": 1, "elevator": 1}}
MOVING = {
    "rate": "400 deg/s",
    "bandwidth": "50 rad/s",
    "damping": 0.7,
    "limits": ["-20 deg", "20 deg"],
}
DRIVEN = {name: mix | MOVING for name, mix in MIXED.items()}


def write_own_law(folder, effectors="", aileron="0.0", compiled=False):
    argument = f", effectors={{{effectors}}}" if effectors else ""
    return write_law(folder, LAW.format(aileron=aileron, effectors=argument, compiled=compiled))


def campaign_of(folder, effectors, controllers=None, **entries):
    vehicle = {"base": "ghame_x", "effectors": effectors}
    content = {
        "name": "one",
        "vehicle": vehicle,
        "mission": "level",
        "controllers": controllers or "tlc",
    }
    return read_campaign(write_inputs(content | {"runs": 2, "dispersions": {}} | entries, folder))


@pytest.mark.parametrize(
    ("commands", "fragment"),
    [
        ('"flop": 0.1', "flop"),  # unknown
        ('**{"left": 0.1}', "different effectors"),  # no names
    ],
)
def test_unknown_effectors_are_rejected(tmp_path, commands, fragment):
    law = write_own_law(tmp_path, commands, compiled=True)
    with pytest.raises(InputError, match=fragment):
        short_plan(5, law, "level", {"base": "ghame_x", "effectors": DRIVEN})


@pytest.mark.parametrize("law", ["tlc", "lqr"])
def test_laws_limit_their_commands_to_what_the_effectors_can_do(law):
    """Check the saturation of elevons.

    The bank step needs 20 deg of aileron; elevons of 1 and -1.5 deg leave 1 deg to either side.
    """
    limits = {"left": ["-1.5 deg", "1 deg"], "right": ["-1.5 deg", "1 deg"]}
    effectors = {name: DRIVEN[name] | {"limits": limits[name]} for name in MIXED}
    plan = short_plan(100, law, "s_manoeuvre", {"base": "ghame_x", "effectors": effectors})
    last = dict(zip({"tlc": TLC_SETTINGS, "lqr": LQR_SETTINGS}[law], plan.settings, strict=True))
    ends = [last[f"{axis}_{end}"] for axis in ("aileron", "elevator") for end in ("min", "max")]
    np.testing.assert_allclose(np.rad2deg(ends), [-1.0, 1.0, -1.5, 1.0])
    history = fly(plan, nominal_parameters(1), 1).history[0]
    names = [channel.name for channel in plan.channels]
    aileron = history[:, names.index("aileron_command_deg")]
    assert np.abs(aileron).max() == pytest.approx(1.0, rel=1e-5)


def test_failures_of_axes_are_rejected_if_effectors_have_actuators(tmp_path):
    weak = {"control.right_effectiveness": {"distribution": "uniform", "half_width": "20 %"}}
    assert campaign_of(tmp_path, DRIVEN, dispersions=weak).names == (
        "control.effector_1_effectiveness",
    )
    failing = {
        "failure.aileron.loss_time": {"distribution": "uniform", "low": "1 s", "high": "2 s"}
    }
    with pytest.raises(InputError, match=r"'failure\.aileron\.loss_time' .*'tlc' .*: left,"):
        campaign_of(tmp_path, DRIVEN, dispersions=failing).simulator.make_plans(["tlc"])


def test_all_laws_of_a_campaign_share_the_actuators_and_their_usage_metrics(tmp_path):
    entries = {
        "requirements": [{"metric": "left_max_deg", "below": 30, "probability": 0.5}],
        "keep": {"histories": {"channels": ["right_command_deg", "altitude_m", "left_deg"]}},
        "metrics": {
            "swing_deg": {"of": "left_deg - right_command_deg", "statistic": "peak_to_peak"}
        },
    }
    with pytest.raises(InputError, match="channel 'left_deg'"):
        campaign_of(tmp_path, MIXED, **entries)
    laws = {"tlc": "tlc", "own": write_own_law(tmp_path, '"left": 0.1')}
    campaign = campaign_of(tmp_path, MIXED, laws, **entries)
    assert campaign.kept_channels == ("altitude_m", "left_deg", "right_command_deg")
    for plan in campaign.simulator.make_plans(laws).values():
        assert [m.name for m in plan.metrics] == [
            m.name for m in campaign.measured
        ] and "left" in plan.effectors
        block = fly(cut(plan, 60), nominal_parameters(1), 1)
        channel_index = [channel.name for channel in plan.channels].index("left_deg")
        metric_index = [metric.name for metric in plan.metrics].index("left_max_deg")
        assert block.metrics[0, metric_index] == pytest.approx(
            np.abs(block.history[0, :, channel_index]).max(), rel=1e-6
        )


ELEVONS = [(side, limit) for side in (-1, 1) for limit in (0, 1)]


@pytest.mark.parametrize(
    ("effectors", "limits"),
    [
        ([(-1, 0), (1, 0)], (3, 3)),  # elevons 3
        ([(0, 0), (0, 1)], (20, 6)),  # ailerons 20 and 6
        (ELEVONS, (20, 2)),  # elevons 20 and 2
    ],
)
def test_less_effectiveness_is_that_share_of_the_roll_rate(tmp_path, effectors, limits):
    """At every limit, by axes and by effectors: of the axes, and of all effectors one by one."""
    aerodynamics = make_document("vehicle", "ghame_x").data["aerodynamics"]
    for terms in aerodynamics.values():  # the effectors turn it, and about the x axis alone
        terms[:] = [
            term | ({"scale": 0.0} if term.get("times") == "aileron" else {}) for term in terms
        ]
    flaps, commands = {}, []
    for i, (side, limit) in enumerate(effectors):
        mix = {"aileron": side, "elevator": 1} if side else {"aileron": 1}
        flaps[f"flap_{i}"] = (
            mix | MOVING | {"limits": [f"-{limits[limit]} deg", f"{limits[limit]} deg"]}
        )
        share = (side or 1) / len(effectors)
        aerodynamics["rolling_moment"].append(
            {"table": "roll_aileron", "times": f"flap_{i}", "scale": share}
        )
        commands.append(f'"flap_{i}": {{0}} * {side or 1} + reference.elevator * {abs(side)}')
    vehicle = {"base": "ghame_x", "effectors": flaps, "aerodynamics": aerodynamics}
    ks = (1.0, 0.8, 0.5, 0.2)
    cases = [{"control.aileron_effectiveness": k} for k in ks]
    cases += [
        {f"control.effector_{i}_effectiveness": k for i in range(len(effectors))} for k in ks[1:]
    ]
    for kind in ("axes", "effectors"):
        rates = []
        for aileron in ("0.0", "0.2967"):
            named = "" if kind == "axes" else ", ".join(commands).format(aileron)
            law = write_own_law(tmp_path, named, aileron if kind == "axes" else "0.0")
            block = fly(short_plan(5, law, "level", vehicle), rows_of(*cases), 1, keep_states=True)
            rates.append(block.states[:, 5, s.ROLL_RATE])
        felt = rates[1] - rates[0]
        np.testing.assert_allclose(felt / felt[0], [*ks, *ks[1:]], rtol=0.01)
