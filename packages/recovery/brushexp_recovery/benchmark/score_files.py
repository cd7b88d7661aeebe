"""Provide ``brushexp.score_strokes``, which scores strokes from Python."""

from os import PathLike
from typing import Any

from brushexp.contracts.files import find_path
from brushexp.contracts.pictures import load_picture
from brushexp_recovery.benchmark.prediction_files import read_prediction
from brushexp_recovery.benchmark.score import score
from brushexp_recovery.benchmark.truth import read_truth


def score_strokes(truth: str | PathLike[str], strokes: str | PathLike[str]) -> dict[str, Any]:
    """Score strokes from any method against the known strokes of a painting, as ``task=score`` does.

    Args:
        truth: NAME.npz of task=benchmark; the painting next to it, NAME.png, supplies the colours of labels without
            curves.
        strokes: labels (.png, .npy or .npz with ``labels``), curves (.npz with ``curve`` (N, 3, 2) and ``width`` (N,)
            in pixels, bottom to top) or a catalogue; recovered strokes keep their labels and confidence.

    Returns:
        The scores that `brushexp_recovery.benchmark.score.score` defines.

    Raises:
        UserError: a file is not valid.
    """
    place = find_path(truth)
    known, picture = read_truth(place), place.with_suffix(".png")
    height, width = known.labels.shape
    image = load_picture(str(picture), None).permute(1, 2, 0).numpy() if picture.is_file() else None
    return score(known, read_prediction(find_path(strokes), (height, width), image))
