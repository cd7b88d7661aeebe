"""Abstraction: fewer and larger strokes, flatter forms, and faces that stay faces."""

import pytest
import torch
from skimage import data

import brushexp
from brushexp.pictures.abstraction import simplified
from brushexp.pictures.focus import faces


@pytest.fixture(scope="module")
def paintings():
    portrait = data.astronaut()[:192, 128:320]
    return [brushexp.paint(portrait, abstraction=value, steps=4) for value in (0, 0.7, 1)]


def test_strokes_become_fewer_and_the_picture_less_like(paintings):
    counts = [len(painting.strokes) for painting in paintings]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] == pytest.approx(40 * counts[-1], rel=0.05)
    distances = [painting.metrics["perceptual"] for painting in paintings]
    assert distances == sorted(distances)


def test_a_face_stays_a_face(paintings):
    assert faces(torch.from_numpy(paintings[1].image).float().movedim(-1, 0) / 255)


def test_what_is_typed_stays():
    painting = brushexp.paint("astronaut", abstraction=1, strokes=50, resolution=64, steps=0, quality="draft")
    assert len(painting.strokes) == 50


def test_forms_become_flat_where_nobody_looks():
    picture = torch.rand(3, 40, 60, generator=torch.Generator().manual_seed(0))
    attended = torch.zeros(40, 60)
    attended[:, 30:] = 1
    flat = simplified(picture, 1, attended)
    assert torch.equal(flat[:, :, 30:], picture[:, :, 30:])
    assert flat[:, :, :30].std() < 0.5 * picture[:, :, :30].std()
    assert simplified(picture, 0, attended) is picture
    assert simplified(picture[:, :1, :1], 0.5, None).shape == (3, 1, 1)
