"""Cases: streams of truth, checks of shapes, and a card that survives JSON."""

import dataclasses
import json

import numpy as np
import pytest

from cases import CASES
from suite.case import GIVEN_TRACK, RECORDED, Card, Divergence, StateBlock, Truth, draw, measure
from suite.errors import BadInput
from suite.random import Streams
from tests.oracles import generators, random_linear

BASE = CASES["linear-gaussian"]
DRAWN_STARTS = (
    "manoeuvre-detection/naval",
    "manoeuvre-detection/naval-straight",
    "passive-multisensor",
    "passive-multisensor/5mrad",
)
"""Cases whose given track starts elsewhere in every run."""


@pytest.mark.parametrize("name", list(CASES))
def test_simulation_depends_on_run_and_seed_alone(name):
    case = CASES[name]
    whole = case.simulate(5, seed=3)
    assert whole.x.shape == (case.steps, case.model.n, 5)
    assert whole.y.shape == (case.steps, case.model.m, 5)
    for first, runs in [(0, 1), (2, 2), (4, 1)]:
        part = case.simulate(runs, seed=3, first=first)
        np.testing.assert_array_equal(part.x, whole.x[..., first : first + runs])
        np.testing.assert_array_equal(part.y, whole.y[..., first : first + runs])
    seen = whole.y[~np.isnan(whole.y)]
    if case.origin == RECORDED:
        np.testing.assert_array_equal(case.simulate(1, seed=4).y, whole.y[..., :1])
    else:
        assert not np.isin(case.simulate(1, seed=4).y, seen).any()
        assert len(np.unique(seen)) > 0.999 * seen.size  # no run repeats another


@pytest.mark.parametrize("name", list(CASES))
def test_truths_come_from_where_the_case_says(name):
    """Runs of a given track or of a recording share their states, those drawn do not; recordings share all."""
    case = CASES[name]
    truth = case.simulate(2)
    states, measurements = (np.array_equal(part[..., 0], part[..., 1], equal_nan=True) for part in (truth.x, truth.y))
    drawn = case.name in DRAWN_STARTS
    assert states == (case.origin in (GIVEN_TRACK, RECORDED) and not drawn)
    assert measurements == (case.origin == RECORDED)


def test_cases_of_another_name_have_other_numbers():
    other = dataclasses.replace(BASE, name="another")
    assert not np.isin(other.simulate(2).y, BASE.simulate(2).y).any()


def test_draw_and_measure_follow_the_model_step_by_step():
    problem = random_linear(4, 2, 2, 1)
    truth = draw(problem.model, 3, generators(4, "draw"))
    rng = generators(4, "draw")
    x = problem.model.prior.sample(rng, (4,))
    path = []
    for k in (1, 2, 3):
        x = problem.model.dynamics.sample(rng, x, k)
        path.append(x)
    np.testing.assert_array_equal(truth.x, np.stack(path))
    y = [problem.model.sensor.sample(rng, at, k) for k, at in enumerate(path, start=1)]
    np.testing.assert_array_equal(truth.y, np.stack(y))
    again = measure(problem.model.sensor, truth.x, generators(4, "measure"))
    assert again.shape == (3, 2, 4)


def test_runs_start_at_one():
    for runs in (0, -1):
        with pytest.raises(BadInput, match="at least 1"):
            BASE.simulate(runs)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"state": ("x",)}, "1 state names for 4 components"),
        ({"blocks": (StateBlock("position", (0, 4), "m"),)}, "'position' names components outside 0..3"),
        ({"blocks": (StateBlock("position", (), "m"),)}, "'position'"),
        ({"blocks": (StateBlock("position", (-1,), "m"),)}, "'position'"),
        ({"divergence": Divergence("height", 1.0, 1)}, "unknown block 'height'"),
        ({"steps": 0}, "steps must be at least 1"),
    ],
)
def test_a_bad_case_is_refused_by_name(changes, words):
    with pytest.raises(ValueError, match=rf"case linear-gaussian: .*{words}"):
        dataclasses.replace(BASE, **changes)


@pytest.mark.parametrize("part", ["x", "y"])
def test_a_generator_of_the_wrong_shape_is_named(part):
    truth = BASE.simulate(2)
    arrays = {"x": truth.x, "y": truth.y} | {part: getattr(truth, part)[:-1]}
    broken = dataclasses.replace(BASE, generate=lambda rng: Truth(**arrays))
    with pytest.raises(ValueError, match=f"case linear-gaussian: {part} has shape"):
        broken.simulate(2)


@pytest.mark.parametrize("name", list(CASES))
def test_the_card_survives_json(name):
    case = CASES[name]
    card = Card.from_dict(json.loads(json.dumps(case.to_dict())))
    for field in dataclasses.fields(Card):
        assert getattr(card, field.name) == getattr(case, field.name), field.name
    assert type(card) is Card
    assert card.block(case.blocks[0].name) == case.blocks[0]


def test_generators_are_keyed_by_seed_name_and_purpose():
    seen = []
    spy = dataclasses.replace(
        BASE, generate=lambda rng: seen.append(rng) or Truth(np.zeros((100, 4, 1)), np.zeros((100, 2, 1)))
    )
    spy.simulate(1, seed=5, first=7)
    expected = Streams((5, "linear-gaussian", "truth"), 7).batch(0, 1)
    np.testing.assert_array_equal(seen[0].random((3, 1)), expected.random((3, 1)))
