"""Draws the figures of `builtin_nose.md` and writes its parameter table and measured figures between their markers.

    python docs/make_builtin_nose_figures.py [--data ../shared/data] [--tables]

With `--tables`, no figure is drawn anew. The CT sections need SimpleITK and the development data; without them the page
keeps the figures that it has, and this says so. Everything else comes from the package alone.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from scipy import ndimage

from naris.anatomy.builtin import NORMAL_RANGES, NoseParameters, built_in_nose
from naris.anatomy.distance import SignedDistance, signed_distance
from naris.core.anatomy import Anatomy
from naris.core.camera import Intrinsics
from naris.core.pose import Pose
from naris.render.appearance import ENDOSCOPE
from naris.render.scene import Scene, render

matplotlib.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).resolve().parent
FIGURES = HERE / "figures"
PAGE = HERE / "builtin_nose.md"
SECTIONS_Y_MM = (-39, -31, -24, -16, -8, 0, 8, 16, 23, 33)
AREAS_Y_MM = np.arange(-42.0, 26.5, 1.0)
X_MM = np.arange(-22, 22.01, 0.25)
Z_MM = np.arange(-34, 30.01, 0.25)
TIP_Y_MM, CHOANA_Y_MM, FLOOR_Z_MM = -45.0, 27.0, -18.0


@dataclass(frozen=True)
class Placement:
    """Where a nose lies in a CT, in voxels, found by eye: the tip of the nostrils, a choana, the midline, the floor.

    Attributes:
        tilt_deg: how far the nasal floor rises backwards.
    """

    name: str
    image: str
    labels: str | None
    midline_x: float
    tip_y: float
    choana_y: float
    floor_z_at_choana: float
    tilt_deg: float

    def voxels(self, y_mm: float, spacing: tuple[float, float, float]) -> np.ndarray:
        """Voxel coordinates (z, y, x) of the section that lies at the same share of the way from tip to choana."""
        way_mm = (self.choana_y - self.tip_y) * spacing[1]
        along_mm = (y_mm - CHOANA_Y_MM) * way_mm / (CHOANA_Y_MM - TIP_Y_MM)
        x, z = np.meshgrid(X_MM, Z_MM - FLOOR_Z_MM)
        cos, sin = np.cos(np.deg2rad(self.tilt_deg)), np.sin(np.deg2rad(self.tilt_deg))
        y_off, z_off = along_mm * cos - z * sin, along_mm * sin + z * cos
        return np.stack(
            [
                self.floor_z_at_choana + z_off / spacing[2],
                self.choana_y + y_off / spacing[1],
                self.midline_x + x / spacing[0],
            ]
        )


CTS = (
    Placement("NasalSeg P001", "nasalseg-p001/P001_img.nrrd", "nasalseg-p001/P001_seg.nrrd", 77, 5, 128, 18.8, 15.0),
    Placement("ct_head", "ct-head/ct_head.nii.gz", None, 97, 14, 97, 36.6, -5.0),
)

VIEWS = (
    ("left nostril", (7, -38, -24), (0, 0.6, 0.8)),
    ("nasal valve, left", (5, -31, -12), (0, 1, 0.1)),
    ("inferior turbinate, left", (5.5, -25, -9), (0.1, 1, 0.15)),
    ("middle turbinate, left", (6.5, -15, 2), (0.1, 1, 0.1)),
    ("middle meatus, left", (9, -9, 2), (0.25, 1, 0.35)),
    ("towards the olfactory cleft, left", (5.2, -15, 7), (-0.05, 1, 0.3)),
    ("nasal valve, right", (-5, -31, -12), (0, 1, 0.1)),
    ("middle turbinate, right", (-5.5, -15, 2), (-0.1, 1, 0.1)),
    ("floor and inferior turbinate, right", (-4.5, -18, -14), (-0.1, 1, 0)),
    ("choana, left", (4.4, 15, -8), (0.12, 1, 0)),
    ("torus and Eustachian opening, left", (4, 26, -7), (0.75, 1, 0.05)),
    ("choanae, from behind", (0, 42.5, -7), (0, -1, 0)),
)


def main() -> int:
    """Draws what can be drawn here."""
    parser = argparse.ArgumentParser(description=__doc__)
    default = os.environ.get("NARIS_TEST_DATA") or HERE.parent.parent / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(default), help="folder with the CTs")
    parser.add_argument("--tables", action="store_true", help="draw no figure")
    arguments = parser.parse_args()
    nose = built_in_nose()
    distance = signed_distance(nose)
    compared = None if arguments.tables else draw(nose, distance, arguments.data)
    page = PAGE.read_text()
    if compared is not None:
        page = between(page, "compared", compared)
    page = between(page, "parameters", parameter_table())
    page = between(page, "measured", measured(nose, distance))
    PAGE.write_text(page)
    return 0


def draw(nose: Anatomy, distance: SignedDistance, data: Path) -> str | None:
    """Every figure that can be drawn here; Markdown of the comparison with a CT, None without the CTs."""
    FIGURES.mkdir(exist_ok=True)
    draw_views(nose)
    draw_regions(nose, distance)
    cts = [read_ct(place, data) for place in CTS]
    missing = [place.name for place, ct in zip(CTS, cts, strict=True) if ct is None]
    if missing:
        print(f"no CT data for {', '.join(missing)}: the section figures stay as they are", file=sys.stderr)
        return None
    draw_sections(distance, cts)
    return draw_areas(distance, cts[0])


def between(page: str, name: str, text: str) -> str:
    """The page with what stands between its markers replaced."""
    begin, end = f"<!-- {name}: generated -->\n", f"<!-- {name}: end -->"
    head, rest = page.split(begin)
    return head + begin + text + end + rest.split(end, 1)[1]


def parameter_table() -> str:
    """Markdown, from the metadata of the parameters."""
    rows = ["| parameter | default | normal in adults | what is measured | source |", "|---|---|---|---|---|"]
    default = NoseParameters()
    for name, normal in NORMAL_RANGES.items():
        value = f"{getattr(default, name):g} {normal.unit}"
        rows.append(f"| `{name}` | {value} | {normal.low:g} to {normal.high:g} | {normal.meaning} | {normal.source} |")
    return "\n".join(rows) + "\n"


def measured(nose: Anatomy, distance: SignedDistance) -> str:
    """Markdown, measured on the default nose."""
    a, b, c = (nose.vertices_mm[nose.faces[:, i]] for i in range(3))
    volume_ml = float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6000
    edges = np.unique(np.sort(nose.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    genus = 1 - (len(nose.vertices_mm) - len(edges) + len(nose.faces)) // 2
    lines = ["| measured on the default nose | |", "|---|---|"]
    lines.append(f"| faces, vertices | {len(nose.faces):,}, {len(nose.vertices_mm):,} |")
    lines.append(f"| genus of the surface | {genus} |")
    lines.append(f"| enclosed air (nasopharynx included) | {volume_ml:.1f} ml |")
    for side, sign in (("left", 1), ("right", -1)):
        areas = [section_area_mm2(distance, y, sign) for y in np.arange(-32.0, -20.0, 0.5)]
        at = -32.0 + 0.5 * int(np.argmin(areas))
        lines.append(
            f"| least coronal section between sill and turbinate, {side} | {min(areas):.0f} mm² (y = {at:g}) |"
        )
    for passage in nose.passages:
        # With as many digits as `naris anatomy builtin --json` has, so that a reader finds the very numbers.
        room = f"{passage.clearance_mm.min():.2f}–{passage.clearance_mm.max():.2f} mm"
        lines.append(f"| passage `{passage.name}` | {passage.length_mm:.0f} mm, from its middle to the wall {room} |")
    return "\n".join(lines) + "\n"


def air(distance: SignedDistance, y_mm: float) -> np.ndarray:
    """Signed distance (mm) on one coronal section, (z, x)."""
    x, z = np.meshgrid(X_MM, Z_MM)
    return distance(np.stack([x, np.full_like(x, y_mm), z], axis=-1))


def section_area_mm2(distance: SignedDistance, y_mm: float, sign: int) -> float:
    """The coronal section of the air on one side (sign of x)."""
    inside = air(distance, y_mm)[:, sign * X_MM > 0] > 0
    return float(inside.sum()) * (X_MM[1] - X_MM[0]) * (Z_MM[1] - Z_MM[0])


def read_ct(place: Placement, data: Path) -> tuple[Placement, np.ndarray, np.ndarray | None, tuple] | None:
    """Grey values and labels (z, y, x) with the spacing, or None where the file or its reader is absent."""
    try:
        import SimpleITK
    except ImportError:
        return None
    if not (data / place.image).exists():
        return None
    image = SimpleITK.ReadImage(str(data / place.image))
    labels = None
    if place.labels is not None:
        labels = SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(data / place.labels)))
    return place, SimpleITK.GetArrayFromImage(image).astype(np.float32), labels, image.GetSpacing()


def sampled(volume: np.ndarray, where: np.ndarray, order: int) -> np.ndarray:
    """A volume (z, y, x) at voxel coordinates."""
    return ndimage.map_coordinates(volume, where, order=order, mode="constant", cval=float(volume.min()))


def draw_sections(distance: SignedDistance, cts: list) -> None:
    """Coronal sections of the built-in nose above those of the CTs."""
    extent = (X_MM[0], X_MM[-1], Z_MM[0], Z_MM[-1])
    figure, axes = plt.subplots(3, len(SECTIONS_Y_MM), figsize=(15, 7.0))
    for column, y in enumerate(SECTIONS_Y_MM):
        grey = np.clip(-air(distance, y) / 0.5, -1, 1) * 0.28 + 0.30
        axes[0, column].imshow(grey, cmap="gray", vmin=0, vmax=1, origin="lower", extent=extent)
        axes[0, column].set_title(f"y = {y} mm", fontsize=9)
        for row, (place, volume, labels, spacing) in enumerate(cts, start=1):
            where = place.voxels(y, spacing)
            ax = axes[row, column]
            ax.imshow(sampled(volume, where, 1), cmap="gray", vmin=-1000, vmax=900, origin="lower", extent=extent)
            if labels is not None:
                nose = sampled(np.isin(labels, (3, 4, 5)).astype(np.float32), where, 1)
                ax.contour(X_MM, Z_MM, nose, [0.5], colors="#39c5d8", linewidths=0.7)
    for ax in axes.ravel():
        ax.set_xticks([])
        ax.set_yticks([])
    for ax, name in zip(axes[:, 0], ("built-in nose", *(place.name for place, *_ in cts)), strict=True):
        ax.set_ylabel(name, fontsize=10)
    axes[0, 0].plot([-20, -10], [-31, -31], color="white", lw=2)
    axes[0, 0].text(-15, -29, "10 mm", color="white", fontsize=7, ha="center")
    save(figure, "builtin_nose_sections.jpg", 95)


def draw_areas(distance: SignedDistance, ct: tuple) -> str:
    """The cross-section of each side along the nose, beside that of the labelled CT; Markdown with the medians."""
    behind = AREAS_Y_MM >= 0
    lines = [
        "| median coronal section between the turbinates (y ≥ 0) | built-in nose | NasalSeg P001 |",
        "|---|---|---|",
    ]
    place, _, labels, spacing = ct
    figure, ax = plt.subplots(figsize=(7.5, 3.4))
    for sign, name, style in ((1, "left", "-"), (-1, "right", "--")):
        ours = [section_area_mm2(distance, y, sign) for y in AREAS_Y_MM]
        ax.plot(AREAS_Y_MM, ours, style, color="#c0392b", label=f"built-in nose, {name}")
        label = 4 if sign > 0 else 3
        pixel_mm2 = (X_MM[1] - X_MM[0]) * (Z_MM[1] - Z_MM[0])
        real = [
            (sampled((labels == label).astype(np.float32), place.voxels(y, spacing), 1) > 0.5).sum() * pixel_mm2
            for y in AREAS_Y_MM
        ]
        ax.plot(AREAS_Y_MM, real, style, color="#2c7fb8", label=f"NasalSeg P001, {name}")
        medians = [np.median(np.asarray(areas)[behind]) for areas in (ours, real)]
        lines.append(f"| {name} | {medians[0]:.0f} mm² | {medians[1]:.0f} mm² |")
    ax.set_xlabel("y of the built-in nose (mm), nostril to choana")
    ax.set_ylabel("coronal section of the air (mm²)")
    ax.legend(frameon=False, fontsize=8)
    ax.spines[["top", "right"]].set_visible(False)
    save(figure, "builtin_nose_areas.png", 90)
    return "\n".join(lines) + "\n"


def draw_views(nose: Anatomy) -> None:
    """Endoscopic pictures along both sides."""
    position, forward = (np.array([view[k] for view in VIEWS], dtype=float) for k in (1, 2))
    poses = Pose.look(position, forward, np.array([0.0, 0.0, 1.0]), nose.frame)
    pictures = render(Scene(nose), poses, Intrinsics.from_vertical_fov(420, 420, 80), ENDOSCOPE, want=("rgb",)).rgb
    figure, axes = plt.subplots(2, 6, figsize=(15, 5.6))
    for ax, (name, *_), picture in zip(axes.ravel(), VIEWS, pictures, strict=True):
        ax.imshow(picture)
        ax.set_title(name, fontsize=9)
        ax.axis("off")
    save(figure, "builtin_nose_views.jpg", 80)


def draw_regions(nose: Anatomy, distance: SignedDistance) -> None:
    """The anatomical regions in two sagittal and two coronal sections, with the passages of the left side."""
    regions = nose.regions["anatomical"]
    colours = plt.get_cmap("tab20")(np.arange(len(regions.names)))
    y_mm = np.arange(-48, 52, 0.4)
    figure, axes = plt.subplots(1, 4, figsize=(15, 4.4), width_ratios=(100, 100, 44, 44))
    for ax, x in zip(axes[:2], (4.0, 10.0), strict=True):
        y, z = np.meshgrid(y_mm, Z_MM)
        _paint(ax, np.stack([np.full_like(y, x), y, z], axis=-1), distance, regions, colours)
        ax.set_title(f"x = {x:g} mm (left)", fontsize=9)
    for ax, y0 in zip(axes[2:], (-26.0, 2.0), strict=True):
        x, z = np.meshgrid(X_MM, Z_MM)
        _paint(ax, np.stack([x, np.full_like(x, y0), z], axis=-1), distance, regions, colours)
        ax.set_title(f"y = {y0:g} mm", fontsize=9)
    for passage in nose.passages:
        if passage.name.startswith("left"):
            end = passage.points_mm[-1, 1:] - [0, 4 * passage.name.endswith("septal")]
            axes[0].plot(passage.points_mm[:, 1], passage.points_mm[:, 2], lw=1, color="black")
            axes[0].annotate(passage.name, end, fontsize=7)
    handles = [plt.Rectangle((0, 0), 1, 1, color=c) for c in colours]
    figure.legend(handles, regions.names, ncol=5, fontsize=7, loc="lower center", frameon=False)
    figure.subplots_adjust(bottom=0.22)
    save(figure, "builtin_nose_regions.png", 80, tight=False)


def _paint(ax: plt.Axes, points: np.ndarray, distance: SignedDistance, regions: object, colours: np.ndarray) -> None:
    across = points[..., 1] if np.ptp(points[..., 1]) else points[..., 0]
    picture = np.ones((*points.shape[:2], 3))
    inside = distance(points) > 0
    picture[inside] = colours[regions.label(points)[inside]][:, :3]  # type: ignore[attr-defined]
    ax.imshow(picture, origin="lower", extent=(across.min(), across.max(), Z_MM[0], Z_MM[-1]))
    ax.contour(across[0], Z_MM, distance(points), [0], colors="0.3", linewidths=0.5)


def save(figure: plt.Figure, name: str, dpi: int, tight: bool = True) -> None:
    """Writes a figure and refuses one that weighs more than a page should carry."""
    if tight:
        figure.tight_layout(pad=0.4)
    figure.savefig(FIGURES / name, dpi=dpi, **({"pil_kwargs": {"quality": 86}} if name.endswith("jpg") else {}))
    plt.close(figure)
    size = (FIGURES / name).stat().st_size
    print(f"{name}: {size // 1024} KiB")
    if size > 300 * 1024:
        raise SystemExit(f"{name} is larger than 300 KiB: lower its resolution")


if __name__ == "__main__":
    raise SystemExit(main())
