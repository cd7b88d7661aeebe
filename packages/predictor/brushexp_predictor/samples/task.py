"""``task=sample``: paint a picture several times, and measure its brushwork with intervals."""

import logging
import time
from pathlib import Path

import numpy as np
from omegaconf import DictConfig

from brushexp.contracts.files import as_shown, write_json, write_picture, write_text
from brushexp.contracts.results import MISSING, markdown_table
from brushexp_predictor.samples.conformal import COVERAGE
from brushexp_predictor.samples.figure import write_figure
from brushexp_predictor.samples.kinds import HALF_TURN, PAINTING_KINDS
from brushexp_predictor.samples.sampled import Interval, SampledBrushwork, sample_with

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write the measures with their intervals, the maps and the best painting to the run's folder."""
    brushwork = sample_with(cfg)
    best = max(brushwork.samples, key=lambda sample: sample.psnr)
    write_picture(folder / "painting.png", best.painting)
    write_json(folder / "brushwork.json", data_of(brushwork, cfg.image))
    write_text(folder / "brushwork.md", text_of(brushwork, Path(cfg.image).name))
    write_figure(folder / "brushwork.png", brushwork, Path(cfg.image).name)
    log.info("%s: brushwork.md, brushwork.json, brushwork.png, painting.png", as_shown(folder))
    for name in ("direction", "length", "width"):
        log.info("%s %s", PAINTING_KINDS[name].name, " ".join(texts_of(name, brushwork.measures[name]).values()))
    psnr = [sample.psnr for sample in brushwork.samples]
    return {
        "n_strokes": len(best.strokes),
        "psnr": best.psnr,
        "psnr_worst": min(psnr),
        "seconds_total": time.monotonic() - start,
        "picture": "painting.png",
        **{f"sampled_{name}": float(one.value) for name, one in brushwork.measures.items()},
    }


def data_of(brushwork: SampledBrushwork, image: str) -> dict[str, object]:
    """Return the measures as data that can be written as JSON."""
    return {
        "image": image,
        "samples": len(brushwork.samples),
        "strokes": len(brushwork.samples[0].strokes),
        "height": brushwork.picture.shape[1],
        "width": brushwork.picture.shape[2],
        "interval": COVERAGE,
        "calibrated": brushwork.is_calibrated,
        "measures": {
            name: {"unit": PAINTING_KINDS[name].unit, **{key: float(value) for key, value in one._asdict().items()}}
            for name, one in brushwork.measures.items()
        },
    }


def text_of(brushwork: SampledBrushwork, name: str) -> str:
    """Return the measures and an explanation as Markdown."""
    rows = [{"measure": PAINTING_KINDS[key].name, **texts_of(key, one)} for key, one in brushwork.measures.items()]
    scaled = (
        f"Intervals are scaled so that {COVERAGE:.0%} of them contain the truth in paintings with known strokes."
        if brushwork.is_calibrated
        else "Intervals are derived only from the samples, and contain the truth less often than stated."
    )
    about = (
        f"{len(brushwork.samples)} paintings of {len(brushwork.samples[0].strokes):,} strokes on "
        f"{brushwork.picture.shape[2]} x {brushwork.picture.shape[1]} px. {scaled} Lengths and widths hold for about "
        "that many strokes. Directions run clockwise from horizontal: 45° falls to the right."
    )
    return f"# Brushwork of {name}\n\n{about}\n\n{markdown_table(rows, align='lrrrl')}\n"


def texts_of(name: str, one: Interval) -> dict[str, str]:
    """Format a measure and the ends of its interval, which are "any" for an undetermined direction."""
    kind = PAINTING_KINDS[name]
    texts = {key: f"{value:.3g}" if np.isfinite(value) else MISSING for key, value in one._asdict().items()}
    if kind.axial and one.high - one.low >= HALF_TURN - 1e-6:
        texts |= {"low": "any", "high": "any"}
    return {**texts, "unit": kind.unit}
