"""The loss of the compact network against torch's distributions, numpy, and what it is meant to do."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch.distributions import MultivariateNormal
from torch.nn import functional

from naris.core.pose import Pose
from naris.model.compact import Compact, CompactConfig
from naris.model.losses import Targets, compact_loss, covariance_of, gaussian_nll, twist_to
from naris.model.residual import patches

TINY = CompactConfig(input_px=16, channels=(8, 16), blocks=(1, 1), reduced=4, embedding=12, hypotheses=2)
MEAN, SCALE = torch.tensor([1.0, -5.0, 2.0]), torch.tensor([4.0, 20.0, 8.0])


def _pictures(n: int, seed: int = 0) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).integers(0, 256, (n, 16, 16, 3), dtype=np.uint8))


def _targets(n: int, strangers: int = 0) -> Targets:
    rng = np.random.default_rng(1)
    rotation = torch.from_numpy(Rotation.random(n, rng=rng).as_matrix()).float()
    position = torch.from_numpy(rng.normal(size=(n, 3)) * 10).float()
    return Targets(torch.arange(n) % 3, position, rotation, torch.arange(n) < n - strangers)


def _network(seed: int = 0) -> Compact:
    torch.manual_seed(seed)
    return Compact(3, TINY)


def test_likelihood_agrees_with_torchs_normal_distribution() -> None:
    output = _network()(_pictures(5))
    error = torch.randn(5, 2, 6)
    normal = MultivariateNormal(torch.zeros(6, dtype=torch.float64), covariance_of(output.factor.double()))
    expected = -normal.log_prob(error.double()) - 3 * np.log(2 * np.pi)
    ours = gaussian_nll(error.double(), output.factor.double())
    assert torch.allclose(ours, expected, rtol=1e-6)


def test_covariances_are_symmetric_and_positive_before_any_training() -> None:
    covariance = covariance_of(_network()(_pictures(6)).factor.double())
    assert torch.allclose(covariance, covariance.transpose(-1, -2))
    assert (torch.linalg.eigvalsh(covariance) > 0).all()
    deviation = covariance.diagonal(dim1=-2, dim2=-1).sqrt()
    assert (deviation[..., :3] > 1).all() and (deviation[..., 3:] < 3).all()


def test_twist_is_the_logarithm_of_the_relative_pose_to_first_order() -> None:
    rng = np.random.default_rng(3)
    predicted = Pose.of(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3) * 10, "mean", "camera")
    small = np.array([0.02, -0.01, 0.03, 2e-3, 1e-3, -3e-3])
    true = predicted @ Pose.exp(small, "camera", "camera")
    tensors = [torch.from_numpy(x.copy())[None, None] for x in (predicted.position_mm, predicted.rotation)]
    tensors += [torch.from_numpy(x.copy())[None, None] for x in (true.position_mm, true.rotation)]
    assert np.allclose(twist_to(*tensors)[0, 0].numpy(), small, atol=1e-4)


def test_strangers_teach_the_domain_head_alone() -> None:
    network = _network().eval()  # in training mode the batch's statistics would tie the pictures together
    pictures, targets = _pictures(6), _targets(6, strangers=2)
    losses = compact_loss(network(pictures), targets, MEAN, SCALE)
    others = targets._replace(position_mm=targets.position_mm.clone(), region=targets.region.clone())
    others.position_mm[4:] += 100
    others.region[4:] = 0
    same = compact_loss(network(pictures), others, MEAN, SCALE)
    assert float(losses.total) == float(same.total)
    familiar = compact_loss(network(pictures), targets._replace(in_domain=torch.ones(6, dtype=bool)), MEAN, SCALE)
    assert float(familiar.domain) != float(losses.domain)


def test_only_the_best_hypothesis_is_pulled_hard() -> None:
    network = _network()
    output = network(_pictures(4))
    output.position.retain_grad()
    targets = _targets(4)
    compact_loss(output, targets, MEAN, SCALE).pose.backward()
    pull = output.position.grad.norm(dim=-1)
    assert (pull.min(dim=1).values > 0).all()
    assert (pull.min(dim=1).values < 0.2 * pull.max(dim=1).values).all()


def test_loss_falls_to_a_set_of_pictures_that_can_be_learned_by_heart() -> None:
    network, pictures, targets = _network(), _pictures(8), _targets(8)
    optimiser = torch.optim.Adam(network.parameters(), 1e-2)
    history = []
    for _ in range(150):
        losses = compact_loss(network(pictures), targets, MEAN, SCALE)
        optimiser.zero_grad()
        losses.total.backward()
        optimiser.step()
        history.append([float(part) for part in losses])
    first, last = np.array(history[0]), np.array(history[-10:]).mean(axis=0)
    assert last[1] < 0.3 * first[1] and last[2] < 0.3 * first[2] and last[3] < first[3]


def test_gain_and_tint_do_not_reach_the_network() -> None:
    pictures = _pictures(3) * 0.5
    tinted = pictures * torch.tensor([1.3, 0.9, 1.1])
    assert torch.allclose(patches(tinted), patches(pictures), atol=0.05)


def test_patches_are_torchs_of_standardised_pictures_with_the_colours_last() -> None:
    pictures = _pictures(2)
    planes = pictures.permute(0, 3, 1, 2).double()
    deviation = planes.std((2, 3), keepdim=True, correction=0)
    planes = (planes - planes.mean((2, 3), keepdim=True)) / (deviation + 4)
    torchs = functional.pixel_unshuffle(planes, 4).unflatten(1, (3, 4, 4)).permute(0, 2, 3, 1, 4, 5).flatten(1, 3)
    assert torch.allclose(patches(pictures).double(), torchs, atol=1e-4)


@pytest.mark.parametrize("value", [0, 255])
def test_a_flat_picture_gives_numbers(value: int) -> None:
    output = _network().eval()(torch.full((1, 16, 16, 3), value, dtype=torch.uint8))
    assert all(torch.isfinite(part).all() for part in output)
