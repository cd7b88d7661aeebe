"""Pictures from Python: whatever they are kept in, they are what they plainly are, or refused in one line."""

import io

import numpy as np
import pytest
import torch
from PIL import Image
from torch.testing import assert_close

import brushexp
from brushexp.pictures.held import hold
from brushexp.pictures.load import load_picture, samples

SMALL = {"look": "plain", "resolution": 32, "strokes": 20, "steps": 4}


class OfAnotherLibrary:
    """An array as those of JAX, h5py or xarray are."""

    def __init__(self, array):
        self.array = array

    def __array__(self, dtype=None, copy=None):
        return self.array


def kinds_of_picture() -> dict[str, object]:
    pixels = load_picture("chelsea", 32)
    eight_bit = (pixels * 255).round().byte()
    array = eight_bit.permute(1, 2, 0).numpy()
    Image.fromarray(array).save(file := io.BytesIO(), "PNG")
    return {
        "tensor": eight_bit,
        "array": array,
        "with alpha": np.dstack([array, np.full_like(array[..., 0], 255)]),
        "blue first": array[..., ::-1].copy()[..., ::-1],
        "batch": eight_bit[None],
        "pillow": Image.fromarray(array),
        "bytes": file.getvalue(),
        "file": file,
        "of another library": OfAnotherLibrary(array),
        "floats": eight_bit.permute(1, 2, 0).numpy() / 255,
        "float tensor": (eight_bit / 255).requires_grad_(),
    }


def test_a_picture_may_be_of_any_kind():
    small = SMALL | {"resolution": None}
    first, *others = (brushexp.paint(picture, **small) for picture in kinds_of_picture().values())
    for other in others:
        assert np.array_equal(other.target, first.target)
        assert np.array_equal(other.image, first.image)
    ramp = np.linspace(0, 1, 70 * 64).reshape(70, 64)
    grey = brushexp.paint(ramp, **small, style=Image.fromarray(np.uint8(255 * ramp.T)))
    assert grey.image.shape == (70, 64, 3)
    assert "style_poly" in grey.metrics


def test_transparent_pixels_lie_over_white_and_count_nothing_in_a_mask_and_true_is_bright():
    color, alpha = np.full((4, 5, 3), 51, np.uint8), np.array([[0, 255, 255, 255, 102]] * 4, np.uint8)
    rgba = np.dstack([color, alpha])
    expected = {1.0: [255, 51, 51, 51, 173], 0.0: [0, 51, 51, 51, 20]}  # 51 * 0.4 and 0.6 of the backdrop
    for backdrop, row in expected.items():
        for picture in (rgba, rgba / 255, torch.from_numpy(rgba).permute(2, 0, 1), Image.fromarray(rgba)):
            pixels = hold(picture).over[backdrop]
            assert_close(pixels[0, :, 0] * (1 if pixels.dtype == np.uint8 else 255), np.array(row), atol=1, rtol=0,
                         check_dtype=False)  # fmt: skip
    premultiplied = Image.merge("LA", [Image.fromarray(color[..., 0]), Image.fromarray(alpha)]).convert("La")
    np.testing.assert_allclose(hold(premultiplied).over[1.0][0, :, 0], expected[1.0], atol=1)
    assert np.array_equal(hold(alpha > 102).over[1.0][0, :, 2], [0, 255, 255, 255, 0])


def closed_picture() -> Image.Image:
    with Image.open(samples()["chelsea"]) as picture:
        return picture


@pytest.mark.parametrize(("picture", "options", "words"), [
    ("astronaut", {"stepz": 3}, "stepz is no key of task=paint; nearest first: steps"),
    ("astronaut", {"steps": "many"}, "steps=many is not a whole number; try steps=500"),
    ("astronaut", {"resume": "x"}, "resume=x is no option here"),
    ("astronaut", {"callbacks": ["timer"]}, "say where with output="),
    ("astronaut", {"logger": ["tensorboard"]}, "logger=tensorboard may write files; say where with output="),
    ("nowhere.png", {}, "image=nowhere.png is not there"),
    (np.zeros((4, 4, 2)), {}, r"image is an array of shape \(4, 4, 2\); give a path"),
    (np.full((4, 4), 7.0), {}, "image is an array of float64 from 7 to 7; give image / 255, floats from 0 to 1"),
    (np.full((4, 4), 999, np.uint16), {}, "image is an array of uint16 from 999 to 999; give image / 65535"),
    (np.eye(4, dtype=int), {}, r"image is an array of int64 from 0 to 1; give image.astype\(bool\), if it is a mask"),
    (np.eye(4) * 2 - 1, {}, r"float64 from -1 to 1; give \(image \+ 1\) / 2, if it goes from -1 to 1"),
    (np.full((4, 4), np.nan), {}, r"image is an array of float64 from nan to nan; give np.nan_to_num\(image\)"),
    (np.ma.masked_less(np.eye(4), 1), {}, "image is a masked array; say what is seen"),
    (np.array([["a"]]), {}, "image is an array of <U1; give"),
    (np.matrix(np.full((4, 4), 7.0)), {}, "image is an array of float64 from 7 to 7; give"),
    (torch.rand(2, 5, 6), {}, "image is a tensor of shape"),
    (torch.rand(3, 4, 5).to_sparse(), {}, "image is a tensor that is sparse"),
    (torch.rand(3, 4, 5, device="meta"), {}, "image is a tensor that is sparse, .* or without numbers"),
    (torch.zeros(3, 4, 5, dtype=torch.cfloat).conj(), {}, "image is a tensor that is sparse, quantized, complex"),
    (Image.new("RGB", (0, 0)), {}, "image is a picture without pixels; give"),
    (Image.fromarray(np.full((4, 4), np.nan, np.float32)), {}, "image has pixels that are NaN or infinite"),
    (torch.rand(5, 6, 3), {}, r"permute\(2, 0, 1\) puts the channels first"),
    (np.zeros((3, 4, 6)), {}, r"transpose\(1, 2, 0\) puts the channels last"),
    (b"no picture" * 1000, {}, "^image, 10000 bytes, is not a picture of a known format; .{1,60}$"),
    (Image.new("I", (4, 4), 200), {}, r"32 bits up to 200, nearly black; give image.convert\('L'\)"),
    ([[0.5, 0.5], [0.5, 0.5]], {}, r"a list of 2; for an array of numbers, give np.array\(image\)"),
    (io.TextIOWrapper(io.BytesIO(b"\x89PNG")), {}, 'image is a file that was opened as text; open it with "rb"'),
    (io.StringIO("x"), {}, 'image is a file that was opened as text; open it with "rb"'),
    (["a.jpg", "b.jpg"], {}, "image takes one picture, and this is a list of 2; give one after the other"),
    ("astronaut", {"style": [np.zeros((4, 4))] * 2}, "style takes one picture, .* list of 2; give one of them"),
    ("astronaut", {"style": ["coffee", "rocket"]}, "several are not taken; try style.image=coffee"),
    (closed_picture(), {}, "image is closed or damaged .*; give"),
    ({}, {}, "image={} says nothing; leave it out"),
    (
        "astronaut",
        {"focus": np.ones((3, 9))},
        "focus=.* pixels, the picture 32 x 32; give one whose sides have the same ratio",
    ),
])  # fmt: skip
def test_a_mistake_is_a_message_of_one_line(picture, options, words):
    for call in (brushexp.paint, brushexp.iterate):  # at once, and not with the first state
        with pytest.raises(brushexp.UserError, match=words) as caught:
            call(picture, **SMALL | options)
        assert "\n" not in str(caught.value)
