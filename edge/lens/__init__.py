"""A camera's lens: kinds says which models there are, model goes from pixel to ray and back with any of them."""

from edge.lens.kinds import DEFAULT_LENS, LENS_KINDS, LensName, check_lens_name, measured_names
from edge.lens.model import Distorted, LensModel, distort, pixel_to_ray, ray_to_pixel

__all__ = [
    "DEFAULT_LENS",
    "LENS_KINDS",
    "Distorted",
    "LensModel",
    "LensName",
    "check_lens_name",
    "distort",
    "measured_names",
    "pixel_to_ray",
    "ray_to_pixel",
]
