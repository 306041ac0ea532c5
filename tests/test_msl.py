"""The examples of `tests/msl` are those of the specs, part by part, and run inside the tube of the references."""

import pytest
from msl_bench import (
    EXAMPLES,
    connections_of,
    equations_of,
    fixed_starts,
    load,
    our_end,
    our_parameters,
    our_type,
    run,
    type_of,
    value_of,
)

from cartpend_dae.language import parts_of

every_example = pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)


@every_example
def test_parts_and_connections_are_those_of_the_spec(path, msl_dir):
    example = load(path, msl_dir)
    expected = {name: our_type(facts["type"]) for name, facts in example.components.items()}
    found = {name: type_of(part) for name, part in parts_of(example.model).items()}
    pairs = example.spec["wiring"]["connections"]
    if example.partial:
        found = {name: kind for name, kind in found.items() if name in expected}
        pairs = [ends for ends in pairs if all(" " not in end and "." in end for end in ends)]
    wanted = {frozenset(our_end(end, example.components) for end in ends) for ends in pairs}
    assert found == expected
    assert wanted <= connections_of(example.model)
    assert example.partial or wanted == connections_of(example.model)
    assert not equations_of(example.model)


@every_example
def test_parameters_are_those_of_the_spec(path, msl_dir):
    example = load(path, msl_dir)
    parts = parts_of(example.model)
    for part, facts in example.components.items():
        for name, expected in our_parameters(facts).items():
            found = value_of(parts[part], name)
            # The numbers of the spec are rounded to fourteen digits.
            near = found == expected or (isinstance(expected, float) and found == pytest.approx(expected, rel=1e-12))
            assert near, f"{part}.{name} is {found} instead of {expected}"


@every_example
def test_the_motion_stays_inside_the_tube_of_the_reference(path, msl_dir, record_property):
    example = load(path, msl_dir)
    outcome = run(example)
    record_property("tube_use", outcome.worst)
    outside = {name: use for name, use in outcome.use.items() if use > 1}
    assert not outside
    # What the reference fixes at the start is met by solving, not by integration.
    for name, value in fixed_starts(example):
        assert outcome.start[name] == pytest.approx(value, abs=1e-9), name


def test_the_spring_that_holds_the_rod_level_is_found(msl_dir):
    example = next(path for path in EXAMPLES if path.stem == "init_spring_constant")
    # c (0.2 m - 0.1 m) 1 m = 1 kg 9.80665 m/s2 0.5 m
    assert run(load(example, msl_dir)).start["spring.c"] == pytest.approx(49.03325, rel=1e-10)
