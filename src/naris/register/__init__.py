"""The registration: from what a camera saw to its pose in the anatomy, with a confidence, or none."""
