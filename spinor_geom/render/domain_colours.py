"""Complex numbers as colours."""

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.adapters.contents import srgb_of

# largest chroma in OKLCH, and its slopes at black and at white, so that all hues lie inside sRGB
_CHROMA, _RISE, _FALL = 0.125, 0.25, 0.5
_RINGS = 0.08  # relative step of the lightness at powers of two
# Source: Ottosson, "A perceptual color space for image processing" (2020).
_TO_LMS = np.array(
    [[1.0, 0.3963377774, 0.2158037573], [1.0, -0.1055613458, -0.0638541728], [1.0, -0.0894841775, -1.2914855480]]
)
_TO_RGB = np.array(
    [
        [4.0767416621, -3.3077115913, 0.2309699292],
        [-1.2684380046, 2.6097574011, -0.3413193965],
        [-0.0041960863, -0.7034186147, 1.7076147010],
    ]
)


def domain_colours(value: Complex[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
    """Colours in sRGB, 0 to 1: red for positive numbers, blue-green for negative ones, black at 0, white at ∞.

    The lightness grows with the modulus, with a small step back at every power of two. Equal steps of the argument
    look equally large. NaN is white.
    """
    modulus = np.abs(value)
    with np.errstate(divide="ignore", invalid="ignore"):
        octave = np.log2(modulus)
        share = modulus / (1 + modulus)
        ring = np.where(np.isfinite(octave), octave - np.floor(octave), 0.0)
    share = np.where(np.isinf(modulus), 1.0, share)
    lightness = share**0.7 * (1 - _RINGS * (1 - ring))
    chroma = np.minimum(_CHROMA, np.minimum(_RISE * lightness, _FALL * (1 - lightness)))
    hue = np.angle(value) + np.radians(25.0)  # red
    lab = np.stack([lightness, chroma * np.cos(hue), chroma * np.sin(hue)], axis=-1)
    linear = np.clip((lab @ _TO_LMS.T) ** 3 @ _TO_RGB.T, 0.0, 1.0)
    rgb = srgb_of(linear)
    return np.asarray(np.where(np.isnan(rgb), 1.0, rgb))
