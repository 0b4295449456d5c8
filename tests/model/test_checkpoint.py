"""The file of a network: what goes in comes out, and what is broken is told in one sentence."""

from __future__ import annotations

import json
import pickle
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file

from naris.core.anatomy import GridRegions, SlabRegions
from naris.core.camera import Brown, Intrinsics
from naris.dataset.layout import RegionLabels
from naris.errors import CheckpointError, RegionError
from naris.model.calibration import Calibration, fit_usual
from naris.model.checkpoint import (
    SCHEMA,
    Checkpoint,
    Subject,
    load_checkpoint,
    read_tensors,
    save_checkpoint,
    write_tensors,
)
from naris.model.compact import Compact, CompactConfig
from naris.model.localizer import build, config_json, name_of, open_localizer, weights_of
from naris.model.two_layer import TwoLayerConfig
from tests.anatomy.shapes import box

SLABS = SlabRegions("paper", ("a", "b", "c"), "mean", 1, (-30.0, 0.0))
TINY = CompactConfig(input_px=16, channels=(8, 16), blocks=(1, 1), reduced=4, embedding=12, hypotheses=2)
LENS = Brown(k1=-0.1, p2=0.01)


def _checkpoint(config: CompactConfig | TwoLayerConfig = TINY) -> Checkpoint:
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    intrinsics = Intrinsics.from_vertical_fov(300, 300, 45.0, LENS)
    subject = Subject(RegionLabels.of(SLABS), "mean nose", "0" * 64, "mean", intrinsics, SLABS)
    width = 12 if isinstance(config, CompactConfig) else 84
    embedding = rng.normal(size=(40, width)).astype(np.float32)
    usual = fit_usual(embedding, np.arange(40) % 3, embedding + 1)
    network = build(config, 3)
    calibration = Calibration(1.5, 40, usual, 0.4)
    return Checkpoint(name_of(config), config_json(config), subject, weights_of(network), calibration, {"seed": 3})


def _saved(tmp_path: Path, config: CompactConfig | TwoLayerConfig = TINY) -> Path:
    path = tmp_path / "model.safetensors"
    save_checkpoint(path, _checkpoint(config))
    return path


@pytest.mark.parametrize("config", [TINY, TwoLayerConfig(20)])
def test_everything_comes_back(tmp_path: Path, config: CompactConfig | TwoLayerConfig) -> None:
    before, after = _checkpoint(config), load_checkpoint(_saved(tmp_path, config), regions=SLABS)
    assert after.subject.to_json() == before.subject.to_json()
    assert after.subject.intrinsics == before.subject.intrinsics
    assert (after.network, after.training, after.version) == (before.network, before.training, before.version)
    assert after.weights.keys() == before.weights.keys()
    assert all(np.array_equal(after.weights[name], value) for name, value in before.weights.items())
    assert (after.calibration.temperature, after.calibration.power) == (1.5, 0.4)
    assert after.subject.borders == SLABS
    assert np.array_equal(after.calibration.usual.whitening, before.calibration.usual.whitening)
    pictures = np.random.default_rng(1).integers(0, 256, (3, 20, 20, 3), dtype=np.uint8)
    for ours, theirs in zip(
        open_localizer(before).predict(pictures), open_localizer(after).predict(pictures), strict=True
    ):
        assert np.array_equal(ours.log_probabilities, theirs.log_probabilities)
        assert abs(np.exp(ours.log_probabilities).sum() - 1) < 1e-9


def test_borders_of_any_shape_come_back(tmp_path: Path) -> None:
    labels = np.random.default_rng(0).integers(-1, 3, (4, 5, 6)).astype(np.int8)
    grid = GridRegions("mine", ("a", "b", "c"), "mean", labels, np.array([0.1, -2.0, 3.3]), 0.7)
    before = _checkpoint()
    subject = replace(before.subject, regions=RegionLabels.of(grid), borders=grid)
    save_checkpoint(tmp_path / "model.safetensors", replace(before, subject=subject))
    after = load_checkpoint(tmp_path / "model.safetensors", regions=grid).subject.borders
    points = np.random.default_rng(1).uniform(-5, 8, (500, 3))
    assert isinstance(after, GridRegions)
    assert np.array_equal(after.label(points), grid.label(points))


class _TiltedSlabs(SlabRegions):
    """Regions of somebody's own, which no file of ours can hold."""


