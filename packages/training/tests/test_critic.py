"""Test that the critic's loss is the RaSGAN loss, stays finite, and has gradients whose norm is set by its weight."""

import pytest
import torch
from brushexp_training.fitting.network_fitting import renderer_settings
from brushexp_training.fitting.renderer_module import Critic, RendererSettings, balance, relativistic_loss
from test_trainer import fit, module_of


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32, torch.bfloat16, torch.float16])
@pytest.mark.parametrize("score", [1e4, -1e4, 0.0])
def test_the_loss_and_its_gradient_are_finite_for_any_score(score, dtype):
    real = torch.full((4,), score, dtype=dtype, requires_grad=True)
    drawn = torch.full((3,), -score, dtype=dtype, requires_grad=True)
    loss = relativistic_loss(real, drawn)
    loss.backward()
    assert bool(real.grad.isfinite().all())
    assert bool(drawn.grad.isfinite().all())
    expected = 2 * torch.tensor(-2 * score, dtype=torch.float64).exp().log1p() if score >= 0 else 4e4
    assert float(loss.detach()) == pytest.approx(float(expected), rel=1e-2, abs=1e-3)


@pytest.mark.parametrize("window", [16, 64, 128])
def test_the_critic_gives_one_score_a_picture(window):
    critic = Critic(window, 4)
    pictures = torch.rand(3, 4, window, window, requires_grad=True)
    scores = critic(pictures)
    assert scores.shape == (3,)
    torch.testing.assert_close(critic(pictures[1:2]), scores[1:2], rtol=1e-4, atol=1e-6)
    scores.sum().backward()
    assert bool(pictures.grad.isfinite().all())
    assert float(pictures.grad.abs().sum()) > 0


def test_the_critic_pulls_as_hard_as_its_weight_says_by_rasgan_with_the_same_schedule_on_a_faster_scale(config):
    module = module_of(RendererSettings(critic=True, critic_width=2))
    trainer = fit(module, None, max_epochs=2)
    own, critic = trainer.optimizers[0].param_groups[0]["lr"], module.critic_optimizer.param_groups[0]["lr"]
    assert critic == pytest.approx(4 * own)
    cfg = config("task=train")
    assert cfg.critic_lr == pytest.approx(4 * cfg.lr)
    assert renderer_settings(cfg) == RendererSettings()
    push, pull = torch.randn(3, 4, 5, 7), 1e5 * torch.randn(3, 4, 5, 7)
    added = balance(push, pull, 0.25) - push
    torch.testing.assert_close(added.norm(), 0.25 * push.norm())
    torch.testing.assert_close(torch.cosine_similarity(added.flatten(), pull.flatten(), 0), torch.tensor(1.0))
    assert torch.equal(balance(push, torch.zeros_like(pull), 0.25), push)
    real, drawn = torch.randn(7, dtype=torch.float64), torch.randn(5, dtype=torch.float64)
    critic = -torch.sigmoid(real - drawn.mean()).log().mean() - (1 - torch.sigmoid(drawn - real.mean())).log().mean()
    renderer = -torch.sigmoid(drawn - real.mean()).log().mean() - (1 - torch.sigmoid(real - drawn.mean())).log().mean()
    torch.testing.assert_close(relativistic_loss(real, drawn), critic)
    torch.testing.assert_close(relativistic_loss(drawn, real), renderer)
