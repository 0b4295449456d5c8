"""Any picture file: read or refused in one sentence; found where a frame is; and an answer only where there is one."""

from __future__ import annotations

import struct
import zlib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from naris.core.anatomy import SlabRegions
from naris.core.camera import Brown, Fisheye, Intrinsics, Lens, Pinhole
from naris.core.results import Prediction
from naris.dataset.layout import RegionLabels
from naris.errors import ImageError, RegionError
from naris.locate import Doubt, is_localised, locate, read_picture, views_of, visible_area
from naris.model.calibration import Calibration, fit_usual
from naris.model.checkpoint import Checkpoint, Subject, save_checkpoint
from naris.model.compact import CompactConfig
from naris.model.localizer import (
    Localizer,
    Outputs,
    build,
    config_json,
    fitted,
    open_localizer,
    predictions,
    weights_of,
)
from naris.model.two_layer import TwoLayerConfig
from tests.conftest import shared_file

SLABS = SlabRegions("paper", ("a", "b", "c"), "mean", 1, (-30.0, 0.0))
CAMERA = Intrinsics.from_vertical_fov(48, 48, 45.0)
TINY = CompactConfig(input_px=48, channels=(8, 16), blocks=(1, 1), reduced=4, embedding=12, hypotheses=2)


def _colours(height: int = 60, width: int = 80) -> np.ndarray:
    v, u = np.mgrid[0:height, 0:width]
    return np.stack([100 + u, 60 + v, 200 - u], axis=-1).clip(0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def localizer() -> Localizer:
    """A network that has learned nothing, but knows what its world looks like: `_colours` with a little noise."""
    torch.manual_seed(0)
    subject = Subject(RegionLabels.of(SLABS), "mean nose", None, "mean", CAMERA)
    bare = open_localizer(Checkpoint("compact", config_json(TINY), subject, weights_of(build(TINY, 3).eval())))
    rng = np.random.default_rng(0)
    world = np.stack([_colours(48, 48)] * 300).astype(int) + rng.integers(-12, 13, (300, 48, 48, 3))
    said = bare.outputs(world.clip(0, 255).astype(np.uint8))
    usual = fit_usual(said.embedding[:150], np.zeros(150, int), said.embedding[150:], said.domain_logit[150:])
    calibration = Calibration(1.0, 150, usual)
    checkpoint = bare.checkpoint
    return open_localizer(Checkpoint(checkpoint.network, checkpoint.config, subject, checkpoint.weights, calibration))


def _png_header(width: int, height: int) -> bytes:
    body = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + struct.pack(">I", 13)
        + body
        + struct.pack(">I", zlib.crc32(body))
        + struct.pack(">I", 5000)
        + b"IDAT"
    )


@pytest.mark.parametrize("mode", ["RGB", "L", "LA", "RGBA", "P", "1", "I;16", "CMYK"])
@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_every_mode_gives_the_same_colours(tmp_path: Path, mode: str, suffix: str) -> None:
    if (mode, suffix) in {("CMYK", ".png"), ("I;16", ".tif")}:
        pytest.skip("there is no such file")
    path = tmp_path / f"picture{suffix}"
    rgb = Image.fromarray(_colours())
    if mode == "I;16":
        grey = np.asarray(rgb.convert("L"))
        Image.fromarray(grey.astype(np.uint16) * 257).save(path)
    else:
        rgb.convert(mode).save(path)
    expected = rgb.convert("L" if mode in ("LA", "I;16") else mode).convert("RGB")
    assert np.array_equal(read_picture(path), np.array(expected))


def test_jpeg_and_its_orientation(tmp_path: Path) -> None:
    picture = Image.fromarray(_colours())
    exif = Image.Exif()
    exif[0x0112] = 6
    picture.save(tmp_path / "turned.jpg", quality=95, exif=exif)
    found = read_picture(tmp_path / "turned.jpg")
    assert found.shape == (80, 60, 3)
    assert np.abs(found.astype(int) - np.rot90(_colours(), -1)).mean() < 3


def test_what_is_transparent_is_black(tmp_path: Path) -> None:
    clear = np.dstack([_colours(), np.where(np.arange(80) < 40, 255, 0)[None].repeat(60, 0)]).astype(np.uint8)
    Image.fromarray(clear).save(tmp_path / "clear.png")
    found = read_picture(tmp_path / "clear.png")
    assert np.array_equal(found[:, :40], _colours()[:, :40])
    assert not found[:, 40:].any()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("text.png", b"This is no picture.\n" * 40, "a file of another kind"),
        ("empty.png", b"", "a file of another kind"),
        ("bomb.png", _png_header(60_000, 60_000), "64,000,000 pixels"),
        ("wide.png", _png_header(30_000, 3_000), "30000×3000"),
        ("dot.png", _png_header(1, 1), "1×1"),
        ("header.png", _png_header(100, 100), "a damaged one"),
    ],
)
def test_what_is_no_picture_is_told(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ImageError, match=message) as caught:
        read_picture(path)
    assert "\n" not in str(caught.value)
    assert name in str(caught.value)


