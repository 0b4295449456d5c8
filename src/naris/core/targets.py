"""Target registration error: how far a found pose puts the places that matter from where they are.

A surgeon needs what is in front of the scope to be where it is drawn, not a camera pose; an angle that does no harm
3 mm ahead is 2 mm off at 60 mm.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from naris.core.pose import Pose
from naris.errors import PoseError

CENTRE_DEG = 20.0
"""Around the optical axis: the part of the wall that somebody who works there looks at."""


def target_errors_mm(found: Pose, true: Pose, targets_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """How far each target lies from where the found pose puts it, |found · true⁻¹ · p − p|.

    That of J. Fitzpatrick and J. West (IEEE Trans. Med. Imaging 20, 2001), "The distribution of target registration
    error in rigid-body point-based registration", the target being fixed to the camera by the true pose.

    Args:
        found, true: `anatomy_T_camera`.
        targets_mm: in the frame of the anatomy.

    Raises:
        PoseError: if the poses are not between the same frames.
    """
    if (found.target, found.source) != (true.target, true.source):
        raise PoseError(
            f"a found pose {true.target}_T_{true.source}", f"{found.target}_T_{found.source}", "bring them to one frame"
        )
    return np.asarray(np.linalg.norm((found @ true.inverse()).apply(targets_mm) - targets_mm, axis=-1))


def expected_errors_mm(
    found: Pose, covariance: Float[np.ndarray, "6 6"], targets_mm: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n"]:
    """How far each target is off if a pose is off as its covariance says: the root of the mean square.

    To first order (Fitzpatrick and West 2001): a twist (t, ω) in the camera moves what it has at q by t + ω × q, so
    the mean square is the trace of J Σ Jᵀ with J = (I, −[q]×).

    Args:
        found: `anatomy_T_camera`.
        covariance: Σ of the twist in the camera, mm and rad (`naris.core.results.Registration.covariance`).
        targets_mm: in the frame of the anatomy.
    """
    x, y, z = np.moveaxis(found.inverse().apply(targets_mm), -1, 0)
    none = np.zeros_like(x)
    turned = np.stack([none, z, -y, -z, none, x, y, -x, none], axis=-1).reshape(-1, 3, 3)
    jacobian = np.concatenate([np.broadcast_to(np.eye(3), turned.shape), turned], axis=2)
    return np.asarray(np.sqrt(np.einsum("nij,jk,nik->n", jacobian, covariance, jacobian)))


def wall_ahead_mm(
    true: Pose, ranges_mm: Float[np.ndarray, "h w"], rays: Float[np.ndarray, "h w 3"], within_deg: float = CENTRE_DEG
) -> Float[np.ndarray, "n 3"]:
    """The points of the wall that the camera sees around its axis, in the anatomy; all that it sees if there are none.

    Args:
        true: `anatomy_T_camera`.
        ranges_mm: along unit rays, not finite where nothing was met.
        rays: in the camera.
        within_deg: of the optical axis.
    """
    met = np.isfinite(ranges_mm) & (ranges_mm > 0)
    ahead = met & (rays[..., 2] >= np.cos(np.deg2rad(within_deg)))
    chosen = ahead if ahead.any() else met
    return true.apply(rays[chosen] * ranges_mm[chosen][:, None])
