"""Tests of the abstraction option, which uses fewer strokes and flattens forms but keeps faces recognisable."""

import pytest
import torch
from skimage import data

import brushexp
from brushexp.pictures.abstraction import simplify
from brushexp.pictures.faces.detection import find_faces


@pytest.fixture(scope="module")
def paintings():
    portrait = data.astronaut()[:192, 128:320]
    return [brushexp.paint(portrait, abstraction=value, steps=4, variety=0) for value in (0, 0.5, 1)]


def test_abstraction_makes_strokes_fewer_forms_flat_where_nobody_looks_and_leaves_faces_and_what_is_typed(paintings):
    counts = [len(painting.strokes) for painting in paintings]
    assert counts == sorted(counts, reverse=True)
    distances = [painting.metrics["perceptual"] for painting in paintings]
    assert distances == sorted(distances)
    (face,) = find_faces(torch.from_numpy(paintings[0].target).float().movedim(-1, 0) / 255)
    for painting in paintings:  # faces keep many strokes, and are still found
        position = painting.strokes.position
        on_face = (position - torch.tensor([face.x, face.y])).norm(dim=1) < face.side / 2
        assert on_face.sum() > 80
        assert find_faces(torch.from_numpy(painting.image).float().movedim(-1, 0) / 255)
    without = [brushexp.paint("chelsea", abstraction=value, steps=0, resolution=192, faces="off") for value in (0, 1)]
    assert len(without[0].strokes) == pytest.approx(40 * len(without[1].strokes), rel=0.05)
    painting = brushexp.paint("astronaut", abstraction=1, strokes=50, resolution=64, steps=0, quality="draft")
    assert len(painting.strokes) == 50
    picture = torch.rand(3, 40, 60, generator=torch.Generator().manual_seed(0))
    attended = torch.zeros(40, 60)
    attended[:, 30:] = 1
    flat = simplify(picture, 1, attended)
    assert torch.equal(flat[:, :, 30:], picture[:, :, 30:])
    assert flat[:, :, :30].std() < 0.5 * picture[:, :, :30].std()
    assert simplify(picture, 0, attended) is picture
    assert simplify(picture[:, :1, :1], 0.5, None).shape == (3, 1, 1)
