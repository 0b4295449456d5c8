"""What pictures must show: left on the left, the distance to a ball's wall, the published light, the round stop."""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from naris.core.anatomy import Anatomy
from naris.core.camera import Fisheye, Intrinsics
from naris.core.pose import Pose
from naris.errors import ImageError, InputError, PoseError
from naris.render.appearance import (
    ENDOSCOPE,
    PAPER,
    PAPER_CULLED,
    TRAINING_APPEARANCE,
    UNSEEN_APPEARANCE,
    Appearance,
    Light,
    Mucosa,
    Optics,
    Sensor,
    TextureColours,
    Uniform,
)
from naris.render.scene import Scene, render
from tests.render.surfaces import UP, picture, pod, sphere, views

ENGINES = ("fast", "numpy")
FLAT = Appearance(Uniform((0.5, 0.5, 0.5)), Light(ambient=(1, 1, 1), diffuse=(0, 0, 0)))


def coloured_sphere(rgb_of) -> tuple[Anatomy, TextureColours]:
    """A ball, and a texture whose texel rule gives vertex i the colour rgb_of(position)."""
    ball = sphere()
    return ball, TextureColours(texture_of(np.array([rgb_of(p) for p in ball.vertices_mm], np.uint8)))


def texture_of(colours: np.ndarray) -> np.ndarray:
    """An image whose texel (i mod width, i mod height) is colour i: width and height without common divisor."""
    count = len(colours)
    width = math.isqrt(count) + 1
    height = next(h for h in range(width + 1, 4 * width) if math.gcd(h, width) == 1)
    image = np.zeros((height, width, 3), np.uint8)
    index = np.arange(count)
    image[index % height, index % width] = colours
    return image


@pytest.mark.parametrize("engine", ENGINES)
def test_the_patients_left_is_right_in_a_picture_that_looks_back_and_top_is_up(engine) -> None:
    # LPS: x to the patient's left, y to the back, z up. The camera looks to the back, as an endoscope goes in.
    ball, paint = coloured_sphere(lambda p: (255 * (p[0] > 5), 255 * (p[2] > 5), 255 * (p[0] < -5)))
    look = Appearance(paint, FLAT.light)
    pose = Pose.look(np.zeros(3), np.array([0, 1.0, 0]), UP, "LPS")
    intrinsics = picture(60, 60, 100)
    rendering = render(Scene(ball, engine=engine), pose, intrinsics, look)
    rows, columns = np.mgrid[0:60, 0:60]
    red, green, blue = (rendering.rgb[0, ..., c] > 128 for c in range(3))
    assert columns[red].min() > 35 and columns[blue].max() < 24 and rows[green].max() < 24
    for point, channel in (
        (np.array([6.0, 7, 0]), red),
        (np.array([-6.0, 7, 0]), blue),
        (np.array([0, 7, 6.0]), green),
    ):
        pixel, seen = intrinsics.project(pose.inverse().apply(point))
        column, row = np.rint(pixel).astype(int)
        assert seen and channel[row, column]


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("lens", [None, Fisheye(-0.02)])
def test_depth_and_normals_in_a_ball_are_those_of_the_formula(engine, lens) -> None:
    radius, centre = 10.0, np.array([1.0, -2.0, 1.5])
    scene = Scene(sphere(radius, 5), engine=engine)
    intrinsics = Intrinsics(80, 60, 40.0, 40.0, 39.5, 29.5, lens) if lens else picture(80, 60, 90)
    pose = Pose.look(centre, np.array([0.3, 1.0, -0.2]), UP, "LPS", 0.7)
    rendering = render(scene, pose, intrinsics, want=("depth", "normal"))
    rays = intrinsics.rays()
    world = rays @ pose.rotation.T
    along = world @ centre
    distance = -along + np.sqrt(along**2 - centre @ centre + radius**2)
    sag_mm = radius * (1 - np.cos(np.deg2rad(2.2)))  # how far the faces lie inside the ball
    assert rendering.valid.all()
    off = distance * rays[..., 2] - rendering.depth_mm[0]
    assert off.min() > -1e-3 and off.max() < 3 * sag_mm
    inward = -(centre + distance[..., None] * world) / radius @ pose.rotation
    assert (inward * rendering.normals[0]).sum(-1).min() > np.cos(np.deg2rad(3))
    assert np.abs(np.linalg.norm(rendering.normals, axis=-1) - 1).max() < 1e-5
    assert rendering.rgb is None and rendering.face_ids is None