def test_missing_files_folders_and_floats_are_told(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match="no such file"):
        read_picture(tmp_path / "absent.png")
    with pytest.raises(ImageError, match="a folder"):
        read_picture(tmp_path)
    Image.fromarray(np.ones((20, 20), np.float32)).save(tmp_path / "float.tif")
    with pytest.raises(ImageError, match="floating-point"):
        read_picture(tmp_path / "float.tif")


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".bmp", ".webp"])
@given(share=st.floats(0.0, 0.95))
def test_a_truncated_picture_is_told_wherever_it_ends(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, share: float
) -> None:
    path = tmp_path_factory.mktemp("cut") / f"picture{suffix}"
    noise = np.random.default_rng(0).integers(0, 256, (40, 40, 3), dtype=np.uint8)
    Image.fromarray(noise).save(path)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ImageError, match=r"damaged one|another kind"):
        read_picture(path)


@given(st.binary(max_size=300))
def test_any_bytes_are_read_or_told(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.mktemp("any") / "any.png"
    for head in (b"", _png_header(40, 40)):
        path.write_bytes(head + content)
        try:
            assert read_picture(path).dtype == np.uint8
        except ImageError as error:
            assert str(error).startswith("expected a")


def _disc(height: int, width: int, centre: tuple[float, float], radius: float) -> np.ndarray:
    """A lit tube with a dark passage, on a black frame with the noise of a video."""
    v, u = np.mgrid[0:height, 0:width]
    off = np.hypot(u - centre[0], v - centre[1])
    glow = 200 - 190 * np.exp(-((np.hypot(u - centre[0] - 20, v - centre[1]) / (0.45 * radius)) ** 2))
    image = np.stack([glow, 0.6 * glow, 0.5 * glow], axis=-1)
    image[off > radius] = 0
    return (image + np.random.default_rng(0).uniform(0, 5, image.shape)).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("centre", "radius"), [((320.0, 240.0), 200.0), ((400.0, 220.0), 180.0), ((320.0, 240.0), 290.0)]
)
def test_a_round_picture_is_found(centre: tuple[float, float], radius: float) -> None:
    area = visible_area(_disc(480, 640, centre, radius))
    assert area.kind == "round"
    left, top, size = area.inner
    corners = [(left + i * (size - 1), top + j * (size - 1)) for i in (0, 1) for j in (0, 1)]
    assert max(np.hypot(x - centre[0], y - centre[1]) for x, y in corners) < radius + 6
    assert size > 0.9 * min(radius * 2**0.5, 480)
    left, top, size = area.outer
    assert abs(size - 2 * radius) < 0.05 * radius
    assert np.hypot(left + size / 2 - centre[0], top + size / 2 - centre[1]) < 0.05 * radius


def test_bars_are_cut_off_and_a_whole_picture_is_left() -> None:
    picture = np.random.default_rng(0).integers(60, 200, (300, 300, 3), dtype=np.uint8)
    framed = np.zeros((320, 500, 3), np.uint8)
    framed[10:310, 100:400] = picture
    area = visible_area(framed)
    assert area.kind == "bars"
    assert np.abs(np.array(area.inner) - [100, 10, 300]).max() <= 8
    assert visible_area(picture).inner == (0, 0, 300)
    assert visible_area(picture[:200]).inner == (50, 0, 200)


def test_a_dark_passage_is_no_frame() -> None:
    wall = np.zeros((300, 300, 3), np.uint8)
    wall[:, 190:] = 150
    assert visible_area(wall).kind == "whole"
    corner = np.zeros((300, 300, 3), np.uint8)
    cv2.fillPoly(corner, [np.array([[0, 0], [300, 0], [0, 220]])], (180, 120, 100))
    assert visible_area(corner).kind == "whole"
    assert visible_area(np.zeros((300, 300, 3), np.uint8)).kind == "whole"


def test_real_frames_are_seen_as_they_are_framed() -> None:
    """The shot of the development data; the mask that comes with (of another crop) nearly coincides."""
    mask = np.array(Image.open(shared_file("sinus-sfm/undistorted_mask.jpg")).convert("L")) > 128
    image = read_picture(shared_file("sinus-sfm/00004584.jpg"))
    area = visible_area(image)
    assert area.kind == "round"
    left, top, size = area.inner
    assert (image[top : top + size, left : left + size].max(axis=2) > 20).mean() > 0.99
    left, top, size = area.outer
    assert mask[max(top, 0) : top + size, max(left, 0) : left + size].sum() > 0.9 * mask.sum()
    assert size**2 < 0.6 * mask.size


@pytest.mark.parametrize("lens", [Pinhole(), Brown(k1=-0.2, p1=0.003), Fisheye(k1=-0.03)])
def test_a_known_camera_is_matched_ray_by_ray(lens: Lens) -> None:
    camera = Intrinsics.from_vertical_fov(400, 300, 70.0, lens)
    for direction in ([0.1, -0.05, 1.0], [-0.2, 0.15, 1.0], [0.0, 0.0, 1.0]):
        image = np.zeros((300, 400, 3), np.uint8)
        ((u, v),), _ = camera.project(np.array([direction]))
        cv2.circle(image, (round(float(u)), round(float(v))), 4, (255, 255, 255), -1)
        (view,) = views_of(image, 120, CAMERA, camera)
        row, column = np.mgrid[0:120, 0:120]
        weight = view[..., 0].astype(float)
        found = np.array([(column * weight).sum(), (row * weight).sum()]) / weight.sum()
        expected, _ = CAMERA.resized(120, 120).project(np.array([direction]))
        assert np.linalg.norm(found - expected) < 1.0


