"""The critic and the loss it teaches with."""

import pytest
import torch

from brushexp.training.renderer_module import Critic, relativistic_loss


def test_the_loss_is_rasgan_as_written():
    real, drawn = torch.randn(7, dtype=torch.float64), torch.randn(5, dtype=torch.float64)
    critic = -torch.sigmoid(real - drawn.mean()).log().mean() - (1 - torch.sigmoid(drawn - real.mean())).log().mean()
    renderer = -torch.sigmoid(drawn - real.mean()).log().mean() - (1 - torch.sigmoid(real - drawn.mean())).log().mean()
    torch.testing.assert_close(relativistic_loss(real, drawn), critic)
    torch.testing.assert_close(relativistic_loss(drawn, real), renderer)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32, torch.bfloat16, torch.float16])
@pytest.mark.parametrize("score", [1e4, -1e4, 0.0])
def test_the_loss_and_its_gradient_are_finite_for_any_score(score, dtype):
    real = torch.full((4,), score, dtype=dtype, requires_grad=True)
    drawn = torch.full((3,), -score, dtype=dtype, requires_grad=True)
    loss = relativistic_loss(real, drawn)
    loss.backward()
    assert bool(real.grad.isfinite().all())
    assert bool(drawn.grad.isfinite().all())
    wanted = 2 * torch.tensor(-2 * score, dtype=torch.float64).exp().log1p() if score >= 0 else 4e4
    assert float(loss.detach()) == pytest.approx(float(wanted), rel=1e-2, abs=1e-3)


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


def test_the_critic_learns_to_tell_two_kinds_of_pictures_apart():
    critic = Critic(16, 4)
    optimizer = torch.optim.Adam(critic.parameters(), 1e-3)
    smooth = torch.rand(16, 4, 1, 1).expand(-1, -1, 16, 16)
    rough = torch.rand(16, 4, 16, 16)
    first = float(relativistic_loss(critic(smooth), critic(rough)).detach())
    for _ in range(60):
        optimizer.zero_grad()
        loss = relativistic_loss(critic(smooth), critic(rough))
        loss.backward()
        optimizer.step()
    assert float(loss.detach()) < 0.3 * first
