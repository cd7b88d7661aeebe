"""Reading and comparing pictures; colour spaces, structure, regions, feature networks and video."""

from brushexp.features import NETWORKS, open_backbone
from brushexp.features.base import Backbone, packaged_file, read_tensors
from brushexp.features.distance import Distance, bundled_distance
from brushexp.pictures.abstraction import flatten_picture
from brushexp.pictures.boxes import Crop, boxes, clean_aperture_in, properties_of_film
from brushexp.pictures.color import as_lab, as_picture, hex_of, nearest_ink, palette, recolor, to_lab, to_rgb
from brushexp.pictures.colorimetry import BT709, HIGH_RANGE, decode_srgb, encode_srgb, encoding_of, unless_srgb
from brushexp.pictures.cut_short import has_end
from brushexp.pictures.decode import MOVING, decode_image, open_picture, picture_size, read_declared, read_picture
from brushexp.pictures.focus import sharpness
from brushexp.pictures.folders import picture_suffixes, pictures_of
from brushexp.pictures.kinds import FILM_SUFFIXES
from brushexp.pictures.limits import MAX_PIXELS, open_of_any_size
from brushexp.pictures.load import (
    BRIGHTNESS,
    background_color,
    check_ratio,
    downsample,
    load_cutout,
    load_mask,
    load_picture,
    named_color,
    nearest_files,
    planes_of,
    samples,
    sides_of_picture,
    size_at,
    size_of_picture,
)
from brushexp.pictures.region import Region
from brushexp.pictures.similarity import picture_psnr, psnr_of
from brushexp.pictures.structure import FarStructure, along_edges, sample_at, structure_tensor, worst_of_cells
from brushexp.pictures.video import FAST_START, filming, largest_side

__all__ = [
    "BRIGHTNESS",
    "BT709",
    "FAST_START",
    "FILM_SUFFIXES",
    "HIGH_RANGE",
    "MAX_PIXELS",
    "MOVING",
    "NETWORKS",
    "Backbone",
    "Crop",
    "Distance",
    "FarStructure",
    "Region",
    "along_edges",
    "as_lab",
    "as_picture",
    "background_color",
    "boxes",
    "bundled_distance",
    "check_ratio",
    "clean_aperture_in",
    "decode_image",
    "decode_srgb",
    "downsample",
    "encode_srgb",
    "encoding_of",
    "filming",
    "flatten_picture",
    "has_end",
    "hex_of",
    "largest_side",
    "load_cutout",
    "load_mask",
    "load_picture",
    "named_color",
    "nearest_files",
    "nearest_ink",
    "open_backbone",
    "open_of_any_size",
    "open_picture",
    "packaged_file",
    "palette",
    "picture_psnr",
    "picture_size",
    "picture_suffixes",
    "pictures_of",
    "planes_of",
    "properties_of_film",
    "psnr_of",
    "read_declared",
    "read_picture",
    "read_tensors",
    "recolor",
    "sample_at",
    "samples",
    "sharpness",
    "sides_of_picture",
    "size_at",
    "size_of_picture",
    "structure_tensor",
    "to_lab",
    "to_rgb",
    "unless_srgb",
    "worst_of_cells",
]
