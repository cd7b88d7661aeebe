"""How many faces the detector of focus=auto finds in pictures.

python benchmarks/faces.py photo.jpg outputs/a/painting.png
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "src"))
from brushexp.pictures.focus import faces
from brushexp.pictures.load import load_picture

if __name__ == "__main__":
    for path in sys.argv[1:]:
        print(path, len(faces(load_picture(path, None))))
