"""A user's own folder of YOLO-format labels into training material.

`images/**.jpg|png` with `labels/**.txt` beside it (`class cx cy width height`, fractions of the image) and a
`data.yaml` or `classes.txt` that names the classes. Such folders are made for nets that see one picture. Ours sees
three, so say how far apart the pictures are: with `step` 3, images k, k - 3 and k - 6 in order of name are a stack.
With `step` 0 they are stills; what can be lifted off a plain sky is set in motion by the composer.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import yaml

from edge.common.errors import SourceError
from tools.train.footage import Loose, Material, take
from tools.train.patches import CLASSES, Grey

IMAGES: Final = {".jpg", ".jpeg", ".png", ".bmp"}
SAME_AS: Final = {
    "uav": "drone",
    "quadcopter": "drone",
    "multirotor": "drone",
    "airplane": "aeroplane",
    "plane": "aeroplane",
    "aircraft": "aeroplane",
}


def read_names(folder: Path) -> list[str]:
    """Class names of a folder, ours where they mean the same. Raises SourceError if it has none."""
    if (folder / "classes.txt").is_file():
        names = (folder / "classes.txt").read_text().split("\n")
    elif (folder / "data.yaml").is_file():
        names = _yaml_names(folder / "data.yaml")
    else:
        names = []
    names = [name.strip().lower() for name in names if name.strip()]
    if not names:
        raise SourceError("no class names", where=str(folder), action="add classes.txt, one name a line, or data.yaml")
    return [SAME_AS.get(name, name) for name in names]


def _yaml_names(file: Path) -> list[str]:
    """The `names` of a data.yaml: a list, or a table by number. Raises SourceError if it is no YAML."""
    try:
        tree = yaml.safe_load(file.read_text())
    except yaml.YAMLError as error:
        raise SourceError(f"is not YAML ({error})", where=str(file), action="correct it, or add classes.txt") from error
    names = tree.get("names") or [] if isinstance(tree, dict) else []
    ordered = [names[number] for number in sorted(names)] if isinstance(names, dict) else names
    return [str(name) for name in ordered]


def all_classes(names: list[str]) -> tuple[str, ...]:
    """Our classes and then those of the folder that we have not."""
    return CLASSES + tuple(name for name in dict.fromkeys(names) if name not in CLASSES)


def read_folder(folder: Path, step: int, random: np.random.Generator) -> Material:
    """Training material of a YOLO folder."""
    material = Material()
    names = read_names(folder)
    classes = all_classes(names)
    for stack, labels in _pictures(folder, step):
        found = []
        for number, cx, cy, width, height in labels:
            if not 0 <= int(number) < len(names):
                raise SourceError(
                    f"class {number:.0f} has no name", where=str(folder), action="name every class in classes.txt"
                )
            rows, cols = stack[0].shape
            box = ((cx - width / 2) * cols, (cy - height / 2) * rows, width * cols, height * rows)
            found.append(Loose((box,) * 3, classes.index(names[int(number)])))
        take(material, stack, found, random)
    if not material.patches and not material.cutouts:
        raise SourceError("no labelled object", where=str(folder), action="give a folder with images/ and labels/")
    return material


def _pictures(folder: Path, step: int) -> Iterator[tuple[list[Grey], list[list[float]]]]:
    paths = sorted(path for path in (folder / "images").rglob("*") if path.suffix.lower() in IMAGES)
    for k, path in enumerate(paths):
        label = folder / "labels" / path.relative_to(folder / "images").with_suffix(".txt")
        if not label.is_file():
            continue
        earlier = [paths[max(k - n * step, 0)] for n in range(3)]
        earlier = [other if other.parent == path.parent else path for other in earlier]
        stack = [_grey(other) for other in earlier]
        if any(grey.shape != stack[0].shape for grey in stack):
            stack = [stack[0]] * 3
        yield stack, [[float(value) for value in line.split()[:5]] for line in label.read_text().splitlines() if line]


def _grey(path: Path) -> Grey:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise SourceError("the image does not open", where=str(path), action="remove it or repair it")
    return np.asarray(image, np.uint8)
