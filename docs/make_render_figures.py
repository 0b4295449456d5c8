"""Draws `docs/figures/`: the region sets on the anatomies, and what the camera sees under every preset.

    python docs/make_render_figures.py [--mean-nose FOLDER]

The mean nose and its texture are those of `naris fetch mean-nose`, or of the folder that is named; without them only
the built-in nose is drawn.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from naris.anatomy.distance import signed_distance
from naris.anatomy.folder import load_anatomy
from naris.core.anatomy import Anatomy, RegionSet
from naris.core.camera import Intrinsics
from naris.fetch import MEAN_NOSE, cache_folder
from naris.render.appearance import (
    ENDOSCOPE,
    PAPER,
    TRAINING_APPEARANCE,
    UNSEEN_APPEARANCE,
    Appearance,
    AppearanceDistribution,
)
from naris.render.material import TextureColours
from naris.render.scene import Scene, render
from naris.render.viewpoints import INSPECTION, Viewpoints, draw_views, passages_of, view_bank
from naris.report.pictures import region_colours
from naris.report.surface_picture import FROM_ABOVE, FROM_FRONT, FROM_LEFT, draw_surface

FIGURES = Path(__file__).resolve().parent / "figures"
SEED = 2018
_PX_PER_MM, _MARGIN, _LINE = 9.0, 24, 24
_VIEW_PX, _GAP, _LABEL_PX = 200, 6, 210
_INK, _PAPER = (27, 33, 38), (255, 255, 255)


def main(arguments: Sequence[str]) -> int:
    """Draws everything that can be drawn here; the exit status."""
    named = "--mean-nose" in arguments
    folder = Path(arguments[arguments.index("--mean-nose") + 1]) if named else cache_folder() / MEAN_NOSE.name
    FIGURES.mkdir(exist_ok=True)
    nose = load_anatomy("builtin")
    for regions in nose.regions.values():
        save(surface_sheet(nose, regions), f"regions_builtin_{regions.name}")
    save(view_sheet(nose, nose.region_set("paper"), _looks(None)), "views_builtin")
    mesh, texture = (folder / file.name for file in MEAN_NOSE.files[:2])
    if not (mesh.is_file() and texture.is_file()):
        print("the mean nose is not here: naris fetch mean-nose, or --mean-nose FOLDER")
        return 1
    mean = load_anatomy(mesh)
    save(surface_sheet(mean, mean.region_set("paper")), "regions_mean_nose_paper")
    save(view_sheet(mean, mean.region_set("paper"), _looks(TextureColours.read(texture))), "views_mean_nose")
    return 0


def _looks(texture: TextureColours | None) -> dict[str, Appearance | AppearanceDistribution]:
    """The presets by what stands beside their pictures; those of the paper with its texture where there is one."""
    paper = PAPER if texture is None else PAPER.with_(material=texture)
    return {
        "paper": paper,
        "endoscope": ENDOSCOPE,
        "training\n(drawn at random)": TRAINING_APPEARANCE,
        "unseen\n(drawn at random)": UNSEEN_APPEARANCE,
    }


def view_sheet(
    anatomy: Anatomy, regions: RegionSet, looks: dict[str, Appearance | AppearanceDistribution]
) -> Image.Image:
    """The same views, two of every region, under each look."""
    scene, rng = Scene(anatomy), np.random.default_rng(SEED)
    views = _two_of_each(scene, regions, rng)
    camera = Intrinsics.from_vertical_fov(_VIEW_PX, _VIEW_PX, 60.0)
    rows = {}
    for name, look in looks.items():
        drawn = [look.sample(rng) for _ in range(len(views))] if isinstance(look, AppearanceDistribution) else look
        rgb = render(scene, views.anatomy_T_camera, camera, drawn, want=("rgb",)).rgb
        if rgb is not None:
            rows[name] = rgb
    step = _VIEW_PX + _GAP
    sheet = Image.new("RGB", (_LABEL_PX + step * len(views), _LINE + _GAP + step * len(rows)), _PAPER)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(18)
    for column, region in enumerate(views.region.tolist()):
        if column % 2 == 0:
            pen.text((_LABEL_PX + step * column, 0), regions.names[region], _INK, font)
    for row, (name, pictures) in enumerate(rows.items()):
        top = _LINE + _GAP + step * row
        pen.multiline_text((10, top + _VIEW_PX // 2 - 20), name, _INK, font)
        for column, picture in enumerate(pictures):
            sheet.paste(Image.fromarray(picture), (_LABEL_PX + step * column, top))
    return sheet


def _two_of_each(scene: Scene, regions: RegionSet, rng: np.random.Generator) -> Viewpoints:
    distance = signed_distance(scene.anatomy)
    bank = view_bank(distance, passages_of(scene.anatomy, distance), regions, INSPECTION)
    views = draw_views(scene, bank, 2 * len(regions.names), rng)
    return views[np.argsort(views.region, kind="stable")]


def surface_sheet(anatomy: Anatomy, regions: RegionSet) -> Image.Image:
    """The anatomy from the left, the front and above, its regions in colour, with a legend."""
    colours = region_colours(regions.names)
    left, front, above = (
        draw_surface(anatomy, regions, colours, aspect, 2 * _PX_PER_MM).rgba
        for aspect in (FROM_LEFT, FROM_FRONT, FROM_ABOVE)
    )
    shots = [_halved(shot) for shot in (left, front, above)]
    (w, h), (w2, _), (_, h3) = (shot.size for shot in shots)
    legend_top = _MARGIN + h + _MARGIN
    height = max(legend_top + h3, legend_top + _LINE * (len(regions.names) + 1)) + _MARGIN
    font = ImageFont.load_default(17)
    widest = max(int(font.getlength(name)) for name in regions.names) + 30
    sheet = Image.new("RGB", (_MARGIN * 3 + w + max(w2, widest), height), _PAPER)
    for shot, at in zip(shots, ((0, 0), (w + _MARGIN, 0), (0, h + _MARGIN)), strict=True):
        sheet.paste(shot, (_MARGIN + at[0], _MARGIN + at[1]), shot)
    pen = ImageDraw.Draw(sheet)
    for i, (name, colour) in enumerate(zip(regions.names, colours.tolist(), strict=True)):
        x, y = 2 * _MARGIN + w, legend_top + _LINE * i
        pen.rounded_rectangle((x, y + 3, x + 15, y + 18), 3, tuple(colour))
        pen.text((x + 24, y), name, _INK, font)
    y = legend_top + _LINE * len(regions.names) + 10
    pen.line((2 * _MARGIN + w, y + 16, 2 * _MARGIN + w + 10 * _PX_PER_MM, y + 16), _INK, 3)
    pen.text((2 * _MARGIN + w + 10 * _PX_PER_MM + 10, y + 6), "10 mm", _INK, font)
    return sheet


def _halved(rgba: UInt8[np.ndarray, "h w 4"]) -> Image.Image:
    picture = Image.fromarray(rgba)
    return picture.resize((picture.width // 2, picture.height // 2), Image.Resampling.BOX)


def save(sheet: Image.Image, name: str) -> None:
    """Writes a figure and says so."""
    path = FIGURES / f"{name}.webp"
    sheet.save(path, quality=86, method=6)
    print(f"{path.name}: {sheet.width}×{sheet.height}, {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
