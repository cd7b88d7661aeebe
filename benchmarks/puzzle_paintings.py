"""Assemble the paintings in GCompris's puzzle for ``pictures=held_out_paintings``, a picture set used in studies.

    apt-get download gcompris-qt-data && dpkg -x gcompris-qt-data_*.deb gcompris
    python benchmarks/puzzle_paintings.py gcompris/usr/share/gcompris-qt/rcc/paintings.rcc paintings/

This writes 21 pictures, omitting the photograph of a sculpture; the set lists their checksums for version 3.1.
"""

import argparse
import io
import re
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import distance_transform_edt

NAMES = {
    1: "renoir_moulin", 2: "arcimboldo_spring", 3: "arcimboldo_librarian", 4: "hokusai_oiran", 5: "hokusai_fan",
    6: "hokusai_ejiri", 7: "hokusai_wave", 8: "hiroshige_snow", 9: "hiroshige_fish", 10: "hokusai_bridge",
    11: "hokusai_poppies", 12: "hokusai_sea_route", 14: "leonardo_mona_lisa", 15: "bellini_pesaro", 16: "durer_lion",
    17: "bruegel_harvesters", 18: "renoir_piano", 19: "kandinsky_composition_8", 20: "bazille_ramparts",
    21: "cassatt_summertime", 22: "gogh_auvers",
}  # fmt: skip
BORDER = 3  # pixels at the edge, where the pieces do not all end on the same line
PACKED, FOLDER, ZSTD = 1, 2, 4  # flags of nodes in a Qt resource file
PIECE = re.compile(r'"image/(.*?)",\s*"x"\s*:\s*"([\d.]+)",\s*"y"\s*:\s*"([\d.]+)"')


def files_in(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield the names and contents of files in a Qt resource file (version 3), except those packed with Zstandard."""
    _, tree, contents, names = struct.unpack(">4I", data[4:20])
    waiting = [0]
    while waiting:
        name, flags, first, second = struct.unpack(">IHII", data[tree + 22 * waiting.pop() :][:14])
        if flags & FOLDER:
            waiting += range(second, second + first)
        elif not flags & ZSTD:
            (length,) = struct.unpack(">H", data[names + name :][:2])
            (size,) = struct.unpack(">I", data[contents + second :][:4])
            content = data[contents + second + 4 :][:size]
            unpacked = zlib.decompress(content[4:]) if flags & PACKED else content
            yield data[names + name + 6 :][: 2 * length].decode("utf-16-be"), unpacked


def painting_of(board: str, files: dict[str, bytes]) -> Image.Image:
    """Assemble the pieces of a puzzle board, and fill the gaps between them with the nearest pixels."""
    size = tuple(int(re.search(rf'"{side}": (\d+)', board)[1]) for side in ("width", "height"))  # type: ignore[index]
    whole = Image.new("RGBA", size)
    for name, x, y in PIECE.findall(board):
        piece = Image.open(io.BytesIO(files[name])).convert("RGBA")
        corner = (float(x) * size[0] - piece.width / 2, float(y) * size[1] - piece.height / 2)
        whole.alpha_composite(piece, (max(0, round(corner[0])), max(0, round(corner[1]))))
    left, top, right, bottom = whole.getbbox() or (0, 0, 0, 0)
    pixels = np.array(whole.crop((left + BORDER, top + BORDER, right - BORDER, bottom - BORDER)))
    nearest = distance_transform_edt(pixels[..., 3] < 255, return_distances=False, return_indices=True)
    return Image.fromarray(pixels[tuple(nearest)][..., :3])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("resources", type=Path, help="paintings.rcc")
    parser.add_argument("folder", type=Path, help="folder to write the pictures to")
    arguments = parser.parse_args()
    files = dict(files_in(arguments.resources.read_bytes()))
    arguments.folder.mkdir(parents=True, exist_ok=True)
    for number, name in NAMES.items():
        path = arguments.folder / f"{name}.bmp"  # uncompressed, so that the file is the same everywhere
        painting_of(files[f"board{number}_0.qml"].decode(), files).save(path)
        print(path)