@pytest.mark.parametrize("engine", ENGINES)
def test_outside_the_surface_a_camera_sees_its_outside_or_nothing(engine) -> None:
    scene = Scene(sphere(), engine=engine)
    towards = Pose.look(np.array([0, -30.0, 0]), np.array([0, 1.0, 0]), UP, "LPS")
    away = Pose.look(np.array([0, -30.0, 0]), np.array([0, -1.0, 0]), UP, "LPS")
    seen, nothing = (render(scene, pose, picture(33, 33), PAPER) for pose in (towards, away))
    assert seen.depth_mm[0, 16, 16] == pytest.approx(20, abs=0.05) and 0 < seen.valid.mean() < 1
    assert seen.normals[0, 16, 16] == pytest.approx([0, 0, -1], abs=0.1)
    assert not nothing.valid.any() and not nothing.rgb.any() and (nothing.face_ids == -1).all()


@pytest.mark.parametrize("engine", ENGINES)
def test_paper_light_is_opengls_fixed_pipeline_at_the_vertices(engine) -> None:
    anatomy, pose = pod(), views(1, seed=2)[0]
    colours = np.random.default_rng(3).integers(0, 256, (len(anatomy.vertices_mm), 3), dtype=np.uint8)
    look = PAPER.with_(material=TextureColours(texture_of(colours)))
    intrinsics = Intrinsics.from_vertical_fov(40, 40, 80)
    rendering = render(Scene(anatomy, engine=engine), pose, intrinsics, look)
    for row, column in ((5, 6), (20, 20), (33, 11), (0, 39)):
        face = anatomy.faces[rendering.face_ids[0, row, column]]
        point = intrinsics.unproject(np.array([float(column), row]))
        point = pose.apply(point / point[2] * float(rendering.depth_mm[0, row, column]))
        corners = anatomy.vertices_mm[face]
        weights = np.linalg.lstsq(np.vstack([corners.T, np.ones(3)]), np.append(point, 1), rcond=None)[0]
        lit = [opengl_vertex(anatomy, pose, v, colours[v] / 255) for v in face]
        expected = 255 * (weights @ np.array(lit))
        assert np.abs(rendering.rgb[0, row, column] - expected).max() < 1.5


def opengl_vertex(anatomy: Anatomy, pose: Pose, vertex: int, colour: np.ndarray) -> np.ndarray:
    """Section 2.14.1 of the OpenGL 1.5 specification with the published numbers, seen from the back of the face."""
    to_light = pose.position_mm - anatomy.vertices_mm[vertex]
    to_light /= np.linalg.norm(to_light)
    normal = -anatomy.vertex_normals[vertex]
    axial = max(-to_light @ pose.forward, 0.0)
    spot = axial**0.5 if axial >= math.cos(math.radians(45)) else 0.0
    ambient, diffuse = 0.2 * colour, np.array([10.5, 10.0, 10.0]) * colour * max(normal @ to_light, 0.0)
    return np.clip(0.2 * colour + spot / 7.5 * (ambient + diffuse), 0, 1)


def test_texel_rule() -> None:
    image = np.arange(3 * 5 * 3, dtype=np.uint8).reshape(3, 5, 3)
    colours = TextureColours(image).vertex_colours(17)
    for i in range(17):
        assert np.array_equal(np.rint(colours[i] * 255), image[i % 3, i % 5])


def test_a_text_file_is_no_texture(tmp_path) -> None:
    (tmp_path / "a.png").write_text("not a picture")
    with pytest.raises(ImageError, match="picture"):
        TextureColours.read(tmp_path / "a.png")


