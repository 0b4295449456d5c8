"""Edges of walls as they are drawn on a frame."""

from __future__ import annotations

import numpy as np

from naris.register.look import edges


def test_a_wall_before_nothing_has_an_edge_on_every_side() -> None:
    depth = np.zeros((9, 12))
    depth[2:7, 3:9] = 5.0
    ring = np.zeros(depth.shape, bool)
    ring[2:7, 3:9] = True
    ring[3:6, 4:8] = False
    assert (edges(depth) == ring).all()


def test_a_wall_before_another_has_an_edge_and_slopes_have_none() -> None:
    depth = np.tile(np.linspace(5.0, 6.0, 12), (9, 1))
    assert not edges(depth).any()
    depth[:, 6:] *= 2.0
    assert edges(depth).sum(axis=0).tolist() == [0] * 5 + [9] + [0] * 6