@pytest.mark.parametrize("kind", ["int16 labels", "a class of one's own"])
def test_borders_that_would_not_come_back_are_left_out(tmp_path: Path, kind: str) -> None:
    labels = np.zeros((5, 5, 5), dtype=np.int16)
    grid = GridRegions("paper", ("a", "b", "c"), "LPS", labels, np.zeros(3), 1.0)
    tilted = _TiltedSlabs("paper", ("a", "b", "c"), "LPS", 1, (-30.0, 0.0))
    before = _checkpoint()
    subject = Subject.of(box(), grid if kind == "int16 labels" else tilted, before.subject.intrinsics)
    save_checkpoint(tmp_path / "model.safetensors", replace(before, subject=subject))
    assert load_checkpoint(tmp_path / "model.safetensors").subject.borders is None
    known = Subject.of(box(), replace(SLABS, frame="LPS"), before.subject.intrinsics)
    assert known.borders is not None


def test_borders_of_other_regions_are_refused() -> None:
    with pytest.raises(CheckpointError, match="borders of 'paper' in the frame 'mean'"):
        replace(_checkpoint().subject, borders=replace(SLABS, borders_mm=(-30.0, 1.0)))


def test_a_file_from_before_borders_were_kept_still_reads(tmp_path: Path) -> None:
    path = _saved(tmp_path)
    about, tensors = read_tensors(path, SCHEMA, "a model", "")
    del about["borders"], about["calibration"]["power"]
    write_tensors(path, SCHEMA, {k: v for k, v in about.items() if k not in ("schema", "sha256")}, tensors)
    after = load_checkpoint(path)
    assert after.subject.borders is None
    assert after.calibration.power == 0


def test_a_truncated_file_is_told_at_any_length(tmp_path: Path) -> None:
    path = _saved(tmp_path)
    whole = path.read_bytes()
    for length in (0, 1, 7, 8, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(CheckpointError, match="truncated file or one of another kind"):
            load_checkpoint(path)


def test_a_changed_number_is_told(tmp_path: Path) -> None:
    path = _saved(tmp_path)
    content = bytearray(path.read_bytes())
    content[-5] ^= 0x10
    path.write_bytes(content)
    with pytest.raises(CheckpointError, match="numbers changed"):
        load_checkpoint(path)


def test_other_files_are_told(tmp_path: Path) -> None:
    path = tmp_path / "model.safetensors"
    with pytest.raises(CheckpointError, match="no such file"):
        load_checkpoint(path)
    save_file({"x": np.zeros(3, np.float32)}, path)
    with pytest.raises(CheckpointError, match="weights of other origin"):
        load_checkpoint(path)
    path.write_bytes(struct.pack("<Q", 2**62) + b"{}")
    with pytest.raises(CheckpointError, match="another kind"):
        load_checkpoint(path)


class _Trap:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (Path.touch, (Path("executed"),))  # type: ignore[return-value]


def test_nothing_is_executed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "model.pt"
    torch.save({"weights": _Trap()}, path)
    with pytest.raises(CheckpointError):
        load_checkpoint(path)
    path.write_bytes(pickle.dumps(_Trap()))
    with pytest.raises(CheckpointError):
        load_checkpoint(path)
    assert not (tmp_path / "executed").exists()


def test_other_regions_and_networks_are_told(tmp_path: Path) -> None:
    path = _saved(tmp_path)
    other = replace(SLABS, names=("a", "b", "d"))
    with pytest.raises(RegionError, match="made for the 3 of 'paper'"):
        load_checkpoint(path, regions=other)
    with pytest.raises(CheckpointError, match="one with compact"):
        load_checkpoint(path, network="two-layer")
    moved = SlabRegions("paper", ("a", "b", "c"), "mean", 1, (-30.0, 1.0))
    with pytest.raises(RegionError, match="other borders"):
        load_checkpoint(path, regions=moved)


def test_weights_of_another_shape_are_told() -> None:
    checkpoint = _checkpoint()
    wider = replace(checkpoint, config={**checkpoint.config, "embedding": 13})
    with pytest.raises(CheckpointError, match=r"others in "):
        open_localizer(wider)
    with pytest.raises(CheckpointError, match="one of the networks"):
        open_localizer(replace(checkpoint, network="huge"))
    with pytest.raises(CheckpointError, match="one of the networks"):
        open_localizer(replace(checkpoint, config={"depth": 3}))


def test_a_description_that_lacks_something_is_told(tmp_path: Path) -> None:
    path = _saved(tmp_path)
    content = path.read_bytes()
    (length,) = struct.unpack("<Q", content[:8])
    header = json.loads(content[8 : 8 + length])
    about = json.loads(header["__metadata__"]["naris"])
    del about["regions"]
    header["__metadata__"]["naris"] = json.dumps(about)
    text = json.dumps(header).encode()
    path.write_bytes(struct.pack("<Q", len(text)) + text + content[8 + length :])
    with pytest.raises(CheckpointError, match="without 'regions'"):
        load_checkpoint(path)


def test_building_the_default_networks_gives_the_documented_sizes() -> None:
    parameters = sum(p.numel() for p in Compact(4).parameters())
    assert 1_000_000 < parameters < 3_000_000