def test_a_texture_is_read_with_the_care_of_any_picture(tmp_path) -> None:
    colours = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
    path = tmp_path / "a.png"
    Image.fromarray(colours).save(path)
    assert np.array_equal(TextureColours.read(path).image, colours)
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (300, 300, 3), dtype=np.uint8)).save(path)
    whole = path.read_bytes()
    second = whole.rindex(b"IDAT")
    large = whole[:16] + struct.pack(">II", 9000, 9000) + whole[24:29]
    large += struct.pack(">I", zlib.crc32(large[12:29])) + whole[33:]
    script = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 20 20\n%%EndComments\nshowpage\n%%EOF\n"
    for content, said in (
        (whole[:second] + b"\x01DAT" + whole[second + 4 :], "a damaged one"),
        (whole[:50], "a damaged one"),
        (large, "got 9000×9000"),
        (script, "a file of another kind"),  # Pillow would hand it to Ghostscript
    ):
        path.write_bytes(content)
        with pytest.raises(ImageError, match=said):
            TextureColours.read(path)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_round_stop_blackens_the_picture_and_leaves_the_geometry(engine) -> None:
    scene, pose = Scene(sphere(), engine=engine), views(1)
    stopped = FLAT.with_(optics=Optics(mask_radius=0.8, mask_centre=(0.1, 0.0)), sensor=Sensor(read_noise=3.0))
    rendering = render(scene, pose, picture(50, 40), stopped)
    row, column = np.mgrid[0:40, 0:50]
    radius = np.hypot((column - 24.5) / 20 - 0.1, (row - 19.5) / 20)
    assert not rendering.rgb[0][radius > 0.81].any() and (rendering.rgb[0][radius < 0.78] > 100).all()
    assert rendering.valid.all() and (rendering.depth_mm > 0).all()


@pytest.mark.parametrize("engine", ENGINES)
def test_automatic_exposure_brings_near_and_far_walls_to_the_same_light(engine) -> None:
    light = Light(attenuation=(0.0, 0.0, 1.0))
    automatic = Sensor(auto_exposure=1.0, target=0.4, meter_quantile=0.5, gain_range=(1e-6, 1e6))
    near, far = (Scene(sphere(radius), engine=engine) for radius in (3.0, 12.0))
    pose = Pose.look(np.zeros(3), np.array([0, 1.0, 0]), UP, "LPS")
    white = Appearance(Uniform((1, 1, 1)), light, sensor=automatic)
    for scene in (near, far):
        assert np.median(render(scene, pose, picture(), white).rgb) == pytest.approx(0.4 * 255, abs=4)
    fixed = Appearance(Uniform((1, 1, 1)), light, sensor=Sensor(gain=8))
    bright, dim = (render(scene, pose, picture(), fixed).rgb.mean() for scene in (near, far))
    assert bright == pytest.approx(16 * dim, rel=0.1)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_filter_keeps_even_walls_and_sharpens_edges(engine) -> None:
    scene, pose = Scene(sphere(), engine=engine), Pose.look(np.zeros(3), np.array([0, 1.0, 0]), UP, "LPS")
    even = render(scene, pose, picture(), FLAT.with_(sensor=Sensor(blur_px=0.8, sharpen=1.0))).rgb
    assert even.min() >= 127 and even.max() <= 128
    edged = FLAT.with_(optics=Optics(mask_radius=0.7, mask_softness=1e-4))
    plain, blurred, sharp = (
        render(scene, pose, picture(), edged.with_(sensor=sensor)).rgb.astype(float)
        for sensor in (Sensor(), Sensor(blur_px=0.8), Sensor(sharpen=1.0))
    )
    steps = [np.abs(np.diff(image[0], axis=1)).max() for image in (blurred, plain, sharp)]
    assert steps[0] < 0.8 * steps[1] < steps[1] < steps[2]
    assert blurred.mean() == pytest.approx(plain.mean(), rel=0.01)


def test_tone_curve_is_the_gamma_it_says() -> None:
    scene, pose = Scene(sphere()), Pose.look(np.zeros(3), np.array([0, 1.0, 0]), UP, "LPS")
    for light in (0.02, 0.2, 0.9, 1.5):
        look = FLAT.with_(sensor=Sensor(gain=2 * light, gamma=2.2))
        assert np.median(render(scene, pose, picture(), look).rgb) == pytest.approx(
            255 * min(light, 1) ** (1 / 2.2), abs=1
        )


