"""Sections as dataclasses: every kind of value is read, refused, written, and in the schema."""

from __future__ import annotations

import json
import pickle
import re
import time
from dataclasses import dataclass
from typing import Any

import pytest
import yaml
from scenario_file.refused import refused

import radar_sense as rs
from radar_sense.limits import ANY, LEVEL_NAME, NAME, NOT_NEGATIVE, POSITIVE, RUNS, SEED, Limit
from radar_sense.scenario_file import declare, sections
from radar_sense.scenario_file.declare import (
    by_word,
    deviations,
    key,
    keys_of,
    list_of,
    matrix,
    named,
    number,
    numbers,
    or_section,
    read,
    section,
    write,
    yes_no,
)
from radar_sense.scenario_file.load import default_text
from radar_sense.scenario_file.place import parse


@dataclass(frozen=True, kw_only=True)
class Wheel:
    """A wheel."""

    radius_m: float = key("Radius.", POSITIVE)


@dataclass(frozen=True, kw_only=True)
class Sledge:
    """A sledge."""

    length_m: float = key("Length.", POSITIVE, default=2.0)


@dataclass(frozen=True, kw_only=True)
class Cart:
    """A cart, with a key of every kind."""

    name: str = key("Name.", NAME)
    load_kg: float | None = key("Load [kg].", NOT_NEGATIVE, one_of="load")
    boxes: int | None = key("Boxes.", RUNS, one_of="load")
    life_s: float = key("Life.", Limit(at_least=0, infinite=True), default=0.0)
    colour: str = key("Colour.", ("red", "green", "4"), default="red")
    brake: bool = key("Brake.", yes_no(), default=False)
    place_m: Any = key("Place.", numbers(2), default=None)
    std_m: Any = key("Deviations.", deviations(2), unless=("covariance",))
    covariance: Any = key("Covariance.", matrix(2), default=None, instead_of=("std_m",))
    wheels: Any = key("Wheels.", list_of(section(Wheel), "one wheel or more", 1, 2), default=None)
    spare: Wheel | None = key("Spare wheel.", Wheel, default=None)
    runs_on: Any = key(
        "What it runs on.",
        by_word("kind", {"wheel": Wheel, "sledge": Sledge}, bare=True, synonyms={"sled": "sledge"}),
        default=None,
    )
    parts: Any = key("Parts.", named(LEVEL_NAME, number(ANY), "part"), default=None)
    drive: Any = key("Drive.", or_section(NOT_NEGATIVE, Wheel), default=None)


GOOD = """\
name: cart
load_kg: 1e2
life_s: .inf
colour: green
brake: true
place_m: [1, -2.50]
std_m: [[1, 0], [0, 4]]
wheels: [{radius_m: 1}, {radius_m: 2}]
spare: {radius_m: 0.5}
runs_on: {kind: wheel, radius_m: 1}
parts: {a: 1, b: 2}
drive: {radius_m: 3}
"""


def cart(text: str) -> Cart:
    return read(parse(text, "my.yaml"), Cart)


def test_every_kind_is_read_and_written_as_typed():
    made = cart(GOOD)
    assert (made.load_kg, made.life_s) == (100, float("inf"))
    assert (made.brake, made.place_m) == (True, (1, -2.5))
    assert made.wheels == (Wheel(radius_m=1), Wheel(radius_m=2))
    assert (made.runs_on, made.parts["b"], made.drive) == (Wheel(radius_m=1), 2, Wheel(radius_m=3))
    written = write(made)
    assert written == {**yaml.safe_load(GOOD.replace("1e2", "1.0e+2")), "life_s": ".inf"}
    text = yaml.safe_dump(written, sort_keys=False, default_flow_style=None)
    assert "load_kg: 1e2\n" in text
    assert "place_m: [1, -2.50]\n" in text
    assert cart(text) == cart(json.dumps(written)) == made == pickle.loads(pickle.dumps(made))


def test_defaults_that_are_something_are_written():
    assert write(cart("{name: a, boxes: 5e1, std_m: 0, runs_on: sledge}")) == {
        **{"name": "a", "boxes": 50, "colour": "red", "std_m": 0, "runs_on": "sledge"}
    }
    assert write(cart("{name: a, boxes: 2, colour: 4, std_m: 1}"))["colour"] == 4
    assert write(cart("{name: a, boxes: 2, std_m: 1, runs_on: {kind: sledge, length_m: 3}}"))[
        "runs_on"
    ] == {"kind": "sledge", "length_m": 3}


