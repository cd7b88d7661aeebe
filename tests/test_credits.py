"""What a picture says of its author is in what is painted after it, and not where it was taken."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, IptcImagePlugin

from brushexp.pictures.credits import credits_of, write_credited
from brushexp.pictures.decode import read_picture
from brushexp.tasks import export, paint

XMP = """<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"
 xmlns:dc="http://purl.org/dc/elements/1.1/"><rdf:Description xmlns:p="http://ns.adobe.com/photoshop/1.0/"
 p:DateCreated="2024-05-06"><dc:title><rdf:Alt><rdf:li xml:lang="x-default">Bäume</rdf:li></rdf:Alt></dc:title>
<dc:creator><rdf:Seq><rdf:li>A. Löw</rdf:li><rdf:li>B. 李</rdf:li></rdf:Seq></dc:creator></rdf:Description></rdf:RDF>
</x:xmpmeta>"""
PICTURE = Image.fromarray(np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8))


def photo(path: Path, **extra: object) -> Path:
    exif = Image.Exif()
    exif[315], exif[33432], exif[306] = "A. Author", "(c) 2024 A. Author\n all rights", "2024:01:02 03:04:05"
    exif[0x8769], exif[0x8825] = {36867: "2023:01:02 03:04:05"}, {1: "N", 2: (48.0, 8.0, 33.0)}
    PICTURE.save(path, exif=exif.tobytes(), **extra)
    return path


def test_titles_and_rights_are_read_wherever_they_stand(tmp_path, monkeypatch):
    assert credits_of(str(photo(tmp_path / "a.jpg"))) == {
        "Author": "A. Author", "Copyright": "(c) 2024 A. Author all rights", "Creation Time": "2023:01:02 03:04:05",
    }  # fmt: skip
    found = credits_of(str(photo(tmp_path / "b.jpg", xmp=XMP.encode())))
    assert (found["Title"], found["Author"], found["Creation Time"]) == ("Bäume", "A. Löw, B. 李", "2024-05-06")
    assert found["Copyright"] == "(c) 2024 A. Author all rights"
    bomb = "<!DOCTYPE x [<!ENTITY a 'b'>]>" + XMP
    assert credits_of(str(photo(tmp_path / "c.jpg", xmp=bomb.encode())))["Author"] == "A. Author"
    PICTURE.save(tmp_path / "d.jpg")
    entries = {(2, 5): b"Title", (2, 80): [b"One", b"Two"]}
    monkeypatch.setattr(IptcImagePlugin, "getiptcinfo", lambda picture: entries)
    assert credits_of(str(tmp_path / "d.jpg")) == {"Title": "Title", "Author": "One, Two"}
    assert credits_of("coffee") == credits_of(str(tmp_path)) == {}
    (tmp_path / "e.jpg").write_bytes(b"damaged")
    assert credits_of(str(tmp_path / "e.jpg")) == {}


def test_a_png_says_srgb_and_its_credits_twice(tmp_path):
    entries = {"Title": "Bäume", "Author": "A. 李", "Copyright": "(c) A.", "Creation Time": "2024"}
    write_credited(tmp_path / "a.png", np.asarray(PICTURE), entries)
    with Image.open(tmp_path / "a.png") as file:
        file.load()
        assert (file.info["srgb"], file.text) == (0, entries)
        assert file.getexif()[33432] == "(c) A."
    assert credits_of(str(tmp_path / "a.png")) == entries
    assert np.array_equal(read_picture(tmp_path / "a.png"), np.asarray(PICTURE))


@pytest.mark.slow
def test_a_painting_and_its_print_carry_the_credits_of_the_photograph(run_task, tmp_path):
    path = photo(tmp_path / "a.jpg", xmp=XMP.encode())
    run_task(paint, f"image={path}", "look=plain", "strokes=5", "steps=1", "frames=0", "report=false")
    for resolution in (None, 64):
        if resolution:
            words = (f"catalogue={tmp_path / 'catalogue.h5'}", f"resolution={resolution}", "overwrite=true")
            run_task(export, "task=export", "to=png", *words)
        with Image.open(tmp_path / "painting.png") as file:
            assert max(file.size) == (resolution or 32)
            assert (file.info["srgb"], file.text["Title"], file.getexif()[33432][:5]) == (0, "Bäume", "(c) 2")
            assert 0x8825 not in file.getexif(), "the place"
