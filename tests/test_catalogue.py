"""The catalogue owns the strokes, keeps them in range, adds and removes them."""

import math

import pytest
import torch
from scenes import random_strokes

from brushexp.errors import UserError
from brushexp.strokes.catalogue import Catalogue, check_strokes

UNITS = {"position": 1.0, "start": 1.0, "control": 1.0, "end": 1.0, "width": 0.3, "color": 1.0, "opacity": 0.5}


def assert_same(one, other):
    torch.testing.assert_close(dict(one.items()), dict(other.items()))


@pytest.mark.parametrize("n", [0, 20])
def test_a_catalogue_gives_back_its_strokes(n):
    catalogue = Catalogue(random_strokes(n, (30, 40)), UNITS)
    catalogue.keep_in_range()
    assert_same(catalogue(), random_strokes(n, (30, 40)))


def test_a_step_of_one_rate_moves_each_field_by_its_unit():
    strokes = random_strokes(5, (30, 40))
    catalogue = Catalogue(strokes, UNITS)
    optimizer = torch.optim.SGD(catalogue.parameters(), lr=1e-3)
    sum(parameter.sum() for parameter in catalogue.parameters()).backward()
    optimizer.step()
    moved = catalogue()
    assert all(bool((getattr(moved, name) != getattr(strokes, name)).any()) for name in UNITS)
    torch.testing.assert_close(moved.width, strokes.width - 1e-3 * 0.3)
    torch.testing.assert_close(moved.position, strokes.position - 1e-3 * 0.5 * strokes.scale[:, None])
    assert torch.equal(moved.scale, strokes.scale), "a field without a unit must not move"


def test_the_scale_can_move_instead_of_the_position():
    catalogue = Catalogue(random_strokes(5, (30, 40)), {"scale": 10.0})
    catalogue().scale.sum().backward()
    torch.testing.assert_close(catalogue.scale.grad, torch.full((5,), 10.0))
    with pytest.raises(UserError, match="set the rate of scale to 0"):
        Catalogue(random_strokes(5, (30, 40)), {"scale": 10.0, "position": 1.0})


def test_numbers_out_of_range_are_brought_back_but_named_when_they_are_given():
    strokes = random_strokes(4, (30, 40))
    catalogue = Catalogue(strokes, UNITS)
    with torch.no_grad():
        catalogue.color[0, 0] = 7.0
        catalogue.opacity[1] = -3.0
        catalogue.width[2] = -1.0
        catalogue.start[3, 0] = torch.nan
        catalogue.position[0, 1] = torch.inf
    catalogue.keep_in_range()
    check_strokes(catalogue())
    with pytest.raises(UserError, match="no stroke field is called 'colour'; the fields are position, scale"):
        Catalogue(strokes, {"colour": 1.0})
    strokes.control[2, 1] = torch.nan
    with pytest.raises(UserError, match=r"stroke 2: control is .*nan; it must lie in \[-1000, 1000\]"):
        Catalogue(strokes, UNITS)


def test_strokes_of_a_loop_of_ones_own_are_brought_back_where_they_are():
    strokes = random_strokes(3, (20, 30)).map(lambda value: value.requires_grad_())
    with torch.no_grad():
        strokes.color[0] = torch.tensor([-0.5, 0.25, 1.5])
        strokes.opacity[1], strokes.width[2], strokes.scale[0] = math.nan, -1.0, -math.inf
    leaf = strokes.color
    assert strokes.clamp() is strokes
    check_strokes(strokes)
    assert strokes.color is leaf
    assert leaf.is_leaf
    assert leaf[0].tolist() == [0.0, 0.25, 1.0]
    assert (strokes.opacity[1].item(), strokes.width[2].item()) == (0.0, 0.0)


def test_strokes_that_stay_keep_their_optimiser_state():
    strokes, new = random_strokes(6, (30, 40)), random_strokes(3, (30, 40), seed=9)
    catalogue = Catalogue(strokes, UNITS)
    optimizer = torch.optim.Adam(catalogue.parameters(), lr=0.01)
    for _ in range(3):
        optimizer.zero_grad()
        sum(parameter.square().sum() for parameter in catalogue.parameters()).backward()
        optimizer.step()
    before, momentum = catalogue(), optimizer.state[catalogue.start]["exp_avg"].clone()
    keep = torch.tensor([True, False, True, True, False, True])
    catalogue.revise(keep, new, optimizer)
    assert_same(catalogue()[:4], before[keep].map(torch.Tensor.detach))
    assert_same(catalogue()[4:], new)
    state = optimizer.state[catalogue.start]
    torch.testing.assert_close(state["exp_avg"][:4], momentum[keep])
    assert (state["exp_avg"][4:] == 0).all()
    assert float(state["step"]) == 3
    assert catalogue.brush.tolist() == [0, 2, 3, 5, 4, 5, 6], "and the look that renderers give them"
    again = Catalogue(random_strokes(7, (30, 40)), UNITS)
    again.load_state_dict(catalogue.state_dict())
    assert torch.equal(again().map(torch.Tensor.double)[2:].brush, catalogue.brush[2:])
    optimizer.zero_grad()
    catalogue().start.sum().backward()
    optimizer.step()  # the optimiser moves the new parameters
    assert not torch.equal(catalogue().start[4:], new.start)


def test_strokes_are_replaced_in_place_whatever_their_units():
    units = UNITS | {"width": 0.0, "color": 0.3}
    catalogue, new = Catalogue(random_strokes(6, (30, 40)), units), random_strokes(6, (30, 40), seed=9)
    held = {name: parameter for name, parameter in catalogue.named_parameters()}
    catalogue.replace(new)
    assert_same(catalogue(), new)
    assert all(parameter is held[name] for name, parameter in catalogue.named_parameters())
