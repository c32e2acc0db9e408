"""Content of documents, and source locations of errors."""

import pickle
from typing import Annotated, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import Field, model_validator

from abhv_mc.io.documents import (
    File,
    StrictModel,
    read_document,
    validate,
    write_document,
)
from abhv_mc.io.messages import InputError, InputErrors, Refusal, one_of
from abhv_mc.io.units import Fraction, Length


class Uniform(StrictModel):
    distribution: Literal["uniform"]
    half_width: Fraction


class Normal(StrictModel):
    distribution: Literal["normal"]
    standard_deviation: Fraction


class Campaign(StrictModel):
    name: str
    runs: Annotated[int, Field(gt=0)]
    altitudes: tuple[Length, ...] = ()
    step: float = 1.0
    sampling: Literal["random", "lhs"] = "random"
    vehicle: File | None = None
    dispersions: dict[str, Annotated[Uniform | Normal, Field(discriminator="distribution")]] = (
        Field(default_factory=dict)
    )

    @model_validator(mode="after")
    def _check(self):
        if self.name == "same":
            raise Refusal("'same'", "another", ("name",))
        return self


def document(folder, text):
    path = folder / "x.yaml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_document(path)


GOOD = "name: a\nruns: 3\n"


def test_values_and_places(tmp_path):
    read = document(
        tmp_path, "a: 1\nb:\n  - x: 2.5\n    y: [true, null, ~, 'no']\n  - no\n  - 2014-01-31\n"
    )
    assert read.data == {
        "a": 1,
        "b": [{"x": 2.5, "y": [True, None, None, "no"]}, "no", "2014-01-31"],
    }
    assert read.position("a") == (1, 4)
    assert read.key_position("a") == (1, 1)
    assert read.position("b", 0, "y", 3) == (4, 24)
    assert read.key_position("b", 0, "y") == (4, 5)
    assert read.position("b", 0, "missing", 7) == read.position("b", 0) == (3, 5)


@pytest.mark.parametrize(
    ("text", "location", "problem"),
    [
        ("a: 1\na: 2\n", (2, 1), "'a' is repeated"),
        ("a: 1\n\tb: 2\n", (2, 1), "a tab"),
        ("a: 1\nb: [1\n", (3, 1), "expected"),
        ("a: 1\nb: {c: 1, d\r", (3, 1), "expected"),  # a lone carriage return ends a line in YAML
        ("a: !!python/object/apply:os.system [ls]\n", (1, 4), "tag"),
        ("x: 1\na: *unknown\n", (2, 4), "alias"),
        ("1: a\n", (1, 1), "key 1"),
        ("a: .nan\n", (1, 4), ".nan"),
        ("a: 1\n---\nb: 2\n", (2, 1), "another document"),
        (b"a: 1\nb: \xff\n", (2, 4), "0xff"),
        ("a: 1\nb: \x01\n", (2, 4), "\\x01"),
        ("a: 1_000\n", (1, 4), "1_000"),
        ("%YAML 1.1\n---\na: yes\n", (3, 4), "bool"),  # true there, no text as in YAML 1.2
        ('a: "b\\u202ec"\n', (1, 4), "\\u202e"),
        ("", (1, 1), "empty"),
        ("[" * 50_000, (), "nested"),
        ("a: &a [*a]\n", (), "nested"),
        (
            "a: &a [1, 2, 3, 4, 5, 6, 7, 8, 9]\nb: &b [*a, *a, *a, *a]\nc: ["
            + "*b, " * 5000
            + "1]\n",
            (1, 32),
            "100\u202f000",
        ),
    ],
)
def test_refused_text(tmp_path, text, location, problem):
    with pytest.raises(InputError) as caught:
        document(tmp_path, text)
    error = caught.value
    assert problem in error.found
    assert str(error).startswith(":".join(map(str, (tmp_path / "x.yaml", *location))) + ": ")


