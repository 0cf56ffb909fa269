"""Whether two pictures show the same, independently of size, colour table and machine."""

from pathlib import Path

import numpy as np
from PIL import Image

# of one picture drawn on two machines; different ones are many times as far apart
SAME = 0.01


def difference(one, other):
    """Mean difference of the grey values of both, blurred to 120 × 60 points, per range."""
    images = [Image.open(picture) if isinstance(picture, Path) else picture for picture in (one, other)]
    small = [np.asarray(image.convert("L").resize((120, 60), Image.Resampling.BOX), float) for image in images]
    return float(np.abs(small[0] - small[1]).mean() / 255)
