"""Networks that say where a camera is: the paper's two-layer network, a compact one of our own, and their files."""
