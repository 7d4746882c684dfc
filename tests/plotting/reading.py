"""Figures of the pages, read back as the elements they are made of."""

import base64
import io
from xml.etree import ElementTree as ET

import numpy as np
from PIL import Image

SVG = "{http://www.w3.org/2000/svg}"


def parsed(figure: str) -> ET.Element:
    """The figure as a tree; it must be well-formed."""
    return ET.fromstring(figure)


def of_class(root: ET.Element, name: str) -> list[ET.Element]:
    """Elements that have all of these classes."""
    wanted = set(name.split())
    return [one for one in root.iter() if wanted <= set(one.get("class", "").split())]


def texts(root: ET.Element, name: str) -> list[str]:
    """Words of the elements of a class."""
    return ["".join(one.itertext()) for one in of_class(root, name)]


def points(path: ET.Element) -> np.ndarray:
    """Corners of a path, shape (N, 2)."""
    pairs = path.get("d", "").replace("Z", "").replace("M", "L").split("L")
    return np.array([[float(one) for one in pair.split()] for pair in pairs if pair])


def image(picture: ET.Element) -> np.ndarray:
    """Colours of a picture inside a figure, shape (rows, columns, 4)."""
    data = picture.get("href", "").partition("base64,")[2]
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGBA")).astype(int)