#: A line of a cart, and the error. `...` stands for some letters.
REFUSED = {
    "spar: x": "2: unknown key 'spar', allowed: ...; did you mean 'spare'?",
    "zzz: x": "2: unknown key 'zzz', allowed: name, load_kg, ..., drive",
    "load_kg: 5": "2: duplicate key 'load_kg', first on line 1",
    "boxes: 5": "2: boxes: stands beside 'load_kg'; give only one of the two",
    "covariance: [[1, 0], [0, 1]]": "2: covariance: stands beside 'std_m'; give only ...",
    "? [1]\n: 2": "2: keys must be plain words",
    "brake: yes": "2: brake: must be one of true, false, got 'yes'",
    "colour: rde": "2: colour: must be one of red, green, 4, got 'rde'; did you mean 'red'?",
    "place_m: [1]": "2: place_m: must be a list of 2 numbers, got a list of 1",
    "place_m:\n- 1\n- x": "4: place_m[2]: must be a number, got 'x'",
    "wheels: []": "2: wheels: must be a list of one wheel or more, got a list of 0",
    "wheels: [1]": "2: wheels[1]: must be a mapping (key: value), got 1",
    "wheels: [{}, {}, {}]": "2: wheels: has 3 entries, allowed are 2",
    "spare: {}": "2: spare: missing key 'radius_m', required: radius_m",
    "spare: {radius_m: 0,6}": "2: spare: unknown key '6', ...: write a decimal point, such "
    "as 0.6 for 0,6",
    "spare: {radius_m: -1}": "2: spare.radius_m: must be a number greater than 0, got -1",
    "runs_on: air": "2: runs_on: must be one of wheel, sledge, got 'air'",
    "runs_on: sled": "2: runs_on: must be one of wheel, sledge, got 'sled'; write 'sledge'",
    "runs_on: wheel": "2: runs_on: needs a mapping with 'kind' and radius_m",
    "runs_on: {radius_m: 1}": "2: runs_on: missing key 'kind', one of wheel, sledge",
    "runs_on: {knd: wheel}": "2: runs_on: unknown key 'knd', allowed: ...; did you mean 'kind'?",
    "runs_on: {kind: sledge, radius_m: 1}": "2: ... allowed: kind, length_m; it is a key of wheel",
    "parts: {}": "2: parts: needs at least one part",
    "parts: {a b: 1}": "2: parts: must be the name of a level, ..., got 'a b'",
    "drive: x": "2: drive: must be a number not less than 0, got 'x'",
    "life_s: .nan": "2: life_s: must be a number not less than 0, or .inf, got '.nan'",
    "drive: !!python/name:os.system x": "2: drive: tags are not supported, got ...",
}


@pytest.mark.parametrize("line", REFUSED)
def test_a_refusal_names_line_path_value_and_what_is_allowed(line):
    with refused(f"my.yaml:{REFUSED[line]}$"):
        cart(f"load_kg: 1\n{line}\nname: cart\nstd_m: 1\n")


MISSING = {
    "{boxes: 2, std_m: 1}": "missing key 'name', required: name",
    "{name: a, std_m: 1}": "needs one of the keys 'load_kg' and 'boxes'",
    "{name: a, boxes: 2}": "missing key 'std_m', required without covariance",
    "[1]": "must be a mapping (key: value), got a list of 1",
}


@pytest.mark.parametrize("text", MISSING)
def test_what_is_missing_is_named(text):
    with refused(f"my.yaml:1: {MISSING[text]}"):
        cart(text)


# Numbers.

#: Texts that are no numbers, as an error shows them. `test_table_file` has other hints.
NO_NUMBERS = {
    **{"[1, 2]": "a list of 2", "{}": "a mapping", "": "nothing", "1e400": "1e400"},
    **{"'5'": "'5'; leave out the quotes", "1,5": "'1,5'; write 1.5 for 1,5"},
    **{"0,125": "'0,125'; write 0.125 for 0,125", ".nan": ".nan", "-.Inf": "-.Inf"},
    **{text: f"'{text}'" for text in ("yes", "null", "~", "abc", "2001-01-01", "+", ".", "1e")},
    **{text: f"'{text}'" for text in ("0x10", "1_000", "١٢", "１", "--1")},
}