def test_mucosa_is_solid_and_moves_with_its_seed() -> None:
    anatomy, pose = pod(), views(1, seed=4)
    scene = Scene(anatomy)
    still = ENDOSCOPE.with_(sensor=Sensor(), optics=Optics(), light=FLAT.light)
    turned = Pose(pose.matrix @ Pose.exp(np.array([0, 0, 0, 0, 0, 0.5]), "camera", "camera").matrix, "LPS", "camera")
    one, two = (render(scene, p, picture(96, 96), still) for p in (pose, turned))
    ball = np.hypot(*(np.mgrid[0:96, 0:96] - 47.5)) < 40
    # The same walls turned in the picture: their colours are the same in distribution.
    for channel in range(3):
        assert one.rgb[0][ball][:, channel].mean() == pytest.approx(two.rgb[0][ball][:, channel].mean(), abs=2)
    other = render(scene, pose, picture(96, 96), still.with_(material=Mucosa(seed=1)))
    assert np.abs(other.rgb.astype(int) - one.rgb).mean() > 2
    red, green, blue = one.rgb.reshape(-1, 3).mean(axis=0)
    assert red > 1.3 * green > 1.3 * blue


def test_draws_repeat_and_the_unseen_ones_are_apart() -> None:
    first, again = (TRAINING_APPEARANCE.sample(np.random.default_rng(3)) for _ in range(2))
    assert first == again != TRAINING_APPEARANCE.sample(np.random.default_rng(4))
    rng = np.random.default_rng(0)
    seen = [TRAINING_APPEARANCE.sample(rng) for _ in range(300)]
    unseen = [UNSEEN_APPEARANCE.sample(rng) for _ in range(300)]
    assert not {a.material.family for a in seen} & {a.material.family for a in unseen}
    assert max(a.light.exponent for a in seen) < min(a.light.exponent for a in unseen)
    assert max(a.light.attenuation[2] for a in seen) <= min(a.light.attenuation[2] for a in unseen)
    assert max(warmth(a) for a in unseen) < min(warmth(a) for a in seen)
    assert max(violet(a) for a in seen) < min(violet(a) for a in unseen)


def test_a_fifth_of_the_training_looks_is_flat_and_no_other() -> None:
    rng = np.random.default_rng(0)
    falloff = np.array([TRAINING_APPEARANCE.sample(rng).light.attenuation[2] for _ in range(400)])
    flat = falloff <= 0.004
    assert 0.13 < flat.mean() < 0.27
    assert falloff[~flat].min() >= 0.01
    assert min(UNSEEN_APPEARANCE.sample(rng).light.attenuation[2] for _ in range(100)) >= 0.1


def warmth(appearance: Appearance) -> float:
    red, _, blue = appearance.light.diffuse
    return red - blue


def violet(appearance: Appearance) -> float:
    red, _, blue = appearance.material.pale
    return blue / red


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"poses": views(2, frame="mean")}, PoseError),
        ({"poses": Pose.identity("LPS", "head")}, PoseError),
        ({"appearance": [PAPER]}, InputError),
        ({"seeds": np.arange(3)}, InputError),
        ({"want": ("rgb", "smell")}, InputError),
    ],
)
def test_bad_arguments_are_refused(arguments, error) -> None:
    call = {"poses": views(2), "appearance": PAPER, **arguments}
    poses, appearance = call.pop("poses"), call.pop("appearance")
    with pytest.raises(error, match="expected"):
        render(Scene(sphere(subdivisions=1)), poses, picture(), appearance, **call)


def test_a_mucosa_says_what_is_wrong_with_it() -> None:
    with pytest.raises(InputError, match="family"):
        Mucosa(family="tartan")
    with pytest.raises(InputError, match="above 0"):
        Mucosa(relief_mm=0.0)


def test_presets_hang_together() -> None:
    assert PAPER.with_(cull_near_walls=True) == PAPER_CULLED and PAPER.light.per_vertex
    assert not PAPER.with_(material=Mucosa()).light.per_vertex  # a solid texture has no vertices to light
    assert replace(ENDOSCOPE, sensor=ENDOSCOPE.sensor) == ENDOSCOPE
