"""Clouds of points registered to a surface by their most likely matches: ICP, IMLP, IMLOP and its like."""
