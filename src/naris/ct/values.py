"""Whether the values of a scan can be Hounsfield units of a head.

Air is near −1000 HU, soft tissue near 50, bone above 300 and not where the head begins. An MR may have some of these by
chance, seldom all: its bone is dark, its fat is bright and lies below the skin. Two real scans have 16 and 22 % of
their tissue in bone, simulated ones 2.4 % or more; soft tissue is most often at 30 to 40 HU, below the skin it is at
−31 to 41. A scan without air or without soft tissue is refused. All else is told, since phantoms have no bone and
cone-beam CTs may be off by some hundred HU.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int, Int16
from scipy.ndimage import gaussian_filter1d

from naris.core.volume import Volume
from naris.ct.scan import Finding, Scan
from naris.ct.size import check_voxels
from naris.errors import ScanError

_SAMPLES = 2_000_000
_AIR_HU = (-1400, -650)
_SOFT_HU = (-150, 250)
_MUCH = 0.02  # share of the voxels that are air, and that are soft tissue, in nearly every scan of a head
_CLEARLY = 3.0  # more soft tissue than in the values as they are, where bone is there, too
_INTERCEPT_HU = -1024
_BELOW_AIR_HU = (-1750, -1400)  # between what stands beyond the picture and air, nothing is; fat is, shifted
_LEAST = 0.002  # share of the voxels of a head that are air, and that are soft tissue, at the very least
_TISSUE_HU, _FAT_HU, _BONE_HU = -500, -50, 300
_LEAST_BONE = 0.003  # share of the tissue; flat panels and blur leave more than that
_USUAL_AIR_HU, _USUAL_SOFT_HU = (-1100, -900), (0, 120)
_BIN_HU = 10
_SKIN_MM = (1.5, 4.0)
_BRIGHT_SKIN_HU = 150
_FEWEST_SKIN = 1000


def check_values(scan: Scan) -> tuple[Finding, ...]:
    """See that a scan has air and soft tissue where Hounsfield units put them; warnings of what else is unlike a CT.

    Raises:
        ScanError: if it has one value only, or has not: it is no CT, or its rescale was lost; or if its voxels are of
            no size that scanners make.
    """
    check_voxels(scan.volume)
    hu = scan.volume.hu
    step = max(int(np.cbrt(hu.size / _SAMPLES)), 1)
    values = hu[::step, ::step, ::step]
    _check_rescaled(values)
    _check_air_and_soft_tissue(values)
    tissue = values[values > _TISSUE_HU]
    return (*_off(values), *_boneless(tissue), *_bright(below_skin_hu(scan.volume)))


def _check_rescaled(values: Int16[np.ndarray, "ni nj nk"]) -> None:
    """Refuses values that are those of a CT but for the rescale intercept, which files forget or apply twice."""
    lost = float(np.mean(values < _TISSUE_HU)) < _LEAST
    between = float(np.mean((values >= _BELOW_AIR_HU[0]) & (values <= _BELOW_AIR_HU[1])))
    if not lost and between < _LEAST:
        return
    offset = _INTERCEPT_HU if not lost else -_INTERCEPT_HU
    mended = values.astype(np.int32) - offset
    if not _usual(mended) or (not lost and _shares(mended)[1] < _CLEARLY * _shares(values)[1]):
        return
    seems, todo = ("to be lost", "subtract") if lost else ("to be applied twice", "add")
    raise ScanError(
        "air near −1000 HU and soft tissue near 50 in a CT",
        f"air at about {_signed(offset - 1000)} HU and soft tissue at about {_signed(offset + 50)}",
        f"the rescale intercept seems {seems}: {todo} {abs(offset)}, or export the scan anew",
    )


def _usual(values: Int[np.ndarray, "ni nj nk"]) -> bool:
    """Whether much is where air and soft tissue are in a CT."""
    air, soft = _shares(values)
    if min(air, soft) < _MUCH:
        return False
    air_hu, soft_hu = _modes(values)
    return _USUAL_AIR_HU[0] <= air_hu <= _USUAL_AIR_HU[1] and _USUAL_SOFT_HU[0] <= soft_hu <= _USUAL_SOFT_HU[1]


def _shares(values: Int[np.ndarray, "ni nj nk"]) -> tuple[float, float]:
    """Of voxels where air is and where soft tissue is."""
    air, soft = (float(np.mean((values >= a) & (values <= b))) for a, b in (_AIR_HU, _SOFT_HU))
    return air, soft


def _modes(values: Int[np.ndarray, "ni nj nk"]) -> tuple[float, float]:
    """Where most air and most soft tissue is, in HU."""
    air_hu = _mode(values[(values >= _AIR_HU[0]) & (values <= _TISSUE_HU)])
    return air_hu, _mode(values[values > _FAT_HU])  # some heads have more fat than anything else


def _signed(hu: float) -> str:
    return f"{hu:.0f}".replace("-", "−")


def _check_air_and_soft_tissue(values: Int16[np.ndarray, "ni nj nk"]) -> None:
    low, high = int(values.min()), int(values.max())
    if low == high:
        raise ScanError("a CT of a head", f"a volume of {low} HU throughout", "check the scan")
    air, soft = _shares(values)
    if air >= _LEAST and soft >= _LEAST:
        return
    todo = "give a CT in Hounsfield units"
    if float(np.mean(values < _TISSUE_HU)) < _LEAST:
        todo += ": hardly any value is as low as air, as in an MR or as if the rescale intercept were lost"
    raise ScanError(
        "both air (about −1000 HU) and soft tissue (about 50 HU) in a CT",
        f"{100 * air:.1f} % and {100 * soft:.1f} % of voxels there, values {low} to {high}",
        todo,
    )


def below_skin_hu(volume: Volume) -> float | None:
    """The usual mean of 1.5 to 4 mm behind where lines of voxels first meet tissue from the air; None if few do."""
    found: list[Float[np.ndarray, "n"]] = []
    for axis in range(3):
        near, far = (max(round(mm / float(volume.spacing_mm[axis])), 1) for mm in _SKIN_MM)
        for lines in (np.moveaxis(volume.hu, axis, -1), np.moveaxis(volume.hu, axis, -1)[..., ::-1]):
            thinned = lines[::2, ::2]
            solid = thinned > _TISSUE_HU
            first = solid.argmax(axis=-1)
            # A line that begins in tissue is cut off there and has no skin.
            met = (first > 0) & (first + far < thinned.shape[-1])
            where = first[met][:, None] + np.arange(near, far + 1)
            found.append(np.take_along_axis(thinned[met], where, axis=-1).mean(axis=-1))
    all_found = np.concatenate(found)
    return float(np.median(all_found)) if len(all_found) >= _FEWEST_SKIN else None


def _off(values: Int16[np.ndarray, "ni nj nk"]) -> tuple[Finding, ...]:
    air_hu, soft_hu = _modes(values)
    if _USUAL_AIR_HU[0] <= air_hu <= _USUAL_AIR_HU[1] and _USUAL_SOFT_HU[0] <= soft_hu <= _USUAL_SOFT_HU[1]:
        return ()
    text = f"air is at {air_hu:.0f} HU and soft tissue at {soft_hu:.0f}, not near −1000 and 50: "
    text += "Hounsfield units may be off, as in a cone-beam CT, or this is no CT"
    return (Finding("hounsfield", text, "warning"),)


def _boneless(tissue: Int16[np.ndarray, "n"]) -> tuple[Finding, ...]:
    share = float(np.mean(tissue > _BONE_HU))
    if share >= _LEAST_BONE:
        return ()
    text = f"{100 * share:.1f} % of the tissue is bone (above {_BONE_HU} HU): this may be an MR or a phantom and no CT"
    return (Finding("no bone", text, "warning"),)


def _bright(skin_hu: float | None) -> tuple[Finding, ...]:
    if skin_hu is None or skin_hu <= _BRIGHT_SKIN_HU:
        return ()
    text = f"values below the skin are near {skin_hu:.0f} HU: soft tissue is not as bright, fat in an MR is"
    return (Finding("bright skin", text, "warning"),)


def _mode(values: Int[np.ndarray, "n"]) -> float:
    """The most frequent value, of a smoothed histogram."""
    counts, edges = np.histogram(values, np.arange(_AIR_HU[0], 3000 + _BIN_HU, _BIN_HU))
    return float(edges[gaussian_filter1d(counts.astype(np.float64), 2).argmax()] + _BIN_HU / 2)
