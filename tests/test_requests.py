"""Requests: one declaration gives options, function arguments and their documentation."""

import inspect

import pytest
import typer

import abhv_mc
from abhv_mc.cli.app import app
from abhv_mc.io.messages import InputError
from abhv_mc.requests import RareRequest, Request, WorstRequest, options_of
from abhv_mc_tune.request import TuneRequest

TAKEN = [
    ("run", abhv_mc.Campaign.run, Request),
    ("worst", abhv_mc.worst, WorstRequest),
    ("rare", abhv_mc.rare, RareRequest),
    ("tune", abhv_mc.tune, TuneRequest),
]


@pytest.mark.parametrize(("name", "function", "request_"), TAKEN)
def test_options_and_arguments_are_the_fields_with_their_help(name, function, request_):
    options = options_of(request_)
    arguments = inspect.signature(function).parameters
    assert list(arguments) == list(inspect.signature(request_).parameters)
    assert set(arguments) == set(options)
    command = typer.main.get_command(app).get_command(None, name)
    helps = {parameter.name: parameter.help for parameter in command.params}
    for field, option in options.items():
        if option.kind:
            assert helps[field] == option.help
        if (name, field) != ("run", "campaign"):
            is_documented = f"{field}\n    {option.help} By default" in inspect.getdoc(function)
            is_required = arguments[field].default is inspect.Parameter.empty
            assert f"{field}\n    {option.help}" in inspect.getdoc(function)
            assert is_documented == bool(option.default and not is_required)


def test_values_are_converted_and_checked(repository):
    shipped = repository / "campaigns" / "wide.yaml"
    request = RareRequest("wide", "out", "miss", target_cov="5 %", flights=10)
    assert request.campaign == shipped and request.settings == {
        "requirement": "miss",
        "target_cov": 0.05,
        "flights": 10,
        "surrogate": False,
    }
    assert RareRequest("wide", "out", "miss").settings["flights"] == 20_000
    assert RareRequest("wide", "out", "miss", surrogate=True).settings["flights"] == 400
    assert Request(abhv_mc.Campaign.read(shipped)).campaign == shipped
    for wrong in ({"runs": 0}, {"seed": -1}, {"workers": True}, {"workers": 10_000}):
        (name,) = wrong
        with pytest.raises(InputError, match=f"^{name}: "):
            Request(shipped, **wrong)


@pytest.mark.parametrize(("flag", "bad"), [("--above", "high"), ("--below", "low"), (None, None)])
def test_a_side_is_a_flag(flag, bad, monkeypatch):
    requests = []
    monkeypatch.setattr("abhv_mc.api.worst", lambda **fields: requests.append(fields) or 1 / 0)
    arguments = ["worst", "wide", "--metric", "m", "-o", "out", *([flag] if flag else [])]
    with pytest.raises(ZeroDivisionError):
        typer.main.get_command(app)(arguments)
    assert requests[0]["bad"] == bad and requests[0]["flights"] == 2000
