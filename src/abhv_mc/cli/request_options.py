"""Command-line options created from the fields of a request."""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from abhv_mc.cli.options import (
    CampaignFile,
    controller_option,
    controllers_option,
    metric_option,
    parse_names,
)
from abhv_mc.cli.outputs import campaign_folder, campaign_folder_or_address, output, output_file
from abhv_mc.io.input_error import InputError
from abhv_mc.requests import Option, options_of


def _parse_shard(text: str) -> tuple[int, int]:
    i, slash, n = text.partition("/")
    if not (text.isascii() and slash and i.isdecimal() and n.isdecimal()):
        raise InputError(
            "--shard", f"invalid shard '{text}'", "a shard and the number of shards, such as 3/8"
        )
    return int(i), int(n)


# Type and typer declaration of each kind of option; options of all other kinds are flags.
_KINDS: dict[str, tuple[Any, Callable[[Option], Any]]] = {
    "address": (Path, lambda o: output(campaign_folder_or_address, "DIR", o.help, o.default or "")),
    "campaign": (Path, lambda _: get_args(CampaignFile)[1]),
    "controller": (str, lambda o: controller_option(o.help, "NAME", show_default=o.default)),
    "controllers": (str, lambda o: controllers_option(o.help)),
    "count": (int, lambda o: _option(o, min=o.low, max=o.high)),
    "file": (Path, lambda o: _option(o, "--tune", metavar="FILE")),
    "folder": (Path | None, lambda o: output(campaign_folder, "DIR", o.help, o.default or "")),
    "metric": (str, lambda o: metric_option(o.help)),
    "new file": (Path, lambda o: output(output_file, "NEW.yaml", o.help)),
    "requirement": (str, lambda o: _option(o, metavar="ID")),
    "number": (float, lambda o: _option(o, min=o.low, max=o.high)),
    "results": (Path, lambda o: _option(o, metavar="DIR")),
    "scheduler": (str, lambda o: _option(o, metavar="ADDRESS")),
    "shard": (str, lambda o: _option(o, metavar="I/N")),
    "share": (str, lambda o: _option(o, metavar="COV")),
    "side": (bool, lambda o: _option(o, "--above/--below")),
}
_PARSERS: dict[str, Callable[[Any], Any]] = {
    "controllers": parse_names,
    "shard": _parse_shard,
    "side": lambda above: "high" if above else "low",
}


def _option(option: Option, *names: str, **settings: Any) -> Any:
    return typer.Option(*names, help=option.help, show_default=option.default or True, **settings)


def takes_options(request: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds the fields of a request as options of a command.

    The decorated function receives the request and the values of its remaining options.
    """
    options = options_of(request)

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        def command(**values: Any) -> None:
            fields = {name: values.pop(name) for name in options if name in values}
            for name, value in fields.items():
                if value is not None and options[name].kind in _PARSERS:
                    fields[name] = _PARSERS[options[name].kind](value)
            if fields.get("output", ...) is None and options["output"].kind == "folder":
                subject = fields.get("metric") or fields["requirement"]
                name = f"{Path(fields['campaign']).stem}_{function.__name__}_{subject}"
                fields["output"] = campaign_folder(Path("reports") / name)
            function(request(**fields), **values)

        _, *further = inspect.signature(function).parameters.values()
        parameters = [
            _make_parameter(parameter, options[name])
            for name, parameter in inspect.signature(request).parameters.items()
            if options[name].kind
        ]
        described: Any = command
        described.__name__, described.__doc__ = function.__name__, function.__doc__
        described.__signature__ = inspect.Signature(
            [
                parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)
                for parameter in (*parameters, *further)
            ]
        )
        return command

    return decorate


def _make_parameter(parameter: inspect.Parameter, option: Option) -> inspect.Parameter:
    flag = f"--{parameter.name.replace('_', '-')}"
    kind, make = _KINDS.get(option.kind, (bool, lambda option: _option(option, flag)))
    if parameter.default is None:
        kind = kind | None
    elif option.kind == "folder":
        parameter = parameter.replace(default=None)
    return parameter.replace(annotation=Annotated[kind, make(option)])
