"""Where was this picture taken? Regions and poses for any picture file, or the honest answer that it cannot be told.

>>> from naris.locate import is_localised, locate              # doctest: +SKIP
>>> (prediction,) = locate([Path("frame.png")], Path("model.safetensors"))  # doctest: +SKIP
>>> prediction.region_name, is_localised(prediction)           # doctest: +SKIP
"""

from naris.core.pictures import read_picture
from naris.locate.answer import Doubt, is_localised, is_strange, locate
from naris.locate.view import VisibleArea, views_of, visible_area

__all__ = ["Doubt", "VisibleArea", "is_localised", "is_strange", "locate", "read_picture", "views_of", "visible_area"]
