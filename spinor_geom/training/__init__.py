"""Training of complex-valued networks for Plateau's problem: the paper's algorithm, and Levenberg-Marquardt."""

from spinor_geom.training.levenberg_marquardt import LevenbergMarquardt, train_by_levenberg_marquardt
from spinor_geom.training.rmsprop import RMSprop, train_by_rmsprop
from spinor_geom.training.trained import Trained, TrainingStep

__all__ = [
    "LevenbergMarquardt",
    "RMSprop",
    "Trained",
    "TrainingStep",
    "train_by_levenberg_marquardt",
    "train_by_rmsprop",
]
