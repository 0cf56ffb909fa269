"""torch, for the modules that cannot do without it. Importing this one without torch raises a MissingPackageError."""

from spinor_geom.errors import require

require("torch", extra="torch")

import torch as torch  # noqa: E402
from torch import Tensor as Tensor  # noqa: E402
