"""How good is a model? Predictions are exported once, then scored as often as one likes.

>>> from naris.evaluate import export, score, summary                      # doctest: +SKIP
>>> said = export(Path("model.safetensors"), dataset, Path("said.npz"))    # doctest: +SKIP
>>> score(said).accuracy                                                   # doctest: +SKIP
"""

from naris.evaluate.predictions import Said, export, read_said
from naris.evaluate.score import PoseScore, Reliability, Score, Summary, score, summary

__all__ = ["PoseScore", "Reliability", "Said", "Score", "Summary", "export", "read_said", "score", "summary"]