@pytest.mark.parametrize(("text", "whole"), [("9,000", "9000"), ("-20,000", "-20000")])
def test_a_comma_before_three_digits_may_be_between_thousands(text, whole):
    value = parse(f"key: {text}\n", "my.yaml")["key"]
    with refused(f"got '{text}'; write {whole} or {text.replace(',', '.')} for {text}$"):
        number(ANY).read(value)
    with refused(f"got '{text}'; write {whole} for {text}$"):
        number(Limit(whole=True)).read(value)


@pytest.mark.parametrize("text", NO_NUMBERS)
def test_what_is_no_number_is_refused(text):
    value = parse(f"a: 1\nkey: {text}\n", "my.yaml")["key"]
    for limit in (ANY, Limit(whole=True)):
        with refused(f"my.yaml:2: key: must be ..., got {NO_NUMBERS[text]}$") as error:
            number(limit).read(value)
        assert re.search("must be (a (whole )?number|finite)", str(error.value))


@pytest.mark.parametrize(
    "text", ["1e-6", "1.7e-4", "5", "5.0", "+5", ".5", "5.", "1E3", "007", "&anchor 5", "-0.0"]
)
def test_numbers_as_people_write_them(text):
    plain = text.removeprefix("&anchor ")
    found = number(ANY).read(parse(f"key: {text}", "my.yaml")["key"])
    assert (found, repr(found)) == (float(plain), plain)


def test_whole_numbers_may_be_written_otherwise_and_have_many_digits():
    def whole(text: str) -> int:
        return number(SEED).read(parse(f"key: {text}", "my.yaml")["key"])

    assert [whole(text) for text in ("1e3", "500.0", "9" * 400)] == [1000, 500, int("9" * 400)]
    for text in ("0.5", "-1", "9" * 401):
        with refused("must be a whole number not less than 0"):
            whole(text)


@pytest.mark.parametrize(
    "text", ["1" * 60_000 + "x", "1." * 30_000, "1e" + "9" * 60_000, "-" * 60_000]
)
def test_long_texts_are_refused_at_once(text):
    """Regular expressions that try all parts of a text take minutes."""
    scenario = default_text().replace("constant: 167", f"constant: {text}")
    began = time.process_time()
    with refused("radar.constant: must be a number") as error:
        rs.parse_scenario(scenario)
    assert len(str(error.value)) < 200
    assert time.process_time() - began < 20  # the expression before took over a minute


# Every key of a scenario.

KEYS = [k for _, cls in declare.sections(sections.File) for k in keys_of(cls)]


def read_key(k, text):
    return k.kind.read(parse(f"a: 1\n{k.name}: {text}\n", "my.yaml")[k.name])


def test_every_key_refuses_what_it_is_not():
    """Names are any text; all other values are refused with their place."""
    tried = 0
    for k in KEYS:
        schema = k.kind.schema()
        names = "pattern" in schema.get("anyOf", [schema])[0]
        for text in ("[[1], 2]", "{No!: 1}", "!x y", "12:30", "''")[: 3 if names else 5]:
            with refused(f"my.yaml:2: {k.name}"):
                read_key(k, text)
            tried += 1
    assert tried > 1000


def beyond(schema):
    """Return texts beyond each end of a number, by its schema; none if it is no number."""
    ends = [schema[end] for end in ("exclusiveMinimum", "exclusiveMaximum") if end in schema]
    for end, sign in (("minimum", -1), ("maximum", 1)):
        if end in schema:
            ends.append(schema[end] + sign * max(1, abs(schema[end])))
    return [f"{end:.17g}" for end in ends] + ["2.5"] * (schema.get("type") == "integer")


def test_every_number_refuses_what_is_beyond_its_limit():
    """With its place, what is allowed, and what was given; the limit is that of the schema."""
    tried = 0
    for k in KEYS:
        schema = k.kind.schema()
        for text in beyond(schema.get("anyOf", [schema])[0]):
            allowed = k.kind.allowed.partition(",")[0]
            with refused(f"my.yaml:2: {k.name}: must be {allowed}") as error:
                read_key(k, text)
            assert str(error.value).endswith(f"got {text}") or "of a size" in str(error.value)
            tried += 1
    assert tried > 150
