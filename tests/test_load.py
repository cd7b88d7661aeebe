"""Tests that paintings load from folders, strokes are drawn in batches, and bad input is refused in one line."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch
from refusals import refuses
from scenes import random_strokes

import brushexp
from brushexp.strokes.bezier import roomy_window

SMALL = {"resolution": 32, "strokes": 20, "steps": 3}
SIZE = (24, 32)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Paint a picture that is lit by a lamp, and return the run's folder with all output files."""
    place = tmp_path_factory.mktemp("runs") / "x"
    brushexp.paint("chelsea", look="impasto", **SMALL, output=place, threads=1)
    return place


def test_a_run_is_loaded_as_it_was_painted(folder, tmp_path):
    painting = brushexp.load(folder)
    assert painting.metrics == json.loads((folder / "metrics.json").read_text())
    assert repr(painting) == f"Painting(20 strokes on 32 x 21 pixels, {painting.metrics['psnr']:.2f} dB)"
    assert painting.target.shape == painting.image.shape == (21, 32, 3)
    assert np.array_equal(painting.image, painting.render())
    again = brushexp.load(folder / "catalogue.h5")
    for name, value in painting.strokes.items():
        assert torch.equal(value, getattr(again.strokes, name))
    assert torch.equal(painting.depth, again.depth)
    assert painting.save(tmp_path / "copy").is_file()
    copy = brushexp.load(tmp_path / "copy")
    assert copy.metrics == painting.metrics
    assert np.array_equal(copy.image, painting.image)
    assert "chelsea" in (tmp_path / "copy" / ".hydra" / "overrides.yaml").read_text()
    assert "<iframe" in painting._repr_html_()


def test_a_catalogue_alone_is_drawn_and_has_no_target(folder, tmp_path):
    (text,) = brushexp.load(folder).export("json", tmp_path)
    painting = brushexp.load(text)
    assert np.abs(painting.image.astype(int) - brushexp.load(folder).image).max() <= 1
    assert painting.metrics == {}
    assert repr(painting) == "Painting(20 strokes on 32 x 21 pixels)"
    with pytest.raises(brushexp.UserError, match=r"loaded without the target\.png of its run"):
        painting.target  # noqa: B018
    assert painting.save(tmp_path / "saved").is_file()
    assert brushexp.load(tmp_path / "saved").metrics["status"] == "completed"


def test_what_is_no_painting_is_refused(folder, tmp_path):
    refuses("give the folder of a finished run, source=outputs/x", brushexp.load, tmp_path)
    shutil.copytree(folder, tmp_path / "sweep" / "0")
    refuses(r"give one of the folders below it, source=.*0.catalogue\.h5", brushexp.load, tmp_path / "sweep")


def test_a_batch_has_the_pictures_and_the_gradients_of_each_alone():
    several = [random_strokes(n, SIZE).map(lambda value: value.requires_grad_()) for n in (5, 3, 4)]
    depths = [torch.randperm(len(strokes)) for strokes in several]
    grounds = torch.rand(3, 3)
    pictures = brushexp.render(several, SIZE, depth=depths, background=grounds)
    alone = [
        brushexp.render(strokes, SIZE, depth=depth, background=ground)
        for strokes, depth, ground in zip(several, depths, grounds, strict=True)
    ]
    assert torch.equal(pictures, torch.stack(alone))
    pictures.square().sum().backward()
    together = [strokes.color.grad.clone() for strokes in several]
    for strokes, picture, expected in zip(several, alone, together, strict=True):
        strokes.color.grad = None
        picture.square().sum().backward()
        torch.testing.assert_close(strokes.color.grad, expected)
    plain = brushexp.render(several, SIZE)
    assert torch.equal(plain[1], brushexp.render(several[1], SIZE))


def test_what_a_batch_cannot_be_is_refused():
    one = random_strokes(3, SIZE)
    refuses("strokes is an empty list", brushexp.render, [], SIZE)
    refuses(r"strokes\[1\] is Tensor; give Strokes, or a list of them", brushexp.render, [one, one.color], SIZE)
    refuses("depth has 3 entries for 2 canvases", brushexp.render, [one, one], SIZE, depth=torch.arange(3))
    refuses(r"depth has shape \(2,\); give a rank for each of the 3", brushexp.render, one, SIZE, depth=torch.arange(2))
    refuses(r"background has shape \(4, 3\); .*, or \(2, 3\) of them", brushexp.render, [one, one], SIZE,
            background=torch.ones(4, 3))  # fmt: skip


def test_second_derivatives_and_transforms_are_refused_in_one_line_and_dense_has_second_ones():
    strokes = random_strokes(3, SIZE).map(lambda value: value.requires_grad_())

    def slope(blend, power):
        picture = brushexp.render(strokes, SIZE, blend=blend)
        return torch.autograd.grad(picture.pow(power).sum(), strokes.color, create_graph=True)[0]

    for power in (1, 2):  # the gradient of the picture is constant at first, then not
        refuses("first derivatives only; blend='dense' .* has second too", slope("tiled", power).sum().backward)
    torch.testing.assert_close(slope("dense", 2), slope("tiled", 2), rtol=1e-3, atol=1e-3)
    (second,) = torch.autograd.grad(slope("dense", 2).sum(), strokes.color)
    assert second.abs().max() > 0
    color = strokes.color.detach()

    plain = random_strokes(3, SIZE)

    def mean_of(color):
        return brushexp.render(replace(plain, color=color), SIZE).mean()

    message = r"render does not work within torch\.func .*; call \.backward\(\) or .*, and give a list of strokes"
    refuses(message, torch.func.grad(mean_of), color)
    refuses(message, torch.func.vmap(mean_of), color.expand(2, 3, 3))


def test_one_stroke_is_selected_by_its_number_and_a_loop_ends():
    strokes = random_strokes(3, SIZE)
    for k, one in enumerate(strokes):
        assert len(one) == 1
        assert torch.equal(one.position[0], strokes.position[k])
        assert one.brush.tolist() == [k]
    assert torch.equal(strokes[-1].color, strokes.color[2:])
    assert len(strokes[torch.tensor([True, False, True])]) == 2
    with pytest.raises(IndexError):
        strokes[3]
    refuses(r"map must keep the number of strokes, 3, but the function returned 1; select strokes with strokes\[:1\]",
            strokes.map, lambda value: value[:1])  # fmt: skip


def test_windows_of_several_pitches():
    assert roomy_window(torch.tensor([0.1, 10.0])).tolist() == pytest.approx([roomy_window(0.1), roomy_window(10.0)])
