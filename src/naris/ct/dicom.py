"""CT series from folders of DICOM files, nested, mixed and unsorted as they come.

Geometry is read from the header of every image and checked by `naris.ct.slices`; which images there are, by
`naris.ct.series`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from naris.core.progress import SILENT, Progress
from naris.core.volume import Volume
from naris.ct.continuity import check_continuity
from naris.ct.pixels import hu_of, hu_of_all
from naris.ct.resample import even, upright
from naris.ct.sameness import check_one_scan
from naris.ct.scan import MOST_VOXELS, Finding, Scan
from naris.ct.series import Image, Series, contents_of
from naris.ct.slices import FEWEST, SAME_DIRECTION_RAD, SAME_PLACE_MM, Stack, stacked
from naris.errors import ScanError

_STRAY = 0.1  # share of a series' images in other orientations that may be left out as stray localisers
_WIDEST_MM = 3.0  # gap between slices that linear interpolation may bridge


def read_dicom(folder: Path, series: str | None = None, progress: Progress = SILENT) -> Scan:
    """The CT of a folder.

    Args:
        folder: with DICOM files in it or below it; or one multi-frame file.
        series: the key or the number of one of its series, needed where several would do.
        progress: told of headers and slices.

    Raises:
        ScanError: if there is no CT, several would do, or its geometry is incomplete or contradicts itself.
    """
    contents = contents_of(folder, progress)
    chosen = _chosen(contents.series, series, folder)
    findings = [*_strange(contents.strange), *_others(contents.series, chosen)]
    if chosen.localisers:
        findings.append(Finding("localisers", f"{chosen.localisers} localiser images were left out"))
    images = _without_copies(_of_one_orientation(chosen, findings), findings)
    stack = stacked([image.plane for image in images])
    _check_gaps(stack, images)
    ordered = [images[number] for number in stack.order]
    findings += check_one_scan(ordered, stack)
    hu = hu_of_all(ordered, progress)
    findings += check_continuity(hu, told=lambda k: ordered[k].path.name)
    if chosen.inverted:
        findings.append(Finding("monochrome1", "MONOCHROME1: shown inverted, the values are read as they are"))
    slice_mm = stack.step_mm
    if not stack.is_even:
        low, high = stack.gaps_mm.min(), stack.gaps_mm.max()
        text = f"slices {low:.2f} to {high:.2f} mm apart were resampled at {stack.step_mm:.2f} mm"
        findings.append(Finding("uneven", text, "warning"))
        hu, stack = even(hu, stack)
    volume = Volume(hu, stack.frame_T_index())
    if not stack.is_upright:
        text = f"the gantry was tilted by {stack.tilt_deg:.1f}°; the scan was resampled at right angles"
        findings.append(Finding("tilt", text, "warning"))
        volume = upright(volume)
    return Scan(volume, "DICOM", slice_mm, tuple(findings))


def _strange(paths: Sequence[Path]) -> tuple[Finding, ...]:
    if not paths:
        return ()
    text = f"{paths[0].name} is no DICOM and was left out: is it a slice that breaks off?"
    if len(paths) > 1:
        text = f"{len(paths)} files are no DICOM and were left out, such as {paths[0].name}: are slices among them?"
    return (Finding("no dicom", text, "warning"),)


def _others(found: Sequence[Series], chosen: Series) -> tuple[Finding, ...]:
    others = [one.told() for one in found if one is not chosen]
    if not others:
        return ()
    told = f"{len(others)} other series, such as" if len(others) > 1 else "another series,"
    return (Finding("other series", f"{told} {others[0]}: left out"),)


def _chosen(found: Sequence[Series], wanted: str | None, folder: Path) -> Series:
    listed = "; ".join(one.told() for one in found[:8])
    if wanted is not None:
        matching = [one for one in found if wanted in (one.key, str(one.number))]
        if len(matching) != 1:
            raise ScanError(
                f"one of the series in {folder}", repr(wanted), f"name one of those by its letters: {listed}"
            )
        usable = matching
    else:
        usable = [one for one in found if one.modality in ("CT", "") and len(one.images) >= FEWEST]
        if not usable:
            raise ScanError(f"a CT series of {FEWEST} images or more in {folder}", listed, "give the folder of a CT")
        if len(usable) > 1:
            raise ScanError(f"one CT series in {folder}", f"{len(usable)} ({listed})", "name one of them with --series")
    (series,) = usable
    if series.modality not in ("CT", ""):
        raise ScanError("a CT", f"modality {series.modality}", "give a CT: its values are Hounsfield units")
    return series


def _of_one_orientation(series: Series, findings: list[Finding]) -> tuple[Image, ...]:
    """The images of the usual orientation; a few others are stray localisers, many are another scan."""
    groups: list[list[Image]] = []
    for image in series.images:
        for group in groups:
            if image.plane.turned_rad(group[0].plane) <= SAME_DIRECTION_RAD:
                group.append(image)
                break
        else:
            groups.append([image])
    groups.sort(key=len, reverse=True)
    others = sum(len(group) for group in groups[1:])
    if others > _STRAY * len(series.images):
        raise ScanError(
            "a series in one orientation",
            f"{len(groups)} of {', '.join(str(len(group)) for group in groups[:5])} images",
            "give each orientation as a series of its own",
        )
    if others:
        text = "1 image in another orientation was left out"
        if others > 1:
            text = f"{others} images in other orientations were left out"
        findings.append(Finding("stray", text, "warning"))
    return tuple(groups[0])


def _without_copies(images: Sequence[Image], findings: list[Finding]) -> list[Image]:
    """Images in the place of another left out where their pixels are the same; else they are two scans in one.

    Raises:
        ScanError: if two different images claim one place.
    """
    normal = images[0].plane.normal
    depth = np.array([image.plane.position_mm @ normal for image in images])
    kept: list[Image] = []
    last = -np.inf
    copies = 0
    for number in np.argsort(depth, kind="stable"):
        image = images[number]
        if depth[number] - last > SAME_PLACE_MM:
            kept.append(image)
            last = depth[number]
        elif np.array_equal(hu_of(image), hu_of(kept[-1])):
            copies += 1
        else:
            raise ScanError(
                "one image in each place",
                f"different ones, such as {image.path.name} and {kept[-1].path.name}",
                "separate the two scans that are mixed here",
            )
    if copies:
        told = "1 copy of a slice was" if copies == 1 else f"{copies} copies of slices were"
        findings.append(Finding("copies", f"{told} left out"))
    return kept


def _check_gaps(stack: Stack, images: Sequence[Image]) -> None:
    if stack.slices_missing:
        first = int(stack.missing[0])
        before, after = (images[stack.order[first + k]].path.name for k in (0, 1))
        raise ScanError(
            f"slices every {stack.step_mm:.3g} mm",
            f"{stack.slices_missing} missing, the first between {before} and {after}",
            "give the whole series",
        )
    if not stack.is_even and stack.gaps_mm.max() > _WIDEST_MM:
        raise ScanError(
            f"slices at equal distances, or nowhere more than {_WIDEST_MM} mm apart",
            f"{stack.gaps_mm.min():.3g} to {stack.gaps_mm.max():.3g} mm",
            "give a thinner reconstruction",
        )
    voxels = len(images) * images[0].plane.shape[0] * images[0].plane.shape[1]
    if voxels > MOST_VOXELS:
        raise ScanError(f"a scan of at most {MOST_VOXELS:,} voxels", f"{voxels:,}", "crop it or take fewer slices")