@pytest.mark.parametrize(
    ("word", "key"), [("std", "sigma"), ("min", "low"), ("Gaussian", "normal")]
)
def test_words_of_other_programs_suggest_the_key(word, key):
    assert one_of(["sigma", "low", "high", "normal"], word).endswith(f" '{key}'?)")
    assert "?" not in one_of(["alpha", "beta"], word)


def test_numbers_of_numpy_are_written_as_numbers(tmp_path):
    """Regression: a sweep over np.linspace in a notebook raised a RepresenterError."""
    data = {
        "a": np.float64(0.1),
        "b": [np.int64(3), np.bool_(True), np.str_("c")],
        "d": np.array(2.5),
    }
    write_document(tmp_path / "x.yaml", data)
    assert read_document(tmp_path / "x.yaml").data == {"a": 0.1, "b": [3, True, "c"], "d": 2.5}
    for odd in (np.zeros(2), object()):
        with pytest.raises(InputError, match=f"of type {type(odd).__name__}"):
            write_document(tmp_path / "x.yaml", {"a": odd})
    assert read_document(tmp_path / "x.yaml").data == {"a": 0.1, "b": [3, True, "c"], "d": 2.5}


def test_refused_paths(tmp_path):
    for path, problem in (
        (tmp_path / "missing.yaml", r"missing\.yaml: "),
        (tmp_path, "folder"),
        ("a\0b", "null"),
    ):
        with pytest.raises(InputError, match=rf"{problem}.*\bYAML\b"):
            read_document(path)


@pytest.mark.parametrize(
    ("text", "location", "problem", "expected"),
    [
        (GOOD + "sampling: lsh\n", (3, 11), "'lsh'", "'lhs'"),
        (GOOD + "vehicel: x\n", (3, 1), "'vehicel'", "'vehicle'"),
        ("name: a\n", (1, 1), "'runs'", "'runs'"),
        ("name: a\nruns: 0\n", (2, 7), "0", "greater than 0"),
        (GOOD + "altitudes: [1 m, 20]\n", (3, 18), "20 ", "'20 km'"),
        (
            GOOD + "vehicle: missing.yaml\n",
            (3, 10),
            "'missing.yaml'",
            "path",
        ),
        (
            GOOD + "dispersions: {a: {distribution: unifrm}}\n",
            (3, 33),
            "'unifrm'",
            "'uniform'",
        ),
        (
            GOOD + "dispersions: {a: {half_width: 1}}\n",
            (3, 18),
            "'distribution'",
            "mapping",
        ),
        (
            GOOD + "dispersions: {normal: {distribution: normal, standard_deviation: 3 m}}\n",
            (3, 66),
            "'3 m'",
            "percentage",
        ),
        ("name: same\nruns: 3\n", (1, 7), "'same'", "another"),
        ("- 1\n", (1, 1), "list", "a mapping"),
    ],
)
def test_refused_values(tmp_path, text, location, problem, expected):
    with pytest.raises(InputErrors) as caught:
        validate(document(tmp_path, text), Campaign)
    (error,) = caught.value.errors
    assert (error.line, error.column) == location
    assert problem in error.found
    assert expected in error.expected


def test_errors_travel_between_processes():
    error = InputError("x.yaml", "a", "b", 3)
    assert str(pickle.loads(pickle.dumps(error))) == "x.yaml:3: a; expected b"  # noqa: S301
    both = pickle.loads(pickle.dumps(InputErrors([error, error])))  # noqa: S301
    assert str(both) == f"{error}\n{error}"
    assert (both.line, both.found) == (3, "a")


SHOWN = st.text(st.characters(exclude_categories=("C", "Zl", "Zp")))
PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | SHOWN,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(SHOWN, inner, max_size=4),
    max_leaves=12,
)


@settings(max_examples=60)
@given(
    data=st.dictionaries(SHOWN, PLAIN, max_size=5), comment=st.text(alphabet="abc \n#", max_size=20)
)
def test_what_is_written_reads_back(tmp_path_factory, data, comment):
    path = tmp_path_factory.getbasetemp() / "written.yaml"
    write_document(path, data, comment)
    assert read_document(path).data == data