def test_intrinsics_of_a_picture_of_another_shape_are_refused(localizer: Localizer) -> None:
    camera = Intrinsics.from_vertical_fov(1920, 1080, 60.0)
    with pytest.raises(ImageError, match=r"shape 1920×1080 .*, got 108×108"):
        locate([_colours(108, 108)], localizer, intrinsics=camera)
    for width in (192, 193):  # the same picture made smaller, rounded
        assert len(locate([_colours(108, width)], localizer, intrinsics=camera)) == 1


def test_a_domain_head_judges_without_a_calibration_and_no_head_judges_nothing(localizer: Localizer) -> None:
    checkpoint = replace(localizer.checkpoint, calibration=Calibration())
    logit = np.array([9.0, 0.0, -9.0], np.float32)
    outputs = Outputs(np.tile(np.array([[4.0, 0, 0]], np.float32), (3, 1)), np.zeros((3, 12), np.float32), logit)
    known, torn, strange = predictions(outputs, checkpoint)
    assert [known.out_of_domain, torn.out_of_domain] == pytest.approx([1 / (1 + np.exp(9)), 0.5])
    assert is_localised(known)
    assert strange.out_of_domain > 0.99
    assert strange.region == 0
    assert not is_localised(strange, Doubt(probability=0.0))
    assert all(p.out_of_domain is None for p in predictions(replace(outputs, domain_logit=None), checkpoint))
    (judged,) = open_localizer(checkpoint).predict(_colours(48, 48)[None])
    assert 0 < judged.out_of_domain < 1
    config = TwoLayerConfig(16)
    weights = weights_of(build(config, 3))
    two_layer = Checkpoint("two-layer", config_json(config), checkpoint.subject, weights)
    assert open_localizer(two_layer).predict(_colours(16, 16)[None])[0].out_of_domain is None


def test_files_and_arrays_give_the_same_answers(tmp_path: Path, localizer: Localizer) -> None:
    picture = _colours(300, 300)
    Image.fromarray(picture).save(tmp_path / "a.png")
    model = tmp_path / "model.safetensors"
    save_checkpoint(model, localizer.checkpoint)
    of_file, of_array = locate([tmp_path / "a.png", picture], model, regions=SLABS, threads=1)
    plain = localizer.predict(fitted(picture[None], 48))[0]
    for prediction in (of_file, of_array):
        assert np.allclose(prediction.log_probabilities, plain.log_probabilities, atol=1e-6)
        assert np.allclose(prediction.hypotheses.matrix, plain.hypotheses.matrix, atol=1e-5)
    assert prediction.weights.sum() == pytest.approx(1.0)
    assert (np.diff(prediction.weights) <= 0).all()
    assert (np.linalg.eigvalsh(prediction.covariance) > 0).all()
    assert locate([], model) == []


def test_an_array_of_another_kind_and_a_model_of_other_regions_are_told(tmp_path: Path, localizer: Localizer) -> None:
    with pytest.raises(ImageError, match="4×4"):
        locate([np.zeros((4, 4, 3), np.uint8)], localizer)
    save_checkpoint(tmp_path / "m.safetensors", localizer.checkpoint)
    other = SlabRegions("halves", ("front", "back"), "mean", 1, (0.0,))
    with pytest.raises(RegionError, match="made for the 3 of 'paper'"):
        locate([_colours()], tmp_path / "m.safetensors", regions=other)


def test_a_picture_of_the_world_is_an_answer_and_another_is_not_more_sure_than_chance(localizer: Localizer) -> None:
    rng = np.random.default_rng(5)
    usual = (_colours(48, 48).astype(int) + rng.integers(-12, 13, (48, 48, 3))).clip(0, 255).astype(np.uint8)
    page = np.full((200, 200, 3), 250, np.uint8)
    cv2.putText(page, "naris", (5, 120), 0, 2.0, (0, 0, 0), 5)
    known, strange = locate([usual, page], localizer)
    assert known.out_of_domain < 0.5
    assert strange.out_of_domain == 1.0
    assert np.allclose(strange.probabilities, 1 / 3, atol=0.01)
    (plain,) = localizer.network(torch.from_numpy(fitted(page[None], 48))).region_logits.detach().numpy()
    assert strange.region == plain.argmax()
    assert not is_localised(strange)


def test_doubt() -> None:
    sure = Prediction("paper", ("a", "b"), np.log([0.9, 0.1]), out_of_domain=0.1)
    torn = Prediction("paper", ("a", "b", "c"), np.log([0.4, 0.35, 0.25]))
    assert is_localised(sure)
    assert not is_localised(sure, Doubt(out_of_domain=0.05))
    assert not is_localised(torn)
    assert is_localised(torn, Doubt(probability=0.3))
