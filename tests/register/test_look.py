"""Edges of walls as they are drawn on a frame."""

from __future__ import annotations

import numpy as np

from naris.register.look import edges, levels, overlay


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


def test_a_wall_without_edges_is_drawn_by_lines_of_equal_depth_and_one_with_edges_by_these() -> None:
    frame, slope = np.full((64, 96, 3), 90, np.uint8), np.tile(np.geomspace(4.0, 16.0, 96), (64, 1))
    assert not edges(slope).any()
    at = np.flatnonzero(levels(slope).all(axis=0))
    np.testing.assert_allclose(slope[0, at], np.geomspace(4.0, 16.0, 9)[1:-1], rtol=0.02)
    assert (overlay(frame, slope)[:, at] != 90).any(axis=2).all()
    slope[:, 48:] *= 1.5
    drawn = np.flatnonzero((overlay(frame, slope) != 90).any(axis=(0, 2)))
    assert np.abs(drawn - 47.5).max() < 3


def test_a_flat_wall_and_nothing_have_no_lines_of_equal_depth() -> None:
    for depth in (np.full((9, 12), 5.0), np.zeros((9, 12))):
        assert not levels(depth).any()


def test_lines_are_as_wide_in_large_pictures_as_in_small_ones() -> None:
    shares = []
    for size in (480, 960):
        depth = np.full((size, size), 5.0)
        depth[:, size // 2 :] = 10.0
        drawn = overlay(np.full((size, size, 3), 90, np.uint8), depth)
        shares.append(float((drawn != 90).any(axis=2).mean()))
    assert 0.003 < shares[0] == shares[1] < 0.01


def test_nothing_is_drawn_on_a_stop_and_what_is_dark_within_is_drawn_on() -> None:
    frame = np.full((60, 60, 3), 90, np.uint8)
    y, x = np.mgrid[:60, :60] - 29.5
    stop = np.hypot(x, y) > 28
    frame[stop] = 3
    frame[20:40, :40] = 0  # up to the stop
    depth = np.full((60, 60), 5.0)
    depth[:, 25:] = 10.0
    drawn = (overlay(frame, depth) != frame).any(axis=2)
    assert not drawn[np.hypot(x, y) > 31].any()
    assert drawn[20:40].any(axis=1).all()


def test_a_dark_half_of_a_picture_without_a_stop_is_drawn_on() -> None:
    frame = np.full((60, 60, 3), 90, np.uint8)
    frame[:, :30] = 0
    depth = np.full((60, 60), 5.0)
    depth[:, 15:] = 10.0
    assert (overlay(frame, depth) != frame).any(axis=(1, 2)).all()
