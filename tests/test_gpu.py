"""Tests on a GPU: paintings match those made on the CPU, and a renderer trains."""

import pytest
import torch
from brushexp_training.tasks import train
from painters import take
from test_density import painter_of, picture

from brushexp.plugins.density.traced import Traced
from brushexp.tasks import paint

pytestmark = [pytest.mark.gpu, pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")]


@pytest.mark.parametrize("chosen", [
    "look=oil",  # strays, textures, light
    "look=plain density=adaptive order=accuracy",
    "look=plain sampler=patches sampler.n_active=40 sampler.patch=64",
    "look=plain renderer=neural finish_steps=5",
    "look=plain color=pigment loss=[mse,width,kl]",
    "look=plain painter=haeberli",
    "look=plain painter=greedy",
])  # fmt: skip
def test_a_painting_is_that_of_the_processor(chosen, run_task, tmp_path):
    words = ["image=astronaut", "resolution=96", "strokes=150", "steps=30", "report=false", *chosen.split()]
    there, here = (run_task(paint, *words, f"device={name}", f"output={tmp_path / name}") for name in ("cuda", "cpu"))
    assert (there["device"].partition(":")[0], here["device"]) == ("cuda", "cpu")
    assert there["psnr"] == pytest.approx(here["psnr"], abs=0.3)


def test_a_surplus_of_strokes_goes_when_the_fit_has_left_them_on_the_processor():
    painter = painter_of(Traced(surplus=0.4), n=60, steps=120, target=picture((72, 96))).cuda()
    take(painter, 50)
    assert len(painter.catalogue) > 60
    painter.cpu().hand_over()
    assert len(painter.catalogue) == len(painter.front_to_back) == 60


def test_a_renderer_is_trained(run_task, tmp_path):
    words = ["task=train", "renderer=inverse_vgg", "renderer.width=4", "engine=disc", "simulate=100", "epochs=2"]
    metrics = run_task(train, *words, "critic=true", "device=cuda", f"sets={tmp_path / 'sets'}")
    assert metrics["device"].startswith("cuda")
    assert metrics["steps"] > 0
    assert metrics["fid_effl0"] > 0, "it is judged where it was trained"
