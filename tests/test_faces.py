"""Tests of faces: the network, detection at any tilt and size, and the small strokes of eyes and mouths."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image
from torch.testing import assert_close

from brushexp.config.check import check
from brushexp.errors import UserError
from brushexp.painting.build import build_painter, faces_of
from brushexp.painting.components import first_strokes
from brushexp.painting.faces import (
    FLOOR,
    FLOOR_OF_FACE,
    THINNEST_STROKE,
    TYPED_SHARE,
    Feature,
    draw_features,
    features_of,
    places_of,
)
from brushexp.pictures.color import as_lab
from brushexp.pictures.face import Face, Landmark
from brushexp.pictures.faces.contrast import NONE, restore_forms
from brushexp.pictures.faces.detection import (
    HEAD_SCORE,
    HEAD_SEEN,
    LEAST_SCORE,
    distinct,
    faces_among,
    find_faces,
    find_faces_and_heads,
    heads_among,
    rotate,
    rotate_back,
)
from brushexp.pictures.faces.marked import marked_faces
from brushexp.pictures.faces.network import HEADS, LANDMARKS, STRIDES, _decode, open_network
from brushexp.pictures.faces.spots import MOST_SPOTS, contrast_of_spot, find_eyes, find_spots
from brushexp.pictures.focus import attention
from brushexp.pictures.load import load_picture
from brushexp.plugins.density.fixed import Fixed
from brushexp.registry import take_built
from brushexp.strokes.bezier import half_width_of
from brushexp.strokes.catalogue import Strokes

# Results of ONNX Runtime with the published file, face_detection_yunet_2023mar.onnx, for a face on black: the best
# candidate at strides 8 and 32.
PUBLISHED = {
    8: (0.93134, (62.921, 57.101), (88.237, 108.419), (40.497, 38.209), (79.061, 79.473)),
    32: (0.91805, (62.423, 57.028), (91.634, 112.786), (37.946, 37.014), (77.568, 79.232)),
}


def test_the_network_answers_as_the_published_one():
    canvas = torch.zeros(3, 640, 640)
    canvas[:, :128, :128] = load_picture("astronaut", None)[:, 64:192, 160:288]
    candidates, first = open_network()(canvas), 0
    for stride in STRIDES:
        count = (640 // stride) ** 2
        best = first + int(candidates.score[first : first + count].argmax())
        first += count
        if stride in PUBLISHED:
            score, middle, size, right_eye, left_mouth = PUBLISHED[stride]
            assert float(candidates.score[best]) == pytest.approx(score, abs=1e-4)
            assert candidates.middle[best].tolist() == pytest.approx(middle, abs=0.01)
            assert candidates.size[best].tolist() == pytest.approx(size, abs=0.01)
            assert candidates.landmarks[best, Landmark.RIGHT_EYE].tolist() == pytest.approx(right_eye, abs=0.01)
            assert candidates.landmarks[best, Landmark.LEFT_MOUTH].tolist() == pytest.approx(left_mouth, abs=0.01)
    assert first == len(candidates.score)


def test_the_network_keeps_channels_side_by_side():
    for features in open_network().features(torch.rand(1, 3, 64, 96)):
        assert features.is_contiguous(memory_format=torch.channels_last)


def test_answers_are_decoded_place_by_place():
    generator = torch.Generator().manual_seed(0)
    answers = {head: torch.randn(count, 3, 5, generator=generator) for head, count in HEADS.items()}
    score, middle, size, landmarks = _decode(answers, 16)
    for row in range(3):
        for column in range(5):
            here = {head: values[:, row, column].tolist() for head, values in answers.items()}
            number = 5 * row + column
            chance = math.prod(1 / (1 + math.exp(-here[head][0])) for head in ("cls", "obj"))
            assert float(score[number]) == pytest.approx(math.sqrt(chance), rel=1e-5)
            dx, dy, width, height = here["bbox"]
            assert middle[number].tolist() == pytest.approx([16 * (column + dx), 16 * (row + dy)], rel=1e-5)
            assert size[number].tolist() == pytest.approx([16 * math.exp(width), 16 * math.exp(height)], rel=1e-5)
            for point in range(LANDMARKS):
                dx, dy = here["kps"][2 * point : 2 * point + 2]
                expected = [16 * (column + dx), 16 * (row + dy)]
                assert landmarks[number, point].tolist() == pytest.approx(expected, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("size", [(1, 1), (7, 12), (20, 9)])
@pytest.mark.parametrize("tilt", [0.3, -math.pi / 4])
def test_turning_a_picture_interpolates_it_pixel_by_pixel(size, tilt):
    picture = torch.rand(3, *size)
    canvas = rotate(picture, tilt)
    for row in range(canvas.shape[1]):
        for column in range(canvas.shape[2]):
            x, y = rotate_back(torch.tensor([[column + 0.5, row + 0.5]]), tilt, size)[0].tolist()
            expected = torch.zeros(3)
            for i in range(math.floor(y - 0.5), math.floor(y - 0.5) + 2):
                for j in range(math.floor(x - 0.5), math.floor(x - 0.5) + 2):
                    if 0 <= i < size[0] and 0 <= j < size[1]:
                        expected += (1 - abs(y - 0.5 - i)) * (1 - abs(x - 0.5 - j)) * picture[:, i, j]
            assert_close(canvas[:, row, column], expected, rtol=1e-4, atol=1e-4)


def test_a_quarter_of_a_turn_is_exact_and_none_is_nothing():
    picture = torch.rand(3, 7, 12)
    assert rotate(picture, 0) is picture
    assert_close(rotate(picture, math.pi / 2), picture.rot90(-1, (1, 2)))


def only_face(picture: torch.Tensor) -> Face:
    (face,) = find_faces(picture)
    return face


def test_one_face_is_found_where_it_is_at_any_size_and_in_the_dark():
    face = only_face(load_picture("astronaut", None))
    assert (face.x, face.y) == pytest.approx((224, 122), abs=8)
    assert 80 < face.side < 120
    (right, left), mouth = face.eyes, face.mouth
    assert right[0] < face.landmarks[Landmark.NOSE][0] < left[0], "the right eye of a person is on the left"
    assert max(right[1], left[1]) < face.landmarks[Landmark.NOSE][1] < mouth[1]
    for side in (128, 300, 1100):
        other = only_face(load_picture("astronaut", side))
        assert (512 / side * other.x, 512 / side * other.y) == pytest.approx((face.x, face.y), abs=10)
        assert 512 / side * other.side == pytest.approx(face.side, rel=0.25)
    dark = only_face(load_picture("astronaut", 256) ** 3)
    assert (2 * dark.x, 2 * dark.y) == pytest.approx((face.x, face.y), abs=10)


@pytest.mark.parametrize("degrees", [15, -15, 30, -30, 45, -45])
def test_the_face_of_a_turned_picture_is_turned(degrees):
    picture, tilt = load_picture("astronaut", 320), math.radians(degrees)
    face, canvas = only_face(picture), rotate(picture, tilt)
    other = only_face(canvas)
    x, y = rotate_back(torch.tensor([[other.x, other.y]]), tilt, (320, 320))[0].tolist()
    assert math.hypot(x - face.x, y - face.y) < 0.15 * face.side
    assert other.side == pytest.approx(face.side, rel=0.25)
    back = rotate_back(torch.from_numpy(other.landmarks).float(), tilt, (320, 320))
    assert float((back - torch.from_numpy(face.landmarks)).norm(dim=1).max()) < 0.15 * face.side
    assert math.degrees(other.tilt - face.tilt) == pytest.approx(degrees, abs=12)


def test_the_face_of_a_mirrored_picture_is_mirrored():
    picture = load_picture("astronaut", 320)
    face, other = only_face(picture), only_face(picture.flip(2))
    assert (320 - other.x, other.y) == pytest.approx((face.x, face.y), abs=0.1 * face.side)
    assert other.tilt == pytest.approx(-face.tilt, abs=0.1)
    assert other.eyes[0, 0] < other.eyes[1, 0], "it is the other eye that is the right one now"


def test_each_of_several_faces_is_found_once():
    portrait = load_picture("astronaut", 256)
    faces = find_faces(torch.cat([portrait, portrait.flip(2), rotate(portrait, 0.5)[:, :256]], 2))
    assert len(faces) == 3
    assert [face.score for face in faces] == sorted((face.score for face in faces), reverse=True)


@pytest.mark.parametrize("name", ["chelsea", "coffee", "rocket", "coins", "brick", "text", "hubble_deep_field"])
def test_where_there_is_no_face_none_is_found(name):
    assert find_faces(load_picture(name, 400)) == []


@pytest.mark.parametrize("size", [(1, 1), (1, 300), (300, 1), (2, 3), (9, 9), (40, 700)])
def test_even_tiny_and_narrow_pictures_have_no_faces(size):
    for level in (0.0, 0.5, 1.0):
        assert find_faces(torch.full((3, *size), level)) == []
    assert find_faces(torch.rand(3, *size)) == []


def face_at(x: float, score: float, side: float = 40) -> Face:
    return Face(x, 50.0, side, score, np.zeros((5, 2)))


def test_of_candidates_at_one_place_the_most_certain_is_kept():
    one, same, inside, beside = face_at(100, 0.9), face_at(110, 0.85), face_at(100, 0.88, 15), face_at(125, 0.82)
    assert distinct([same, beside, one, inside]) == [one, beside]
    assert distinct([]) == []


def test_the_tilt_of_a_head_is_that_of_its_eyes_over_its_mouth():
    upright = np.array([[-1, -1], [1, -1], [0, 0], [-1, 1], [1, 1]], float)
    for tilt in (0.0, 0.7, -0.7):
        c, s = math.cos(tilt), math.sin(tilt)
        assert Face(0, 0, 1, 1, upright @ np.array([[c, s], [-s, c]])).tilt == pytest.approx(tilt)


LOOKS = ("oil", "impasto", "vangogh", "gouache", "watercolour", "pastel", "pointillist", "ink")


@pytest.fixture(scope="module")
def portrait() -> torch.Tensor:
    return load_picture("astronaut", None)[:, :256, 96:352].contiguous()


def small_strokes(feature: Feature, strokes: Strokes) -> int:
    """Count the visible strokes within a feature that are narrow enough to draw it."""
    narrow = 2 * half_width_of(strokes) < 1.5 * max(feature.radius / feature.fineness, THINNEST_STROKE)
    return int((narrow & feature.holds(strokes.position) & (strokes.opacity > 0)).sum())


@pytest.mark.parametrize("words", [(), ("abstraction=1",), ("strokes=300",)], ids=["as it is", "abstract", "few"])
@pytest.mark.parametrize("look", LOOKS)
def test_eyes_and_mouth_have_small_strokes_in_every_look(config, portrait, look, words):
    cfg = config(f"look={look}", *words)
    faces = find_faces(portrait)
    features = features_of(faces)
    assert len(features) == 3
    strokes, budget = first_strokes(cfg, portrait, Fixed(), None, faces, features)
    assert budget == len(strokes)
    if words == ("strokes=300",):
        assert len(strokes) == 300
    plain, fewer = first_strokes(cfg, portrait, Fixed(), None)
    assert fewer == len(plain) <= len(strokes)
    asked = TYPED_SHARE * 300 / len(features) if words == ("strokes=300",) else FLOOR
    least = 4 if look == "ink" else asked / 3  # ink fills dark shapes, and strokes outside of the feature are dropped
    for feature in features:
        assert small_strokes(feature, strokes) >= least
        assert small_strokes(feature, strokes) >= small_strokes(feature, plain)


def test_small_strokes_lie_last_and_few_strokes_keep_half_for_the_rest(config, portrait):
    features = features_of(find_faces(portrait))
    cfg = config("look=gouache", "strokes=60")
    strokes, _ = first_strokes(cfg, portrait, Fixed(), None, (), features)
    inside = torch.stack([feature.holds(strokes.position) for feature in features]).any(0)
    width = half_width_of(strokes)
    assert len(strokes) == 60
    assert inside[-10:].all(), "the last ones draw features"
    assert int((width < width[-10:].max() * 1.01).sum()) <= 30
    again, _ = first_strokes(config("look=gouache", "strokes=60"), portrait, Fixed(), None, (), features)
    assert torch.equal(strokes.position, again.position)


def test_a_feature_that_has_enough_small_strokes_is_given_none(config, portrait):
    features = features_of(find_faces(portrait))
    initializer = take_built(config("look=oil").init)
    generator = torch.Generator().manual_seed(0)
    dense = initializer(portrait, 40_000, generator)
    assert len(draw_features(portrait, features, dense, generator)) == 0
    none = Strokes.none()
    drawn = draw_features(portrait, features, none, generator)
    assert 3 * FLOOR / 2 < len(drawn) <= 3 * FLOOR
    assert len(draw_features(portrait, features, none, generator, limit=30)) <= 30
    assert len(draw_features(portrait, features, none, generator, limit=0)) == 0
    assert len(draw_features(portrait, (), none, generator)) == 0


def test_small_strokes_below_a_broad_one_draw_no_mouth(config, portrait):
    feature = features_of(find_faces(portrait))[2]
    initializer = take_built(config("look=oil").init)
    dense = initializer(portrait, 40_000, torch.Generator().manual_seed(0))
    x, y, side = torch.tensor([feature.x]), torch.tensor([feature.y]), torch.tensor([3 * feature.radius])
    shape = torch.tensor([[-0.5, 0.0]]), torch.tensor([[0.0, 0.0]]), torch.tensor([[0.5, 0.0]])
    broad = replace(dense[:1], position=torch.stack([x, y], 1), scale=side, start=shape[0], control=shape[1])
    broad = replace(broad, end=shape[2], width=torch.tensor([0.9]))
    above, below = Strokes.join(broad, dense), Strokes.join(dense, broad)
    assert len(draw_features(portrait, [feature], above, torch.Generator().manual_seed(0))) == 0
    assert len(draw_features(portrait, [feature], below, torch.Generator().manual_seed(0))) > FLOOR / 2


@pytest.mark.parametrize("place", [(0, 0, 5), (39, 29, 3), (-20, -20, 4), (20, 15, 0.4), (20, 15, 500)])
def test_features_at_the_edge_of_a_picture_beyond_it_and_larger_than_it_are_drawn_as_far_as_they_are_seen(place):
    target = torch.rand(3, 30, 40)
    drawn = draw_features(target, [Feature(*place)], Strokes.none(), torch.Generator().manual_seed(0))
    assert Feature(*place).holds(drawn.position).all()
    assert drawn.position.isfinite().all()
    assert len(drawn) <= FLOOR


def disc(size: tuple[int, int], x: float, y: float, radius: float) -> torch.Tensor:
    """Draw one disc of ones in a mask (H, W) of zeros."""
    down, across = torch.meshgrid(torch.arange(size[0]), torch.arange(size[1]), indexing="ij")
    return ((across + 0.5 - x).square() + (down + 0.5 - y).square() < radius**2).float()


def test_a_mark_on_a_found_face_adds_none_and_a_mark_on_a_hidden_one_finds_it(portrait):
    (face,) = find_faces(portrait)
    mark = disc((256, 256), face.x, face.y, face.side / 2)
    assert marked_faces(portrait, mark, [face]) == []
    (again,) = marked_faces(portrait, mark)
    assert np.abs(again.landmarks - face.landmarks).max() < face.side / 10
    assert again.score > 0


def test_a_round_mark_where_the_network_sees_nothing_is_a_face_that_is_drawn_whole():
    mask = torch.maximum(disc((200, 300), 80, 90, 35), disc((200, 300), 230, 60, 21))
    first, second = sorted(marked_faces(torch.full((3, 200, 300), 0.5), mask), key=lambda face: face.x)
    assert (first.x, first.y, first.side) == pytest.approx((80, 90, 50), abs=1)
    assert (second.x, second.y, second.side) == pytest.approx((230, 60, 30), abs=1)
    assert first.score == second.score == 0
    assert len(first.landmarks) == len(second.landmarks) == 0
    larger, smaller = features_of([first, second])
    assert larger.radius > smaller.radius
    assert larger.floor == FLOOR_OF_FACE
    drawn = draw_features(torch.rand(3, 200, 300), [larger], Strokes.none(), torch.Generator())
    assert small_strokes(larger, drawn) > FLOOR_OF_FACE / 3


def test_lines_specks_and_a_dark_mask_mark_no_face():
    grey = torch.full((3, 120, 200), 0.5)
    line, speck = torch.zeros(120, 200), disc((120, 200), 60, 60, 3)
    line[50:62, 20:180] = 1
    for mask in (line, speck, torch.zeros(120, 200), 0.49 * disc((120, 200), 60, 60, 30)):
        assert marked_faces(grey, mask) == []


def test_a_mask_of_faces_is_asked_beside_the_network(config, tmp_path):
    picture = torch.full((3, 100, 140), 0.5)
    mask = tmp_path / "faces.png"
    Image.fromarray((255 * disc((100, 140), 70, 50, 28)).byte().numpy()).save(mask)
    (face,) = faces_of(config("look=oil", f"faces={mask}"), picture)
    assert len(features_of([face])) == 1
    assert faces_of(config("look=oil", "faces=off"), picture) == []
    with pytest.raises(UserError, match=r"faces=.*ratio"):
        faces_of(config("look=oil", f"faces={mask}"), torch.full((3, 100, 100), 0.5))


def test_faces_off_looks_for_none_and_what_is_found_is_told(config, portrait, monkeypatch, caplog):
    calls = []
    monkeypatch.setattr(
        "brushexp.pictures.faces.detection.find_faces_and_heads",
        lambda picture: calls.append(picture) or find_faces_and_heads(picture),
    )
    words = ("look=oil", "steps=0", "quality=draft")
    with caplog.at_level("INFO"):
        without = build_painter(config(*words, "faces=off"), portrait)
    assert not calls
    assert "face" not in caplog.text
    with caplog.at_level("INFO"):
        painter = build_painter(config(*words), portrait)
    assert len(calls) == 1
    assert "found 1 face" in caplog.text
    assert len(painter.strokes()) > len(without.strokes())
    assert faces_of(config(*words, "catalogue=painting.h5", "focus=null"), portrait) == []
    with pytest.raises(UserError, match="faces"):
        check(config("faces=maybe"), ["faces=maybe"])


def test_spots_are_dark_round_and_where_one_looks():
    picture = torch.full((3, 200, 300), 0.8)
    y, x = torch.meshgrid(torch.arange(200) + 0.5, torch.arange(300) + 0.5, indexing="ij")

    def paint(column: float, row: float, radius: float, value: float) -> None:
        picture[:, ((x - column) ** 2 + (y - row) ** 2) < radius**2] = value

    paint(80, 60, 4, 0.1)  # an eye
    paint(200, 140, 6, 0.1)  # a larger eye
    paint(250, 40, 4, 1.0)  # a light eye
    picture[:, 100:104] = 0.1  # a line
    everywhere = torch.ones(200, 300)
    spots = sorted(find_spots(picture, everywhere), key=lambda spot: spot.x)
    assert [(round(spot.x), round(spot.y)) for spot in spots] == [(80, 60), (200, 140)]
    assert spots[0].radius < spots[1].radius
    left = everywhere.clone()
    left[:, 150:] = 0
    assert [round(spot.x) for spot in find_spots(picture, left)] == [80]
    larger = torch.nn.functional.interpolate(picture[None], scale_factor=3.0, mode="bilinear")[0]
    twice = sorted(find_spots(larger, torch.ones(600, 900)), key=lambda spot: spot.x)
    assert [(round(spot.x / 30), round(spot.y / 30)) for spot in twice] == [(8, 6), (20, 14)]


@pytest.mark.parametrize("size", [(1, 1), (1, 60), (3, 2), (40, 700)])
def test_even_pictures_have_no_spots_and_others_at_most_a_few(size):
    for level in (0.0, 0.5, 1.0):
        assert find_spots(torch.full((3, *size), level), torch.ones(size)) == []
    assert len(find_spots(torch.rand(3, *size), torch.ones(size))) <= MOST_SPOTS
    assert find_spots(torch.rand(3, *size), torch.zeros(size)) == []


@pytest.mark.parametrize(("luma", "count"), [(0.2, 1), (0.3, 1), (0.5, 0)])
def test_a_spot_that_hardly_differs_from_its_surroundings_is_no_eye(luma, count):
    y, x = torch.meshgrid(torch.arange(200) + 0.5, torch.arange(300) + 0.5, indexing="ij")
    inside = torch.hypot(x - 150, y - 100) < 4
    picture = torch.where(inside, luma, 0.6).expand(3, 200, 300)
    assert contrast_of_spot(picture[0].numpy(), 150, 100, 2.5) == pytest.approx(1 - luma / 0.6)
    assert len(find_spots(picture, torch.ones(200, 300))) == count


def test_the_eyes_of_a_cat_are_spots():
    cat = load_picture("chelsea", 451)
    spots = find_spots(cat, attention(cat, []))
    for x, y in ((170, 118), (312, 137)):  # the cat's pupils
        assert any(math.hypot(spot.x - x, spot.y - y) < 1.2 * spot.radius for spot in spots)


def test_heads_are_doubtful_faces_that_are_seen_again_and_lie_apart():
    sure, doubtful, weak = face_at(100, HEAD_SCORE + 0.1), face_at(300, HEAD_SCORE), face_at(500, HEAD_SCORE - 0.01)
    beside = face_at(130, HEAD_SCORE)
    looks = HEAD_SEEN * [[sure, doubtful, weak, beside]]
    assert heads_among(looks) == [sure, doubtful]
    assert heads_among([*looks[1:], [sure]]) == [sure], "the other was seen too seldom"
    assert heads_among([]) == []
    assert faces_among(looks, LEAST_SCORE) == []


def test_a_cat_has_a_head_whose_eyes_are_found_and_pictures_without_animals_have_none():
    cat = load_picture("chelsea", None)
    faces, heads = find_faces_and_heads(cat)
    assert faces == []
    eyes = find_eyes(cat, heads)
    assert len(eyes) <= MOST_SPOTS * len(heads)
    for x, y in ((170, 118), (312, 137)):  # its pupils
        assert any(math.hypot(eye.x - x, eye.y - y) < eye.radius for eye in eyes)
    for name in ("coffee", "rocket", "brick"):
        assert find_faces_and_heads(load_picture(name, 300)) == ([], [])


def test_a_person_is_no_animal(portrait):
    faces, heads = find_faces_and_heads(portrait)
    assert [face.score for face in faces] == [face.score for face in find_faces(portrait)]
    assert heads == []


@pytest.mark.parametrize("place", [(0, 0, 30), (199, 99, 20), (-60, 40, 20), (100, 50, 300)])
def test_eyes_are_sought_in_the_part_of_a_head_that_the_picture_shows(place):
    x, y, side = place
    eyes = find_eyes(torch.rand(3, 100, 200), [Face(x, y, side, 0.5, np.zeros((5, 2)))])
    assert len(eyes) <= MOST_SPOTS
    assert all(0 <= eye.x <= 200 and 0 <= eye.y <= 100 for eye in eyes)


def eye_on_skin(size: tuple[int, int] = (120, 160)) -> torch.Tensor:
    """Draw a dark eye with a light, faintly green glint on skin (3, H, W), centred at (x, y) = (80, 60)."""
    picture = torch.tensor([0.85, 0.65, 0.55])[:, None, None].repeat(1, *size)
    eye, glint = disc(size, 80, 60, 7), disc(size, 80, 60, 2)
    picture = torch.lerp(picture, torch.tensor([0.2, 0.1, 0.1])[:, None, None], eye)
    return torch.lerp(picture, torch.tensor([0.8, 0.95, 0.8])[:, None, None], glint)


def test_forms_that_a_palette_flattened_come_back_in_their_place_alone():
    picture = eye_on_skin()
    flat = torch.tensor([0.9, 0.8, 0.6])[:, None, None].repeat(1, 120, 160)
    restored = restore_forms(flat, picture, [(80.0, 60.0, 20.0)])
    assert float(restored[:, 60, 75].mean()) < float(restored[:, 60, 90].mean()) - 0.25
    beyond = disc((120, 160), 80, 60, 20 * NONE) == 0
    assert torch.equal(restored[:, beyond], flat[:, beyond])
    assert torch.equal(flat, flat[:, :1, :1].expand_as(flat)), "the target itself is left alone"
    red, green, blue = restored[:, 60, 80].tolist()
    assert red >= green > blue, "a light place keeps the tint of the palette"
    assert torch.equal(restore_forms(flat, picture, []), flat)


def test_a_palette_of_one_ink_gets_no_other_hues_back():
    picture = eye_on_skin()
    flat = torch.tensor([0.6, 0.57, 0.5])[:, None, None].repeat(1, 120, 160)
    hues = [as_lab(restore_forms(flat, picture, [(80.0, 60.0, 20.0)], hues=hues)) for hues in (False, True)]
    assert np.ptp(hues[0][..., 0]) > 20
    away = [np.hypot(*(lab - as_lab(flat))[..., 1:].T).max() for lab in hues]
    assert away[0] < 1
    assert away[1] > 4


def test_forms_that_a_palette_kept_stay_and_small_places_get_more_contrast():
    picture = eye_on_skin()
    kept = restore_forms(picture, picture, [(80.0, 60.0, 20.0)])
    assert_close(kept, picture, rtol=0, atol=0.02)
    small = restore_forms(picture, picture, [(80.0, 60.0, 10.0)])
    assert float(small[:, 60, 75].mean()) < float(picture[:, 60, 75].mean())


@pytest.mark.parametrize("place", [(-100, 5, 3), (0, 0, 4), (39, 29, 0.3), (20, 15, 400)])
def test_forms_of_any_place_in_any_picture_are_colours(place):
    for picture in (torch.rand(3, 30, 40), torch.zeros(3, 30, 40), torch.ones(3, 30, 40)):
        restored = restore_forms(torch.rand(3, 30, 40), picture, [place])
        assert restored.isfinite().all()
        assert ((restored >= 0) & (restored <= 1)).all()


def test_a_look_that_flattens_forms_keeps_those_of_eyes_and_mouths(config, tmp_path, portrait):
    Image.fromarray(portrait.movedim(0, -1).mul(255).byte().numpy()).save(tmp_path / "portrait.png")
    words = (f"image={tmp_path / 'portrait.png'}", "look=gouache", "palette.flatness=1", "steps=0")
    (face,) = find_faces(portrait)
    contrast = []
    for value in ("auto", "off"):
        painter = build_painter(config(*words, f"faces={value}"))
        target = painter.picture.target.mean(0)
        places = [target[places_of([feature], (256, 256))] for feature in features_of([face])]
        contrast.append(min(float(values.std()) for values in places))
        assert (painter.features is None) == (value == "off")
    assert contrast[0] > 1.2 * contrast[1]


def test_the_places_of_features_are_marked():
    assert places_of([], (30, 40)) is None
    marked = places_of([Feature(10, 10, 4), Feature(30, 20, 2)], (30, 40))
    assert torch.equal(marked.float(), torch.maximum(disc((30, 40), 10, 10, 4), disc((30, 40), 30, 20, 2)))
