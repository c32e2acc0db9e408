"""Python function ``abhv_mc.tune``."""

from dataclasses import replace
from pathlib import Path

from abhv_mc.report.pages.page import write_answer
from abhv_mc.requests import takes
from abhv_mc_tune.page import make_tune_answer
from abhv_mc_tune.request import TuneRequest
from abhv_mc_tune.tuning import TuneFound, tune_controller


@takes(TuneRequest)
def tune(request: TuneRequest) -> TuneFound:
    """Tune the free parameters of a controller, as ``abhv-mc tune`` does.

    The new controller file is written only if the result is shown to be better and is within all
    limits (``.shown``).

    Returns
    -------
    TuneFound
        Result of the tuning; ``.as_json()`` returns the content of ``--json``.

    Raises
    ------
    InputError
        If a file or an argument is invalid.

    Examples
    --------
    >>> result = abhv_mc.tune("tune.yaml", "tuned.yaml")  # doctest: +SKIP
    >>> result.shown  # doctest: +SKIP
    True
    """
    out = Path(request.output)

    def finish(result: TuneFound) -> None:
        if request.tell is not None:
            request.tell(result)
        figures = out.with_suffix(".tuning") / "figures"
        write_answer(make_tune_answer(result), out.with_suffix(".html"), figures)

    return tune_controller(replace(request, tell=finish))
